//! Intervals of a figure that is measured in rounds.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::bootstrap::Interval;
use super::{Unfit, quantile};

/// Resamples of the rounds.
const RESAMPLES: u32 = 2_000;

/// The 95 % percentile interval of a figure of several rounds, from 2 000 resamples of whole rounds drawn from `seed`.
///
/// Measurements within a round follow each other closely: the same minute, the same place in memory, the same neighbours
/// on the processor. So rounds are what is drawn, not measurements.
///
/// # Errors
/// With fewer than three rounds, or if the figure of all is none.
pub fn interval_over_rounds<R>(
    rounds: &[R],
    seed: u64,
    figure: impl Fn(&[&R]) -> Option<f64>,
) -> Result<Interval, Unfit> {
    if rounds.len() < 3 {
        return Err(Unfit::TooFew {
            found: rounds.len(),
            needed: 3,
        });
    }
    let all: Vec<&R> = rounds.iter().collect();
    let value = figure(&all).ok_or(Unfit::NotFinite)?;
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut drawn = Vec::with_capacity(RESAMPLES as usize);
    for _ in 0..RESAMPLES {
        let resample: Vec<&R> = all
            .iter()
            .map(|_| {
                let index = (u64::from(generator.next_u32()) * rounds.len() as u64) >> 32;
                usize::try_from(index).map_or(all[0], |index| all[index])
            })
            .collect();
        drawn.extend(figure(&resample));
    }
    drawn.sort_by(f64::total_cmp);
    match (quantile(&drawn, 0.025), quantile(&drawn, 0.975)) {
        (Some(low), Some(high)) => Ok(Interval { value, low, high }),
        _ => Err(Unfit::NotFinite),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean(rounds: &[&f64]) -> Option<f64> {
        Some(rounds.iter().copied().sum::<f64>() / rounds.len() as f64)
    }

    #[test]
    fn rounds_that_agree_give_a_narrow_interval_and_others_a_wide_one() {
        let same = interval_over_rounds(&[2.0; 8], 1, mean).unwrap();
        assert_eq!((same.value, same.low, same.high), (2.0, 2.0, 2.0));
        let apart = interval_over_rounds(&[1.0, 3.0, 1.0, 3.0, 1.0, 3.0, 1.0, 3.0], 1, mean).unwrap();
        assert_eq!(apart.value, 2.0);
        assert!(apart.low < 1.6 && apart.high > 2.4, "{apart:?}");
    }

    #[test]
    fn too_few_rounds_say_nothing() {
        let refused = interval_over_rounds(&[1.0, 2.0], 1, mean);
        assert_eq!(refused, Err(Unfit::TooFew { found: 2, needed: 3 }));
    }
}
