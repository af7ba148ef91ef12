//! The same recorded human against another law or model.
//!
//! ```text
//!   recorded commands ──▶ arbiter, with the other law ──▶ robot ─┐     under virtual time, in one thread:
//!                              ▲   predictor, with the other model │     a World with the recorded human
//!                              └───────────┴───────────────────────┘     in the operator's place
//! ```
//!
//! Nodes are built as the file says they were, but for what is changed. With nothing changed a lockstep session comes
//! out as it was, byte for byte. A session in real time comes close: messages take no time here, where they took a
//! millisecond or two.
//!
//! What cannot be known: the human saw another robot than this one, and would have commanded otherwise. [`CAVEAT`]
//! says so to whoever reads the figures.

mod human;
mod law;

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::Arc;

use tandem_arbiter::LawName;
use tandem_cesn::Model;
use tandem_recorder::{Evidence, RecordedNode, Recording, Run};
use tandem_wire::{NodeName, Pace, Stamp, Timing, Topic, Vec3, seconds};

use crate::reexecute::{configuration, models};
use crate::world::{Player, Seat, World};
use crate::{Blueprint, Configuration, Measures, Missing, Trace, Tracer, Unbuildable};
use human::{RecordedHuman, first_state, last_word};
pub use law::LawChoice;

/// What no such comparison can know.
pub const CAVEAT: &str = "the commands are those given to the original robot: in front of this one the human would have \
                          reacted differently";
/// What is besides this for the human alone.
pub const HUMAN_ONLY_CAVEAT: &str = "under the law \"human\" the path is what these commands alone give, without the \
                                     corrections that a human who drives alone would make";

/// What shall be otherwise.
#[derive(Clone, Default)]
pub struct Change {
    /// The law; `None`: as it was.
    pub law: Option<LawChoice>,
    /// The predictor's model; `None`: as it was.
    pub model: Option<Model>,
}

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub enum NoAnswer {
    /// A node cannot be built again.
    #[error("the {node} cannot be built as it was: {missing}")]
    Node {
        /// Which.
        node: NodeName,
        /// What is missing.
        missing: Missing,
    },
    /// The changed settings or the other model do not fit.
    #[error(transparent)]
    Unbuildable(#[from] Unbuildable),
    /// Nobody commanded anything.
    #[error("the recording holds no commands of a human")]
    NoCommands,
    /// No trial is in it.
    #[error("the recording holds no trial: there is nothing to compare")]
    NoTrial,
}

/// A message of the alternative.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Said {
    /// On the original's time axis, the recorder's clock; in lockstep the tick's instant.
    pub at: Stamp,
    /// On which topic.
    pub topic: Topic,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// What would have been.
#[derive(Clone, Debug)]
pub struct WhatIf {
    /// Everything that was said.
    pub messages: Vec<Said>,
    /// Rates, as the arbiter had them.
    pub timing: Timing,
    /// The law that the original had.
    pub law_then: LawChoice,
    /// The law that was used.
    pub law: LawChoice,
    /// The trials, in order.
    pub trials: Vec<Comparison>,
    /// States and setpoints of the alternative, and how many of them the original has byte for byte.
    pub same: (u64, u64),
    /// What must be said besides the figures.
    pub caveats: Vec<String>,
}

/// One trial, as it was and as it would have been.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// As it was.
    pub original: (Trace, Measures),
    /// As it would have been.
    pub alternative: (Trace, Measures),
    /// Mean distance of the two tools at the same tick, in metres, while either moves.
    pub apart_mean_m: Option<f64>,
    /// The largest.
    pub apart_max_m: Option<f64>,
    /// The first tick, from the trial's beginning, at which the tools are more than a tenth of a millimetre apart.
    pub parts_at: Option<u32>,
}

