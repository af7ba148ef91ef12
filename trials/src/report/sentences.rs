//! What the numbers mean, in plain words.

use super::comparison::{Comparison, StepTests};
use super::quantities::{Better, QUANTITIES, Quantity, rounded};
use super::{ALL, Report};

/// Below this, a difference is called one.
pub(super) const LEVEL: f64 = 0.05;

pub(super) fn quantity(key: &str) -> Option<&'static Quantity> {
    QUANTITIES.iter().find(|quantity| quantity.key == key)
}

/// A p-value as people write it.
pub(super) fn p_value(p: f64) -> String {
    if p < 0.0001 {
        "p < 0.0001".to_owned()
    } else if p < 0.01 {
        format!("p = {p:.4}")
    } else {
        format!("p = {p:.3}")
    }
}

/// A p-value in a table's column.
pub(super) fn p_cell(p: f64) -> String {
    p_value(p).trim_start_matches("p ").trim_start_matches("= ").to_owned()
}

pub(super) fn group_name(group: &str) -> String {
    match group {
        ALL => "all contexts".to_owned(),
        "" => "contexts without a group".to_owned(),
        other => format!("{other} contexts"),
    }
}

fn plural(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

impl Report {
    /// The run in one sentence.
    pub(super) fn overview(&self) -> String {
        let setup = &self.setup;
        let mut text = format!(
            "{} of {} under {}",
            plural(self.trials.len(), "trial"),
            plural(self.participants.len(), "participant"),
            plural(setup.conditions.len(), "condition"),
        );
        let successes = self.trials.iter().filter(|case| case.identity.success).count();
        text += &format!(", {successes} successful.");
        if setup.practice + setup.aborted > 0 {
            let (practice, aborted) = (
                plural(setup.practice, "practice trial"),
                plural(setup.aborted, "aborted one"),
            );
            text += &format!(" Left out: {practice} and {aborted}.");
        }
        if !setup.unreadable.is_empty() {
            text += &format!(" {} could not be read.", plural(setup.unreadable.len(), "trial"));
        }
        text
    }

    /// What a comparison says, in one or two sentences.
    pub(super) fn meaning(&self, comparison: &Comparison) -> String {
        let Some(quantity) = quantity(comparison.quantity) else {
            return String::new();
        };
        let (first, second) = (self.label(&comparison.first), self.label(&comparison.second));
        let place = group_name(&comparison.group);
        let Some(difference) = comparison.difference.found() else {
            let pairs = plural(comparison.pairs, "pair");
            let why = comparison.difference.text(|_| String::new());
            let same = comparison.first_mean.is_some() && comparison.first_mean == comparison.second_mean;
            return match comparison.paired_t.found() {
                None if same && comparison.pairs > 1 => {
                    format!(
                        "{}, {place}: {first} and {second} are the same in all {pairs}.",
                        quantity.label
                    )
                }
                _ => format!(
                    "{}, {place}: {first} against {second} cannot be judged from {pairs}: {why}.",
                    quantity.label
                ),
            };
        };
        let size = quantity.with_unit(difference.value.abs());
        let way = if difference.value < 0.0 { "less" } else { "more" };
        let share = comparison
            .second_mean
            .filter(|mean| *mean > 0.0)
            .map_or_else(String::new, |mean| {
                format!(" ({} %)", rounded(100.0 * difference.value / mean, 0))
            });
        let verdict = match comparison.holm_p {
            Some(p) if p < LEVEL => format!("more than chance explains ({} after Holm)", p_value(p)),
            Some(p) => format!("chance explains as much ({} after Holm)", p_value(p)),
            None => "not tested".to_owned(),
        };
        let judged = match (
            quantity.better,
            difference.value < 0.0,
            comparison.holm_p.is_some_and(|p| p < LEVEL),
        ) {
            (_, _, false) | (Better::Neither, ..) => "",
            (Better::Less, true, true) | (Better::More, false, true) => " Better.",
            _ => " Worse.",
        };
        format!(
            "{}, {place}: {first} has {size} {way} than {second}{share}, 95 % interval {} to {}, {}; {verdict}.{judged}{}",
            quantity.label,
            quantity.shown(difference.low),
            quantity.with_unit(difference.high),
            plural(comparison.pairs, "pair"),
            floor(comparison.pairs),
        )
    }

    /// What the paper's tests say, and what they do not.
    pub(super) fn steps_meaning(&self, comparison: &Comparison, steps: &StepTests) -> String {
        let (first, second) = (self.label(&comparison.first), self.label(&comparison.second));
        let tests = format!(
            "{}: {first} N = {}, {second} N = {} steps from {} and {} trials; t {}, Welch {}, U {}, Cohen's d {}.",
            group_name(&comparison.group),
            steps.first_steps,
            steps.second_steps,
            comparison.first_trials,
            comparison.second_trials,
            steps
                .student
                .text(|test| format!("= {}, {}", rounded(test.t, 2), p_value(test.p))),
            steps
                .welch
                .text(|test| format!("= {}, {}", rounded(test.t, 2), p_value(test.p))),
            steps
                .mann_whitney
                .text(|test| format!("= {:.0}, z = {}, {}", test.u, rounded(test.z, 2), p_value(test.p))),
            steps.cohen_d.text(|d| format!("= {}", rounded(*d, 2))),
        );
        match (steps.autocorrelation, steps.worth_steps) {
            (Some(r), Some(worth)) => format!(
                "{tests} A step's effort correlates with the next one's by {r:.2}, so {first}'s {} steps are worth \
                 about {worth:.0} independent ones.",
                steps.first_steps
            ),
            _ => tests,
        }
    }

    /// What constants of matched weight say.
    pub(super) fn controls_meaning(&self) -> String {
        let Some(controls) = &self.controls else {
            return "There is no condition of constant weight beside one of changing weight, so whether the law itself \
                    helps, or merely the robot's larger share, cannot be told from this run."
                .to_owned();
        };
        let reference = self.label(&self.setup.reference);
        let matched = controls.constants.iter().find(|(name, ..)| *name == controls.matched);
        let (weight, effort) = matched.map_or((f64::NAN, f64::NAN), |(_, weight, effort)| (*weight, *effort));
        let mut text = format!(
            "{reference} gives the human a weight of {:.2} in the mean and costs {:.1} mm/s. Its matched control, the \
             constant nearest in weight, is {} with {weight:.2}: {:.1} mm/s.",
            controls.weight,
            controls.effort_m_s * 1e3,
            self.label(&controls.matched),
            effort * 1e3,
        );
        text += &match controls.effort_of_same_weight_m_s {
            Some(same) => format!(
                " A constant of {reference}'s own mean weight would cost {:.1} mm/s, drawn straight between the \
                 constants around it: the law itself {} {:.1} mm/s.",
                same * 1e3,
                if controls.effort_m_s < same { "saves" } else { "costs" },
                (controls.effort_m_s - same).abs() * 1e3,
            ),
            None if (weight - controls.weight).abs() > 0.1 => " That is too far to be a fair control: a difference \
                 may come from the robot's larger or smaller share alone."
                .to_owned(),
            None => String::new(),
        };
        text
    }
}

/// With so few pairs the permutation test cannot reach the level, whatever the difference.
fn floor(pairs: usize) -> String {
    let least = (0..pairs).fold(2.0, |p, _| p / 2.0);
    if least > LEVEL {
        format!(" So few pairs cannot show more: p is at least {least:.3}.")
    } else {
        String::new()
    }
}

/// What every report says about the paper's tests.
pub(super) const STEPS_ARE_NOT_INDEPENDENT: &str = "The paper takes every step of every trial as a sample of its own. \
    Steps of one movement follow each other and are not independent, so these p-values are far too small; they are here \
    to be compared with the paper's. Judge by the paired tests on trials.";

/// How the paired tests are to be read.
pub(super) const HOW_TO_READ: &str = "One value per trial; trials of the same participant, context and repetition form \
    a pair. Differences are reference − other, with 95 % bootstrap intervals (BCa). A p-value is the probability of a \
    difference at least this large if the conditions did not differ; Holm's correction raises it for the number of \
    comparisons made of one quantity.";
