//! Models that are conditioned anew while the movement goes on: the context is a time and where the movement was then.
//!
//! Every demonstration is learnt under the conditions of [`CONDITIONS`] of its steps, evenly from the checkpoint on;
//! under each only the steps that follow, since what lies behind a condition cannot always be told from it. The context
//! is `[time, position]`; the reservoir hears
//!
//! ```text
//! [ (t_c − t_mid) / t_half,  (p_c − p̄(t_c)) / d ]
//! ```
//!
//! with `t_mid ± t_half` the conditions' span, `p̄` the demonstrations' mean path and `d` half their largest range at
//! any one condition: a factor for time, which has no noise, and *one* factor for all positions, which have. Positions
//! count from the mean path because where a movement is along its way hardly differs from the time.
//!
//! # What a departure means
//!
//! Where the demonstrations differ, a position off their mean says which of them it is like. Elsewhere, and across
//! what they differ in, they say nothing, and a model fitted to them alone invents metres. The jittered copies say it
//! instead: one that is `δ` off at its condition is learnt with the target
//!
//! ```text
//! y(t) + δ · (1 − u)² (1 + 2u)          u = (t − t_c) / (T − 1 − t_c)
//! ```
//!
//! so a movement that is off stays off at first and comes back smoothly by its end, and a forecast begins where the
//! movement is. The jitter's deviation is how large such departures are taken to be, against the demonstrations' own
//! spread at that time. Copies come in pairs, one on either side.
//!
//! Further than 1.5 half-ranges from the mean path nothing was taught at all. There the reservoir hears a position
//! at that distance in the same direction; the rest is added to the forecast, coming back as above, and the leverage
//! counted up with the square of the distance. So no departure, however large, runs away.
//!
//! # Intervals
//!
//! Rows of every condition count (`1/(R+1)` for copies), so `ν` sees a step of a demonstration as often as it is
//! learnt; leaving one out leaves out all its conditions, so `s_lodo`, which the robust interval uses, is not
//! flattered. The ratio compares like with like: `h_train(t_c, t)` is the largest leverage at step `t` of the clean
//! demonstrations under conditions at `t_c`, linear between steps. (A late step is much less certain from the checkpoint
//! than from just before it; compared with the largest of all conditions, what is new just before it looked known.)
//! `ρ_hi` is measured under the first condition, at the checkpoint, as for a model of one checkpoint: later the
//! demonstrations run together, and twice their range is nothing new.
//!
//! A departure of the size of the jitter is no novelty: the copies have taught it. So the ratio stays near one for a
//! few centimetres, and grows with the square of what lies beyond.

mod conditions;

use crate::demonstration::Demonstration;
use crate::forecast::{ForecastError, Forecaster};
use crate::model::{Model, Provenance};
use crate::random::{generator, normal};
use crate::regression::Fit;
use crate::reservoir::Reservoir;
use crate::samples::{Samples, Sequence};
use crate::scale::{Scale, ends_of_principal_axis};
use crate::settings::{IntervalKind, Jitter, Settings};
use crate::train::{RHO_HI_REACH, TrainError, check, facts, shape};
pub use conditions::CONDITIONS;
pub(crate) use conditions::Conditions;
use conditions::floor;

/// How far from the mean path the reservoir hears a position to be, at most, in half-ranges of the demonstrations.
const REACH: f64 = 1.5;

/// The share of a departure that is left at `step` of one made at `condition`.
fn remaining(step: usize, condition: f64, steps: usize) -> f64 {
    let way = (steps as f64 - 1.0 - condition).max(1.0);
    let u = ((step as f64 - condition) / way).clamp(0.0, 1.0);
    (1.0 - u) * (1.0 - u) * (1.0 + 2.0 * u)
}

/// What of a context the reservoir does not hear. Empty for a model of one checkpoint.
#[derive(Clone, Debug, Default)]
pub(crate) struct Aside {
    /// When the condition was, in steps.
    pub(crate) time: Option<f64>,
    /// How far it lies from the mean path, by how far the reservoir hears it does.
    stretch: f64,
    /// What lies beyond [`REACH`], one number for each output.
    beyond: Vec<f64>,
}

impl Aside {
    /// Keeps what lies beyond [`REACH`] of `held`, which is `[time, position − mean path]`, and leaves the rest there.
    pub(crate) fn split(&mut self, model: &Model, context: &[f64], held: &mut [f64]) {
        self.beyond.clear();
        let (time, offsets) = (context.first(), held.get_mut(1..).unwrap_or_default());
        self.time = model.conditions.as_ref().and(time).map(|time| time / model.period_s());
        if self.time.is_none() {
            return;
        }
        let distance = offsets.iter().map(|offset| offset * offset).sum::<f64>().sqrt();
        self.stretch = (distance / (REACH * model.facts.context_scale.half_range)).max(1.0);
        for offset in offsets {
            let heard = *offset / self.stretch;
            self.beyond.push(*offset - heard);
            *offset = heard;
        }
    }

