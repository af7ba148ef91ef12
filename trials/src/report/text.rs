//! The report for a terminal.

use super::comparison::Comparison;
use super::quantities::{EFFORT, QUANTITIES};
use super::sentences::{LEVEL, STEPS_ARE_NOT_INDEPENDENT, group_name};
use super::{ALL, Report};

/// What a terminal's table shows of each condition.
const COLUMNS: [&str; 5] = [
    EFFORT,
    "weight_mean_after",
    "tracking_wish_after_mean_m",
    "tracking_forecast_mean_m",
    "min_clearance_m",
];

/// Of so many conditions every comparison is told; of more, only what was found.
const FEW: usize = 3;

impl Report {
    /// The report as text for a terminal: figures per condition, then what the tests mean.
    #[must_use]
    pub fn text(&self) -> String {
        let mut parts = vec![self.overview()];
        let lines = self.setup.bad_lines.iter();
        let lines: Vec<String> = lines.map(|(trials, line)| format!("  {trials}: {line}")).collect();
        if !lines.is_empty() {
            parts.push(format!("Bad lines on purpose:\n{}", lines.join("\n")));
        }
        parts.extend(self.groups.iter().map(|group| self.conditions_text(group)));
        let paired = self.paired_lines();
        if !paired.is_empty() {
            parts.push(format!("Paired tests, one value per trial:\n{}", paired.join("\n")));
        }
        let many = self.setup.conditions.len() > FEW;
        let steps: Vec<String> = self
            .comparisons
            .iter()
            .filter(|one| !many || one.group == ALL)
            .filter_map(|one| Some(format!("  {}", self.steps_meaning(one, one.steps.as_ref()?))))
            .collect();
        if !steps.is_empty() {
            parts.push(format!(
                "The paper's tests, one sample per step:\n{}\n  {STEPS_ARE_NOT_INDEPENDENT}",
                steps.join("\n")
            ));
        }
        parts.push(self.controls_meaning());
        let unreadable = self.setup.unreadable.iter().map(|why| format!("not read: {why}"));
        parts.extend(unreadable);
        parts.join("\n\n")
    }

    /// A sentence for each comparison; of many conditions, under each of them those that found something.
    fn paired_lines(&self) -> Vec<String> {
        let told = |one: &Comparison| format!("  {}", self.meaning(one));
        if self.setup.conditions.len() <= FEW {
            return self.comparisons.iter().map(told).collect();
        }
        let mut lines = Vec::new();
        for (condition, label) in &self.setup.conditions {
            let against = self.comparisons.iter().filter(|one| one.second == *condition);
            let (found, rest): (Vec<_>, Vec<_>) = against.partition(|one| one.holm_p.is_some_and(|p| p < LEVEL));
            if found.is_empty() && rest.is_empty() {
                continue;
            }
            lines.push(format!("  {} against {label}:", self.label(&self.setup.reference)));
            lines.extend(found.into_iter().map(|one| format!("  {}", told(one))));
            if !rest.is_empty() {
                let count = rest.len();
                lines.push(format!(
                    "    In {count} comparisons chance explains as much, or nothing can be tested: see the page."
                ));
            }
        }
        lines
    }

    fn conditions_text(&self, group: &str) -> String {
        let known = QUANTITIES.iter().filter(|quantity| COLUMNS.contains(&quantity.key));
        let shown: Vec<_> = known
            .filter(|quantity| {
                self.summaries
                    .iter()
                    .any(|summary| summary.mean(quantity.key).is_some())
            })
            .collect();
        let mut head = vec![group_name(group), "trials".into(), "steps".into(), "success".into()];
        head.extend(shown.iter().map(|quantity| match quantity.unit {
            "" => quantity.label.to_owned(),
            unit => format!("{}, {unit}", quantity.label),
        }));
        let mut rows = vec![head];
        for (condition, label) in &self.setup.conditions {
            let Some(summary) = self.summary(condition, group) else {
                continue;
            };
            let mut row = vec![label.clone(), summary.trials.to_string(), summary.steps.to_string()];
            row.push(format!("{}/{}", summary.successes, summary.trials));
            row.extend(shown.iter().map(|quantity| match summary.mean(quantity.key) {
                Some(mean) => {
                    let margin = mean.margin.map(|margin| format!(" ± {}", quantity.shown(margin)));
                    format!("{}{}", quantity.shown(mean.mean), margin.unwrap_or_default())
                }
                None => "–".to_owned(),
            }));
            rows.push(row);
        }
        aligned(&rows)
    }
}

/// Columns side by side, the first to the left and the others to the right.
fn aligned(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| -> String {
        let cells = row.iter().enumerate().map(|(column, cell)| {
            let gap = " ".repeat(widths[column] - cell.chars().count());
            if column == 0 {
                format!("{cell}{gap}")
            } else {
                format!("{gap}{cell}")
            }
        });
        format!("  {}", cells.collect::<Vec<_>>().join("   "))
            .trim_end()
            .to_owned()
    };
    rows.iter().map(line).collect::<Vec<_>>().join("\n")
}
