//! From a configuration to nodes, for whoever runs them and for whoever runs them again.

use std::sync::Arc;

use tandem_arbiter::{Arbiter, WorkspaceTurnedOver};
use tandem_cesn::Model;
use tandem_link::config::CrookedAxes;
use tandem_operator::Operator;
use tandem_predictor::{Predictor, UnfitModel};
use tandem_robot_sim::{RobotSim, UnusableScene};
use tandem_wire::{Session, TaskFrame, Timing};

use crate::Configuration;

/// What the nodes of one process are built from: the same blueprint gives the same nodes.
#[derive(Clone)]
pub struct Blueprint {
    configuration: Configuration,
    session: Session,
    timing: Timing,
    frame: TaskFrame,
    models: Vec<Arc<Model>>,
}

/// Settings that are each right and cannot be right together.
#[derive(Debug, thiserror::Error)]
pub enum Unbuildable {
    /// The task's axes.
    #[error(transparent)]
    Frame(#[from] CrookedAxes),
    /// The arbiter's.
    #[error(transparent)]
    Arbiter(#[from] WorkspaceTurnedOver),
    /// The robot's.
    #[error(transparent)]
    RobotSim(#[from] UnusableScene),
    /// The predictor's model does not fit the task.
    #[error(transparent)]
    Predictor(#[from] UnfitModel),
    /// There is no model.
    #[error("a predictor needs a model")]
    NoModel,
}

impl Blueprint {
    /// The blueprint of the nodes that number their messages in `session`; only a predictor needs the model.
    ///
    /// # Errors
    /// If the task's axes do not span a plane.
    pub fn new(configuration: Configuration, session: Session, model: Option<Model>) -> Result<Self, Unbuildable> {
        Self::with_models(configuration, session, model.map(Arc::new).into_iter().collect())
    }

    /// The same with a model for each of several checkpoints, or none.
    ///
    /// # Errors
    /// If the task's axes do not span a plane.
    pub fn with_models(
        configuration: Configuration,
        session: Session,
        models: Vec<Arc<Model>>,
    ) -> Result<Self, Unbuildable> {
        Ok(Self {
            session,
            timing: configuration.rates.timing(),
            frame: configuration.task.frame()?,
            models,
            configuration,
        })
    }

    /// The same run and model under other settings; the model is shared.
    ///
    /// # Errors
    /// If the task's axes do not span a plane.
    pub fn with_configuration(&self, configuration: Configuration) -> Result<Self, Unbuildable> {
        let fresh = Self::new(configuration, self.session, None)?;
        Ok(Self {
            models: self.models.clone(),
            ..fresh
        })
    }

    /// The settings that it was made from.
    #[must_use]
    pub const fn configuration(&self) -> &Configuration {
        &self.configuration
    }

    /// The run that the nodes belong to.
    #[must_use]
    pub const fn session(&self) -> Session {
        self.session
    }

    /// Rates and limits in time.
    #[must_use]
    pub const fn timing(&self) -> Timing {
        self.timing
    }

    /// The predictor's models, one for each checkpoint.
    #[must_use]
    pub fn models(&self) -> &[Arc<Model>] {
        &self.models
    }

    /// Their files one after the other, as a recording keeps them and
    /// [`Model::several_from_bytes`] reads them.
    #[must_use]
    pub fn model_bytes(&self) -> Vec<u8> {
        self.models.iter().flat_map(|model| model.to_bytes()).collect()
    }

    /// The operator.
    #[must_use]
    pub fn operator(&self) -> Operator {
        let Configuration {
            operator, human, rates, ..
        } = &self.configuration;
        Operator::new(self.session, self.timing, self.frame, rates.seed, operator, human)
    }

    /// The predictor.
    ///
    /// # Errors
    /// If there is no model, or it is one for another task.
    pub fn predictor(&self) -> Result<Predictor, Unbuildable> {
        if self.models.is_empty() {
            return Err(Unbuildable::NoModel);
        }
        let (models, settings) = (self.models.clone(), &self.configuration.predictor);
        Ok(Predictor::with_models(
            self.session,
            self.timing,
            self.frame,
            models,
            settings,
        )?)
    }

    /// The arbiter.
    ///
    /// # Errors
    /// If its workspace is turned over.
    pub fn arbiter(&self) -> Result<Arbiter, Unbuildable> {
        Ok(Arbiter::new(self.session, self.timing, &self.configuration.arbiter)?)
    }

    /// The simulated robot.
    ///
    /// # Errors
    /// If the arm cannot stand in its scene.
    pub fn robot_sim(&self) -> Result<RobotSim, Unbuildable> {
        Ok(RobotSim::new(self.session, self.timing, &self.configuration.robot)?)
    }
}