/// Lets the recorded human meet a changed arbiter or predictor. `progress` is told the time that has passed in seconds.
///
/// # Errors
/// If the file lacks what it takes to build the nodes again, or what is changed does not fit.
pub fn what_if(
    recording: &Recording,
    evidence: &Evidence,
    change: &Change,
    mut progress: impl FnMut(f64),
) -> Result<WhatIf, NoAnswer> {
    if !recording.messages.iter().any(|message| message.topic == Topic::Command) {
        return Err(NoAnswer::NoCommands);
    }
    let cast = Cast::of(evidence, change)?;
    let timing = cast.arbiter.timing();
    let mut human = RecordedHuman::new(recording, evidence, timing);
    let opening = human.opening();
    let limit = match timing.pace {
        Pace::Lockstep => u64::MAX,
        Pace::Real => last_word(recording).0,
    };
    let mut world = World::of(cast.players(human)?, timing, cast.robot.session());
    let mut messages = Vec::new();
    for (topic, bytes) in opening {
        world.say(topic, bytes);
    }
    world.run(limit, |at, topic, bytes| {
        if topic == Topic::State {
            progress(at.seconds());
        }
        let bytes = bytes.to_vec();
        messages.push(Said { at, topic, bytes });
        ControlFlow::Continue(())
    });
    let (law_then, law) = (cast.law_then, cast.law);
    let mut caveats = vec![CAVEAT.to_owned()];
    caveats.extend((law.law == LawName::Human).then(|| HUMAN_ONLY_CAVEAT.to_owned()));
    caveats.extend(cast.caveats(recording));
    let trials = compare(recording, &messages);
    if trials.is_empty() {
        return Err(NoAnswer::NoTrial);
    }
    Ok(WhatIf {
        same: same(recording, &messages),
        messages,
        timing,
        law_then,
        law,
        trials,
        caveats,
    })
}

/// The three nodes that are run again, each from its own configuration and in its own session.
struct Cast {
    predictor: Blueprint,
    arbiter: Blueprint,
    robot: Blueprint,
    law_then: LawChoice,
    law: LawChoice,
    /// Nodes of which the file knows several runs.
    restarted: Vec<NodeName>,
}

impl Cast {
    fn of(evidence: &Evidence, change: &Change) -> Result<Self, NoAnswer> {
        let predictor = recorded(evidence, NodeName::Predictor)?;
        let arbiter = recorded(evidence, NodeName::Arbiter)?;
        let robot = recorded(evidence, NodeName::RobotSim)?;
        let mut settings = settings(NodeName::Arbiter, arbiter.1)?;
        let law_then = LawChoice::of(&settings.arbiter);
        let law = change.law.unwrap_or(law_then);
        settings.arbiter.law = law.law;
        settings.arbiter.constant_weight = law.weight.unwrap_or(settings.arbiter.constant_weight);
        let used = match &change.model {
            Some(other) => vec![Arc::new(other.clone())],
            None => models(evidence, predictor.1).map_err(missing(NodeName::Predictor))?,
        };
        let of_node = |node| evidence.nodes.keys().filter(|run| run.node == node).count();
        Ok(Self {
            predictor: Blueprint::with_models(
                self::settings(NodeName::Predictor, predictor.1)?,
                predictor.0.session,
                used,
            )?,
            arbiter: Blueprint::new(settings, arbiter.0.session, None)?,
            robot: Blueprint::new(self::settings(NodeName::RobotSim, robot.1)?, robot.0.session, None)?,
            law_then,
            law,
            restarted: NodeName::ALL.into_iter().filter(|node| of_node(*node) > 1).collect(),
        })
    }

    fn players(&self, human: RecordedHuman) -> Result<Vec<Box<dyn Player>>, Unbuildable> {
        Ok(vec![
            Box::new(human),
            Box::new(Seat::new(self.predictor.predictor()?)),
            Box::new(Seat::new(self.arbiter.arbiter()?)),
            Box::new(Seat::new(self.robot.robot_sim()?)),
        ])
    }

    fn caveats(&self, recording: &Recording) -> Vec<String> {
        let restarted = self.restarted.iter().map(|node| {
            format!("the {node} was started again during the session: its first run's settings are used throughout")
        });
        let mut caveats: Vec<String> = restarted.collect();
        let start = Vec3::from(self.robot.configuration().robot.start_m);
        let elsewhere = first_state(recording)
            .map(|state| (state.tool.position - start).norm())
            .filter(|distance| *distance > 0.001);
        caveats.extend(elsewhere.map(|distance| {
            format!(
                "the recording begins with the tool {:.0} mm from its start; here it begins at the start",
                distance * 1e3
            )
        }));
        caveats
    }
}

fn missing(node: NodeName) -> impl Fn(Missing) -> NoAnswer {
    move |missing| NoAnswer::Node { node, missing }
}

/// The first run of a node.
fn recorded(evidence: &Evidence, node: NodeName) -> Result<(Run, &RecordedNode), NoAnswer> {
    let mut runs = evidence.nodes.iter().filter(|(run, _)| run.node == node);
    let found = runs.next().map(|(run, recorded)| (*run, recorded));
    found.ok_or_else(|| missing(node)(Missing::Configuration))
}

