//! Demonstrations: what they hold, and how they are read from CSV.
//!
//! ```text
//! time_s,context_x_m,context_y_m,x_m,y_m
//! 0.0,0.2993,0.1024,0.0000,0.0000
//! 0.1,0.2993,0.1024,0.0004,0.0001
//! ```
//! One row per step. Columns whose name begins with `context_` are the condition and hold the same value in every
//! row; `step` and `time_s` are recognised and checked; every other column is an output.

use sha2::{Digest, Sha256};

use crate::csv::Table;

/// Demonstration files above this size are refused.
pub const MAX_TEXT_BYTES: usize = 64 << 20;
/// What marks a column as part of the condition.
const CONTEXT_PREFIX: &str = "context_";

/// One movement with its condition.
#[derive(Clone, Debug, PartialEq)]
pub struct Demonstration {
    name: String,
    context_columns: Vec<String>,
    context: Vec<f64>,
    output_columns: Vec<String>,
    /// `T × Ny`, row by row.
    outputs: Vec<f64>,
    period_s: Option<f64>,
    sha256: [u8; 32],
}

/// Why a demonstration cannot be used. Lines count from 1, the header being line 1.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DemonstrationError {
    /// The file is empty.
    #[error("{file}: the file is empty; the first line must name the columns")]
    Empty {
        /// The file.
        file: String,
    },
    /// The file is larger than any demonstration.
    #[error("{file}: {bytes} bytes; a demonstration has at most {MAX_TEXT_BYTES}")]
    TooLarge {
        /// The file.
        file: String,
        /// Its size.
        bytes: usize,
    },
    /// A column has no name.
    #[error("{file}, line 1: column {position} has no name; name every column")]
    UnnamedColumn {
        /// The file.
        file: String,
        /// Counted from 1.
        position: usize,
    },
    /// Two columns have one name.
    #[error("{file}, line 1: column `{column}` appears twice; rename or remove one")]
    DuplicateColumn {
        /// The file.
        file: String,
        /// The name.
        column: String,
    },
    /// No column is a condition.
    #[error("{file}, line 1: no column begins with `context_`; add one for each number of the condition")]
    NoContext {
        /// The file.
        file: String,
    },
    /// No column is an output.
    #[error("{file}, line 1: no output column; beside `step`, `time_s` and `context_…` there must be one to predict")]
    NoOutput {
        /// The file.
        file: String,
    },
    /// Fewer than two steps.
    #[error("{file}: {rows} row(s) of numbers; a movement has at least two, one for each step")]
    TooShort {
        /// The file.
        file: String,
        /// Rows found, the header not counted.
        rows: usize,
    },
    /// A row has too few or too many fields.
    #[error("{file}, line {line}: {found} fields where the header names {expected} columns; complete the row")]
    FieldCount {
        /// The file.
        file: String,
        /// The line.
        line: usize,
        /// Fields in the row.
        found: usize,
        /// Columns in the header.
        expected: usize,
    },
    /// Text where a number belongs.
    #[error("{file}, line {line}, column `{column}`: `{text}` is not a number; write it with a decimal point")]
    NotANumber {
        /// The file.
        file: String,
        /// The line.
        line: usize,
        /// The column.
        column: String,
        /// What stands there.
        text: String,
    },
    /// NaN or infinity.
    #[error("{file}, line {line}, column `{column}`: {value} is not finite; remove or repair the row")]
    NotFinite {
        /// The file.
        file: String,
        /// The line.
        line: usize,
        /// The column.
        column: String,
        /// The value.
        value: f64,
    },
    /// The condition changes within the movement.
    #[error("{file}, line {line}, column `{column}`: {found} differs from {first} above; a condition holds throughout")]
    ContextVaries {
        /// The file.
        file: String,
        /// The line.
        line: usize,
        /// The column.
        column: String,
        /// The first row's value.
        first: f64,
        /// This row's value.
        found: f64,
    },
    /// `step` does not count 0, 1, 2, …
    #[error("{file}, line {line}, column `step`: {found} where {expected} follows; steps count up from 0, one a row")]
    StepSkips {
        /// The file.
        file: String,
        /// The line.
        line: usize,
        /// What should stand there.
        expected: usize,
        /// What stands there.
        found: f64,
    },
    /// `time_s` does not advance evenly.
    #[error("{file}, line {line}, column `time_s`: {found_s} s after the row above, not {period_s} s; resample evenly")]
    TimeUneven {
        /// The file.
        file: String,
        /// The line.
        line: usize,
        /// This step's duration.
        found_s: f64,
        /// The mean duration.
        period_s: f64,
    },
    /// Built in code from parts that do not fit.
    #[error("{name}: {found} numbers are not whole rows of {columns} columns, or a name has no number")]
    Parts {
        /// The demonstration.
        name: String,
        /// Numbers given.
        found: usize,
        /// Columns named.
        columns: usize,
    },
}

