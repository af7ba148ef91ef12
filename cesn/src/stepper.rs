//! Running a model one step at a time, with its own or the measured output fed back.

use crate::forecast::{ForecastError, check_output, set_context};
use crate::interval::Interval;
use crate::model::Model;
use crate::replan::Aside;
use crate::reservoir::State;

/// What is fed back into the next step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fed<'a> {
    /// The model's own last output; before the first step, the mean of the demonstrations' first rows.
    Own,
    /// The output measured at the step before.
    Measured(&'a [f64]),
}

/// One step's prediction.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// The step, counted from 0.
    pub index: usize,
    /// The expected outputs.
    pub mean: Vec<f64>,
    /// Their interval.
    pub interval: Interval,
}

/// Runs a model one step at a time, with its own or the measured output fed back.
#[derive(Clone, Debug)]
pub struct Stepper {
    state: State,
    input: Vec<f64>,
    aside: Aside,
    step: Step,
    next: usize,
}

impl Stepper {
    /// Starts from rest under `context`.
    ///
    /// # Errors
    /// When the context does not fit the model.
    pub fn new(model: &Model, context: &[f64]) -> Result<Self, ForecastError> {
        let mut input = vec![0.0; model.reservoir().inputs()];
        let mut aside = Aside::default();
        set_context(model, context, &mut input, &mut aside)?;
        let mut state = model.reservoir().rest();
        model.reservoir().hold(&mut state, &input);
        let mean = model
            .facts
            .feedback
            .as_ref()
            .map_or(vec![0.0; model.outputs()], |feedback| feedback.start.clone());
        let interval = Interval::new(&model.triangle, model.outputs());
        Ok(Self {
            state,
            input,
            aside,
            step: Step {
                index: 0,
                mean,
                interval,
            },
            next: 0,
        })
    }

    /// Advances by one step and predicts its outputs. A model without feedback takes [`Fed::Own`] and ignores it.
    ///
    /// # Errors
    /// Past the last step, when the measured output does not fit, or when the model has no feedback to take it.
    pub fn advance(&mut self, model: &Model, fed: Fed<'_>) -> Result<&Step, ForecastError> {
        let shape = (self.state.activations().len(), self.input.len());
        if shape != (model.reservoir().units(), model.reservoir().inputs()) {
            return Err(ForecastError::OtherModel);
        }
        if self.next >= model.steps() {
            return Err(ForecastError::Step {
                step: self.next,
                steps: model.steps(),
            });
        }
        self.feed(model, fed)?;
        model.reservoir().update_driven(&mut self.state);
        self.step.index = self.next;
        self.step.mean.resize(model.outputs(), 0.0);
        model.read(&self.state, &mut self.step.mean);
        let interval = &mut self.step.interval;
        model.interval_into(&self.state, self.next, interval);
        if self.aside.time.is_some() {
            let leverage = self.aside.leverage(interval.leverage);
            interval.leverage = leverage;
            for (k, (mean, half_width)) in self.step.mean.iter_mut().zip(&mut interval.half_width).enumerate() {
                *mean += self.aside.shift(model, self.next, k);
                *half_width = model.calibration().half_width(k, leverage);
            }
            interval.ratio = model.ratio(self.aside.time, self.next, leverage);
        }
        self.next += 1;
        Ok(&self.step)
    }

    /// The reservoir's state after the last step.
    #[must_use]
    pub fn state(&self) -> &State {
        &self.state
    }

    fn feed(&mut self, model: &Model, fed: Fed<'_>) -> Result<(), ForecastError> {
        let before = match (&model.facts.feedback, fed) {
            (None, Fed::Own) => return Ok(()),
            (None, Fed::Measured(_)) => return Err(ForecastError::NoFeedback),
            (Some(_), Fed::Own) => &self.step.mean,
            (Some(_), Fed::Measured(row)) => {
                check_output(model, row)?;
                row
            }
        };
        if let Some(feedback) = &model.facts.feedback {
            let contexts = model.facts.context_scale.mean.len();
            feedback.scale.apply(before, &mut self.input[contexts..]);
            model.reservoir().hold(&mut self.state, &self.input);
        }
        Ok(())
    }
}
