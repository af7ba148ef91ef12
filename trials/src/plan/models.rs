//! The models that a plan names: read, or trained on the spot.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use tandem_cesn::{ArtefactError, Demonstration, DemonstrationError, Model, Settings, TrainError};
use tandem_settings::Place;

use super::ModelPlan;

/// Why a plan's model is not there.
#[derive(Debug, thiserror::Error)]
#[error("{place}: model {name}")]
pub struct NoModel {
    /// Where the plan names it.
    pub place: Place,
    /// The model.
    pub name: String,
    /// What went wrong.
    pub source: Box<ModelFault>,
}

/// What went wrong with a plan's model.
#[derive(Debug, thiserror::Error)]
pub enum ModelFault {
    /// A file cannot be read.
    #[error("cannot read {}: paths are relative to the plan", .path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The model file is none.
    #[error("{} is not a model that can be used", .path.display())]
    Artefact {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: ArtefactError,
    },
    /// A demonstration is none.
    #[error("a demonstration cannot be used")]
    Demonstration(#[from] DemonstrationError),
    /// The demonstrations end before the checkpoint.
    #[error("{demonstration} ends before checkpoint_step = {step}")]
    TooShort {
        /// The demonstration.
        demonstration: String,
        /// The checkpoint's step.
        step: usize,
    },
    /// The demonstrations give no model.
    #[error("cannot be trained")]
    Training(#[from] TrainError),
}

impl ModelPlan {
    /// Reads the model, or trains it, with paths relative to the folder `base`.
    ///
    /// # Errors
    /// If a file cannot be read or used, or the demonstrations give no model.
    pub fn load(&self, base: &Path) -> Result<Model, NoModel> {
        self.find(base).map_err(|source| NoModel {
            place: self.place.clone(),
            name: self.name.clone(),
            source: Box::new(source),
        })
    }

    fn find(&self, base: &Path) -> Result<Model, ModelFault> {
        let settings = &self.settings;
        if settings.demonstrations.is_empty() {
            let path = base.join(&settings.file);
            let bytes = read(&path)?;
            return Model::from_bytes(&bytes).map_err(|source| ModelFault::Artefact { path, source });
        }
        let step = settings.checkpoint_step;
        let read_one = |name: &String| {
            let path = base.join(name);
            let text = String::from_utf8_lossy(&read(&path)?).into_owned();
            let demonstration = Demonstration::from_csv(&path.display().to_string(), &text)?;
            demonstration.conditioned_at(step).ok_or_else(|| ModelFault::TooShort {
                demonstration: path.display().to_string(),
                step,
            })
        };
        let demonstrations = settings.demonstrations.iter().map(read_one);
        let demonstrations = demonstrations.collect::<Result<Vec<_>, ModelFault>>()?;
        let (replan, seed) = (settings.replan, settings.seed);
        let chosen = |defaults: Settings| Settings {
            checkpoint_step: step,
            seed,
            ..defaults
        };
        Ok(if replan {
            Model::train_replanning(&demonstrations, &chosen(Settings::replanning()))?
        } else {
            Model::train(&demonstrations, &chosen(Settings::default()))?
        })
    }
}

fn read(path: &Path) -> Result<Vec<u8>, ModelFault> {
    let path = path.to_owned();
    fs::read(&path).map_err(|source| ModelFault::Unreadable { path, source })
}
