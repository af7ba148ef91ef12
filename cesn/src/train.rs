//! From demonstrations to a model: check them against each other, normalise, copy with jitter, harvest, solve.

mod error;

use std::sync::OnceLock;

pub use error::TrainError;

use crate::demonstration::Demonstration;
use crate::forecast::{ForecastError, Forecaster};
use crate::interval::{Calibration, SMALLEST_RHO_HI};
use crate::model::{Facts, FeedbackFacts, Model, Provenance, Source};
use crate::random::{generator, normal};
use crate::readout::Readout;
use crate::regression::{Fit, FitError};
use crate::reservoir::Reservoir;
use crate::samples::{Samples, Sequence};
use crate::scale::{Scale, ends_of_principal_axis};
use crate::seeded::Shape;
use crate::settings::{IntervalKind, Settings};
use crate::triangle::Triangle;

/// How far from the mean context `ρ_hi` is measured, in half-ranges of the demonstrations.
pub(crate) const RHO_HI_REACH: f64 = 2.0;

impl Model {
    /// Draws a reservoir from the seed and trains on `demonstrations`.
    ///
    /// # Errors
    /// When the demonstrations do not fit each other, a setting is out of range, or the regression has no answer.
    pub fn train(demonstrations: &[Demonstration], settings: &Settings) -> Result<Self, TrainError> {
        let first = check(demonstrations, settings)?;
        let reservoir = Reservoir::from_seed(&shape(first, settings, first.context().len()), settings.seed)?;
        Self::train_with(reservoir, demonstrations, settings)
    }

    /// Trains on a reservoir that is there already: its weights, its leak and its gains stand.
    ///
    /// # Errors
    /// As [`Self::train`], and when the reservoir has the wrong size.
    pub fn train_with(
        reservoir: Reservoir,
        demonstrations: &[Demonstration],
        settings: &Settings,
    ) -> Result<Self, TrainError> {
        let first = check(demonstrations, settings)?;
        let wanted = shape(first, settings, first.context().len());
        if (reservoir.units(), reservoir.inputs()) != (wanted.units, wanted.inputs) {
            let (units, inputs) = (reservoir.units(), reservoir.inputs());
            let (wanted_units, wanted_inputs) = (wanted.units, wanted.inputs);
            return Err(TrainError::OtherReservoir {
                units,
                inputs,
                wanted_units,
                wanted_inputs,
            });
        }
        let contexts = demonstrations.iter().map(Demonstration::context);
        let context_scale = Scale::of(contexts).ok_or(TrainError::ContextsDoNotVary)?;
        let feedback = settings
            .feedback
            .map(|_| FeedbackFacts::of(demonstrations))
            .transpose()?;
        let sequences = sequences(demonstrations, settings, &context_scale, feedback.as_ref());
        let outputs = first.output_columns().len();
        let samples = Samples::harvest(&reservoir, &sequences, outputs, settings.washout)?;
        let fit = Fit::new(&samples, settings.ridge, settings.bias)?;
        if settings.interval == IntervalKind::Robust && fit.left_out.is_none() {
            return Err(TrainError::LeaveOneOut);
        }
        let facts = facts(first, settings, context_scale, feedback, &fit);
        let copies = settings.jitter.map_or(0, |jitter| jitter.copies);
        let leverages = training_leverages(&fit.leverages, facts.steps, settings.washout, copies);
        let provenance = Provenance::of(demonstrations);
        let mut model = Self::assemble(reservoir, fit, facts, provenance, leverages, settings)?;
        model.calibration.rho_hi = model.measure_rho_hi(demonstrations)?;
        Ok(model)
    }

