//! The payload of a model file, and what has to hold of it before a model is made of it.

use std::sync::OnceLock;

use super::{ArtefactError, MAX_STEPS, inconsistent};
use crate::interval::Calibration;
use crate::model::{Facts, Model, Provenance};
use crate::readout::Readout;
use crate::replan::Conditions;
use crate::reservoir::{Reservoir, StoredReservoir};
use crate::settings::Settings;
use crate::triangle::{StoredTriangle, Triangle};

/// The payload, in the order it is written.
#[derive(bincode::Encode, bincode::Decode)]
pub(super) struct Stored {
    pub(super) settings: Settings,
    pub(super) facts: Facts,
    pub(super) provenance: Provenance,
    pub(super) reservoir: StoredReservoir,
    pub(super) w_out: Vec<f64>,
    pub(super) triangle: StoredTriangle,
    pub(super) calibration: Calibration,
}

impl Stored {
    /// Builds the model, checking every shape and number that a forecast relies on.
    pub(super) fn into_model(self, conditions: Option<Conditions>) -> Result<Model, ArtefactError> {
        let settings = self.settings;
        settings.check().map_err(|error| inconsistent(error.to_string()))?;
        let reservoir = Reservoir::try_from(self.reservoir).map_err(|error| inconsistent(error.to_string()))?;
        let triangle = Triangle::try_from(self.triangle).map_err(inconsistent)?;
        let outputs = self.facts.output_columns.len();
        let readout = Readout::new(outputs, self.w_out).ok_or_else(|| inconsistent("the readout has no rows"))?;
        check_facts(&self.facts, &settings, &reservoir)?;
        let columns = reservoir.units() + 1;
        require(readout.columns() == columns, "the readout does not fit the reservoir")?;
        require(
            triangle.size() == columns,
            "the triangular factor does not fit the reservoir",
        )?;
        require(
            readout.weights().iter().all(|w| w.is_finite()),
            "the readout holds a number that is not finite",
        )?;
        check_calibration(&self.calibration, &self.facts)?;
        check_conditions(conditions.as_ref(), &self.facts, &settings)?;
        Ok(Model {
            settings,
            facts: self.facts,
            provenance: self.provenance,
            reservoir,
            readout,
            triangle,
            calibration: self.calibration,
            conditions,
            hash: OnceLock::new(),
        })
    }
}

fn check_facts(facts: &Facts, settings: &Settings, reservoir: &Reservoir) -> Result<(), ArtefactError> {
    let (contexts, outputs) = (facts.context_columns.len(), facts.output_columns.len());
    let fed_back = if facts.feedback.is_some() { outputs } else { 0 };
    require(
        settings.units == reservoir.units(),
        "the settings name another number of units",
    )?;
    require(
        reservoir.inputs() == contexts + fed_back,
        "the reservoir does not fit the columns",
    )?;
    require(
        (2..=MAX_STEPS).contains(&facts.steps),
        "the number of steps is out of range",
    )?;
    require(
        settings.checkpoint_step < facts.steps - 1,
        "the checkpoint lies outside the movement",
    )?;
    require(
        facts.period_s.is_finite() && facts.period_s > 0.0,
        "the period is not positive",
    )?;
    let scale_fits = |scale: &crate::Scale, length: usize| {
        scale.mean.len() == length
            && scale.mean.iter().all(|x| x.is_finite())
            && scale.half_range.is_finite()
            && scale.half_range > 0.0
    };
    require(
        contexts > 0 && scale_fits(&facts.context_scale, contexts),
        "the context scale does not fit",
    )?;
    if let Some(feedback) = &facts.feedback {
        let start = feedback.start.len() == outputs && feedback.start.iter().all(|x| x.is_finite());
        require(
            start && scale_fits(&feedback.scale, outputs),
            "the feedback scale does not fit",
        )?;
    }
    let counts = [facts.lambda, facts.effective_rows, facts.edf];
    require(
        counts.iter().all(|x| x.is_finite() && *x >= 0.0),
        "a fact of training is not a number from 0 up",
    )
}

fn check_conditions(conditions: Option<&Conditions>, facts: &Facts, settings: &Settings) -> Result<(), ArtefactError> {
    let Some(conditions) = conditions else { return Ok(()) };
    let outputs = facts.output_columns.len();
    require(
        conditions.fits(settings.checkpoint_step, facts.steps, outputs)
            && facts.context_columns.len() == outputs + 1
            && facts.feedback.is_none(),
        "the conditions do not fit the movement",
    )
}

fn check_calibration(calibration: &Calibration, facts: &Facts) -> Result<(), ArtefactError> {
    let outputs = facts.output_columns.len();
    let usable =
        |numbers: &[f64], length: usize| numbers.len() == length && numbers.iter().all(|x| x.is_finite() && *x >= 0.0);
    let scalars = [
        calibration.confidence,
        calibration.nu,
        calibration.t_quantile,
        calibration.rho_hi,
    ];
    require(usable(&scalars, 4), "a number of the calibration is not usable")?;
    require(
        calibration.rho_hi >= crate::interval::SMALLEST_RHO_HI,
        "rho_hi is below its least value",
    )?;
    require(usable(&calibration.s, outputs), "the spread does not fit the outputs")?;
    let left_out = calibration.s_lodo.as_deref();
    require(
        left_out.is_none_or(|s| usable(s, outputs)),
        "the left-out spread does not fit the outputs",
    )?;
    require(
        usable(&calibration.training_leverages, facts.steps),
        "the training leverages do not fit the steps",
    )
}

fn require(holds: bool, what: &str) -> Result<(), ArtefactError> {
    if holds { Ok(()) } else { Err(inconsistent(what)) }
}
