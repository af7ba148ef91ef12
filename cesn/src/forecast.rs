//! Running a model forward: what is to come of a movement, with intervals.

use serde::{Deserialize, Serialize};

use crate::model::Model;
use crate::replan::Aside;
use crate::reservoir::State;
use crate::update::LANES;

/// Contexts and fed-back outputs further than this from the demonstrations, in half-ranges, are refused.
///
/// The forecast saturates long before; the bound keeps every sum finite.
pub const FARTHEST: f64 = 1e6;

/// What is to come, step by step, with intervals.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, bincode::Encode, bincode::Decode)]
pub struct Forecast {
    first_step: usize,
    outputs: usize,
    mean: Vec<f64>,
    half_width: Vec<f64>,
    ratio: Vec<f64>,
    leverage: Vec<f64>,
}

impl Forecast {
    /// The first step forecast, counted from 0 at the start of the movement.
    #[must_use]
    pub fn first_step(&self) -> usize {
        self.first_step
    }

    /// The steps forecast, in the movement's own count.
    #[must_use]
    pub fn steps(&self) -> std::ops::Range<usize> {
        self.first_step..self.first_step + self.ratio.len()
    }

    /// `Ny`.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// The expected outputs at `step`; none outside the forecast.
    #[must_use]
    pub fn mean(&self, step: usize) -> Option<&[f64]> {
        self.mean.get(self.row(step)?)
    }

    /// The half-width of each output's interval at `step`; none outside the forecast.
    #[must_use]
    pub fn half_width(&self, step: usize) -> Option<&[f64]> {
        self.half_width.get(self.row(step)?)
    }

    /// The half-width at `step` over the largest of the demonstrations there; none outside the forecast.
    #[must_use]
    pub fn ratio(&self, step: usize) -> Option<f64> {
        self.ratio.get(step.checked_sub(self.first_step)?).copied()
    }

    /// `h = zᵀ A⁻¹ z` at `step`.
    #[must_use]
    pub fn leverage(&self, step: usize) -> Option<f64> {
        self.leverage.get(step.checked_sub(self.first_step)?).copied()
    }

    /// The mean of the ratio over all steps forecast.
    #[must_use]
    pub fn mean_ratio(&self) -> f64 {
        self.ratio.iter().sum::<f64>() / self.ratio.len().max(1) as f64
    }

    fn row(&self, step: usize) -> Option<std::ops::Range<usize>> {
        let first = step.checked_sub(self.first_step)?.checked_mul(self.outputs)?;
        Some(first..first.checked_add(self.outputs)?)
    }

    fn resize(&mut self, first_step: usize, steps: usize, outputs: usize) {
        (self.first_step, self.outputs) = (first_step, outputs);
        self.mean.resize(steps * outputs, 0.0);
        self.half_width.resize(steps * outputs, 0.0);
        self.leverage.resize(steps, 0.0);
        self.ratio.resize(steps, 0.0);
    }

    fn is_finite(&self) -> bool {
        self.mean
            .iter()
            .chain(&self.half_width)
            .chain(&self.ratio)
            .all(|x| x.is_finite())
    }
}

/// Why there is no forecast.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ForecastError {
    /// The context has the wrong dimension.
    #[error("the context has {found} numbers; this model takes {expected}")]
    ContextDimension {
        /// Numbers given.
        found: usize,
        /// Numbers wanted.
        expected: usize,
    },
    /// A fed-back output has the wrong dimension.
    #[error("{found} measured numbers do not make whole rows of {expected}")]
    OutputDimension {
        /// Numbers given.
        found: usize,
        /// Numbers wanted.
        expected: usize,
    },
    /// A number is not finite, or beyond anything the demonstrations could say something about.
    #[error("{column} is {value}; it must be finite and within a million half-ranges of the demonstrations")]
    OutOfReach {
        /// The context or output column.
        column: String,
        /// Its value.
        value: f64,
    },
    /// The step lies outside the movement.
    #[error("step {step} is outside the movement, whose steps are 0 to {}", steps.saturating_sub(1))]
    Step {
        /// The step asked for.
        step: usize,
        /// Steps of the movement.
        steps: usize,
    },
    /// Measured outputs for a model that has no use for them.
    #[error("this model was trained without feedback and cannot take measured outputs")]
    NoFeedback,
    /// A stepper was handed another model than it was made for.
    #[error("the stepper was made for a model of another shape")]
    OtherModel,
    /// The model's numbers overflow (a model file made by hand).
    #[error("the forecast is not finite; the model's weights are unusable")]
    NotFinite,
}

