//! The report as tables for other programs: SI units, a head line, `.` as the decimal point, empty for what is not.

use super::Report;
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
        let mut rows = vec![words(&[
            "quantity",
            "group",
            "first",
            "second",
            "first_trials",
            "second_trials",
            "pairs",
            "first_mean",
            "second_mean",
            "difference",
            "difference_low",
            "difference_high",
            "d_z",
            "d_z_low",
            "d_z_high",
            "rank_biserial",
            "rank_biserial_low",
            "rank_biserial_high",
            "paired_t",
            "paired_t_p",
            "wilcoxon_w",
            "wilcoxon_p",
            "permutation_p",
            "permutation_p_holm",
            "first_steps",
            "second_steps",
            "steps_t",
            "steps_t_p",
            "steps_welch_t",
            "steps_welch_p",
            "steps_u",
            "steps_u_p",
            "steps_cohen_d",
            "steps_autocorrelation",
        ])];
        for one in &self.comparisons {
            let mut row = words(&[one.quantity, &one.group, &one.first, &one.second]);
            row.extend([one.first_trials, one.second_trials, one.pairs].map(|count| count.to_string()));
            row.extend([one.first_mean, one.second_mean].map(number));
            for interval in [&one.difference, &one.d_z, &one.rank_biserial] {
                let found = interval.found();
                row.extend([found.map(|i| i.value), found.map(|i| i.low), found.map(|i| i.high)].map(number));
            }
            row.extend(
                [
                    one.paired_t.found().map(|test| test.t),
                    one.paired_t.found().map(|test| test.p),
                ]
                .map(number),
            );
            row.extend(
                [
                    one.wilcoxon.found().map(|test| test.w),
                    one.wilcoxon.found().map(|test| test.p),
                ]
                .map(number),
            );
            row.extend([one.permutation.found().map(|test| test.p), one.holm_p].map(number));
            let steps = one.steps.as_ref();
            row.extend(
                [steps.map(|s| s.first_steps), steps.map(|s| s.second_steps)]
                    .map(|n| n.map_or_else(String::new, |n| n.to_string())),
            );
            let student = steps.and_then(|steps| steps.student.found());
            let welch = steps.and_then(|steps| steps.welch.found());
            let u = steps.and_then(|steps| steps.mann_whitney.found());
            row.extend([student.map(|test| test.t), student.map(|test| test.p)].map(number));
            row.extend([welch.map(|test| test.t), welch.map(|test| test.p)].map(number));
            row.extend([u.map(|test| test.u), u.map(|test| test.p)].map(number));
            row.push(number(steps.and_then(|steps| steps.cohen_d.found()).copied()));
            row.push(number(steps.and_then(|steps| steps.autocorrelation)));
            rows.push(row);
        }
        rows
    }
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