fn settings(node: NodeName, recorded: &RecordedNode) -> Result<Configuration, NoAnswer> {
    configuration(recorded).map_err(missing(node))
}

/// How many states and setpoints the original has byte for byte, and how many there are.
fn same(recording: &Recording, messages: &[Said]) -> (u64, u64) {
    let counts = |topic| matches!(topic, Topic::State | Topic::Setpoint);
    let mut recorded = BTreeMap::new();
    for message in recording.messages.iter().filter(|message| counts(message.topic)) {
        let id = message.header.id();
        recorded.insert((message.topic, id.session, id.seq), message.bytes.as_slice());
    }
    let mut found = (0, 0);
    for said in messages.iter().filter(|said| counts(said.topic)) {
        found.1 += 1;
        if let Ok((_, header)) = tandem_wire::codec::peek(&said.bytes)
            && recorded.get(&(said.topic, header.session, header.seq)) == Some(&said.bytes.as_slice())
        {
            found.0 += 1;
        }
    }
    found
}

/// Every trial of which both know.
fn compare(recording: &Recording, messages: &[Said]) -> Vec<Comparison> {
    let numbers: std::collections::BTreeSet<u32> = messages
        .iter()
        .filter(|said| said.topic == Topic::State)
        .filter_map(|said| tandem_wire::decode::<tandem_wire::State>(&said.bytes).ok())
        .map(|state| state.body.trial)
        .filter(|trial| *trial > 0)
        .collect();
    let trace = |number, said: &mut dyn Iterator<Item = (Topic, &[u8])>| {
        let mut tracer = Tracer::of_trial(number);
        said.for_each(|(topic, bytes)| tracer.see(topic, bytes));
        let trace = tracer.trace();
        let measures = Measures::of(&trace);
        (trace, measures)
    };
    let both = numbers.into_iter().map(|number| {
        let then = &mut recording
            .messages
            .iter()
            .map(|message| (message.topic, message.bytes.as_slice()));
        let now = &mut messages.iter().map(|said| (said.topic, said.bytes.as_slice()));
        let (original, alternative) = (trace(number, then), trace(number, now));
        let (apart_mean_m, apart_max_m, parts_at) = apart(&original.0, &alternative.0);
        Comparison {
            original,
            alternative,
            apart_mean_m,
            apart_max_m,
            parts_at,
        }
    });
    both.filter(|both| both.original.0.trial > 0).collect()
}

/// Tools that are no farther apart than this, in metres, are at the same place.
const SAME_PLACE_M: f64 = 1e-4;

/// Mean and largest distance of the two tools at the same tick, and the first tick at which there is one.
fn apart(original: &Trace, alternative: &Trace) -> (Option<f64>, Option<f64>, Option<u32>) {
    let places = |trace: &Trace| -> BTreeMap<u32, Vec3> {
        let states = trace.ticks.iter();
        states
            .filter_map(|tick| Some((tick.tick, Vec3::from(tick.state.as_ref()?.tool))))
            .collect()
    };
    let motion = original.motion().into_iter().chain(alternative.motion());
    let Some((first, last)) = motion.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))) else {
        return (None, None, None);
    };
    let (then, now) = (places(original), places(alternative));
    let distances: Vec<(u32, f64)> = then
        .range(first..=last)
        .filter_map(|(tick, place)| Some((*tick, (*place - *now.get(tick)?).norm())))
        .collect();
    let parts_at = distances.iter().find(|(_, distance)| *distance > SAME_PLACE_M);
    let sum: f64 = distances.iter().map(|(_, distance)| distance).sum();
    let largest = distances.iter().map(|(_, distance)| *distance).reduce(f64::max);
    (
        largest.map(|_| sum / distances.len() as f64),
        largest,
        parts_at.map(|(tick, _)| *tick),
    )
}

impl WhatIf {
    /// Whether every state and setpoint is the original's.
    #[must_use]
    pub const fn is_the_original(&self) -> bool {
        self.same.0 == self.same.1
    }

    /// How much of the session was run again, in seconds.
    #[must_use]
    pub fn span_s(&self) -> f64 {
        let (first, last) = (self.messages.first(), self.messages.last());
        first
            .zip(last)
            .map_or(0.0, |(first, last)| seconds(last.at.since(first.at)))
    }
}
