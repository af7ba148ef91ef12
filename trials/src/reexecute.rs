//! Executing a recorded session again: the same nodes, the same inputs at the same stamps, every output compared.
//!
//! ```text
//!  configuration, seed, session, model ──▶ node ◀── inputs, in the order in which this node saw them
//!                                           │                                      ▲
//!                                           ▼                                      │
//!                                      outputs now ◀── byte for byte ──▶ outputs recorded ── journal
//! ```
//!
//! Each node is fed from its own journal, so a difference in one does not spread to the others, and a node that
//! diverges is the one whose code, settings or arithmetic changed. The recorder is none of them: what it hears is the
//! recording itself. How one journal is followed is in `again.rs`.

use std::collections::BTreeSet;
use std::sync::Arc;

use tandem_cesn::Model;
use tandem_recorder::{Evidence, RecordedNode, Run};
use tandem_settings::Document;
use tandem_wire::{JournalBatch, NodeName, Session, Topic};

use crate::again::{Ran, follow};
use crate::blueprint::Unbuildable;
use crate::verdict::{Findings, Missing, RunFinding, Verdict};
use crate::{Blueprint, Configuration};

/// Executes every run of every node again. `progress` is told now and then how many journal entries of how many
/// are done.
pub fn reexecute(evidence: &Evidence, mut progress: impl FnMut(u64, u64)) -> Findings {
    let parts = evidence.journals.values().flatten();
    let total = parts.map(|part| part.entries.len() as u64).sum();
    let mut done = 0;
    let mut tick = |entries| {
        done += entries;
        progress(done, total);
    };
    let runs = runs(evidence)
        .into_iter()
        .map(|run| judge(evidence, run, &mut tick))
        .collect();
    Findings {
        runs,
        faults: evidence.faults.iter().map(ToString::to_string).collect(),
    }
}

/// All runs that the file knows of, whether by configuration, by journal, or by messages alone.
fn runs(evidence: &Evidence) -> BTreeSet<Run> {
    let known = evidence.nodes.keys().chain(evidence.journals.keys()).copied();
    let heard = evidence.heard.iter().filter_map(|(topic, session)| {
        let (node, session) = (speaker(*topic)?, *session);
        Some(Run { node, session })
    });
    known
        .chain(heard)
        .filter(|run| run.node != NodeName::Recorder)
        .collect()
}

/// The node of the loop that says this at every step: hearing it tells of a run, also of one without a journal.
const fn speaker(topic: Topic) -> Option<NodeName> {
    match topic {
        Topic::Command => Some(NodeName::Operator),
        Topic::Proposal => Some(NodeName::Predictor),
        Topic::Setpoint => Some(NodeName::Arbiter),
        Topic::State => Some(NodeName::RobotSim),
        _ => None,
    }
}

fn judge(evidence: &Evidence, run: Run, tick: &mut dyn FnMut(u64)) -> RunFinding {
    let recorded = evidence.nodes.get(&run);
    let journal = evidence.journals.get(&run).map_or(&[][..], Vec::as_slice);
    // A part without entries only says how far the journal went.
    let executed = match recorded {
        _ if journal.iter().all(|part| part.entries.is_empty()) => Err(Missing::Journal),
        None => Err(Missing::Configuration),
        Some(recorded) => execute(evidence, run, recorded, journal, tick),
    };
    let (verdict, ran) = match executed {
        Ok((verdict, ran)) => (verdict, ran),
        Err(missing) => (Verdict::Incomplete(missing), Ran::default()),
    };
    RunFinding {
        run,
        build: recorded.map(|recorded| recorded.build.clone()),
        verdict,
        steps: ran.steps,
        outputs: ran.outputs,
        snapshots: ran.snapshots,
        span: ran.span,
        stopped: ran.stopped,
        resumed: ran.resumed,
    }
}

fn execute(
    evidence: &Evidence,
    run: Run,
    recorded: &RecordedNode,
    journal: &[JournalBatch],
    tick: &mut dyn FnMut(u64),
) -> Result<(Verdict, Ran), Missing> {
    let models = match run.node {
        NodeName::Predictor => models(evidence, recorded)?,
        _ => Vec::new(),
    };
    let blueprint = blueprint(run.session, recorded, models)?;
    let unbuildable = |why: Unbuildable| Missing::Buildable { why: why.to_string() };
    match run.node {
        NodeName::Operator => follow(|| Ok(blueprint.operator()), journal, tick),
        NodeName::Predictor => follow(|| blueprint.predictor().map_err(unbuildable), journal, tick),
        NodeName::Arbiter => follow(|| blueprint.arbiter().map_err(unbuildable), journal, tick),
        NodeName::RobotSim => follow(|| blueprint.robot_sim().map_err(unbuildable), journal, tick),
        NodeName::Recorder => Err(Missing::Journal),
    }
}

pub(crate) fn models(evidence: &Evidence, recorded: &RecordedNode) -> Result<Vec<Arc<Model>>, Missing> {
    let sha256 = recorded.model.clone();
    let bytes = sha256.as_deref().and_then(|sha256| evidence.model(sha256));
    let bytes = bytes.ok_or(Missing::Model { sha256 })?;
    let models = Model::several_from_bytes(bytes).map_err(|why| Missing::Buildable { why: why.to_string() })?;
    Ok(models.into_iter().map(Arc::new).collect())
}

pub(crate) fn configuration(recorded: &RecordedNode) -> Result<Configuration, Missing> {
    let unreadable = |why: String| Missing::Buildable { why };
    let read = Document::parse("recorded", &recorded.config).and_then(|text| Configuration::from_document(&text));
    let mut configuration = read.map_err(|why| unreadable(why.to_string()))?;
    configuration.rates.seed = recorded.seed;
    Ok(configuration)
}

pub(crate) fn blueprint(
    session: Session,
    recorded: &RecordedNode,
    models: Vec<Arc<Model>>,
) -> Result<Blueprint, Missing> {
    let unreadable = |why: String| Missing::Buildable { why };
    Blueprint::with_models(configuration(recorded)?, session, models).map_err(|why| unreadable(why.to_string()))
}
