//! From a text to a plan: every section read, every name and key checked, and what ties several of them together.

use tandem_link::LinkSettings;
use tandem_operator::SourceKind;
use tandem_recorder::RecorderSettings;
use tandem_settings::{Document, Place, Section};

use super::{
    BadPlan, Condition, Conditions, Context, ModelPlan, ModelSettings, NAME_MAX, OrderSettings, Participant,
    PauseSettings, Plan, PlanSettings, SuccessSettings, TRIALS_MAX, is_name, shortened,
};
use crate::Configuration;
use crate::drive::DriveSettings;

/// Reads a plan; errors will call the text `file`.
pub(super) fn read(file: &str, text: &str) -> Result<Plan, BadPlan> {
    let document = Document::parse(file, text)?;
    let reading = Reading {
        file,
        document: &document,
    };
    let plan = Plan {
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
            let participant = code
                .parse::<Participant>()
                .map_err(|why| BadPlan::Code { file: self.file(), why })?;
            if participants.contains(&participant) {
                let (file, code) = (self.file(), code.clone());
                return Err(BadPlan::Twice { file, code });
            }
            participants.push(participant);
        }
        if participants.is_empty() && settings.source == SourceKind::Simulated {
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
