//! The CSV behind a demonstration: one header, one row of finite numbers a step, complaints with line and column.

use crate::demonstration::{DemonstrationError, MAX_TEXT_BYTES};

/// Time steps may differ from their mean by this share of it.
const PERIOD_TOLERANCE: f64 = 1e-3;

/// A parsed file: names and finite numbers.
pub(crate) struct Table<'a> {
    file: &'a str,
    pub(crate) header: Vec<String>,
    numbers: Vec<f64>,
    /// Line of each row, since blank lines are skipped.
    lines: Vec<usize>,
}

impl<'a> Table<'a> {
    pub(crate) fn parse(file: &'a str, text: &str) -> Result<Self, DemonstrationError> {
        if text.len() > MAX_TEXT_BYTES {
            return Err(DemonstrationError::TooLarge {
                file: file.to_owned(),
                bytes: text.len(),
            });
        }
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let (_, first) = lines
            .next()
            .ok_or_else(|| DemonstrationError::Empty { file: file.to_owned() })?;
        let header = parse_header(file, first)?;
        let mut table = Self {
            file,
            header,
            numbers: Vec::new(),
            lines: Vec::new(),
        };
        for (index, line) in lines {
            table.add_row(index + 1, line)?;
        }
        Ok(table)
    }

    fn add_row(&mut self, line: usize, text: &str) -> Result<(), DemonstrationError> {
        let (file, expected) = (self.file.to_owned(), self.header.len());
        let found = text.split(',').count();
        if found != expected {
            return Err(DemonstrationError::FieldCount {
                file,
                line,
                found,
                expected,
            });
        }
        for (name, text) in self.header.iter().zip(text.split(',').map(str::trim)) {
            let column = name.clone();
            match text.parse::<f64>() {
                Ok(value) if value.is_finite() => self.numbers.push(value),
                Ok(value) => {
                    return Err(DemonstrationError::NotFinite {
                        file,
                        line,
                        column,
                        value,
                    });
                }
                Err(_not_a_number) => {
                    let text = text.chars().take(40).collect();
                    return Err(DemonstrationError::NotANumber {
                        file,
                        line,
                        column,
                        text,
                    });
                }
            }
        }
        self.lines.push(line);
        Ok(())
    }

    pub(crate) fn rows(&self) -> usize {
        self.lines.len()
    }

    pub(crate) fn at(&self, row: usize, column: usize) -> f64 {
        self.numbers[row * self.header.len() + column]
    }

    pub(crate) fn columns(&self, wanted: impl Fn(&str) -> bool) -> Vec<usize> {
        (0..self.header.len())
            .filter(|column| wanted(&self.header[*column]))
            .collect()
    }

    fn column(&self, name: &str) -> Option<usize> {
        self.header.iter().position(|column| column == name)
    }

    pub(crate) fn check_steps(&self) -> Result<(), DemonstrationError> {
        let Some(column) = self.column("step") else {
            return Ok(());
        };
        for expected in 0..self.rows() {
            let found = self.at(expected, column);
            if (found - expected as f64).abs() > 0.0 {
                let (file, line) = (self.file.to_owned(), self.lines[expected]);
                return Err(DemonstrationError::StepSkips {
                    file,
                    line,
                    expected,
                    found,
                });
            }
        }
        Ok(())
    }

    pub(crate) fn check_constant(&self, column: usize) -> Result<(), DemonstrationError> {
        let first = self.at(0, column);
        for row in 1..self.rows() {
            let found = self.at(row, column);
            if found.to_bits() != first.to_bits() && (found - first).abs() > 0.0 {
                let (file, line, column) = (self.file.to_owned(), self.lines[row], self.header[column].clone());
                return Err(DemonstrationError::ContextVaries {
                    file,
                    line,
                    column,
                    first,
                    found,
                });
            }
        }
        Ok(())
    }

    /// The mean time step, when there is a clock and it is even.
    pub(crate) fn period_s(&self) -> Result<Option<f64>, DemonstrationError> {
        let Some(column) = self.column("time_s") else {
            return Ok(None);
        };
        let last = self.rows() - 1;
        let period_s = (self.at(last, column) - self.at(0, column)) / last as f64;
        for row in 1..=last {
            let found_s = self.at(row, column) - self.at(row - 1, column);
            let even = (found_s - period_s).abs() <= PERIOD_TOLERANCE * period_s;
            if !even || period_s <= 0.0 {
                let (file, line) = (self.file.to_owned(), self.lines[row]);
                return Err(DemonstrationError::TimeUneven {
                    file,
                    line,
                    found_s,
                    period_s,
                });
            }
        }
        // Ten digits are all that a clock written in decimal can mean; they drop what binary subtraction added.
        Ok(Some((period_s * 1e9).round() / 1e9)
            .filter(|rounded| *rounded > 0.0)
            .or(Some(period_s)))
    }
}

fn parse_header(file: &str, line: &str) -> Result<Vec<String>, DemonstrationError> {
    let file = file.to_owned();
    let header: Vec<String> = line.split(',').map(|name| name.trim().to_owned()).collect();
    if let Some(position) = header.iter().position(String::is_empty) {
        return Err(DemonstrationError::UnnamedColumn {
            file,
            position: position + 1,
        });
    }
    let repeated = |i: &usize| header[..*i].contains(&header[*i]);
    match (1..header.len()).find(repeated) {
        Some(i) => Err(DemonstrationError::DuplicateColumn {
            file,
            column: header[i].clone(),
        }),
        None => Ok(header),
    }
}
