//! Figures per condition, and which constants a law has to be measured by.

use serde::Serialize;

use super::case::Case;
use super::quantities::{EFFORT, QUANTITIES};
use super::{ALL, Report};
use crate::statistics::{margin, mean};

/// A quantity's mean over trials.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Mean {
    /// The quantity's key.
    pub quantity: &'static str,
    /// Trials that have it.
    pub trials: usize,
    /// The mean, in the measure's unit.
    pub mean: f64,
    /// Half of the mean's 95 % interval by Student's t, from two trials on.
    pub margin: Option<f64>,
    /// The smallest value.
    pub least: f64,
    /// The largest value.
    pub most: f64,
}

/// The figures of one condition in one group of contexts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// The condition.
    pub condition: String,
    /// The group of contexts, or "all".
    pub group: String,
    /// How many trials.
    pub trials: usize,
    /// How many shared steps in them.
    pub steps: usize,
    /// Trials that were judged a success.
    pub successes: usize,
    /// Stops by whom and why, and how often; numbers within a reason are left out.
    pub stops: Vec<(String, usize)>,
    /// What there is to average.
    pub means: Vec<Mean>,
}

impl Summary {
    pub(super) fn of(condition: &str, group: &str, cases: &[&Case]) -> Self {
        let means = QUANTITIES.iter().filter_map(|quantity| {
            let values: Vec<f64> = cases.iter().filter_map(|case| (quantity.of)(&case.measures)).collect();
            Some(Mean {
                quantity: quantity.key,
                trials: values.len(),
                mean: mean(&values)?,
                margin: margin(&values),
                least: values.iter().copied().fold(f64::INFINITY, f64::min),
                most: values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            })
        });
        Self {
            condition: condition.to_owned(),
            group: group.to_owned(),
            trials: cases.len(),
            steps: cases
                .iter()
                .map(|case| case.measures.human_effort_steps_m_s.len())
                .sum(),
            successes: cases.iter().filter(|case| case.identity.success).count(),
            stops: stops(cases),
            means: means.collect(),
        }
    }

    /// The mean of a quantity, if any trial has it.
    #[must_use]
    pub fn mean(&self, key: &str) -> Option<&Mean> {
        self.means.iter().find(|mean| mean.quantity == key)
    }
}

fn stops(cases: &[&Case]) -> Vec<(String, usize)> {
    let mut counts = std::collections::BTreeMap::<String, usize>::new();
    for stop in cases.iter().flat_map(|case| &case.measures.stops) {
        let reason: String = stop
            .reason
            .split(|c: char| c.is_ascii_digit())
            .filter(|part| !part.is_empty())
            .collect::<Vec<_>>()
            .join("…");
        *counts.entry(format!("{}: {reason}", stop.by)).or_default() += 1;
    }
    counts.into_iter().collect()
}

/// The reference beside conditions whose weight is constant.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Controls {
    /// The reference's mean weight after the checkpoint.
    pub weight: f64,
    /// The reference's mean effort.
    pub effort_m_s: f64,
    /// Conditions of constant weight: name, weight, mean effort; by weight.
    pub constants: Vec<(String, f64, f64)>,
    /// The one nearest in weight.
    pub matched: String,
    /// What a constant of the reference's own mean weight would have cost, drawn straight between the two constants
    /// around it; `None` if it lies beyond them.
    pub effort_of_same_weight_m_s: Option<f64>,
}

impl Controls {
    /// `None` if the reference's weight is constant itself, or no other's is.
    pub(super) fn of(report: &Report) -> Option<Self> {
        let group = report.groups.last().map_or(ALL, String::as_str);
        let reference = &report.setup.reference;
        if constant(&report.cases(reference, group)).is_some() {
            return None;
        }
        let summary = report.summary(reference, group)?;
        let (weight, effort) = (summary.mean("weight_mean_after")?.mean, summary.mean(EFFORT)?.mean);
        let others = report.setup.conditions.iter().filter(|(name, _)| name != reference);
        let mut constants: Vec<(String, f64, f64)> = others
            .filter_map(|(name, _)| {
                let held = constant(&report.cases(name, group))?;
                Some((name.clone(), held, report.summary(name, group)?.mean(EFFORT)?.mean))
            })
            .collect();
        constants.sort_by(|a, b| a.1.total_cmp(&b.1));
        let nearest = constants
            .iter()
            .min_by(|a, b| (a.1 - weight).abs().total_cmp(&(b.1 - weight).abs()))?;
        Some(Self {
            weight,
            effort_m_s: effort,
            matched: nearest.0.clone(),
            effort_of_same_weight_m_s: between(&constants, weight),
            constants,
        })
    }
}

/// The weight that all of these trials held after the checkpoint.
fn constant(cases: &[&Case]) -> Option<f64> {
    let mut weights = cases.iter().map(|case| case.constant_weight);
    let first = weights.next()??;
    weights
        .all(|weight| weight.is_some_and(|weight| (weight - first).abs() < 1e-9))
        .then_some(first)
}

fn between(constants: &[(String, f64, f64)], weight: f64) -> Option<f64> {
    let around = constants
        .windows(2)
        .find(|pair| (pair[0].1..=pair[1].1).contains(&weight))?;
    let [(_, w0, e0), (_, w1, e1)] = around else {
        return None;
    };
    let share = if w1 > w0 { (weight - w0) / (w1 - w0) } else { 0.0 };
    Some(e0 + share * (e1 - e0))
}
