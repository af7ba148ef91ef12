//! A run as a report: figures per condition, tests between conditions, and what they mean in plain sentences.
//!
//! [`Case`] takes from each trial's trace what is needed, [`Report`] puts the cases together, and the page, the tables
//! and the files are made of it: [`Report::html`], [`Report::text`], [`Report::csv`], and JSON through serde.
//!
//! Interpolated and extrapolated contexts are kept apart, beside all together. One condition, the *reference*, is
//! compared with each of the others. A condition whose weight never changes after the checkpoint is a *constant*: the
//! one nearest to the reference's mean weight is its matched control, since a law that merely gives the robot more
//! would differ from a constant of half and half without being any better than a constant of its own mean.
//!
//! Pure but for [`read_cases`], which reads a run's folder; writing lies with the caller. The same cases give the same
//! bytes.

mod case;
mod comparison;
mod csv;
mod figures;
mod folder;
mod ground;
mod html;
mod quantities;
mod sentences;
mod summary;
mod svg;
mod text;
mod trial_page;

pub use case::{Case, Curves, Dot, Identity};
pub use comparison::{Answer, Comparison, StepTests};
pub use csv::Table;
pub use folder::read_cases;
pub use quantities::{Better, EFFORT, QUANTITIES, Quantity};
pub use summary::{Controls, Mean, Summary};

use serde::Serialize;

use crate::statistics::holm;

/// All groups together.
pub const ALL: &str = "all";
/// Groups in the order of tables; others follow.
const GROUPS: [&str; 3] = ["demonstrated", "interpolated", "extrapolated"];

/// What the report is about.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Setup {
    /// What the plan is called.
    pub title: String,
    /// The program that made the run.
    pub build: String,
    /// The conditions in the plan's order, each with what people call it.
    pub conditions: Vec<(String, String)>,
    /// The trials whose streams had bad lines on purpose, and these lines in words.
    pub bad_lines: Vec<(String, String)>,
    /// The condition to compare with the others; if it is none of them, `adaptive` or else the first.
    pub reference: String,
    /// Practice trials, which count in nothing.
    pub practice: usize,
    /// Trials that were aborted, which count in nothing.
    pub aborted: usize,
    /// Trials that could not be read, and why.
    pub unreadable: Vec<String>,
}

/// A run, evaluated.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// What it is about.
    pub setup: Setup,
    /// The groups of contexts that occur; [`ALL`] comes last if there are several.
    pub groups: Vec<String>,
    /// Who drove.
    pub participants: Vec<String>,
    /// Figures per condition and group.
    pub summaries: Vec<Summary>,
    /// The reference against each other condition, per quantity and group.
    pub comparisons: Vec<Comparison>,
    /// Conditions of constant weight beside the reference.
    pub controls: Option<Controls>,
    /// Every trial.
    pub trials: Vec<Case>,
}

impl Report {
    /// Evaluates the trials of a run. Conditions that the setup does not name are added at its end.
    #[must_use]
    pub fn new(mut setup: Setup, trials: Vec<Case>) -> Self {
        for case in &trials {
            let name = &case.identity.condition;
            if !setup.conditions.iter().any(|(known, _)| known == name) {
                setup.conditions.push((name.clone(), name.clone()));
            }
        }
        setup.reference = reference(&setup);
        let groups = groups(&trials);
        let mut participants: Vec<String> = trials.iter().map(|case| case.identity.participant.clone()).collect();
        participants.sort();
        participants.dedup();
        let mut report = Self {
            setup,
            groups,
            participants,
            summaries: Vec::new(),
            comparisons: Vec::new(),
            controls: None,
            trials,
        };
        report.summaries = report.summarise();
        report.comparisons = report.compare();
        report.controls = Controls::of(&report);
        report
    }

    /// What people call a condition.
    #[must_use]
    pub fn label<'a>(&'a self, condition: &'a str) -> &'a str {
        let named = self.setup.conditions.iter().find(|(name, _)| name == condition);
        named.map_or(condition, |(_, label)| label)
    }

    /// The trials of a condition in a group.
    #[must_use]
    pub fn cases(&self, condition: &str, group: &str) -> Vec<&Case> {
        let all = self.trials.iter();
        all.filter(|case| case.identity.condition == condition && (group == ALL || case.identity.group == group))
            .collect()
    }

    /// The figures of a condition in a group.
    #[must_use]
    pub fn summary(&self, condition: &str, group: &str) -> Option<&Summary> {
        let mut all = self.summaries.iter();
        all.find(|summary| summary.condition == condition && summary.group == group)
    }

    fn summarise(&self) -> Vec<Summary> {
        let pairs = self
            .groups
            .iter()
            .flat_map(|group| self.setup.conditions.iter().map(move |(name, _)| (group, name)));
        pairs
            .map(|(group, name)| Summary::of(name, group, &self.cases(name, group)))
            .collect()
    }

    fn compare(&self) -> Vec<Comparison> {
        let reference = &self.setup.reference;
        let others: Vec<&String> = self
            .setup
            .conditions
            .iter()
            .map(|(name, _)| name)
            .filter(|name| *name != reference)
            .collect();
        let mut comparisons = Vec::new();
        for quantity in QUANTITIES.iter().filter(|quantity| quantity.tested) {
            let mut family: Vec<Comparison> = Vec::new();
            for group in &self.groups {
                let first = self.cases(reference, group);
                for other in &others {
                    let second = self.cases(other, group);
                    family.push(Comparison::new(quantity, group, (reference, &first), (other, &second)));
                }
            }
            if family.iter().any(|one| one.first_trials + one.second_trials > 0) {
                correct(&mut family);
                comparisons.extend(family);
            }
        }
        comparisons
    }
}

/// Holm's correction over the permutation tests that were possible.
fn correct(family: &mut [Comparison]) {
    let found: Vec<usize> = (0..family.len())
        .filter(|place| family[*place].permutation.found().is_some())
        .collect();
    let p_values: Vec<f64> = found
        .iter()
        .filter_map(|place| Some(family[*place].permutation.found()?.p))
        .collect();
    for (place, corrected) in found.into_iter().zip(holm(&p_values)) {
        family[place].holm_p = Some(corrected);
    }
}

fn reference(setup: &Setup) -> String {
    let known = |wanted: &str| setup.conditions.iter().find(|(name, _)| name == wanted);
    let chosen = known(&setup.reference)
        .or_else(|| known("adaptive"))
        .or_else(|| setup.conditions.first());
    chosen.map(|(name, _)| name.clone()).unwrap_or_default()
}

fn groups(trials: &[Case]) -> Vec<String> {
    let mut found: Vec<String> = trials.iter().map(|case| case.identity.group.clone()).collect();
    let place = |group: &String| GROUPS.iter().position(|known| known == group).unwrap_or(GROUPS.len());
    found.sort_by(|a, b| (place(a), a).cmp(&(place(b), b)));
    found.dedup();
    if found.len() != 1 {
        found.push(ALL.to_owned());
    }
    found
}
