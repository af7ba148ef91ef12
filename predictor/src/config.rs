//! The `[predictor]` section, and what a model must be like to serve here.

use std::sync::Arc;

use tandem_cesn::Model;
use tandem_settings::settings;
use tandem_wire::Timing;

use crate::forecast::Following;

settings! {
    /// How a forecast becomes a proposal.
    pub struct PredictorSettings("predictor") {
        /// The model file; none: a model is trained from the shipped demonstrations at start.
        pub model: String = "";
        /// The share of the tool's distance from the forecast that the robot corrects in one step: 1 leads straight to
        /// the forecast's next point, 0 only moves along with it.
        pub correction: f64 = 1.0, in 0.0..=1.0;
        /// The same for distance across the forecast's way, where it moves at 20 mm/s or more; below that it blends over
        /// into the key above. 0 lets the human decide where and the robot when. Never taken above the key above.
        pub correction_across: f64 = 1.0, in 0.0..=1.0;
        /// The fastest the robot proposes to move, in metres per second.
        pub speed_m_s: f64 = 0.5, in 0.01..=1.7;
    }
}

/// Why a model cannot guide this robot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum UnfitModel {
    /// There is none.
    #[error("a predictor needs a model")]
    None,
    /// Two models' checkpoints do not follow each other.
    #[error(
        "two models have their checkpoints at x = {} m, step {}, and x = {} m, step {}; they must follow each other in both",
        planes[0], steps[0], planes[1], steps[1]
    )]
    Checkpoints {
        /// Where they lie, in metres along the task's x.
        planes: [f64; 2],
        /// At which steps of the demonstrations.
        steps: [usize; 2],
    },
    /// Its outputs are no positions in the plane.
    #[error("the model predicts {found} numbers a step ({columns}); guiding the tool in the plane needs x and y")]
    Outputs {
        /// How many it has.
        found: usize,
        /// What they are called.
        columns: String,
    },
    /// Its context is no point in the plane.
    #[error("the model's context has {found} numbers ({columns}); a checkpoint gives one point, x and y")]
    Context {
        /// How many it has.
        found: usize,
        /// What they are called.
        columns: String,
    },
    /// Its positions are in a frame that is not known here.
    #[error("the model's positions are in the frame {found:?}; only \"{TASK}\" has a known place before the robot")]
    Frame {
        /// What the frame is called.
        found: String,
    },
    /// Its steps are not control periods.
    #[error("the model's steps last {model_s} s, the control period {control_s} s; train it at the control period")]
    Period {
        /// Seconds between the model's steps.
        model_s: f64,
        /// Seconds between ticks.
        control_s: f64,
    },
}

/// Checkpoints this close together, in metres, are one.
const APART: f64 = 1e-3;

/// Checks every model by itself, and that their checkpoints follow each other; sorts them so.
pub(crate) fn check_all(models: &mut [Arc<Model>], timing: &Timing) -> Result<(), UnfitModel> {
    if models.is_empty() {
        return Err(UnfitModel::None);
    }
    models.iter().try_for_each(|model| check(model, timing))?;
    models.sort_by(|one, other| one.checkpoint_plane().total_cmp(&other.checkpoint_plane()));
    for pair in models.windows(2) {
        let (before, after) = (&pair[0], &pair[1]);
        let apart = after.checkpoint_plane() - before.checkpoint_plane() >= APART;
        if !apart || after.checkpoint_step() <= before.checkpoint_step() {
            return Err(UnfitModel::Checkpoints {
                planes: [before.checkpoint_plane(), after.checkpoint_plane()],
                steps: [before.checkpoint_step(), after.checkpoint_step()],
            });
        }
    }
    Ok(())
}

/// The one frame a model's positions may be in.
const TASK: &str = "task";
/// Times in demonstration files are rounded, so the model's period may differ from ours by this share.
const PERIOD_TOLERANCE: f64 = 1e-3;

/// Checks that `model` maps a point of the task's plane to positions in it, one per control period.
pub(crate) fn check(model: &Model, timing: &Timing) -> Result<(), UnfitModel> {
    let (outputs, context) = (model.output_columns(), model.context_columns());
    if outputs.len() != 2 {
        let (found, columns) = (outputs.len(), outputs.join(", "));
        return Err(UnfitModel::Outputs { found, columns });
    }
    let expected = model.context_at(0.0, &[0.0; 2]).len();
    if context.len() != expected {
        let (found, columns) = (context.len(), context.join(", "));
        return Err(UnfitModel::Context { found, columns });
    }
    if model.frame() != TASK {
        let found = model.frame().to_owned();
        return Err(UnfitModel::Frame { found });
    }
    let (model_s, control_s) = (model.period_s(), timing.period_s());
    let same = (model_s - control_s).abs() <= PERIOD_TOLERANCE * control_s;
    if same {
        Ok(())
    } else {
        Err(UnfitModel::Period { model_s, control_s })
    }
}

impl PredictorSettings {
    pub(crate) fn following(&self, timing: &Timing) -> Following {
        Following {
            correction: self.correction,
            across: self.correction_across.min(self.correction),
            speed_limit: self.speed_m_s,
            period_s: timing.period_s(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_settings::{Document, show};

    #[test]
    fn the_defaults_read_back_as_they_print() {
        let document = Document::parse("defaults", &show(&PredictorSettings::default())).unwrap();
        assert_eq!(
            document.section::<PredictorSettings>(),
            Ok(PredictorSettings::default())
        );
    }
}
