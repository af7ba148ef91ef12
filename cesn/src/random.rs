//! Random numbers from a named algorithm: ChaCha with eight rounds, keyed by the seed and by what it is for.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// The stream of `purpose` under `seed`: 8 bytes of seed, then the purpose, then zeros, are the key.
///
/// Streams with different purposes are independent, so that changing the number of jittered copies leaves the
/// weights alone.
pub(crate) fn generator(seed: u64, purpose: &str) -> ChaCha8Rng {
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    for (byte, letter) in key[8..].iter_mut().zip(purpose.bytes()) {
        *byte = letter;
    }
    ChaCha8Rng::from_seed(key)
}

/// Uniform in [0, 1), a multiple of 2⁻⁵³.
pub(crate) fn unit(rng: &mut ChaCha8Rng) -> f64 {
    (rng.next_u64() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
}

/// Uniform in [−1, 1).
pub(crate) fn signed_unit(rng: &mut ChaCha8Rng) -> f64 {
    2.0 * unit(rng) - 1.0
}

/// Uniform in `0 .. bound`; the bias of the multiplication method is below 2⁻⁵⁰ for the bounds used here.
pub(crate) fn below(rng: &mut ChaCha8Rng, bound: usize) -> usize {
    let scaled = (u128::from(rng.next_u64()) * bound as u128) >> 64;
    usize::try_from(scaled).unwrap_or(0)
}

/// Standard normal, by Box and Muller's transform through `libm`.
pub(crate) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * libm::log(1.0 - unit(rng))).sqrt();
    radius * libm::cos(std::f64::consts::TAU * unit(rng))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stream_is_pinned() {
        let mut rng = generator(1, "weights");
        let drawn: Vec<u64> = (0..2).map(|_| rng.next_u64()).collect();
        assert_eq!(drawn, [12_676_315_974_202_317_239, 2_853_433_936_341_407_202]);
    }

    #[test]
    fn normal_numbers_have_mean_zero_and_deviation_one() {
        let mut rng = generator(9, "test");
        let drawn: Vec<f64> = (0..20_000).map(|_| normal(&mut rng)).collect();
        let mean = drawn.iter().sum::<f64>() / 20_000.0;
        let variance = drawn.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / 20_000.0;
        assert!(
            mean.abs() < 0.03 && (variance - 1.0).abs() < 0.04,
            "mean {mean}, variance {variance}"
        );
    }
}