    /// The parts as a model, whose `ρ_hi` is still to be measured.
    pub(crate) fn assemble(
        reservoir: Reservoir,
        fit: Fit,
        facts: Facts,
        provenance: Provenance,
        training_leverages: Vec<f64>,
        settings: &Settings,
    ) -> Result<Self, TrainError> {
        let no_freedom = FitError::NoDegreesOfFreedom {
            effective_rows: fit.effective_rows,
            edf: fit.edf,
        };
        let calibration = Calibration {
            confidence: settings.confidence,
            kind: settings.interval,
            nu: fit.nu,
            t_quantile: Calibration::t_quantile(settings.confidence, fit.nu).ok_or(no_freedom)?,
            training_leverages,
            s: fit.s,
            s_lodo: fit.left_out.map(|left_out| left_out.s),
            rho_hi: SMALLEST_RHO_HI,
        };
        let no_rows = FitError::NoSamples {
            washout: settings.washout,
        };
        let readout = Readout::new(facts.output_columns.len(), fit.w_out).ok_or(no_rows)?;
        let lower = &fit.factor.lower;
        Ok(Self {
            settings: settings.clone(),
            facts,
            provenance,
            reservoir,
            readout,
            triangle: Triangle::new(lower.nrows(), |row, column| lower[(row, column)]),
            calibration,
            conditions: None,
            hash: OnceLock::new(),
        })
    }

    fn measure_rho_hi(&self, demonstrations: &[Demonstration]) -> Result<f64, ForecastError> {
        let contexts: Vec<&[f64]> = demonstrations.iter().map(Demonstration::context).collect();
        let mut forecaster = Forecaster::new(self);
        let mut total = 0.0;
        for context in ends_of_principal_axis(&contexts, &self.facts.context_scale.mean, RHO_HI_REACH) {
            let forecast = forecaster.forecast(self, &context, self.settings.checkpoint_step + 1)?;
            total += 0.5 * forecast.mean_ratio();
        }
        Ok(total.max(SMALLEST_RHO_HI))
    }
}

impl Provenance {
    pub(crate) fn of(demonstrations: &[Demonstration]) -> Self {
        let source = |d: &Demonstration| Source {
            name: d.name().to_owned(),
            sha256: d.sha256(),
        };
        let crate_version = env!("CARGO_PKG_VERSION").to_owned();
        Self {
            sources: demonstrations.iter().map(source).collect(),
            crate_version,
        }
    }
}

pub(crate) fn facts(
    first: &Demonstration,
    settings: &Settings,
    context_scale: Scale,
    feedback: Option<FeedbackFacts>,
    fit: &Fit,
) -> Facts {
    Facts {
        context_columns: first.context_columns().to_vec(),
        output_columns: first.output_columns().to_vec(),
        steps: first.steps(),
        period_s: first.period_s().unwrap_or(settings.period_s),
        context_scale,
        feedback,
        lambda: fit.lambda,
        effective_rows: fit.effective_rows,
        edf: fit.edf,
    }
}

impl FeedbackFacts {
    fn of(demonstrations: &[Demonstration]) -> Result<Self, TrainError> {
        let scale =
            Scale::of(demonstrations.iter().flat_map(Demonstration::rows)).ok_or(TrainError::OutputsDoNotVary)?;
        let mut start = vec![0.0; scale.mean.len()];
        for first in demonstrations
            .iter()
            .filter_map(|demonstration| demonstration.rows().next())
        {
            start
                .iter_mut()
                .zip(first)
                .for_each(|(start, y)| *start += y / demonstrations.len() as f64);
        }
        Ok(Self { scale, start })
    }
}

pub(crate) fn check<'a>(
    demonstrations: &'a [Demonstration],
    settings: &Settings,
) -> Result<&'a Demonstration, TrainError> {
    settings.check()?;
    let (first, others) = match demonstrations {
        [first, others @ ..] if !others.is_empty() => (first, others),
        few => return Err(TrainError::TooFewDemonstrations { found: few.len() }),
    };
    for other in others {
        check_pair(first, other)?;
    }
    let (contexts, outputs) = (first.context().len(), first.output_columns().len());
    if !Settings::inputs_fit(contexts, outputs) {
        return Err(TrainError::TooManyColumns { contexts, outputs });
    }
    let (checkpoint_step, steps) = (settings.checkpoint_step, first.steps());
    if checkpoint_step >= steps - 1 {
        return Err(TrainError::Checkpoint { checkpoint_step, steps });
    }
    Ok(first)
}

