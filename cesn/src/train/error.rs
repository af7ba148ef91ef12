//! What can be wrong with demonstrations and settings.

use crate::forecast::ForecastError;
use crate::regression::FitError;
use crate::reservoir::ReservoirError;
use crate::settings::SettingsError;

/// Why a model cannot be trained.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TrainError {
    /// Fewer than two demonstrations.
    #[error("{found} demonstration(s): at least two with different contexts are needed, or nothing can be generalised")]
    TooFewDemonstrations {
        /// How many were given.
        found: usize,
    },
    /// Two demonstrations name different columns.
    #[error("{other} has the columns {found}, but {first} has {expected}; give all demonstrations the same header")]
    DifferentColumns {
        /// The first demonstration.
        first: String,
        /// The one that differs.
        other: String,
        /// The first one's columns.
        expected: String,
        /// The other one's columns.
        found: String,
    },
    /// Two demonstrations have different lengths.
    #[error("{other} has {found} steps, but {first} has {expected}; resample them to one length")]
    DifferentLengths {
        /// The first demonstration.
        first: String,
        /// The one that differs.
        other: String,
        /// The first one's steps.
        expected: usize,
        /// The other one's steps.
        found: usize,
    },
    /// Two demonstrations have different clocks.
    #[error("{other} has a step every {found_s} s, but {first} every {expected_s} s; resample them to one period")]
    DifferentPeriods {
        /// The first demonstration.
        first: String,
        /// The one that differs.
        other: String,
        /// The first one's period.
        expected_s: f64,
        /// The other one's period.
        found_s: f64,
    },
    /// All contexts are the same, or too large to subtract.
    #[error("the contexts of the demonstrations do not differ; a model of one condition has nothing to interpolate")]
    ContextsDoNotVary,
    /// State feedback in a model that is conditioned anew.
    #[error("a model that is conditioned anew takes no fed-back outputs; leave feedback out")]
    ReplanningWithFeedback,
    /// State feedback of an output that never moves.
    #[error("the outputs of the demonstrations do not vary, so they cannot be fed back")]
    OutputsDoNotVary,
    /// Too many contexts and outputs.
    #[error("{contexts} context and {outputs} output columns are more than the reservoir takes")]
    TooManyColumns {
        /// Context columns.
        contexts: usize,
        /// Output columns.
        outputs: usize,
    },
    /// The checkpoint leaves nothing to forecast.
    #[error("checkpoint_step {checkpoint_step} leaves nothing to forecast in {steps} steps; it must be below {}", steps.saturating_sub(1))]
    Checkpoint {
        /// The setting.
        checkpoint_step: usize,
        /// Steps of the demonstrations.
        steps: usize,
    },
    /// The reservoir given does not fit the settings.
    #[error(
        "the reservoir has {units} units and {inputs} inputs; the settings ask for {wanted_units} and {wanted_inputs}"
    )]
    OtherReservoir {
        /// Units it has.
        units: usize,
        /// Inputs it has.
        inputs: usize,
        /// Units asked for.
        wanted_units: usize,
        /// Inputs asked for.
        wanted_inputs: usize,
    },
    /// No demonstration can be predicted from the others, so the robust interval has no width.
    #[error("leaving a demonstration out has no answer here; choose a larger ridge or the paper's interval")]
    LeaveOneOut,
    /// A setting is out of range.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The reservoir cannot be made.
    #[error(transparent)]
    Reservoir(#[from] ReservoirError),
    /// The regression has no answer.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The trained model cannot forecast its own conditions.
    #[error("the trained model fails on its own conditions")]
    Forecast(#[from] ForecastError),
}
