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
mod sections;

use sha2::{Digest, Sha256};
use tandem_link::LinkSettings;
use tandem_recorder::RecorderSettings;
use tandem_settings::{Document, Error, Place, Section};

pub use models::{ModelFault, NoModel};
pub use order::Slot;
pub use participant::{BadCode, Participant};
pub use reach::OutOfReach;
pub use sections::{
    Blocks, ConditionSettings, Conditions, ContextSettings, Contexts, Group, ModelSettings, OrderSettings,
    PauseSettings, PlanSettings, SuccessSettings,
};

use crate::Configuration;
use crate::drive::DriveSettings;

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
    #[error("{file}: plan.participants: {source}")]
    Code {
        /// The file.
        file: String,
        /// What is wrong with it.
        source: BadCode,
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

/// The sections that conditions, contexts and the setup may give: all but those about the run as a whole.
fn layered() -> impl Iterator<Item = &'static str> {
    let whole = [LinkSettings::NAME, RecorderSettings::NAME, DriveSettings::NAME];
    let sections = Configuration::SECTIONS.into_iter();
    sections.filter(move |section| !whole.contains(section))
}

/// What the runner decides, and why.
const OWNED: [(&str, &str); 6] = [
    ("loop.pace", "simulated humans drive in lockstep, persons in real time"),
    ("loop.seed", "every trial has its own, made from plan.seed"),
    ("loop.first_tick", "trials follow each other"),
    ("operator.source", "write it as plan.source"),
    ("operator.human.wish", "every trial has its own, made from plan.seed"),
    (
        "predictor.model",
        "name the model in [models] and in the condition's models",
    ),
];

impl Plan {
    /// Reads a plan. Errors will call the text `file`.
    ///
    /// # Errors
    /// At the first thing that is wrong, with its place where it has one.
    pub fn parse(file: &str, text: &str) -> Result<Self, BadPlan> {
        let document = Document::parse(file, text)?;
        let reading = Reading {
            file,
            document: &document,
        };
        let plan = Self {
            settings: document.section()?,
            order: document.section()?,
            pauses: document.section()?,
            success: document.section()?,
            conditions: reading.conditions()?,
            contexts: reading.contexts()?,
            models: reading.models()?,
            participants: Vec::new(),
            text: text.to_owned(),
            setup: reading.layer("setup")?,
        };
        reading.check_sections()?;
        reading.check(plan)
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

/// A document on its way to a plan.
struct Reading<'a> {
    file: &'a str,
    document: &'a Document,
}

impl Reading<'_> {
    fn file(&self) -> String {
        self.file.to_owned()
    }

    /// The names below a section, each checked.
    fn names(&self, section: &str, what: &'static str) -> Result<Vec<(String, Place)>, BadPlan> {
        let names = self.document.sections_in(section)?;
        for (name, place) in &names {
            if !is_name(name, NAME_MAX) {
                return Err(BadPlan::Name {
                    place: place.clone(),
                    what,
                    name: shortened(name),
                });
            }
        }
        Ok(names)
    }

    /// A part of the configuration.
    fn layer(&self, section: &str) -> Result<Document, BadPlan> {
        let layer = self.document.below(section);
        for (key, why) in OWNED {
            if let Some(place) = layer.place_of(key) {
                return Err(BadPlan::Owned {
                    place: place.clone(),
                    key,
                    why,
                });
            }
        }
        layer.finish(&layered().collect::<Vec<_>>())?;
        Configuration::from_document(&layer)?;
        Ok(layer)
    }

    fn conditions(&self) -> Result<Vec<Condition>, BadPlan> {
        let names = self.names("conditions", "condition")?;
        let read = names.into_iter().map(|(name, _)| {
            let section = format!("conditions.{name}");
            Ok(Condition {
                settings: self.document.section_at(&section)?,
                layer: self.layer(&section)?,
                name,
            })
        });
        read.collect()
    }

