//! The tests between conditions: the paper's, and the ones that its samples call for.
//!
//! | question | samples | here |
//! | --- | --- | --- |
//! | the paper's | every shared step of every trial, as if all were independent | [`student_t`], [`welch_t`], [`mann_whitney`], [`cohen_d`] |
//! | the sound one | one number per trial, paired by what the trials share | [`paired_t`], [`wilcoxon`], [`permutation`], [`Differences`] |
//! | how large | | [`interval`]: bootstrap intervals of an effect |
//! | how many questions | | [`holm`] |
//!
//! All p-values are two-sided. Steps of one movement follow each other closely, so a test per step finds far more than
//! there is: its N is that of the trials, not of the steps. It is here to be compared with the paper.
//!
//! Distributions come from `statrs`. Its own Mann–Whitney test compares every pair of samples and takes the tail as
//! 1 − cdf, which is slow for tens of thousands of steps and ends at 1e-16; it has no paired test. So the ranks and
//! sums are here, and held to scipy's results.

mod bootstrap;
mod paired;
mod rounds;
mod two_samples;

pub use bootstrap::{Effect, Interval, interval, quantile};
pub use paired::{Differences, PairedT, Permutation, Signed, paired_t, permutation, wilcoxon};
pub use rounds::interval_over_rounds;
pub use two_samples::{RankSum, TwoSampleT, cohen_d, mann_whitney, student_t, welch_t, z_of_u};

use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// Why samples cannot be tested.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unfit {
    /// Fewer than a test needs.
    #[error("too few: {found} of at least {needed}")]
    TooFew {
        /// How many there are, in the smaller sample.
        found: usize,
        /// How many are needed.
        needed: usize,
    },
    /// All the same: there is no spread to compare a difference with.
    #[error("all values are the same")]
    NoSpread,
    /// A value is not finite.
    #[error("a value is not a finite number")]
    NotFinite,
}

/// Holm's correction: the smallest family-wise error rates at which each of these hypotheses would be rejected.
///
/// `p̃₍ᵢ₎ = min(1, max_{j ≤ i} (m − j + 1) p₍ⱼ₎)` in ascending order; returned in the order given.
#[must_use]
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|a, b| p_values[*a].total_cmp(&p_values[*b]));
    let mut adjusted = vec![1.0; p_values.len()];
    let mut largest = 0.0_f64;
    for (rank, index) in order.into_iter().enumerate() {
        largest = largest.max((p_values.len() - rank) as f64 * p_values[index]);
        adjusted[index] = largest.min(1.0);
    }
    adjusted
}

/// The two-sided p-value of Student's `t` with `df` degrees of freedom; 1 where there is no such distribution.
#[must_use]
pub fn p_of_t(t: f64, df: f64) -> f64 {
    StudentsT::new(0.0, 1.0, df).map_or(1.0, |students| (2.0 * students.sf(t.abs())).min(1.0))
}

/// The two-sided p-value of a standard normal `z`.
#[must_use]
pub fn p_of_z(z: f64) -> f64 {
    Normal::new(0.0, 1.0).map_or(1.0, |normal| (2.0 * normal.sf(z.abs())).min(1.0))
}

fn check(samples: &[f64], needed: usize) -> Result<(), Unfit> {
    if samples.iter().any(|value| !value.is_finite()) {
        return Err(Unfit::NotFinite);
    }
    if samples.len() < needed {
        return Err(Unfit::TooFew {
            found: samples.len(),
            needed,
        });
    }
    Ok(())
}

/// The arithmetic mean; `None` of nothing.
#[must_use]
pub fn mean(samples: &[f64]) -> Option<f64> {
    (!samples.is_empty()).then(|| samples.iter().sum::<f64>() / samples.len() as f64)
}

/// The standard deviation of a sample, with `n − 1`; `None` of fewer than two.
#[must_use]
pub fn deviation(samples: &[f64]) -> Option<f64> {
    let centre = mean(samples)?;
    (samples.len() > 1).then(|| (squares(samples, centre) / (samples.len() - 1) as f64).sqrt())
}

/// The half-width of the 95 % interval of a mean by Student's t; `None` of fewer than two.
#[must_use]
pub fn margin(samples: &[f64]) -> Option<f64> {
    let spread = deviation(samples)?;
    let n = samples.len() as f64;
    let students = StudentsT::new(0.0, 1.0, n - 1.0).ok()?;
    Some(students.inverse_cdf(0.975) * spread / n.sqrt())
}

fn squares(samples: &[f64], centre: f64) -> f64 {
    samples.iter().map(|value| (value - centre) * (value - centre)).sum()
}

/// Ranks from 1 of `samples`, ties sharing their mean rank, and `Σ (t³ − t)` over the groups of ties.
fn ranks(samples: &[f64]) -> (Vec<f64>, f64) {
    let mut order: Vec<usize> = (0..samples.len()).collect();
    order.sort_by(|a, b| samples[*a].total_cmp(&samples[*b]));
    let mut ranks = vec![0.0; samples.len()];
    let mut ties = 0.0;
    let mut first = 0;
    for group in order.chunk_by(|a, b| samples[*a] == samples[*b]) {
        let size = group.len() as f64;
        let rank = first as f64 + (size + 1.0) / 2.0;
        group.iter().for_each(|index| ranks[*index] = rank);
        ties += size * size * size - size;
        first += group.len();
    }
    (ranks, ties)
}
