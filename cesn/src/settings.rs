//! Everything that can be chosen before training, with the values that work as defaults.

use serde::{Deserialize, Serialize};

use crate::reservoir::{MAX_INPUTS, MAX_UNITS};

/// Above this gain the reservoir answers a context nonlinearly, and forecasts between demonstrations fall apart.
pub const CONTEXT_GAIN_LIMIT: f64 = 0.03;
/// From this gain on, jittered copies cost more accuracy outside the demonstrations than they buy.
pub const JITTER_GAIN_LIMIT: f64 = 0.01;
/// More copies than this are a slip of the keyboard.
pub const MAX_COPIES: usize = 64;

/// Hyper-parameters and what a model says about itself. The defaults are those of the planar task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, bincode::Encode, bincode::Decode)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Seed of weights and jitter.
    pub seed: u64,
    /// `N`, the number of units.
    pub units: usize,
    /// Share of recurrent weights that are not zero, in (0, 1].
    pub density: f64,
    /// Modulus of the largest eigenvalue of `W`.
    pub spectral_radius: f64,
    /// Half the width of the bias column.
    pub bias_gain: f64,
    /// Half the width of the context columns. It decides everything: a small gain keeps the answer affine.
    pub context_gain: f64,
    /// The leak rate; by default `min(0.3, 40 / T)`.
    pub leak: Option<f64>,
    /// Steps at the start of each movement that are not learnt.
    pub washout: usize,
    /// How λ is chosen.
    pub ridge: Ridge,
    /// Whether λ also holds the bias down.
    pub bias: Bias,
    /// Whose spread the half-widths use.
    pub interval: IntervalKind,
    /// The confidence level, in (0, 1).
    pub confidence: f64,
    /// Jittered copies of the demonstrations, if any; `copies = 0` is none, too.
    pub jitter: Option<Jitter>,
    /// State fed back as input, if any.
    pub feedback: Option<Feedback>,
    /// The step at which the condition is known; later steps are forecast.
    pub checkpoint_step: usize,
    /// Seconds between steps, for demonstrations that do not say it themselves.
    pub period_s: f64,
    /// The frame that contexts and outputs are in.
    pub frame: String,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            seed: 1,
            units: 500,
            density: 0.1,
            spectral_radius: 1.4,
            bias_gain: 0.5,
            context_gain: 0.003,
            leak: None,
            washout: 0,
            ridge: Ridge::Evidence,
            bias: Bias::Penalised,
            interval: IntervalKind::Robust,
            confidence: 0.95,
            jitter: Some(Jitter::default()),
            feedback: None,
            checkpoint_step: 41,
            period_s: 0.1,
            frame: "task".to_owned(),
        }
    }
}

/// How the ridge λ is chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, bincode::Encode, bincode::Decode)]
#[serde(rename_all = "snake_case")]
pub enum Ridge {
    /// λ = 0: ordinary least squares, the published formula. Needs more rows than units.
    None,
    /// This λ.
    Fixed {
        /// λ, above 0.
        lambda: f64,
    },
    /// The λ with the largest marginal likelihood between 1e-8 and 1.
    #[default]
    Evidence,
}

/// Whether the bias is a weight like the others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, bincode::Encode, bincode::Decode)]
#[serde(rename_all = "snake_case")]
pub enum Bias {
    /// λ on every diagonal element.
    #[default]
    Penalised,
    /// λ on all but the bias.
    Free,
}

/// Whose spread the half-widths use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, bincode::Encode, bincode::Decode)]
#[serde(rename_all = "snake_case")]
pub enum IntervalKind {
    /// `s`, from the residuals of the fit: the published formula.
    Paper,
    /// `max(s, s_lodo)`: never narrower than predicting a whole demonstration from the others warrants.
    #[default]
    Robust,
}

/// Each demonstration again, with noise on its context and the same path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, bincode::Encode, bincode::Decode)]
#[serde(default, deny_unknown_fields)]
pub struct Jitter {
    /// Standard deviation of the noise, in the context's own unit.
    pub deviation: f64,
    /// `R`, copies of each demonstration; original and copies weigh `1 / (R + 1)` each.
    pub copies: usize,
}

impl Default for Jitter {
    /// 3 mm, the noise of a checkpoint reached by hand. Two to sixteen copies differ by less than two seeds do.
    fn default() -> Self {
        Self {
            deviation: 0.003,
            copies: 4,
        }
    }
}

/// The output of the step before as a second input beside the context.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, bincode::Encode, bincode::Decode)]
#[serde(default, deny_unknown_fields)]
pub struct Feedback {
    /// Half the width of the fed-back columns; stable from 0.003 to 0.03, diverges at 0.3.
    pub gain: f64,
}

impl Default for Feedback {
    fn default() -> Self {
        Self { gain: 0.003 }
    }
}

/// A setting outside its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{key} is {value}; it must be {allowed}")]
pub struct SettingsError {
    /// The setting, as it is spelled in [`Settings`].
    pub key: &'static str,
    /// Its value.
    pub value: f64,
    /// The legal range, in words.
    pub allowed: &'static str,
}

