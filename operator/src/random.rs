//! Random numbers that can be named: seed, trial, stream and place give the same number on every machine.
//!
//! ChaCha8 is a function of its counter, so nothing is remembered from draw to draw. Two laws compared with the same
//! seed meet the same human: one tick more or less of driving does not shift the noise of all later ones.

use std::f64::consts::TAU;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// What a number is drawn for. The value is the cipher's stream: never change one, only add.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Stream {
    /// The smooth deviation of the wish along the task's x.
    DeviationAlong = 1,
    /// The same along y.
    DeviationAcross = 2,
    /// The larger departure.
    Departure = 3,
    /// The departure after the checkpoint.
    LateDeparture = 4,
    /// The noise of the hand.
    Noise = 5,
}

/// The random numbers of one trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Draws {
    seed: u64,
    trial: u32,
}

impl Draws {
    pub(crate) const fn new(seed: u64, trial: u32) -> Self {
        Self { seed, trial }
    }

    /// Two independent standard normal numbers: the `place`-th pair of `stream`, after Box and Muller (1958).
    pub(crate) fn normal_pair(self, stream: Stream, place: u32) -> [f64; 2] {
        let mut generator = ChaCha8Rng::from_seed(self.key());
        generator.set_stream(stream as u64);
        generator.set_word_pos(u128::from(place) * WORDS_PER_PAIR);
        let radius = (-2.0 * libm::log(above_zero(generator.next_u64()))).sqrt();
        let angle = TAU * above_zero(generator.next_u64());
        [radius * libm::cos(angle), radius * libm::sin(angle)]
    }

    fn key(self) -> [u8; 32] {
        let mut key = *b"............tandem operator wish";
        key[..8].copy_from_slice(&self.seed.to_le_bytes());
        key[8..12].copy_from_slice(&self.trial.to_le_bytes());
        key
    }
}

/// Two numbers of 64 bits, in the cipher's words of 32.
const WORDS_PER_PAIR: u128 = 4;

/// Uniform in (0, 1] with 53 bits: zero is left out because its logarithm is infinite.
fn above_zero(bits: u64) -> f64 {
    ((bits >> 11) + 1) as f64 * (1.0 / (1_u64 << 53) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_depends_on_every_part_of_its_name() {
        let first = Draws::new(1, 1).normal_pair(Stream::Noise, 0);
        assert_eq!(first, Draws::new(1, 1).normal_pair(Stream::Noise, 0));
        for other in [
            Draws::new(2, 1).normal_pair(Stream::Noise, 0),
            Draws::new(1, 2).normal_pair(Stream::Noise, 0),
            Draws::new(1, 1).normal_pair(Stream::Departure, 0),
            Draws::new(1, 1).normal_pair(Stream::Noise, 1),
        ] {
            assert_ne!(first, other);
        }
    }

    #[test]
    fn ten_thousand_pairs_are_normal_and_unrelated() {
        let pairs: Vec<_> = (0..10_000)
            .map(|i| Draws::new(7, 3).normal_pair(Stream::Noise, i))
            .collect();
        let mean = |of: fn(&[f64; 2]) -> f64| pairs.iter().map(of).sum::<f64>() / 10_000.0;
        assert!(mean(|p| p[0]).abs() < 0.04 && mean(|p| p[1]).abs() < 0.04);
        assert!((mean(|p| p[0] * p[0]) - 1.0).abs() < 0.05 && (mean(|p| p[1] * p[1]) - 1.0).abs() < 0.05);
        assert!(mean(|p| p[0] * p[1]).abs() < 0.04);
        let beyond_two = pairs.iter().filter(|p| p[0].abs() > 2.0).count();
        assert!((380..540).contains(&beyond_two), "{beyond_two}");
    }
}
