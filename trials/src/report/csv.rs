//! The report as tables for other programs: SI units, a head line, `.` as the decimal point, empty for what is not.

use super::Report;
use super::comparison::{Answer, Comparison, StepTests};
use super::quantities::QUANTITIES;

/// A table with its file's name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Table {
    /// As in `trials.csv`.
    pub name: &'static str,
    /// The file.
    pub text: String,
}

impl Report {
    /// The tables: every trial, every shared step, every condition, every comparison.
    #[must_use]
    pub fn csv(&self) -> Vec<Table> {
        let table = |name, rows: Vec<Vec<String>>| Table {
            name,
            text: rows.iter().map(|row| line(row)).collect(),
        };
        vec![
            table("trials.csv", self.trial_rows()),
            table("steps.csv", self.step_rows()),
            table("conditions.csv", self.condition_rows()),
            table("comparisons.csv", self.comparison_rows()),
        ]
    }

    fn trial_rows(&self) -> Vec<Vec<String>> {
        let mut head = words(&[
            "number",
            "participant",
            "condition",
            "context",
            "group",
            "repetition",
            "seed",
        ]);
        head.extend(words(&["success", "reached_goal", "goal_distance_m", "ticks"]));
        head.extend(QUANTITIES.iter().map(|quantity| quantity.key.to_owned()));
        head.extend(words(&[
            "weight_mean",
            "weight_mean_before",
            "tracking_forecast_max_m",
            "tracking_wish_mean_m",
        ]));
        head.extend(words(&[
            "latency_p99_ms",
            "shared_steps",
            "session",
            "began_s",
            "stops_in_words",
            "reason",
            "note",
        ]));
        let mut rows = vec![head];
        for case in &self.trials {
            let (who, figures) = (&case.identity, &case.measures);
            let mut row = vec![who.number.to_string(), who.participant.clone(), who.condition.clone()];
            row.extend([
                who.context.clone(),
                who.group.clone(),
                who.repetition.to_string(),
                who.seed.to_string(),
            ]);
            row.extend([who.success.to_string(), figures.reached_goal.to_string()]);
            row.extend([number(figures.goal_distance_m), figures.ticks.to_string()]);
            row.extend(QUANTITIES.iter().map(|quantity| number((quantity.of)(figures))));
            row.extend([figures.weight_mean, figures.weight_mean_before].map(number));
            row.extend([figures.tracking_forecast_max_m, figures.tracking_wish_mean_m].map(number));
            row.extend([
                number(figures.latency_p99_ms),
                figures.human_effort_steps_m_s.len().to_string(),
            ]);
            row.extend([who.session.clone(), who.began_s.to_string()]);
            let stops = figures
                .stops
                .iter()
                .map(|stop| format!("tick {} by {}: {}", stop.tick, stop.by, stop.reason));
            row.push(stops.collect::<Vec<_>>().join("; "));
            row.extend([who.reason.clone().unwrap_or_default(), who.note.clone()]);
            rows.push(row);
        }
        rows
    }

    fn step_rows(&self) -> Vec<Vec<String>> {
        let mut rows = vec![words(&[
            "number",
            "participant",
            "condition",
            "context",
            "group",
            "shared_step",
            "effort_m_s",
        ])];
        for case in &self.trials {
            let who = &case.identity;
            for (step, effort) in case.measures.human_effort_steps_m_s.iter().enumerate() {
                let mut row = vec![who.number.to_string(), who.participant.clone(), who.condition.clone()];
                row.extend([
                    who.context.clone(),
                    who.group.clone(),
                    (step + 1).to_string(),
                    effort.to_string(),
                ]);
                rows.push(row);
            }
        }
        rows
    }

    fn condition_rows(&self) -> Vec<Vec<String>> {
        let mut rows = vec![words(&[
            "group",
            "condition",
            "quantity",
            "trials",
            "mean",
            "margin_95",
            "least",
            "most",
            "successes",
            "steps",
        ])];
        for summary in &self.summaries {
            for mean in &summary.means {
                let mut row = vec![
                    summary.group.clone(),
                    summary.condition.clone(),
                    mean.quantity.to_owned(),
                ];
                row.extend([mean.trials.to_string(), mean.mean.to_string(), number(mean.margin)]);
                row.extend([mean.least.to_string(), mean.most.to_string()]);
                row.extend([summary.successes.to_string(), summary.steps.to_string()]);
                rows.push(row);
            }
        }
        rows
    }

