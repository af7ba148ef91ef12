//! A plan read from its file, with its models, and everything about it checked that can be checked before anybody
//! drives.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use tandem_cesn::Model;
use tandem_link::config::PaceName;
use tandem_link::{Clock, fresh_session};
use tandem_operator::SourceKind;
use tandem_trials::plan::{Condition, Participant, Plan, Slot};
use tandem_trials::{Blueprint, Configuration};
use tandem_wire::Stamp;

use crate::configuration::BadConfiguration;
use crate::shipped;

/// A plan that can be run.
pub(crate) struct Prepared {
    pub(crate) plan: Plan,
    /// For each condition its models, one for each checkpoint.
    models: Vec<Vec<Arc<Model>>>,
}

/// Where a plan's trial lies in the run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Begin {
    /// In lockstep: the number of its first control period.
    pub(crate) first_tick: u32,
}

impl Prepared {
    /// Reads a plan and checks it: its text, its models, and that the arm can follow every context.
    pub(crate) fn read(path: &Path) -> anyhow::Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|source| BadConfiguration::NoPlan {
            path: path.to_owned(),
            source,
        })?;
        let plan = Plan::parse(&path.display().to_string(), &text).map_err(BadConfiguration::from)?;
        let base = path.parent().map_or_else(PathBuf::new, Path::to_owned);
        let models = models(&plan, &base)?;
        let prepared = Self { plan, models };
        for context in &prepared.plan.contexts {
            prepared.plan.check_reach(context).map_err(BadConfiguration::from)?;
        }
        prepared.check_nodes()?;
        Ok(prepared)
    }

    /// Builds every condition's nodes once: what does not fit together is known now.
    fn check_nodes(&self) -> anyhow::Result<()> {
        for (index, condition) in self.plan.conditions.iter().enumerate() {
            let slot = Slot {
                number: 1,
                practice: false,
                condition: index,
                context: 0,
                repetition: 1,
                seed: 1,
            };
            let blueprint = self.blueprint(&slot, Begin { first_tick: 0 })?;
            let built = blueprint
                .predictor()
                .map(drop)
                .and_then(|()| blueprint.arbiter().map(drop))
                .and_then(|()| blueprint.robot_sim().map(drop));
            built.map_err(|source| BadConfiguration::Condition {
                condition: condition.name.clone(),
                source,
            })?;
        }
        Ok(())
    }

    /// Whether simulated humans drive.
    pub(crate) fn is_simulated(&self) -> bool {
        self.plan.settings.source == SourceKind::Simulated
    }

    /// What a slot's nodes are built from, in a session of their own.
    pub(crate) fn blueprint(&self, slot: &Slot, begin: Begin) -> anyhow::Result<Blueprint> {
        let configuration = self.configuration(slot, begin)?;
        let models = self.models[slot.condition].clone();
        Ok(Blueprint::with_models(configuration, fresh_session(), models).map_err(BadConfiguration::from)?)
    }

    /// A slot's whole configuration.
    pub(crate) fn configuration(&self, slot: &Slot, begin: Begin) -> anyhow::Result<Configuration> {
        let plan = &self.plan;
        let laid = plan.configuration(&plan.conditions[slot.condition], &plan.contexts[slot.context]);
        let mut configuration = laid.map_err(BadConfiguration::from)?;
        let rates = &mut configuration.rates;
        rates.seed = slot.seed;
        rates.first_tick = begin.first_tick;
        rates.pace = match plan.settings.source {
            SourceKind::Simulated => plan.settings.pace,
            _ => PaceName::Real,
        };
        configuration.human.wish = 1;
        // A plan tells outages from the trial's begin, which is about now; a receiver by its clock. And every trial has a
        // bad line of its own, the same under every condition that has this one.
        let begin = match rates.pace {
            PaceName::Real => Clock::of_process().now(),
            PaceName::Max => Stamp::of_tick(begin.first_tick, rates.timing().period),
        };
        configuration.impairment = configuration.impairment.of_trial(slot.seed, begin);
        Ok(configuration)
    }

    /// Whose trials are run: the one that is named, or else all of the plan.
    pub(crate) fn participants(&self, named: Option<&str>) -> Result<Vec<Participant>, BadConfiguration> {
        let listed = self.plan.participants();
        let Some(code) = named else {
            return if self.is_simulated() {
                Ok(listed.to_vec())
            } else {
                let what = "a person drives: say who, as in --participant P01".to_owned();
                Err(BadConfiguration::Conflict(what))
            };
        };
        let participant: Participant = code.parse()?;
        if listed.is_empty() || listed.contains(&participant) {
            Ok(vec![participant])
        } else {
            let known: Vec<&str> = listed.iter().map(Participant::as_str).collect();
            let what = format!(
                "{participant} is no participant of the plan; known: {}",
                known.join(", ")
            );
            Err(BadConfiguration::Conflict(what))
        }
    }
}

/// Every condition's models; one that several name is read or trained once.
fn models(plan: &Plan, base: &Path) -> anyhow::Result<Vec<Vec<Arc<Model>>>> {
    let mut named: Vec<(&str, Arc<Model>)> = Vec::new();
    for model in &plan.models {
        let is_used = |condition: &Condition| condition.settings.models.contains(&model.name);
        if plan.conditions.iter().any(is_used) {
            eprintln!("tandem: the model {} is read or trained", model.name);
            let loaded = model.load(base).map_err(BadConfiguration::from)?;
            named.push((&model.name, Arc::new(loaded)));
        }
    }
    let mut shipped: Option<Arc<Model>> = None;
    let mut models = Vec::new();
    for condition in &plan.conditions {
        let names = &condition.settings.models;
        if names.is_empty() {
            let model = match &shipped {
                Some(model) => Arc::clone(model),
                None => Arc::clone(shipped.insert(Arc::new(shipped::model()?))),
            };
            models.push(vec![model]);
        } else {
            let wanted = |name: &String| named.iter().find(|(known, _)| known == name);
            models.push(
                names
                    .iter()
                    .filter_map(wanted)
                    .map(|(_, model)| Arc::clone(model))
                    .collect(),
            );
        }
    }
    Ok(models)
}