/// Makes forecasts one after the other in the same memory.
///
/// ```
/// # use tandem_cesn::{Demonstration, Forecaster, Model, Settings};
/// # let path = |a: f64| (0..60).map(|t| a * f64::from(t) / 59.0).collect();
/// # let one = |a| Demonstration::new("line", &[("context_x", a)], &["y"], path(a), None).unwrap();
/// # let settings = Settings { units: 40, checkpoint_step: 20, ..Settings::default() };
/// # let model = Model::train(&[one(0.8), one(1.0), one(1.2)], &settings)?;
/// let mut forecaster = Forecaster::new(&model);
/// let forecast = forecaster.forecast(&model, &[1.1], model.checkpoint_step() + 1)?;
/// assert_eq!(forecast.steps(), 21..60);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Forecaster {
    state: State,
    input: Vec<f64>,
    before: Vec<f64>,
    tile: Vec<[f64; LANES]>,
    aside: Aside,
    forecast: Forecast,
}

impl Forecaster {
    /// Room for the forecasts of `model`.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        let mut forecast = Forecast::default();
        forecast.resize(0, model.steps(), model.outputs());
        Self {
            state: model.reservoir().rest(),
            input: vec![0.0; model.reservoir().inputs()],
            before: vec![0.0; model.outputs()],
            tile: vec![[0.0; LANES]; model.triangle.padded()],
            aside: Aside::default(),
            forecast,
        }
    }

    /// Forecasts the steps from `first_step` to the last for `context`, starting from rest.
    ///
    /// A model with feedback is fed its own outputs. Costs one update for every step from 0, and one triangular
    /// solve for each eight steps forecast. Does not allocate, unless `model` is larger than the one before.
    ///
    /// # Errors
    /// When the context does not fit the model or the step lies outside the movement.
    pub fn forecast(&mut self, model: &Model, context: &[f64], first_step: usize) -> Result<&Forecast, ForecastError> {
        self.run(model, context, &[], first_step)
    }

    /// Forecasts what follows `measured`, the outputs of the steps 0, 1, … so far, row by row: they are fed back
    /// as long as they last, the model's own outputs after them. The first step forecast is the one after them.
    ///
    /// # Errors
    /// As [`Self::forecast`], and when the model has no feedback or `measured` does not fit it.
    pub fn forecast_after(
        &mut self,
        model: &Model,
        context: &[f64],
        measured: &[f64],
    ) -> Result<&Forecast, ForecastError> {
        let expected = model.outputs();
        if !model.feeds_back() {
            return Err(ForecastError::NoFeedback);
        }
        if !measured.len().is_multiple_of(expected) {
            return Err(ForecastError::OutputDimension {
                found: measured.len(),
                expected,
            });
        }
        for row in measured.chunks_exact(expected) {
            check_output(model, row)?;
        }
        self.run(model, context, measured, measured.len() / expected)
    }

    fn run(
        &mut self,
        model: &Model,
        context: &[f64],
        measured: &[f64],
        first_step: usize,
    ) -> Result<&Forecast, ForecastError> {
        let (steps, outputs) = (model.steps(), model.outputs());
        if first_step >= steps {
            return Err(ForecastError::Step {
                step: first_step,
                steps,
            });
        }
        self.start(model, context)?;
        self.forecast.resize(first_step, steps - first_step, outputs);
        for step in 0..steps {
            self.feed(model, measured, step);
            model.reservoir().update_driven(&mut self.state);
            if step >= first_step {
                self.keep(model, step);
            }
        }
        if self.forecast.is_finite() {
            Ok(&self.forecast)
        } else {
            Err(ForecastError::NotFinite)
        }
    }

    fn start(&mut self, model: &Model, context: &[f64]) -> Result<(), ForecastError> {
        if self.state.activations().len() != model.reservoir().units() {
            self.state = model.reservoir().rest();
        }
        self.tile.resize(model.triangle.padded(), [0.0; LANES]);
        self.tile.fill([0.0; LANES]);
        self.input.resize(model.reservoir().inputs(), 0.0);
        self.before.resize(model.outputs(), 0.0);
        self.state.rest();
        set_context(model, context, &mut self.input, &mut self.aside)?;
        model.reservoir().hold(&mut self.state, &self.input);
        Ok(())
    }

    /// Sets the fed-back half of the input: measured while there is any, the model's own after that.
    fn feed(&mut self, model: &Model, measured: &[f64], step: usize) {
        let Some(feedback) = &model.facts.feedback else { return };
        let outputs = self.before.len();
        match step.checked_sub(1) {
            None if measured.is_empty() => self.before.copy_from_slice(&feedback.start),
            None => self.before.copy_from_slice(&measured[..outputs]),
            Some(last) => match measured.get(last * outputs..(last + 1) * outputs) {
                Some(row) => self.before.copy_from_slice(row),
                None => model.read(&self.state, &mut self.before),
            },
        }
        let contexts = model.facts.context_scale.mean.len();
        feedback.scale.apply(&self.before, &mut self.input[contexts..]);
        model.reservoir().hold(&mut self.state, &self.input);
    }

    /// Collects the state of `step`; every eighth, and the last, settles the whole tile.
    fn keep(&mut self, model: &Model, step: usize) {
        let kept = step - self.forecast.first_step;
        let lane = kept % LANES;
        self.tile[0][lane] = 1.0;
        for (z, x) in self.tile[1..].iter_mut().zip(self.state.activations()) {
            z[lane] = *x;
        }
        if lane == LANES - 1 || step + 1 == model.steps() {
            self.settle(model, kept - lane, lane + 1);
        }
    }

    /// Means, half-widths and ratios of `count` states, the first of which is the forecast's row `first`.
    fn settle(&mut self, model: &Model, first: usize, count: usize) {
        let outputs = model.outputs();
        for k in 0..outputs {
            let means = model.readout.read_tile(k, &self.tile[..model.readout.columns()]);
            for (lane, mean) in means.iter().enumerate().take(count) {
                let shift = self.aside.shift(model, self.forecast.first_step + first + lane, k);
                self.forecast.mean[(first + lane) * outputs + k] = mean + shift;
            }
        }
        let leverages = model.triangle.squared_norms(&mut self.tile);
        for (lane, leverage) in leverages.iter().enumerate().take(count) {
            let row = first + lane;
            let leverage = self.aside.leverage(*leverage);
            for k in 0..outputs {
                self.forecast.half_width[row * outputs + k] = model.calibration().half_width(k, leverage);
            }
            let step = self.forecast.first_step + row;
            self.forecast.leverage[row] = leverage;
            self.forecast.ratio[row] = model.ratio(self.aside.time, step, leverage);
        }
        self.tile.fill([0.0; LANES]);
    }
}