    fn contexts(&self) -> Result<Vec<Context>, BadPlan> {
        let names = self.names("contexts", "context")?;
        let read = names.into_iter().map(|(name, place)| {
            let section = format!("contexts.{name}");
            Ok(Context {
                settings: self.document.section_at(&section)?,
                layer: self.layer(&section)?,
                name,
                place,
            })
        });
        read.collect()
    }

    fn models(&self) -> Result<Vec<ModelPlan>, BadPlan> {
        let names = self.names("models", "model")?;
        let read = names.into_iter().map(|(name, place)| {
            let settings: ModelSettings = self.document.section_at(&format!("models.{name}"))?;
            if settings.file.is_empty() == settings.demonstrations.is_empty() {
                return Err(BadPlan::ModelSource { place, name });
            }
            Ok(ModelPlan { name, settings, place })
        });
        read.collect()
    }

    /// Refuses what belongs to no plan.
    fn check_sections(&self) -> Result<(), BadPlan> {
        let mut known: Vec<String> = [
            PlanSettings::NAME,
            OrderSettings::NAME,
            PauseSettings::NAME,
            SuccessSettings::NAME,
            "setup",
            "conditions",
            "contexts",
            "models",
        ]
        .map(str::to_owned)
        .to_vec();
        let inside = |section: &str| -> Vec<String> { layered().map(|layer| format!("{section}.{layer}")).collect() };
        known.extend(inside("setup"));
        for group in ["conditions", "contexts", "models"] {
            for (name, _) in self.document.sections_in(group)? {
                let section = format!("{group}.{name}");
                known.extend(inside(&section));
                known.push(section);
            }
        }
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        Ok(self.document.finish(&known)?)
    }

    /// Checks what ties several sections together.
    fn check(&self, mut plan: Plan) -> Result<Plan, BadPlan> {
        plan.participants = self.participants(&plan.settings)?;
        let missing = [
            (
                plan.conditions.is_empty(),
                "condition",
                "[conditions.fixed.arbiter] with law = \"fixed\"",
            ),
            (
                plan.contexts.is_empty(),
                "context",
                "[contexts.a083] with amplitude_m = 0.083",
            ),
        ];
        if let Some((_, what, example)) = missing.into_iter().find(|(missing, ..)| *missing) {
            let file = self.file();
            return Err(BadPlan::Nothing { file, what, example });
        }
        let conditions = plan.conditions.len();
        if plan.order.conditions == Conditions::LatinSquare && conditions < 2 {
            let file = self.file();
            return Err(BadPlan::Latin { file, conditions });
        }
        let trials = plan.trials();
        if trials > TRIALS_MAX {
            let file = self.file();
            return Err(BadPlan::TooMany { file, trials });
        }
        for condition in &plan.conditions {
            self.check_models(&plan, condition)?;
            for context in &plan.contexts {
                plan.configuration(condition, context)?;
            }
        }
        Ok(plan)
    }

    fn participants(&self, settings: &PlanSettings) -> Result<Vec<Participant>, BadPlan> {
        let mut participants: Vec<Participant> = Vec::new();
        for code in &settings.participants {
            let participant = code.parse::<Participant>().map_err(|source| BadPlan::Code {
                file: self.file(),
                source,
            })?;
            if participants.contains(&participant) {
                let (file, code) = (self.file(), code.clone());
                return Err(BadPlan::Twice { file, code });
            }
            participants.push(participant);
        }
        if participants.is_empty() && settings.source == tandem_operator::SourceKind::Simulated {
            return Err(BadPlan::Nobody { file: self.file() });
        }
        Ok(participants)
    }

    fn check_models(&self, plan: &Plan, condition: &Condition) -> Result<(), BadPlan> {
        let known = |name: &&String| plan.models.iter().any(|model| model.name == **name);
        match condition.settings.models.iter().find(|name| !known(name)) {
            Some(name) => Err(BadPlan::UnknownModel {
                file: self.file(),
                condition: condition.name.clone(),
                name: shortened(name),
                known: plan.models.iter().map(|model| model.name.clone()).collect(),
            }),
            None => Ok(()),
        }
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