    /// What is left at `step` of output `k`'s part that lies beyond.
    pub(crate) fn shift(&self, model: &Model, step: usize, k: usize) -> f64 {
        let part = self.time.zip(self.beyond.get(k));
        part.map_or(0.0, |(time, beyond)| beyond * remaining(step, time, model.steps()))
    }

    /// The leverage of the whole context, of that of what was heard: the states are nearly linear in small contexts.
    pub(crate) fn leverage(&self, heard: f64) -> f64 {
        match self.time {
            Some(_) => heard * self.stretch * self.stretch,
            None => heard,
        }
    }
}

impl Settings {
    /// What works for a model that is conditioned anew: eight pairs of copies 15 mm off, which say how departures go on.
    ///
    /// Whoever follows such a forecast becomes its next condition, so an error that grows with the departure runs away.
    /// Of 192 ways from up to 120 mm off the planar task's paths, followed blindly, 34 ran away with a gain of .01 and
    /// two pairs 10 mm off, 5 with .003 and four pairs at 15 mm, none with eight.
    #[must_use]
    pub fn replanning() -> Self {
        Self {
            context_gain: 0.003,
            jitter: Some(Jitter {
                deviation: 0.015,
                copies: 16,
            }),
            ..Self::default()
        }
    }
}

impl Model {
    /// Trains a model that can be conditioned anew while the movement goes on; see the [module's page](self). Of the
    /// demonstrations only the outputs count, their own contexts do not. [`Settings::replanning`] are settings for it.
    ///
    /// # Errors
    /// As [`Self::train`], and when outputs are to be fed back.
    pub fn train_replanning(demonstrations: &[Demonstration], settings: &Settings) -> Result<Self, TrainError> {
        let first = check(demonstrations, settings)?;
        if settings.feedback.is_some() {
            return Err(TrainError::ReplanningWithFeedback);
        }
        let (steps, outputs) = (first.steps(), first.output_columns().len());
        let contexts = outputs + 1;
        if !Settings::inputs_fit(contexts, 0) {
            return Err(TrainError::TooManyColumns { contexts, outputs });
        }
        let conditions = Conditions::of(demonstrations, settings.checkpoint_step, steps);
        let scale = Scale {
            mean: vec![0.0; contexts],
            half_range: half_range(demonstrations, &conditions).ok_or(TrainError::ContextsDoNotVary)?,
        };
        let reservoir = Reservoir::from_seed(&shape(first, settings, contexts), settings.seed)?;
        let sequences = sequences(demonstrations, settings, &conditions, &scale);
        let samples = Samples::harvest(&reservoir, &sequences, outputs, settings.washout)?;
        let fit = Fit::new(&samples, settings.ridge, settings.bias)?;
        if settings.interval == IntervalKind::Robust && fit.left_out.is_none() {
            return Err(TrainError::LeaveOneOut);
        }
        let mut facts = facts(first, settings, scale, None, &fit);
        let positions = first.output_columns().iter().map(|column| format!("context_{column}"));
        facts.context_columns = std::iter::once("context_time_s".to_owned()).chain(positions).collect();
        let mut model = Self::assemble(
            reservoir,
            fit,
            facts,
            Provenance::of(demonstrations),
            vec![0.0; steps],
            settings,
        )?;
        model.conditions = Some(conditions);
        model.measure_training_leverages(demonstrations)?;
        model.calibrate(demonstrations)?;
        Ok(model)
    }

    /// Measures `h_train` under conditions at every step, and its largest over all of them.
    fn measure_training_leverages(&mut self, demonstrations: &[Demonstration]) -> Result<(), ForecastError> {
        let Some(Conditions { first, last, .. }) = self.conditions else {
            return Ok(());
        };
        let mut forecaster = Forecaster::new(self);
        let mut table = Vec::with_capacity((last - first + 1) * self.steps());
        for at in first..=last {
            let mut largest = vec![0.0_f64; self.steps()];
            for position in demonstrations.iter().filter_map(|one| one.rows().nth(at)) {
                let context = self.context_at(at as f64, position);
                let forecast = forecaster.forecast(self, &context, at)?;
                for (step, largest) in largest.iter_mut().enumerate() {
                    *largest = largest.max(forecast.leverage(step.max(at)).unwrap_or(0.0));
                }
            }
            table.extend(largest);
        }
        for row in table.chunks_exact(self.steps()) {
            let overall = self.calibration.training_leverages.iter_mut();
            overall.zip(row).for_each(|(overall, one)| *overall = overall.max(*one));
        }
        if let Some(conditions) = &mut self.conditions {
            conditions.training_leverages = table;
        }
        Ok(())
    }

