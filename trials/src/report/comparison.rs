//! Two conditions against each other: the paper's tests on steps, and paired tests on trials.

use std::collections::BTreeMap;

use serde::Serialize;

use super::case::Case;
use super::quantities::{EFFORT, Quantity};
use crate::statistics::{
    Effect, Interval, PairedT, Permutation, RankSum, Signed, TwoSampleT, Unfit, cohen_d, interval, mann_whitney, mean,
    paired_t, permutation, student_t, welch_t, wilcoxon,
};

/// Every random draw of a report begins here: the same run gives the same report.
const SEED: u64 = 0x7A2D;

/// A result, or why there is none: never a number that is none.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Answer<T> {
    /// What was found.
    Found(T),
    /// Why nothing could be.
    Unanswered {
        /// In words.
        why: String,
    },
}

impl<T> Answer<T> {
    /// What was found, if anything.
    pub const fn found(&self) -> Option<&T> {
        match self {
            Self::Found(found) => Some(found),
            Self::Unanswered { .. } => None,
        }
    }

    /// As text: what `show` makes of it, or why there is nothing.
    pub fn text(&self, show: impl FnOnce(&T) -> String) -> String {
        match self {
            Self::Found(found) => show(found),
            Self::Unanswered { why } => why.clone(),
        }
    }
}

impl<T> From<Result<T, Unfit>> for Answer<T> {
    fn from(result: Result<T, Unfit>) -> Self {
        match result {
            Ok(found) => Self::Found(found),
            Err(unfit) => Self::Unanswered { why: unfit.to_string() },
        }
    }
}

/// One quantity, one group of contexts, two conditions. Differences are first − second.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The quantity's key.
    pub quantity: &'static str,
    /// The group of contexts, or "all".
    pub group: String,
    /// The condition that the report asks about.
    pub first: String,
    /// The one it is compared with.
    pub second: String,
    /// Trials of the first that have the quantity.
    pub first_trials: usize,
    /// Trials of the second that have it.
    pub second_trials: usize,
    /// Pairs of trials that share participant, context and repetition.
    pub pairs: usize,
    /// The mean of the first, in the measure's unit.
    pub first_mean: Option<f64>,
    /// The mean of the second.
    pub second_mean: Option<f64>,
    /// Paired t.
    pub paired_t: Answer<PairedT>,
    /// Wilcoxon's signed ranks.
    pub wilcoxon: Answer<Signed>,
    /// Sign-flip permutations of the mean difference.
    pub permutation: Answer<Permutation>,
    /// The permutation test's p after Holm's correction over all comparisons of this quantity.
    pub holm_p: Option<f64>,
    /// Mean difference with its bootstrap interval.
    pub difference: Answer<Interval>,
    /// Cohen's d_z with its bootstrap interval.
    pub d_z: Answer<Interval>,
    /// Matched-pairs rank-biserial correlation with its bootstrap interval.
    pub rank_biserial: Answer<Interval>,
    /// The paper's tests, for the effort.
    pub steps: Option<StepTests>,
}

/// The paper's tests: every shared step of every trial as a sample of its own.
#[derive(Clone, Debug, Serialize)]
pub struct StepTests {
    /// Steps of the first condition.
    pub first_steps: usize,
    /// Steps of the second.
    pub second_steps: usize,
    /// Two-sample t with one pooled variance.
    pub student: Answer<TwoSampleT>,
    /// Two-sample t with a variance each.
    pub welch: Answer<TwoSampleT>,
    /// Mann–Whitney U, with continuity correction.
    pub mann_whitney: Answer<RankSum>,
    /// Cohen's d.
    pub cohen_d: Answer<f64>,
    /// Mean correlation of a step with the next one of its trial.
    pub autocorrelation: Option<f64>,
    /// How many independent steps the first condition's are about worth: `N (1 − r)/(1 + r)`.
    pub worth_steps: Option<f64>,
}

impl Comparison {
    /// Compares the trials of two conditions.
    #[must_use]
    pub fn new(quantity: &Quantity, group: &str, first: (&str, &[&Case]), second: (&str, &[&Case])) -> Self {
        let values =
            |cases: &[&Case]| -> Vec<f64> { cases.iter().filter_map(|case| (quantity.of)(&case.measures)).collect() };
        let (a, b) = (values(first.1), values(second.1));
        let differences = differences(quantity, first.1, second.1);
        Self {
            quantity: quantity.key,
            group: group.to_owned(),
            first: first.0.to_owned(),
            second: second.0.to_owned(),
            first_trials: a.len(),
            second_trials: b.len(),
            pairs: differences.len(),
            first_mean: mean(&a),
            second_mean: mean(&b),
            paired_t: paired_t(&differences).into(),
            wilcoxon: wilcoxon(&differences).into(),
            permutation: permutation(&differences, SEED).into(),
            holm_p: None,
            difference: interval(&differences, Effect::Mean, SEED).into(),
            d_z: interval(&differences, Effect::DZ, SEED).into(),
            rank_biserial: interval(&differences, Effect::RankBiserial, SEED).into(),
            steps: (quantity.key == EFFORT).then(|| StepTests::new(first.1, second.1)),
        }
    }
}

/// First − second, for every pair that both have; in the order of what they share, so that the order of trials does
/// not matter.
fn differences(quantity: &Quantity, first: &[&Case], second: &[&Case]) -> Vec<f64> {
    let by_pairing = |cases: &[&Case]| -> BTreeMap<(String, String, u32), f64> {
        cases
            .iter()
            .filter_map(|case| {
                let (participant, context, repetition) = case.identity.pairing();
                let value = (quantity.of)(&case.measures)?;
                Some(((participant.to_owned(), context.to_owned(), repetition), value))
            })
            .collect()
    };
    let others = by_pairing(second);
    by_pairing(first)
        .iter()
        .filter_map(|(pairing, value)| Some(value - others.get(pairing)?))
        .collect()
}

impl StepTests {
    fn new(first: &[&Case], second: &[&Case]) -> Self {
        let steps = |cases: &[&Case]| -> Vec<f64> {
            cases
                .iter()
                .flat_map(|case| case.measures.human_effort_steps_m_s.iter().copied())
                .collect()
        };
        let (a, b) = (steps(first), steps(second));
        let correlations: Vec<f64> = first
            .iter()
            .chain(second)
            .filter_map(|case| case.autocorrelation)
            .collect();
        let autocorrelation = mean(&correlations);
        Self {
            first_steps: a.len(),
            second_steps: b.len(),
            student: student_t(&a, &b).into(),
            welch: welch_t(&a, &b).into(),
            mann_whitney: mann_whitney(&a, &b, true).into(),
            cohen_d: cohen_d(&a, &b).into(),
            autocorrelation,
            worth_steps: autocorrelation
                .filter(|r| (0.0..1.0).contains(r))
                .map(|r| a.len() as f64 * (1.0 - r) / (1.0 + r)),
        }
    }
}