    fn comparison_rows(&self) -> Vec<Vec<String>> {
        let mut rows = vec![COMPARISON.iter().map(|(name, _)| (*name).to_owned()).collect()];
        for one in &self.comparisons {
            rows.push(COMPARISON.iter().map(|(_, cell)| cell(one)).collect());
        }
        rows
    }
}

/// A column: what it is called, and what stands in it.
type Column<T> = (&'static str, fn(&T) -> String);

/// The columns of a comparison.
const COMPARISON: [Column<Comparison>; 34] = [
    ("quantity", |one| one.quantity.to_owned()),
    ("group", |one| one.group.clone()),
    ("first", |one| one.first.clone()),
    ("second", |one| one.second.clone()),
    ("first_trials", |one| one.first_trials.to_string()),
    ("second_trials", |one| one.second_trials.to_string()),
    ("pairs", |one| one.pairs.to_string()),
    ("first_mean", |one| number(one.first_mean)),
    ("second_mean", |one| number(one.second_mean)),
    ("difference", |one| found(&one.difference, |i| i.value)),
    ("difference_low", |one| found(&one.difference, |i| i.low)),
    ("difference_high", |one| found(&one.difference, |i| i.high)),
    ("d_z", |one| found(&one.d_z, |i| i.value)),
    ("d_z_low", |one| found(&one.d_z, |i| i.low)),
    ("d_z_high", |one| found(&one.d_z, |i| i.high)),
    ("rank_biserial", |one| found(&one.rank_biserial, |i| i.value)),
    ("rank_biserial_low", |one| found(&one.rank_biserial, |i| i.low)),
    ("rank_biserial_high", |one| found(&one.rank_biserial, |i| i.high)),
    ("paired_t", |one| found(&one.paired_t, |test| test.t)),
    ("paired_t_p", |one| found(&one.paired_t, |test| test.p)),
    ("wilcoxon_w", |one| found(&one.wilcoxon, |test| test.w)),
    ("wilcoxon_p", |one| found(&one.wilcoxon, |test| test.p)),
    ("permutation_p", |one| found(&one.permutation, |test| test.p)),
    ("permutation_p_holm", |one| number(one.holm_p)),
    ("first_steps", |one| {
        of_steps(one, |steps| steps.first_steps.to_string())
    }),
    ("second_steps", |one| {
        of_steps(one, |steps| steps.second_steps.to_string())
    }),
    ("steps_t", |one| {
        of_steps(one, |steps| found(&steps.student, |test| test.t))
    }),
    ("steps_t_p", |one| {
        of_steps(one, |steps| found(&steps.student, |test| test.p))
    }),
    ("steps_welch_t", |one| {
        of_steps(one, |steps| found(&steps.welch, |test| test.t))
    }),
    ("steps_welch_p", |one| {
        of_steps(one, |steps| found(&steps.welch, |test| test.p))
    }),
    ("steps_u", |one| {
        of_steps(one, |steps| found(&steps.mann_whitney, |test| test.u))
    }),
    ("steps_u_p", |one| {
        of_steps(one, |steps| found(&steps.mann_whitney, |test| test.p))
    }),
    ("steps_cohen_d", |one| {
        of_steps(one, |steps| found(&steps.cohen_d, |d| *d))
    }),
    ("steps_autocorrelation", |one| {
        of_steps(one, |steps| number(steps.autocorrelation))
    }),
];

/// A figure of a test's result, if there is one.
fn found<T>(answer: &Answer<T>, figure: fn(&T) -> f64) -> String {
    number(answer.found().map(figure))
}

/// A cell about steps, where they were compared.
fn of_steps(one: &Comparison, cell: fn(&StepTests) -> String) -> String {
    one.steps.as_ref().map_or_else(String::new, cell)
}

fn words(words: &[&str]) -> Vec<String> {
    words.iter().map(|word| (*word).to_owned()).collect()
}

/// The shortest text that reads back as this number.
fn number(value: Option<f64>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

/// A line after RFC 4180. A text that a spreadsheet would take for a formula gets an apostrophe before it.
fn line(cells: &[String]) -> String {
    let cell = |text: &String| {
        let formula = text.starts_with(['=', '+', '@', '-', '\t', '\r']) && text.parse::<f64>().is_err();
        let text = if formula { format!("'{text}") } else { text.clone() };
        if text.contains([',', '"', '\n', '\r']) {
            format!("\"{}\"", text.replace('"', "\"\""))
        } else {
            text
        }
    };
    let mut line = cells.iter().map(cell).collect::<Vec<_>>().join(",");
    line.push('\n');
    line
}
