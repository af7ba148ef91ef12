//! Intervals of an effect by resampling.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Normal};

use super::paired::rank_biserial;
use super::{Unfit, check, deviation, mean};

/// Resamples; the ends of the interval stand still to about a fiftieth of its width.
const RESAMPLES: u32 = 4_000;

/// An effect with its bootstrap interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Interval {
    /// The effect in the samples as they are.
    pub value: f64,
    /// The lower end.
    pub low: f64,
    /// The upper end.
    pub high: f64,
}

/// An effect of paired differences.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// The mean difference.
    Mean,
    /// Cohen's d_z.
    DZ,
    /// The matched-pairs rank-biserial correlation.
    RankBiserial,
}

impl Effect {
    /// `None` where resampling left no spread.
    fn of(self, differences: &[f64]) -> Option<f64> {
        match self {
            Self::Mean => mean(differences),
            Self::DZ => {
                let (centre, spread) = (mean(differences)?, deviation(differences)?);
                (spread > centre.abs() * 1e-13).then(|| centre / spread)
            }
            Self::RankBiserial => Some(rank_biserial(differences)),
        }
    }
}

/// The 95 % bootstrap interval of an effect, bias-corrected and accelerated (BCa: Efron, *Better bootstrap confidence
/// intervals*, J. American Statistical Association 82, 1987), from 4 000 resamples drawn from `seed`. Where all
/// resamples lie on one side of the effect, as when no difference has the other sign, it is the percentile interval.
///
/// # Errors
/// With fewer than three differences, with one that is not finite, or if all are the same.
pub fn interval(differences: &[f64], effect: Effect, seed: u64) -> Result<Interval, Unfit> {
    check(differences, 3)?;
    if differences.iter().all(|value| *value == differences[0]) {
        return Err(Unfit::NoSpread);
    }
    let value = effect.of(differences).ok_or(Unfit::NoSpread)?;
    let mut drawn = resamples(differences, effect, seed);
    drawn.sort_by(f64::total_cmp);
    let correction = Correction::of(differences, effect, value, &drawn);
    let end = |level: f64| {
        quantile(
            &drawn,
            correction.as_ref().map_or(level, |correction| correction.level(level)),
        )
    };
    match (end(0.025), end(0.975)) {
        (Some(low), Some(high)) => Ok(Interval { value, low, high }),
        _ => Err(Unfit::NoSpread),
    }
}

fn resamples(differences: &[f64], effect: Effect, seed: u64) -> Vec<f64> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let count = differences.len() as u64;
    let mut resample = vec![0.0; differences.len()];
    let mut drawn = Vec::with_capacity(RESAMPLES as usize);
    for _ in 0..RESAMPLES {
        for value in &mut resample {
            // The share that rounding takes from an index is below count / 2³².
            let index = (u64::from(generator.next_u32()) * count) >> 32;
            *value = usize::try_from(index).map_or(0.0, |index| differences[index]);
        }
        drawn.extend(effect.of(&resample));
    }
    drawn
}

/// Bias `z₀` and acceleration `a`.
struct Correction {
    normal: Normal,
    bias: f64,
    acceleration: f64,
}

impl Correction {
    fn of(differences: &[f64], effect: Effect, value: f64, drawn: &[f64]) -> Option<Self> {
        let normal = Normal::new(0.0, 1.0).ok()?;
        let below = drawn.partition_point(|other| *other < value);
        let up_to = drawn.partition_point(|other| *other <= value);
        // Resamples that hit the effect itself count half, as steps of a coarse distribution would shift the bias.
        let share = (below + up_to) as f64 / (2.0 * drawn.len() as f64);
        if !(share > 0.0 && share < 1.0) {
            return None;
        }
        Some(Self {
            normal,
            bias: normal.inverse_cdf(share),
            acceleration: acceleration(differences, effect)?,
        })
    }

    fn level(&self, level: f64) -> f64 {
        let z = self.bias + self.normal.inverse_cdf(level);
        let bend = 1.0 - self.acceleration * z;
        if bend <= 0.0 {
            return if z > 0.0 { 1.0 } else { 0.0 };
        }
        self.normal.cdf(self.bias + z / bend)
    }
}

/// `Σ (m − xᵢ)³ / 6 (Σ (m − xᵢ)²)^{3/2}` over the values with one difference left out.
fn acceleration(differences: &[f64], effect: Effect) -> Option<f64> {
    let mut others = differences[1..].to_vec();
    let mut left_out = Vec::with_capacity(differences.len());
    left_out.push(effect.of(&others)?);
    for (place, value) in differences[..differences.len() - 1].iter().enumerate() {
        others[place] = *value;
        left_out.push(effect.of(&others)?);
    }
    let centre = mean(&left_out)?;
    let power = |exponent: i32| -> f64 { left_out.iter().map(|value| (centre - value).powi(exponent)).sum() };
    let square = power(2);
    Some(if square > 0.0 {
        power(3) / (6.0 * square * square.sqrt())
    } else {
        0.0
    })
}

/// A quantile of values in ascending order: between the two nearest, as most programs do. `None` of nothing.
#[must_use]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "between 0 and the number of values"
)]
pub fn quantile(sorted: &[f64], level: f64) -> Option<f64> {
    let place = level.clamp(0.0, 1.0) * sorted.len().checked_sub(1)? as f64;
    let below = *sorted.get(place.floor() as usize)?;
    let above = *sorted.get(place.ceil() as usize)?;
    Some(below + (above - below) * place.fract())
}
