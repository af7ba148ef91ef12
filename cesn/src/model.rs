//! A trained model: everything a predictor needs, in one value.

use std::sync::OnceLock;

use crate::forecast::{Forecast, ForecastError, Forecaster};
use crate::interval::{Calibration, Interval, novelty};
use crate::readout::Readout;
use crate::replan::Conditions;
use crate::reservoir::{Reservoir, State};
use crate::scale::Scale;
use crate::settings::{Settings, Warning};
use crate::triangle::Triangle;

/// CESN+, trained.
#[derive(Clone, Debug)]
pub struct Model {
    pub(crate) settings: Settings,
    pub(crate) facts: Facts,
    pub(crate) provenance: Provenance,
    pub(crate) reservoir: Reservoir,
    pub(crate) readout: Readout,
    pub(crate) triangle: Triangle,
    pub(crate) calibration: Calibration,
    /// For a model that is conditioned anew: what its contexts are compared with.
    pub(crate) conditions: Option<Conditions>,
    pub(crate) hash: OnceLock<[u8; 32]>,
}

/// What training found out that is not a weight.
#[derive(Clone, Debug, PartialEq, bincode::Encode, bincode::Decode)]
pub(crate) struct Facts {
    pub(crate) context_columns: Vec<String>,
    pub(crate) output_columns: Vec<String>,
    pub(crate) steps: usize,
    pub(crate) period_s: f64,
    pub(crate) context_scale: Scale,
    pub(crate) feedback: Option<FeedbackFacts>,
    pub(crate) lambda: f64,
    pub(crate) effective_rows: f64,
    pub(crate) edf: f64,
}

/// How outputs are fed back.
#[derive(Clone, Debug, PartialEq, bincode::Encode, bincode::Decode)]
pub(crate) struct FeedbackFacts {
    pub(crate) scale: Scale,
    /// The output "before" the first step: the mean of the demonstrations' first rows.
    pub(crate) start: Vec<f64>,
}

/// Where a model comes from.
#[derive(Clone, Debug, PartialEq, Eq, bincode::Encode, bincode::Decode)]
pub struct Provenance {
    /// The demonstrations, in the order they were given.
    pub sources: Vec<Source>,
    /// The version of this crate that trained it.
    pub crate_version: String,
}

/// One demonstration a model was trained on.
#[derive(Clone, Debug, PartialEq, Eq, bincode::Encode, bincode::Decode)]
pub struct Source {
    /// The file or the name it was given.
    pub name: String,
    /// SHA-256 of its text.
    pub sha256: [u8; 32],
}

impl Model {
    /// Forecasts the steps from `first_step` to the last for `context`, from rest.
    ///
    /// Allocates; a loop should keep a [`Forecaster`].
    ///
    /// # Errors
    /// When the context does not fit the model or the step lies outside the movement.
    pub fn forecast(&self, context: &[f64], first_step: usize) -> Result<Forecast, ForecastError> {
        Forecaster::new(self).forecast(self, context, first_step).cloned()
    }

    /// The interval of one state at `step`. Allocates; see [`Self::interval_into`].
    #[must_use]
    pub fn interval(&self, state: &State, step: usize) -> Interval {
        let mut interval = Interval::new(&self.triangle, self.outputs());
        self.interval_into(state, step, &mut interval);
        interval
    }

    /// The interval of one state at `step`, written over an earlier one without allocating. Costs `p² / 2` products.
    /// Its ratio is that of [`Calibration::ratio`], whenever the condition was.
    pub fn interval_into(&self, state: &State, step: usize, interval: &mut Interval) {
        interval.set(&self.triangle, &self.calibration, state.activations(), step);
    }

    /// How much wider than in training an interval with `leverage` is at `step` under `context`: with conditions at
    /// several times, than under one at this context's time.
    pub(crate) fn ratio(&self, context_time: Option<f64>, step: usize, leverage: f64) -> f64 {
        let conditions = self.conditions.as_ref().zip(context_time);
        let training = conditions.and_then(|(conditions, time)| conditions.training_leverage(time, step));
        match training {
            Some(training) => novelty(leverage, training),
            None => self.calibration.ratio(step, leverage),
        }
    }

    /// `y = W_out [1; x]`, written to `y`.
    pub fn read(&self, state: &State, y: &mut [f64]) {
        self.readout.read(state.activations(), y);
    }

    /// The settings it was trained with, seed included.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// What is legal in its settings but seldom wanted, and what training found wanting.
    #[must_use]
    pub fn warnings(&self) -> Vec<Warning> {
        let mut warnings = self.settings.warnings();
        if self.conditions.is_some() {
            // Its copies have targets of their own.
            warnings.retain(|warning| !matches!(warning, Warning::JitterGain { .. }));
        }
        let (low, high) = crate::evidence::LAMBDA_RANGE;
        let lambda = self.facts.lambda;
        if self.settings.ridge == crate::Ridge::Evidence && (lambda < 1.02 * low || lambda > 0.98 * high) {
            warnings.push(Warning::RidgeAtEnd { lambda });
        }
        warnings
    }

    /// The reservoir.
    #[must_use]
    pub fn reservoir(&self) -> &Reservoir {
        &self.reservoir
    }

    /// Confidence, spreads, training's own leverages and `ρ_hi`.
    #[must_use]
    pub fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    /// Where it comes from.
    #[must_use]
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// `W_out`, `Ny × p`, row by row, the bias first.
    #[must_use]
    pub fn w_out(&self) -> &[f64] {
        self.readout.weights()
    }

    /// Names of the numbers a context holds, in order.
    #[must_use]
    pub fn context_columns(&self) -> &[String] {
        &self.facts.context_columns
    }

    /// Names of the outputs, in order.
    #[must_use]
    pub fn output_columns(&self) -> &[String] {
        &self.facts.output_columns
    }

    /// `Ny`.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.readout.outputs()
    }

    /// `T`, the number of steps of a movement; steps count from 0.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.facts.steps
    }

    /// Seconds between steps.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        self.facts.period_s
    }

    /// The frame that contexts and outputs are in.
    #[must_use]
    pub fn frame(&self) -> &str {
        &self.settings.frame
    }

    /// The step at which the condition is known.
    #[must_use]
    pub fn checkpoint_step(&self) -> usize {
        self.settings.checkpoint_step
    }

    /// The checkpoint plane: the mean of the demonstrations' first context coordinate; of one that is conditioned anew,
    /// of their first output at the checkpoint's step.
    #[must_use]
    pub fn checkpoint_plane(&self) -> f64 {
        let conditioned = self.conditions.as_ref().map(|conditions| {
            let first = self.settings.checkpoint_step * self.outputs();
            conditions.mean_path.get(first)
        });
        let mean = conditioned.unwrap_or(self.facts.context_scale.mean.first());
        mean.copied().unwrap_or(0.0)
    }

    /// How contexts are normalised; its mean is the centre of what the model knows.
    #[must_use]
    pub fn context_scale(&self) -> &Scale {
        &self.facts.context_scale
    }

    /// Whether outputs are fed back as inputs.
    #[must_use]
    pub fn feeds_back(&self) -> bool {
        self.facts.feedback.is_some()
    }

    /// λ, given or found.
    #[must_use]
    pub fn lambda(&self) -> f64 {
        self.facts.lambda
    }

    /// `n = Σ weights` and the effective degrees of freedom.
    #[must_use]
    pub fn rows_and_edf(&self) -> (f64, f64) {
        (self.facts.effective_rows, self.facts.edf)
    }
}
