//! Prediction intervals: how wide, and how much wider than in training.
//!
//! ```text
//! h = zᵀ A⁻¹ z = |L⁻¹ z|²        half-width_k = t_{(1+conf)/2, ν} · s_k · √(1 + h)
//! ratio(t) = √((1 + h) / (1 + h_train(t)))
//! ```
//! `h_train(t)` is the largest `h` of the clean demonstrations at step `t`. In the ratio of a half-width to the
//! largest one in training, confidence, spread and axis cancel: it measures novelty and nothing else. A model that is
//! conditioned anew compares with the same step under the same condition's time instead ([`crate::replan`]).

use crate::quantile::student_t_quantile;
use crate::settings::IntervalKind;
use crate::triangle::Triangle;

/// A novelty scale below this would divide noise by noise: `ρ_hi` is at least 1.05.
pub const SMALLEST_RHO_HI: f64 = 1.05;

/// Everything about intervals that training found out.
#[derive(Clone, Debug, PartialEq, bincode::Encode, bincode::Decode)]
pub struct Calibration {
    /// The confidence level, in (0, 1).
    pub confidence: f64,
    /// Whose spread the half-widths use.
    pub kind: IntervalKind,
    /// Degrees of freedom, `ν = n − edf`.
    pub nu: f64,
    /// `t_{(1+conf)/2, ν}`.
    pub t_quantile: f64,
    /// `s` of each output, from the residuals of the fit.
    pub s: Vec<f64>,
    /// `s_lodo` of each output, from leaving demonstrations out, when that can be computed.
    pub s_lodo: Option<Vec<f64>>,
    /// `h_train(t)`: the largest leverage of the clean demonstrations at each step.
    pub training_leverages: Vec<f64>,
    /// The ratio that counts as wholly unknown: its mean over the steps after the checkpoint, two half-ranges
    /// away from the mean context along the contexts' first principal axis, on both sides; at least 1.05.
    pub rho_hi: f64,
}

impl Calibration {
    /// The quantile for `confidence` on `nu` degrees of freedom.
    pub(crate) fn t_quantile(confidence: f64, nu: f64) -> Option<f64> {
        student_t_quantile(nu, 0.5 * (1.0 + confidence))
    }

    /// The spread of output `k` that the half-widths use.
    #[must_use]
    pub fn spread(&self, k: usize) -> f64 {
        let s = self.s.get(k).copied().unwrap_or(0.0);
        match (self.kind, &self.s_lodo) {
            (IntervalKind::Robust, Some(s_lodo)) => s_lodo.get(k).map_or(s, |lodo| s.max(*lodo)),
            _ => s,
        }
    }

    /// The half-width of output `k` where the leverage is `leverage`.
    #[must_use]
    pub fn half_width(&self, k: usize, leverage: f64) -> f64 {
        self.t_quantile * self.spread(k) * (1.0 + leverage).sqrt()
    }

    /// `PI_train(t)` of output `k`: the largest half-width over the clean demonstrations. None past the last step.
    #[must_use]
    pub fn training_half_width(&self, step: usize, k: usize) -> Option<f64> {
        Some(self.half_width(k, *self.training_leverages.get(step)?))
    }

    /// How much wider than in training an interval with `leverage` is at `step`; past the end, than at the last.
    #[must_use]
    pub fn ratio(&self, step: usize, leverage: f64) -> f64 {
        let training = self
            .training_leverages
            .get(step)
            .or(self.training_leverages.last())
            .copied()
            .unwrap_or(0.0);
        novelty(leverage, training)
    }
}

/// How much wider an interval with `leverage` is than one with the leverage of `training`.
pub(crate) fn novelty(leverage: f64, training: f64) -> f64 {
    ((1.0 + leverage) / (1.0 + training)).sqrt()
}

/// The interval of one state, and the room to compute the next without allocating.
#[derive(Clone, Debug, PartialEq)]
pub struct Interval {
    /// `h = zᵀ A⁻¹ z`.
    pub leverage: f64,
    /// Of each output, in the outputs' own unit.
    pub half_width: Vec<f64>,
    /// To the largest half-width of the demonstrations at the same step.
    pub ratio: f64,
    z: Vec<f64>,
}

impl Interval {
    pub(crate) fn new(triangle: &Triangle, outputs: usize) -> Self {
        Self {
            leverage: 0.0,
            half_width: vec![0.0; outputs],
            ratio: 1.0,
            z: vec![0.0; triangle.padded()],
        }
    }

    /// Recomputes for the activations `x` at `step`.
    pub(crate) fn set(&mut self, triangle: &Triangle, calibration: &Calibration, x: &[f64], step: usize) {
        self.z.resize(triangle.padded(), 0.0);
        self.z.fill(0.0);
        self.z[0] = 1.0;
        self.z[1..].iter_mut().zip(x).for_each(|(z, x)| *z = *x);
        self.leverage = triangle.squared_norm(&mut self.z);
        self.half_width.resize(calibration.s.len(), 0.0);
        for (k, half_width) in self.half_width.iter_mut().enumerate() {
            *half_width = calibration.half_width(k, self.leverage);
        }
        self.ratio = calibration.ratio(step, self.leverage);
    }
}
