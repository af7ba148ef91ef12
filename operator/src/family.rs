//! The planar task's family of paths, in one formula.
//!
//! From the start (0, 0) over one obstacle and under the next to the goal (0.6, 0), in task coordinates, metres:
//!
//! ```text
//! τ = t / 83        s = 10τ³ − 15τ⁴ + 6τ⁵        k = 0.8 + 2 (A − 0.11)
//! x = 0.6 s
//! y = A exp(−((x − 0.28) / 0.07)²) − A k exp(−((x − 0.46) / 0.06)²)
//! x ← x + 0.12 (A − 0.11) sin 2πs
//! ```
//!
//! `t` counts steps of 0.1 s and need not be whole; the amplitude `A` tells one member of the family from another.
//! `s` is the quintic that starts and ends at rest. Before the first step a path stays at its start, after the last
//! at its end.

use std::f64::consts::TAU;

/// The last step of a path: 84 steps, counted from 0.
pub const LAST_STEP: f64 = 83.0;
/// The step at which a path passes the checkpoint, just behind its top over the first obstacle.
pub const CHECKPOINT_STEP: f64 = 41.0;

/// One member of the family.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FamilyPath {
    amplitude: f64,
}

impl FamilyPath {
    /// The member with amplitude `A`, in metres; the demonstrations are those with 0.08, 0.11 and 0.14.
    #[must_use]
    pub const fn new(amplitude: f64) -> Self {
        Self { amplitude }
    }

    /// Where the path is at step `t`, in task coordinates. Costs two exponentials and a sine.
    #[must_use]
    pub fn at(&self, t: f64) -> [f64; 2] {
        let a = self.amplitude;
        let s = quintic(share(t));
        let x = 0.6 * s;
        let k = 0.8 + 2.0 * (a - 0.11);
        let y = a * bell(x, 0.28, 0.07) - a * k * bell(x, 0.46, 0.06);
        [x + 0.12 * (a - 0.11) * libm::sin(TAU * s), y]
    }
}

/// `τ`: which share of the path's time has passed at step `t`, from 0 to 1.
pub(crate) fn share(t: f64) -> f64 {
    (t / LAST_STEP).clamp(0.0, 1.0)
}

fn quintic(tau: f64) -> f64 {
    tau * tau * tau * (10.0 + tau * (6.0 * tau - 15.0))
}

fn bell(x: f64, centre: f64, width: f64) -> f64 {
    let u = (x - centre) / width;
    libm::exp(-(u * u))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The demonstrations' amplitudes, and two far outside.
    const AMPLITUDES: [f64; 5] = [0.05, 0.08, 0.11, 0.14, 0.18];

    #[test]
    fn every_path_leads_from_the_start_to_the_goal() {
        for a in AMPLITUDES {
            let path = FamilyPath::new(a);
            let ([x0, y0], [x1, y1]) = (path.at(0.0), path.at(LAST_STEP));
            assert!(x0.abs() < 1e-12 && y0.abs() < 1e-6, "{a}: ({x0}, {y0})");
            assert!((x1 - 0.6).abs() < 1e-12 && y1.abs() < 0.005, "{a}: ({x1}, {y1})");
            assert_eq!(path.at(-3.0), path.at(0.0));
            assert_eq!(path.at(900.0), path.at(LAST_STEP));
        }
    }

    #[test]
    fn a_path_goes_over_the_first_obstacle_and_under_the_second() {
        for a in AMPLITUDES {
            let points: Vec<_> = (0..=830).map(|i| FamilyPath::new(a).at(f64::from(i) / 10.0)).collect();
            let clear = |cx: f64| {
                let near = points.iter().map(|p| libm::hypot(p[0] - cx, p[1]));
                near.fold(f64::INFINITY, f64::min)
            };
            // Obstacle 20 mm, tool 5 mm.
            assert!(
                clear(0.28) > 0.025 && clear(0.46) > 0.025,
                "{a}: {} {}",
                clear(0.28),
                clear(0.46)
            );
            assert!(points.iter().any(|p| p[1] > 0.9 * a) && points.iter().any(|p| p[1] < -0.5 * a));
        }
    }

    #[test]
    fn the_formula_gives_what_it_gave_before() {
        let [x, y] = FamilyPath::new(0.12).at(CHECKPOINT_STEP);
        assert!((x - 0.293_308_6).abs() < 1e-6, "{x}");
        assert!((y - 0.115_749_8).abs() < 1e-6, "{y}");
    }
}
