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
//! recording itself.

use std::collections::{BTreeSet, VecDeque};

use tandem_cesn::Model;
use tandem_recorder::{Evidence, RecordedNode, Run};
use tandem_settings::Document;
use tandem_wire::{
    Happening, Input, JournalBatch, JournalEntry, Nanos, Node, NodeName, Outbox, Ports, Session, Stamp, Topic,
};

use crate::fields::{Comparison, compare};
use crate::verdict::{Difference, Divergence, Findings, Missing, RunFinding, Verdict};
use crate::{Blueprint, Configuration};

/// The nodes of the loop, and what each says at every step: hearing that tells of a node without a journal.
const LOOP: [(NodeName, Topic); 4] = [
    (NodeName::Operator, Topic::Command),
    (NodeName::Predictor, Topic::Proposal),
    (NodeName::Arbiter, Topic::Setpoint),
    (NodeName::RobotSim, Topic::State),
];

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
    let known = evidence.nodes.keys().chain(evidence.journals.keys());
    let mut runs: BTreeSet<Run> = known.copied().filter(|run| run.node != NodeName::Recorder).collect();
    for (node, topic) in LOOP {
        if evidence.heard.contains(&topic) && !runs.iter().any(|run| run.node == node) {
            let session = Session(0);
            runs.insert(Run { node, session });
        }
    }
    runs
}

fn judge(evidence: &Evidence, run: Run, tick: &mut dyn FnMut(u64)) -> RunFinding {
    let recorded = evidence.nodes.get(&run);
    let journal = evidence.journals.get(&run).map_or(&[][..], Vec::as_slice);
    let executed = match (recorded, journal) {
        (_, []) => Err(Missing::Journal),
        (None, _) => Err(Missing::Configuration),
        (Some(recorded), _) => execute(evidence, run, recorded, journal, tick),
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
        span: ran.span(),
        stopped: ran.stopped,
    }
}

fn execute(
    evidence: &Evidence,
    run: Run,
    recorded: &RecordedNode,
    journal: &[JournalBatch],
    tick: &mut dyn FnMut(u64),
) -> Result<(Verdict, Ran), Missing> {
    let unbuildable = |why: &dyn std::error::Error| Missing::Buildable { why: why.to_string() };
    let model = match run.node {
        NodeName::Predictor => Some(model(evidence, recorded)?),
        _ => None,
    };
    let blueprint = blueprint(run.session, recorded, model)?;
    Ok(match run.node {
        NodeName::Operator => follow(blueprint.operator(), journal, tick),
        NodeName::Predictor => follow(blueprint.predictor().map_err(|why| unbuildable(&why))?, journal, tick),
        NodeName::Arbiter => follow(blueprint.arbiter().map_err(|why| unbuildable(&why))?, journal, tick),
        NodeName::RobotSim => follow(blueprint.robot_sim().map_err(|why| unbuildable(&why))?, journal, tick),
        NodeName::Recorder => return Err(Missing::Journal),
    })
}

pub(crate) fn model(evidence: &Evidence, recorded: &RecordedNode) -> Result<Model, Missing> {
    let sha256 = recorded.model.clone();
    let bytes = sha256.as_deref().and_then(|sha256| evidence.model(sha256));
    let bytes = bytes.ok_or(Missing::Model { sha256 })?;
    Model::from_bytes(bytes).map_err(|why| Missing::Buildable { why: why.to_string() })
}

pub(crate) fn configuration(recorded: &RecordedNode) -> Result<Configuration, Missing> {
    let unreadable = |why: String| Missing::Buildable { why };
    let read = Document::parse("recorded", &recorded.config).and_then(|text| Configuration::from_document(&text));
    let mut configuration = read.map_err(|why| unreadable(why.to_string()))?;
    configuration.rates.seed = recorded.seed;
    Ok(configuration)
}

fn blueprint(session: Session, recorded: &RecordedNode, model: Option<Model>) -> Result<Blueprint, Missing> {
    let unreadable = |why: String| Missing::Buildable { why };
    Blueprint::new(configuration(recorded)?, session, model).map_err(|why| unreadable(why.to_string()))
}

/// What was executed of a run.
#[derive(Clone, Copy, Debug, Default)]
struct Ran {
    steps: u64,
    outputs: u64,
    began: Option<Stamp>,
    now: Stamp,
    stopped: bool,
}

impl Ran {
    fn span(&self) -> Nanos {
        self.began.map_or(0, |began| self.now.since(began))
    }
}

