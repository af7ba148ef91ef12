//! A trial plan: who drives, under which conditions, in which contexts, how often and in which order.
//!
//! ```toml
//! [plan]
//! name = "paper"
//!
//! [conditions]                       # how it is driven: any setting of tandem.toml, and which models
//! fixed = { arbiter.law = "fixed" }
//! adaptive = { arbiter.law = "adaptive" }
//!
//! [contexts]                         # where to: the path that the human wishes to follow
//! a083 = { amplitude_m = 0.083, group = "interpolated" }
//! a165 = { amplitude_m = 0.165, group = "extrapolated" }
//! ```
//!
//! A trial's configuration is laid together from Tandem's defaults, `[setup]`, its condition and its context, the later
//! one counting; all of them spell the keys of `tandem.toml`. What the runner decides itself (the network, the recorder,
//! the pace, the seed of a trial) cannot be set there. The order of trials follows from the plan and the participant's
//! code alone, see [`Plan::slots`].
//!
//! Pure: a text goes in, checked values or an [`Error`](BadPlan) with its place come out.

mod lines;
mod models;
mod order;
mod participant;
mod reach;
mod reading;
mod sections;

use sha2::{Digest, Sha256};
use tandem_settings::{Document, Error, Place};

pub use models::{ModelFault, NoModel};
pub use order::Slot;
pub use participant::{BadCode, Participant};
pub use reach::OutOfReach;
pub use sections::{
    Blocks, ConditionSettings, Conditions, ContextSettings, Contexts, Group, ModelSettings, OrderSettings,
    PauseSettings, PlanSettings, SuccessSettings,
};

use crate::Configuration;

/// A plan that can be run, as far as its text tells.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Name, participants, repetitions and limits.
    pub settings: PlanSettings,
    /// In which order.
    pub order: OrderSettings,
    /// Pauses between trials.
    pub pauses: PauseSettings,
    /// What counts as a success.
    pub success: SuccessSettings,
    /// The conditions, in the order of the text.
    pub conditions: Vec<Condition>,
    /// The contexts, in the order of the text.
    pub contexts: Vec<Context>,
    /// The models that conditions name.
    pub models: Vec<ModelPlan>,
    participants: Vec<Participant>,
    text: String,
    setup: Document,
}

/// One way of driving.
#[derive(Clone, Debug)]
pub struct Condition {
    /// Its name in the plan.
    pub name: String,
    /// Its own keys.
    pub settings: ConditionSettings,
    layer: Document,
}

/// One wish.
#[derive(Clone, Debug)]
pub struct Context {
    /// Its name in the plan.
    pub name: String,
    /// Its own keys.
    pub settings: ContextSettings,
    /// Where the plan names it.
    pub place: Place,
    layer: Document,
}

/// A model that conditions name.
#[derive(Clone, Debug)]
pub struct ModelPlan {
    /// Its name in the plan.
    pub name: String,
    /// How it comes about.
    pub settings: ModelSettings,
    /// Where the plan names it.
    pub place: Place,
}

/// Why a text is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BadPlan {
    /// A key, a section or a value.
    #[error(transparent)]
    Setting(#[from] Error),
    /// No condition or no context.
    #[error("{file}: there is no {what}; add one, such as {example}")]
    Nothing {
        /// The file.
        file: String,
        /// What there is none of.
        what: &'static str,
        /// One that could stand there.
        example: &'static str,
    },
    /// A name that is none.
    #[error("{place}: {name} cannot name a {what}: use 1 to {NAME_MAX} letters, digits, '-' or '_', without quotes")]
    Name {
        /// Where it stands.
        place: Place,
        /// What it should name.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A setting that the runner decides.
    #[error("{place}: {key} cannot be set in a plan: {why}")]
    Owned {
        /// Where it stands.
        place: Place,
        /// The key.
        key: &'static str,
        /// Who decides it.
        why: &'static str,
    },
    /// A participant's code.
    #[error("{file}: plan.participants: {why}")]
    Code {
        /// The file.
        file: String,
        /// What is wrong with it.
        why: BadCode,
    },
    /// A participant twice.
    #[error("{file}: plan.participants names {code} twice")]
    Twice {
        /// The file.
        file: String,
        /// The code.
        code: String,
    },
    /// Simulated humans, but nobody named.
    #[error("{file}: plan.participants is empty; simulated humans need codes, such as participants = [\"S1\"]")]
    Nobody {
        /// The file.
        file: String,
    },
    /// An order that cannot be made.
    #[error(
        "{file}: order.conditions = \"latin-square\" needs at least two conditions, there is {conditions}; \
         use \"fixed\""
    )]
    Latin {
        /// The file.
        file: String,
        /// How many there are.
        conditions: usize,
    },
    /// Too many trials.
    #[error("{file}: {trials} trials for each participant; at most {TRIALS_MAX} are possible: repeat less often")]
    TooMany {
        /// The file.
        file: String,
        /// How many.
        trials: u64,
    },
    /// A model that is nowhere.
    #[error(
        "{file}: condition {condition} names the model {name:?}; known: {}",
        if .known.is_empty() { "none, write one as [models.NAME]".to_owned() } else { .known.join(", ") }
    )]
    UnknownModel {
        /// The file.
        file: String,
        /// The condition.
        condition: String,
        /// The model.
        name: String,
        /// The models there are.
        known: Vec<String>,
    },
    /// A model without a source, or with two.
    #[error("{place}: model {name} needs either a file or demonstrations to train on, and not both")]
    ModelSource {
        /// Where it stands.
        place: Place,
        /// The model.
        name: String,
    },
}

/// Letters of a name.
const NAME_MAX: usize = 32;
/// A run's trials are numbered with at least this many to spare.
const TRIALS_MAX: u64 = 100_000;

impl Plan {
    /// Reads a plan. Errors will call the text `file`.
    ///
    /// # Errors
    /// At the first thing that is wrong, with its place where it has one.
    pub fn parse(file: &str, text: &str) -> Result<Self, BadPlan> {
        reading::read(file, text)
    }

    /// The text that it was read from.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    /// SHA-256 of its text, in hexadecimal digits: two runs with the same hash had the same plan.
    #[must_use]
    pub fn hash(&self) -> String {
        let digest = Sha256::digest(self.text.as_bytes());
        digest.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// Who takes part, if the plan says so.
    #[must_use]
    pub fn participants(&self) -> &[Participant] {
        &self.participants
    }

    /// The configuration of one trial, except for what the runner decides.
    ///
    /// # Errors
    /// If a setting is wrong; a plan that was read has none.
    pub fn configuration(&self, condition: &Condition, context: &Context) -> Result<Configuration, Error> {
        let mut document = self.setup.clone();
        document.lay(&condition.layer);
        document.lay(&context.layer);
        let mut configuration = Configuration::from_document(&document)?;
        configuration.operator.source = self.settings.source;
        configuration.human.amplitude_m = context.settings.amplitude_m;
        configuration.human.time_limit_s = self.settings.time_limit_s;
        Ok(configuration)
    }
}

/// A name that can stand in a file's name, a key and a table.
fn is_name(text: &str, most: usize) -> bool {
    let fits = |b: u8| b.is_ascii_alphanumeric() || b == b'-' || b == b'_';
    (1..=most).contains(&text.len()) && text.bytes().all(fits)
}

/// The beginning of a text that may have any length.
fn shortened(text: &str) -> String {
    const SHOWN: usize = 40;
    match text.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}
