//! Where the simulated human wants to be: a path of the family, and how far from it this trial's wish lies.
//!
//! Three deviations are added to the path, each drawn anew for every trial. All vanish at both ends, so that start and
//! goal stay what they are.
//!
//! - The *deviation*, on both axes: `Σ aᵢ sin(iπτ)` for i = 1, 2, 3 with `aᵢ ~ N(0, cᵢ²)`, `cᵢ ∝ 1/i`, scaled so that
//!   its root mean square over the path is the setting.
//! - The *departure*, the same across the path only (along it, it would be lost time, not another wish). It spans
//!   the whole path and so shows at the checkpoint.
//! - The *late departure*, across the path: `b sin²(πu)` with `b ~ N(0, setting²)` and `u` the share of the way from
//!   the checkpoint to the end. Nothing at the checkpoint tells of it.

use std::f64::consts::PI;

use crate::family::{CHECKPOINT_STEP, FamilyPath, LAST_STEP, share};
use crate::random::{Draws, Stream};

/// How far a wish may lie from its path: standard deviations in metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Spread {
    pub(crate) deviation: f64,
    pub(crate) departure: f64,
    pub(crate) late_departure: f64,
}

/// The wish of one trial, as a function of the step.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Wish {
    path: FamilyPath,
    along: Waves,
    across: Waves,
    departure: Waves,
    late: f64,
}

impl Wish {
    pub(crate) fn new(path: FamilyPath, spread: Spread, draws: Draws) -> Self {
        Self {
            path,
            along: Waves::draw(spread.deviation, draws, Stream::DeviationAlong),
            across: Waves::draw(spread.deviation, draws, Stream::DeviationAcross),
            departure: Waves::draw(spread.departure, draws, Stream::Departure),
            late: spread.late_departure * draws.normal_pair(Stream::LateDeparture, 0)[0],
        }
    }

    /// Where the human wants to be at step `t`, in task coordinates.
    pub(crate) fn at(&self, t: f64) -> [f64; 2] {
        let [x, y] = self.path.at(t);
        let tau = share(t);
        let across = self.across.at(tau) + self.departure.at(tau) + self.late * bump(t);
        [x + self.along.at(tau), y + across]
    }

    /// Where the path begins, and the wish with it.
    pub(crate) fn start(&self) -> [f64; 2] {
        self.path.at(0.0)
    }
}

/// Three half-waves that vanish at both ends.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Waves([f64; 3]);

impl Waves {
    fn draw(sd: f64, draws: Draws, stream: Stream) -> Self {
        // The mean of sin² is one half, hence Σ cᵢ² / 2 = sd² with cᵢ = c / i and Σ 1/i² = 49/36.
        let c = sd * (2.0 * 36.0 / 49.0_f64).sqrt();
        let [first, second] = draws.normal_pair(stream, 0);
        let [third, _] = draws.normal_pair(stream, 1);
        Self([c * first, c / 2.0 * second, c / 3.0 * third])
    }

    fn at(self, tau: f64) -> f64 {
        let [first, second, third] = self.0;
        let wave = |i: f64| libm::sin(i * PI * tau);
        first * wave(1.0) + second * wave(2.0) + third * wave(3.0)
    }
}

/// Rises from 0 at the checkpoint to 1 halfway to the end, and falls back.
fn bump(t: f64) -> f64 {
    let u = ((t - CHECKPOINT_STEP) / (LAST_STEP - CHECKPOINT_STEP)).clamp(0.0, 1.0);
    let wave = libm::sin(PI * u);
    wave * wave
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wish(spread: Spread, trial: u32) -> Wish {
        Wish::new(FamilyPath::new(0.12), spread, Draws::new(1, trial))
    }

    fn wishes(spread: Spread) -> Vec<Wish> {
        (0..2000).map(|trial| wish(spread, trial)).collect()
    }

    /// How far the wishes of many trials lie from the path at one step: root mean square per axis.
    fn rms(wishes: &[Wish], t: f64) -> [f64; 2] {
        let [x, y] = FamilyPath::new(0.12).at(t);
        let sum = wishes.iter().fold([0.0; 2], |sum, wish| {
            let [wx, wy] = wish.at(t);
            [sum[0] + (wx - x) * (wx - x), sum[1] + (wy - y) * (wy - y)]
        });
        sum.map(|s: f64| (s / wishes.len() as f64).sqrt())
    }

    #[test]
    fn without_spread_the_wish_is_the_path() {
        let wish = wish(Spread::default(), 3);
        assert_eq!(wish.at(30.5), FamilyPath::new(0.12).at(30.5));
    }

    #[test]
    fn the_deviation_has_the_spread_asked_for_and_keeps_both_ends() {
        let wishes = wishes(Spread {
            deviation: 0.005,
            ..Spread::default()
        });
        let mut square = [0.0; 2];
        for i in 0..12 {
            let [x, y] = rms(&wishes, (f64::from(i) + 0.5) * LAST_STEP / 12.0);
            square = [square[0] + x * x / 12.0, square[1] + y * y / 12.0];
        }
        for mean in square {
            assert!((mean.sqrt() - 0.005).abs() < 0.0003, "{}", mean.sqrt());
        }
        assert!(rms(&wishes, 0.0)[0] < 1e-9 && rms(&wishes, LAST_STEP)[1] < 1e-9);
    }

    #[test]
    fn a_departure_shows_at_the_checkpoint_and_a_late_one_does_not() {
        let early = wishes(Spread {
            departure: 0.06,
            ..Spread::default()
        });
        let late = wishes(Spread {
            late_departure: 0.06,
            ..Spread::default()
        });
        let [along, across] = rms(&early, CHECKPOINT_STEP);
        assert!(along < 1e-12 && (0.06..0.09).contains(&across), "{across}");
        assert!(rms(&late, CHECKPOINT_STEP)[1] < 1e-12);
        let across = rms(&late, f64::midpoint(CHECKPOINT_STEP, LAST_STEP))[1];
        assert!((across - 0.06).abs() < 0.004, "{across}");
    }
}