/// Something legal that is seldom wanted.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Warning {
    /// The context gain is above [`CONTEXT_GAIN_LIMIT`].
    #[error("context_gain {gain} is above {limit}: expect poor forecasts between and outside the demonstrations")]
    ContextGain {
        /// The setting.
        gain: f64,
        /// The limit.
        limit: f64,
    },
    /// Jittered copies at a gain where they hurt.
    #[error("jitter with context_gain {gain}: from {limit} on it costs accuracy outside the demonstrations")]
    JitterGain {
        /// The setting.
        gain: f64,
        /// The limit.
        limit: f64,
    },
    /// A feedback gain that is likely to diverge.
    #[error("feedback gain {gain} is above {limit}: the fed-back state may run away")]
    FeedbackGain {
        /// The setting.
        gain: f64,
        /// The limit.
        limit: f64,
    },
    /// The evidence rises up to the end of the range it is sought in.
    #[error("the evidence has no maximum inside its range; lambda {lambda} is the range's end")]
    RidgeAtEnd {
        /// The λ that was taken.
        lambda: f64,
    },
}

impl Settings {
    /// Checks every number against its range.
    ///
    /// # Errors
    /// The first setting that is out of range.
    pub fn check(&self) -> Result<(), SettingsError> {
        let count = |n: usize| n as f64;
        let share = |x: f64| x > 0.0 && x <= 1.0;
        let gain = |x: f64| (0.0..=10.0).contains(&x);
        let (jitter, feedback) = (self.jitter.unwrap_or_default(), self.feedback.unwrap_or_default());
        let lambda = match self.ridge {
            Ridge::Fixed { lambda } => lambda,
            Ridge::None | Ridge::Evidence => 1.0,
        };
        let confidence = self.confidence > 0.0 && self.confidence < 1.0;
        let rules = [
            (
                "units",
                count(self.units),
                (1..=MAX_UNITS).contains(&self.units),
                "1 to 4096",
            ),
            ("density", self.density, share(self.density), "above 0 and at most 1"),
            (
                "spectral_radius",
                self.spectral_radius,
                share(0.1 * self.spectral_radius),
                "above 0 and at most 10",
            ),
            ("bias_gain", self.bias_gain, gain(self.bias_gain), "0 to 10"),
            ("context_gain", self.context_gain, gain(self.context_gain), "0 to 10"),
            (
                "leak",
                self.leak.unwrap_or(1.0),
                share(self.leak.unwrap_or(1.0)),
                "above 0 and at most 1",
            ),
            (
                "ridge.fixed.lambda",
                lambda,
                lambda > 0.0 && lambda <= 1e12,
                "above 0 and at most 1e12",
            ),
            ("confidence", self.confidence, confidence, "above 0 and below 1"),
            (
                "jitter.deviation",
                jitter.deviation,
                (0.0..=1e6).contains(&jitter.deviation),
                "0 to 1e6",
            ),
            (
                "jitter.copies",
                count(jitter.copies),
                jitter.copies <= MAX_COPIES,
                "0 to 64",
            ),
            ("feedback.gain", feedback.gain, gain(feedback.gain), "0 to 10"),
            (
                "period_s",
                self.period_s,
                self.period_s > 0.0 && self.period_s <= 3600.0,
                "above 0 and at most 3600",
            ),
        ];
        match rules.into_iter().find(|(_, _, legal, _)| !legal) {
            Some((key, value, _, allowed)) => Err(SettingsError { key, value, allowed }),
            None => Ok(()),
        }
    }

    /// What is legal here but seldom wanted.
    #[must_use]
    pub fn warnings(&self) -> Vec<Warning> {
        let gain = self.context_gain;
        let feedback = self.feedback.map_or(0.0, |feedback| feedback.gain);
        let jitter = self
            .jitter
            .is_some_and(|jitter| jitter.copies > 0 && jitter.deviation > 0.0);
        let limit = CONTEXT_GAIN_LIMIT;
        let candidates = [
            (gain > limit, Warning::ContextGain { gain, limit }),
            (
                jitter && gain >= JITTER_GAIN_LIMIT,
                Warning::JitterGain {
                    gain,
                    limit: JITTER_GAIN_LIMIT,
                },
            ),
            (feedback > limit, Warning::FeedbackGain { gain: feedback, limit }),
        ];
        candidates
            .into_iter()
            .filter_map(|(applies, warning)| applies.then_some(warning))
            .collect()
    }

    /// The leak rate for movements of `steps` steps.
    #[must_use]
    pub fn leak_for(&self, steps: usize) -> f64 {
        self.leak.unwrap_or_else(|| (40.0 / steps.max(1) as f64).min(0.3))
    }

    /// How many context and feedback inputs still fit.
    pub(crate) fn inputs_fit(context: usize, outputs: usize) -> bool {
        context.saturating_add(outputs) <= MAX_INPUTS
    }
}
