//! Smoothness of a movement: the spectral arc length.

use std::f64::consts::TAU;

/// The spectrum is padded to this many times the next power of two, as the authors do (their `padlevel` 4).
const PADDING: usize = 16;
/// Frequencies above this do not count, in hertz.
const CUTOFF_HZ: f64 = 10.0;
/// The spectrum counts up to where it last exceeds this share of its peak.
const THRESHOLD: f64 = 0.05;
/// A speed profile longer than this is no single movement, and its spectrum would take long.
const LONGEST: usize = 1 << 16;

/// Spectral arc length (SPARC) of a speed profile with one sample every `period_s` seconds; `None` for fewer than three
/// samples, for one that never moves, and for more than 65 536.
///
/// With `V̂(f) = |V(f)| / max |V|` the normalised magnitude spectrum of the speed,
/// `SPARC = −∫ sqrt((1/f_c)² + (dV̂/df)²) df` from 0 to `f_c`, where `f_c` is the last frequency below 10 Hz at which
/// `V̂ ≥ 0.05`. Source: Balasubramanian, Melendez-Calderon, Roby-Brami and Burdet, *On the analysis of movement
/// smoothness*, J. NeuroEngineering and Rehabilitation 12:112 (2015), with its parameters: 10 Hz, 0.05, zero-padding to
/// 16 times the next power of two. The spectrum of a sampled profile ends at half the sampling rate, so at a control
/// rate of 10 Hz only 5 Hz are left to look at: compare trials of one rate only.
///
/// Costs `O(n log n)`.
#[must_use]
pub fn sparc(speeds: &[f64], period_s: f64) -> Option<f64> {
    if !(3..=LONGEST).contains(&speeds.len()) || period_s <= 0.0 || speeds.iter().any(|speed| !speed.is_finite()) {
        return None;
    }
    let length = speeds.len().next_power_of_two() * PADDING;
    let spectrum = magnitudes(speeds, length);
    let peak = spectrum.iter().fold(0.0_f64, |peak, value| peak.max(*value));
    if peak <= 0.0 {
        return None;
    }
    let step = 1.0 / (period_s * length as f64);
    let in_reach = spectrum
        .iter()
        .enumerate()
        .take_while(|(index, _)| *index as f64 * step <= CUTOFF_HZ)
        .map(|(_, value)| value / peak);
    let shape: Vec<f64> = in_reach.collect();
    let first = shape.iter().position(|value| *value >= THRESHOLD)?;
    let last = shape.iter().rposition(|value| *value >= THRESHOLD)?;
    if last == first {
        return None;
    }
    let width = 1.0 / (last - first) as f64;
    let arc: f64 = shape[first..=last]
        .windows(2)
        .map(|pair| libm::hypot(width, pair[1] - pair[0]))
        .sum();
    Some(-arc)
}

/// `|DFT|` of `samples` padded with zeros to `length`, a power of two, up to half the sampling rate.
fn magnitudes(samples: &[f64], length: usize) -> Vec<f64> {
    let mut re = vec![0.0; length];
    let mut im = vec![0.0; length];
    for (index, sample) in samples.iter().enumerate() {
        re[reversed(index, length)] = *sample;
    }
    let turns: Vec<(f64, f64)> = (0..length / 2)
        .map(|k| -TAU * k as f64 / length as f64)
        .map(|angle| (libm::cos(angle), libm::sin(angle)))
        .collect();
    let mut half = 1;
    while half < length {
        let stride = length / (2 * half);
        for block in (0..length).step_by(2 * half) {
            for k in 0..half {
                let (c, s) = turns[k * stride];
                let (a, b) = (block + k, block + k + half);
                let (x, y) = (c * re[b] - s * im[b], s * re[b] + c * im[b]);
                (re[b], im[b]) = (re[a] - x, im[a] - y);
                (re[a], im[a]) = (re[a] + x, im[a] + y);
            }
        }
        half *= 2;
    }
    let lower = re.iter().zip(&im).take(length / 2 + 1);
    lower.map(|(re, im)| libm::hypot(*re, *im)).collect()
}

/// The index with the order of its bits turned round, in a transform of `length` samples.
const fn reversed(index: usize, length: usize) -> usize {
    let bits = length.trailing_zeros();
    if bits == 0 {
        index
    } else {
        index.reverse_bits() >> (usize::BITS - bits)
    }
}