/// Writes the context as the reservoir hears it to the front of `input`, and what it does not hear to `aside`.
pub(crate) fn set_context(
    model: &Model,
    context: &[f64],
    input: &mut [f64],
    aside: &mut Aside,
) -> Result<(), ForecastError> {
    let scale = &model.facts.context_scale;
    let (found, expected) = (context.len(), scale.mean.len());
    if found != expected {
        return Err(ForecastError::ContextDimension { found, expected });
    }
    let held = &mut input[..expected];
    match &model.conditions {
        None => held.copy_from_slice(context),
        Some(conditions) => conditions.relative(context, model.period_s(), scale.half_range, held),
    }
    check_reach(held, scale, model.context_columns())?;
    aside.split(model, context, held);
    for (held, mean) in held.iter_mut().zip(&scale.mean) {
        *held = (*held - mean) / scale.half_range;
    }
    Ok(())
}

pub(crate) fn check_output(model: &Model, row: &[f64]) -> Result<(), ForecastError> {
    let Some(feedback) = &model.facts.feedback else {
        return Err(ForecastError::NoFeedback);
    };
    let (found, expected) = (row.len(), model.outputs());
    if found != expected {
        return Err(ForecastError::OutputDimension { found, expected });
    }
    check_reach(row, &feedback.scale, model.output_columns())
}

fn check_reach(values: &[f64], scale: &crate::Scale, columns: &[String]) -> Result<(), ForecastError> {
    for ((value, mean), column) in values.iter().zip(&scale.mean).zip(columns) {
        let distance = (value - mean).abs() / scale.half_range;
        if distance.is_nan() || distance > FARTHEST {
            return Err(ForecastError::OutOfReach {
                column: column.clone(),
                value: *value,
            });
        }
    }
    Ok(())
}