fn check_pair(first: &Demonstration, other: &Demonstration) -> Result<(), TrainError> {
    let columns = |d: &Demonstration| [d.context_columns(), d.output_columns()].concat().join(",");
    let (first_name, other_name) = (first.name().to_owned(), other.name().to_owned());
    let (expected, found) = (columns(first), columns(other));
    if expected != found {
        return Err(TrainError::DifferentColumns {
            first: first_name,
            other: other_name,
            expected,
            found,
        });
    }
    let (expected, found) = (first.steps(), other.steps());
    if expected != found {
        return Err(TrainError::DifferentLengths {
            first: first_name,
            other: other_name,
            expected,
            found,
        });
    }
    let (expected_s, found_s) = (first.period_s().unwrap_or(0.0), other.period_s().unwrap_or(0.0));
    if (expected_s - found_s).abs() > 1e-6 * expected_s.max(found_s) {
        return Err(TrainError::DifferentPeriods {
            first: first_name,
            other: other_name,
            expected_s,
            found_s,
        });
    }
    Ok(())
}

pub(crate) fn shape(first: &Demonstration, settings: &Settings, contexts: usize) -> Shape {
    let mut input_gains = vec![settings.context_gain; contexts];
    if let Some(feedback) = settings.feedback {
        input_gains.resize(contexts + first.output_columns().len(), feedback.gain);
    }
    Shape {
        units: settings.units,
        inputs: input_gains.len(),
        density: settings.density,
        spectral_radius: settings.spectral_radius,
        bias_gain: settings.bias_gain,
        input_gains,
        leak: settings.leak_for(first.steps()),
    }
}

/// Each demonstration followed by its jittered copies, all with weight `1 / (R + 1)`.
fn sequences(
    demonstrations: &[Demonstration],
    settings: &Settings,
    scale: &Scale,
    feedback: Option<&FeedbackFacts>,
) -> Vec<Sequence> {
    let mut rng = generator(settings.seed, "jitter");
    let jitter = settings
        .jitter
        .map_or((0.0, 0), |jitter| (jitter.deviation, jitter.copies));
    let weight = 1.0 / (jitter.1 as f64 + 1.0);
    let mut sequences = Vec::with_capacity(demonstrations.len() * (jitter.1 + 1));
    for (index, demonstration) in demonstrations.iter().enumerate() {
        for copy in 0..=jitter.1 {
            let deviation = if copy == 0 { 0.0 } else { jitter.0 };
            let shaken: Vec<f64> = match copy {
                0 => demonstration.context().to_vec(),
                _ => demonstration
                    .context()
                    .iter()
                    .map(|c| c + deviation * normal(&mut rng))
                    .collect(),
            };
            let inputs = inputs(demonstration, &shaken, scale, feedback);
            let targets = demonstration.rows().flatten().copied().collect();
            sequences.push(Sequence {
                inputs,
                targets,
                weight,
                demonstration: index,
                from: 0,
            });
        }
    }
    sequences
}

/// `[c; y(t − 1)]` for every step, normalised; the output before the first step is the first one.
fn inputs(demonstration: &Demonstration, context: &[f64], scale: &Scale, feedback: Option<&FeedbackFacts>) -> Vec<f64> {
    let contexts = context.len();
    let fed_back = feedback.map_or(0, |feedback| feedback.scale.mean.len());
    let mut inputs = vec![0.0; demonstration.steps() * (contexts + fed_back)];
    let before = demonstration.rows().take(1).chain(demonstration.rows());
    for (input, before) in inputs.chunks_exact_mut(contexts + fed_back).zip(before) {
        let (held, fed) = input.split_at_mut(contexts);
        scale.apply(context, held);
        if let Some(feedback) = feedback {
            feedback.scale.apply(before, fed);
        }
    }
    inputs
}

/// The largest leverage of the clean demonstrations at each step; steps in the washout take the first one kept.
fn training_leverages(leverages: &[f64], steps: usize, washout: usize, copies: usize) -> Vec<f64> {
    let kept = steps.saturating_sub(washout).max(1);
    let clean = || leverages.chunks_exact(kept).step_by(copies + 1);
    let at = |step: usize| clean().map(|one| one[step.saturating_sub(washout)]).fold(0.0, f64::max);
    (0..steps).map(at).collect()
}