    /// Measures `ρ_hi` under the condition at the checkpoint.
    fn calibrate(&mut self, demonstrations: &[Demonstration]) -> Result<(), ForecastError> {
        let checkpoint = self.settings.checkpoint_step;
        let rows: Vec<&[f64]> = demonstrations
            .iter()
            .filter_map(|one| one.rows().nth(checkpoint))
            .collect();
        let outputs = self.outputs();
        let Some(mean) = self.conditions.as_ref().and_then(|conditions| {
            let from = checkpoint * outputs;
            conditions.mean_path.get(from..from + outputs).map(<[f64]>::to_vec)
        }) else {
            return Ok(());
        };
        let mut forecaster = Forecaster::new(self);
        let mut total = 0.0;
        for position in ends_of_principal_axis(&rows, &mean, RHO_HI_REACH) {
            let context = self.context_at(checkpoint as f64, &position);
            total += 0.5 * forecaster.forecast(self, &context, checkpoint + 1)?.mean_ratio();
        }
        self.calibration.rho_hi = total.max(crate::interval::SMALLEST_RHO_HI);
        Ok(())
    }

    /// The last step at which it can be conditioned; none for a model of one checkpoint.
    #[must_use]
    pub fn last_condition_step(&self) -> Option<usize> {
        self.conditions.as_ref().map(|conditions| conditions.last)
    }

    /// The first step that follows from `context`: the checkpoint's; of a model that is conditioned anew, the one under
    /// way at the context's time.
    #[must_use]
    pub fn first_step(&self, context: &[f64]) -> usize {
        let (first, last) = (self.checkpoint_step(), self.last_condition_step());
        let time = self
            .conditions
            .as_ref()
            .and(context.first())
            .map(|time| time / self.period_s())
            .zip(last);
        // A time that was written in decimals may lie a hair before its step.
        time.map_or(first, |(time, last)| floor(time + 1e-6).clamp(first, last))
    }

    /// The context of a movement that was at `position` at `step`, which may lie between two steps: with the time in
    /// front, in seconds, where the model wants to know it.
    #[must_use]
    pub fn context_at(&self, step: f64, position: &[f64]) -> Vec<f64> {
        let time = self.conditions.as_ref().map(|_| step * self.period_s());
        time.into_iter().chain(position.iter().copied()).collect()
    }
}

/// Half the largest range of any output over the demonstrations at one condition's step.
fn half_range(demonstrations: &[Demonstration], conditions: &Conditions) -> Option<f64> {
    let mut largest = 0.0_f64;
    for step in conditions.steps() {
        let rows = || demonstrations.iter().filter_map(move |one| one.rows().nth(step));
        for k in 0..rows().next()?.len() {
            let values = || rows().map(move |row| row[k]);
            largest = largest.max(values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min));
        }
    }
    (largest > 0.0 && largest.is_finite()).then_some(0.5 * largest)
}

/// Each demonstration under each condition, followed by its copies there, all with weight `1 / (R + 1)`.
fn sequences(
    demonstrations: &[Demonstration],
    settings: &Settings,
    conditions: &Conditions,
    scale: &Scale,
) -> Vec<Sequence> {
    let mut rng = generator(settings.seed, "jitter");
    let (deviation, copies) = settings
        .jitter
        .map_or((0.0, 0), |jitter| (jitter.deviation, jitter.copies));
    let mut sequences = Vec::new();
    for (index, demonstration) in demonstrations.iter().enumerate() {
        let (steps, outputs) = (demonstration.steps(), demonstration.output_columns().len());
        for from in conditions.steps() {
            let mut shift = vec![0.0; outputs];
            for copy in 0..=copies {
                // Copies come in pairs, one as far aside as the other on the other side: no side is taught more.
                if copy % 2 == 1 {
                    shift.fill_with(|| deviation * normal(&mut rng));
                } else {
                    shift.iter_mut().for_each(|shift| *shift = -*shift);
                }
                let row = demonstration.rows().nth(from).into_iter().flatten();
                let offsets = row.zip(&shift).enumerate();
                let offset = offsets.map(|(k, (y, shift))| y + shift - conditions.mean_at(from as f64, k, outputs));
                let time = conditions.time(from as f64) * scale.half_range;
                let relative: Vec<f64> = std::iter::once(time).chain(offset).collect();
                let mut input = vec![0.0; outputs + 1];
                scale.apply(&relative, &mut input);
                let shifted = demonstration.rows().enumerate().flat_map(|(step, row)| {
                    let left = remaining(step, from as f64, steps);
                    row.iter().zip(&shift).map(move |(y, shift)| y + left * shift)
                });
                sequences.push(Sequence {
                    inputs: input.repeat(steps),
                    targets: shifted.collect(),
                    weight: 1.0 / (copies as f64 + 1.0),
                    demonstration: index,
                    from,
                });
            }
        }
    }
    sequences
}