/// Follows a journal entry by entry, as far as it goes without a gap.
fn follow<N: Ports>(node: N, journal: &[JournalBatch], tick: &mut dyn FnMut(u64)) -> (Verdict, Ran) {
    let mut again = Again::new(node);
    let mut next = 0_u64;
    for part in journal {
        if part.first > next {
            return (Verdict::Incomplete(gap(next, part)), again.ran);
        }
        for (entry, index) in part.entries.iter().zip(part.first..) {
            // A part that was sent twice holds what has been executed already.
            if index < next {
                continue;
            }
            if let Err(divergence) = again.take(index, entry) {
                return (Verdict::Diverged(divergence), again.ran);
            }
            next = index.saturating_add(1);
        }
        tick(part.entries.len() as u64);
    }
    (again.verdict(next), again.ran)
}

fn gap(next: u64, part: &JournalBatch) -> Missing {
    if next == 0 {
        return Missing::Beginning { first: part.first };
    }
    Missing::Gap {
        from: next,
        to: part.first - 1,
        lost: part.lost.min(part.first - next),
    }
}

/// A node at work again.
struct Again<N: Node> {
    node: N,
    outbox: Outbox<N::Output>,
    /// What it answered to the last input and the journal has not confirmed yet.
    unconfirmed: VecDeque<(Topic, Vec<u8>)>,
    /// The largest difference that was small enough, and where it was.
    closest: Option<(f64, String)>,
    ran: Ran,
}

impl<N: Ports> Again<N> {
    fn new(node: N) -> Self {
        Self {
            node,
            outbox: Outbox::default(),
            unconfirmed: VecDeque::new(),
            closest: None,
            ran: Ran::default(),
        }
    }

    fn take(&mut self, index: u64, entry: &JournalEntry) -> Result<(), Box<Divergence>> {
        let input = match &entry.what {
            Happening::Output { topic, bytes } => return self.confirm(index, *topic, bytes),
            Happening::Sample { topic, bytes } => Input::Sample { topic: *topic, bytes },
            Happening::Wake => Input::Wake,
            Happening::Presence { peer, alive } => Input::Presence {
                peer: *peer,
                alive: *alive,
            },
            Happening::Stop => Input::Stop,
        };
        if let Some((topic, _)) = self.unconfirmed.front() {
            return Err(self.divergence(index, *topic, Difference::Additional));
        }
        self.ran.began.get_or_insert(entry.at);
        self.ran.now = entry.at;
        self.ran.steps += 1;
        self.ran.stopped = input == Input::Stop;
        self.node.step(entry.at, N::event(input), &mut self.outbox);
        for output in self.outbox.drain() {
            let mut bytes = Vec::new();
            if let Some(topic) = N::sample(&output, &mut bytes) {
                self.unconfirmed.push_back((topic, bytes));
            }
        }
        Ok(())
    }

    /// Compares a recorded output with what came out now.
    fn confirm(&mut self, index: u64, topic: Topic, recorded: &[u8]) -> Result<(), Box<Divergence>> {
        let difference = match self.unconfirmed.pop_front() {
            None => Difference::Absent,
            Some((now, _)) if now != topic => Difference::Topic(now),
            Some((_, again)) if again == recorded => {
                self.ran.outputs += 1;
                return Ok(());
            }
            Some((_, again)) => match compare(topic, recorded, &again) {
                Comparison::Close { largest, path } => {
                    self.ran.outputs += 1;
                    if self.closest.as_ref().is_none_or(|(before, _)| largest > *before) {
                        self.closest = Some((largest, format!("{topic}.{path}")));
                    }
                    return Ok(());
                }
                Comparison::Differ(fields) => Difference::Fields(fields),
                Comparison::Opaque => Difference::Bytes,
            },
        };
        Err(self.divergence(index, topic, difference))
    }

    fn divergence(&self, entry: u64, topic: Topic, difference: Difference) -> Box<Divergence> {
        Box::new(Divergence {
            step: self.ran.steps,
            entry,
            at: self.ran.now,
            topic,
            difference,
        })
    }

    /// The verdict on a journal without a gap that ends before entry `next`.
    fn verdict(&self, next: u64) -> Verdict {
        // Answers that a killed node did not write down any more prove nothing; those of one that stopped do.
        if self.ran.stopped && !self.unconfirmed.is_empty() {
            return Verdict::Incomplete(Missing::End { from: next });
        }
        match &self.closest {
            None => Verdict::Identical,
            Some((largest, field)) => Verdict::Close {
                largest: *largest,
                field: field.clone(),
            },
        }
    }
}