impl Demonstration {
    /// Reads `text`, whose origin `file` is used in error messages and as the demonstration's name.
    ///
    /// # Errors
    /// The first thing that is wrong, with line and column.
    pub fn from_csv(file: &str, text: &str) -> Result<Self, DemonstrationError> {
        let table = Table::parse(file, text)?;
        let is_context = |name: &str| name.starts_with(CONTEXT_PREFIX);
        let is_clock = |name: &str| name == "step" || name == "time_s";
        let context = table.columns(is_context);
        let outputs = table.columns(|name| !is_context(name) && !is_clock(name));
        let file_name = || file.to_owned();
        if context.is_empty() {
            return Err(DemonstrationError::NoContext { file: file_name() });
        }
        if outputs.is_empty() {
            return Err(DemonstrationError::NoOutput { file: file_name() });
        }
        if table.rows() < 2 {
            return Err(DemonstrationError::TooShort {
                file: file_name(),
                rows: table.rows(),
            });
        }
        table.check_steps()?;
        for column in &context {
            table.check_constant(*column)?;
        }
        let row = |row: usize| outputs.iter().map(move |column| (row, *column));
        Ok(Self {
            name: file_name(),
            context_columns: context.iter().map(|c| table.header[*c].clone()).collect(),
            context: context.iter().map(|c| table.at(0, *c)).collect(),
            output_columns: outputs.iter().map(|c| table.header[*c].clone()).collect(),
            outputs: (0..table.rows()).flat_map(row).map(|(r, c)| table.at(r, c)).collect(),
            period_s: table.period_s()?,
            sha256: Sha256::digest(text.as_bytes()).into(),
        })
    }

    /// Builds one from named numbers: the condition, the output columns, and their values row by row.
    ///
    /// # Errors
    /// When the values are not whole rows, there are fewer than two, or a number is not finite.
    pub fn new(
        name: &str,
        context: &[(&str, f64)],
        output_columns: &[&str],
        outputs: Vec<f64>,
        period_s: Option<f64>,
    ) -> Result<Self, DemonstrationError> {
        let (columns, found) = (output_columns.len(), outputs.len());
        if columns == 0 || context.is_empty() || !found.is_multiple_of(columns) {
            return Err(DemonstrationError::Parts {
                name: name.to_owned(),
                found,
                columns,
            });
        }
        if found / columns < 2 {
            return Err(DemonstrationError::TooShort {
                file: name.to_owned(),
                rows: found / columns,
            });
        }
        let wrong = |line: usize, column: &str, value: f64| DemonstrationError::NotFinite {
            file: name.to_owned(),
            line,
            column: column.to_owned(),
            value,
        };
        if let Some((column, value)) = context.iter().find(|(_, value)| !value.is_finite()) {
            return Err(wrong(2, column, *value));
        }
        if let Some(bad) = outputs.iter().position(|value| !value.is_finite()) {
            return Err(wrong(bad / columns + 2, output_columns[bad % columns], outputs[bad]));
        }
        let mut demonstration = Self {
            name: name.to_owned(),
            context_columns: context.iter().map(|(name, _)| (*name).to_owned()).collect(),
            context: context.iter().map(|(_, value)| *value).collect(),
            output_columns: output_columns.iter().map(|name| (*name).to_owned()).collect(),
            outputs,
            period_s: period_s.filter(|period| period.is_finite() && *period > 0.0),
            sha256: [0; 32],
        };
        demonstration.sha256 = Sha256::digest(demonstration.to_csv().as_bytes()).into();
        Ok(demonstration)
    }

    /// The same movement under another condition: where it is at `step`, its outputs there being the context. `None` if
    /// it ends before. So one set of demonstrations serves checkpoints at several steps.
    #[must_use]
    pub fn conditioned_at(&self, step: usize) -> Option<Self> {
        let context = self.rows().nth(step)?.to_vec();
        let name = |column: &String| format!("{CONTEXT_PREFIX}{column}");
        Some(Self {
            context_columns: self.output_columns.iter().map(name).collect(),
            context,
            ..self.clone()
        })
    }

    /// The same demonstration as CSV; reading it back gives the same numbers, bit for bit.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut columns: Vec<&str> = self.period_s.map(|_| "time_s").into_iter().collect();
        columns.extend(
            self.context_columns
                .iter()
                .chain(&self.output_columns)
                .map(String::as_str),
        );
        let mut text = columns.join(",") + "\n";
        for (step, row) in self.rows().enumerate() {
            let time = self.period_s.map(|period| rounded_time(step, period));
            let numbers = time.iter().chain(&self.context).chain(row);
            text += &numbers.map(f64::to_string).collect::<Vec<_>>().join(",");
            text.push('\n');
        }
        text
    }

    /// Where it came from.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Names of the condition's numbers, with their prefix.
    #[must_use]
    pub fn context_columns(&self) -> &[String] {
        &self.context_columns
    }

    /// The condition.
    #[must_use]
    pub fn context(&self) -> &[f64] {
        &self.context
    }

    /// Names of the outputs.
    #[must_use]
    pub fn output_columns(&self) -> &[String] {
        &self.output_columns
    }

    /// The outputs, step by step.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[f64]> + Clone {
        self.outputs.chunks_exact(self.output_columns.len())
    }

    /// `T`, the number of steps.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.outputs.len() / self.output_columns.len()
    }

    /// Seconds between steps, when the demonstration has a clock.
    #[must_use]
    pub fn period_s(&self) -> Option<f64> {
        self.period_s
    }

    /// SHA-256 of the text it was read from, or of its CSV when it was built in code.
    #[must_use]
    pub fn sha256(&self) -> [u8; 32] {
        self.sha256
    }
}

/// Multiples of a period such as 0.1 without the digits that binary adds: to the nanosecond.
fn rounded_time(step: usize, period_s: f64) -> f64 {
    (step as f64 * period_s * 1e9).round() / 1e9
}
