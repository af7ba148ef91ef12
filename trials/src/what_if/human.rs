//! A recorded human in the operator's place: says again what was said, whatever comes of it.

use std::collections::{BTreeMap, VecDeque};

use tandem_recorder::{Evidence, Recorded, Recording};
use tandem_wire::{
    Command, Happening, Input, MessageId, Nanos, NodeName, Pace, Stamp, State, Timing, Topic, codec, decode, encode,
};

use crate::world::{Player, Said};

/// The recorded commands and the trials' marks, in the order in which they were said.
pub(super) struct RecordedHuman {
    words: Words,
}

enum Words {
    /// In lockstep each is an answer to the state of a tick.
    ByTick(BTreeMap<u32, VecDeque<(Topic, Vec<u8>)>>),
    /// In real time each has its instant.
    ByStamp {
        words: VecDeque<Word>,
        /// The newest states and when they came, for what a command had seen.
        seen: VecDeque<(Stamp, MessageId)>,
    },
}

struct Word {
    at: Stamp,
    topic: Topic,
    bytes: Vec<u8>,
    /// For a command: how old the state was that its maker had seen. `None` if it had seen none.
    lag: Option<Nanos>,
}

/// States that a command may still answer: five seconds of them at 50 Hz, as receivers remember.
const REMEMBERED: usize = 256;

impl RecordedHuman {
    pub(super) fn new(recording: &Recording, evidence: &Evidence, timing: Timing) -> Self {
        let words = match timing.pace {
            Pace::Lockstep => Words::ByTick(by_tick(recording, evidence)),
            Pace::Real => Words::ByStamp {
                words: by_stamp(recording),
                seen: VecDeque::with_capacity(REMEMBERED),
            },
        };
        Self { words }
    }

    /// What is said before anybody has said anything: in lockstep the first trial's mark starts the robot.
    pub(super) fn opening(&mut self) -> Vec<(Topic, Vec<u8>)> {
        match &mut self.words {
            Words::ByTick(words) => words.remove(&BEFORE).into_iter().flatten().collect(),
            Words::ByStamp { .. } => Vec::new(),
        }
    }
}

/// Where marks stand that come before any state. No robot counts that far.
const BEFORE: u32 = u32::MAX;

/// Commands by the tick that they answer. A mark has no tick of its own: it stands where the robot heard it, which its
/// journal tells, or else where it arrived.
fn by_tick(recording: &Recording, evidence: &Evidence) -> BTreeMap<u32, VecDeque<(Topic, Vec<u8>)>> {
    let mut words = BTreeMap::<u32, VecDeque<(Topic, Vec<u8>)>>::new();
    let mut marks = marks_in_journal(evidence);
    if marks.is_empty() {
        marks = marks_as_they_arrived(recording);
    }
    for (tick, bytes) in marks {
        words.entry(tick).or_default().push_back((Topic::Trial, bytes));
    }
    // Before the commands of their tick, as the operator said them.
    for (tick, topic, bytes) in asides_in_journal(evidence) {
        words.entry(tick).or_default().push_back((topic, bytes));
    }
    for message in recording
        .messages
        .iter()
        .filter(|message| message.topic == Topic::Command)
    {
        let said = words.entry(message.header.tick).or_default();
        said.push_back((Topic::Command, message.bytes.clone()));
    }
    words
}

/// What the operator said of the lease and of emergency stops: no recorder hears it, but its journal tells.
fn asides_in_journal(evidence: &Evidence) -> Vec<(u32, Topic, Vec<u8>)> {
    let operator = evidence.journals.iter().find(|(run, _)| run.node == NodeName::Operator);
    let (mut asides, mut next) = (Vec::new(), 0);
    for part in operator.map(|(_, parts)| parts).into_iter().flatten() {
        for (entry, index) in part.entries.iter().zip(part.first..) {
            // A part that was sent twice holds nothing new.
            if index < next {
                continue;
            }
            next = index + 1;
            if let Happening::Output { topic, bytes } = &entry.what
                && matches!(topic, Topic::Lease | Topic::TakeOver | Topic::Emergency)
                && let Ok((_, header)) = codec::peek(bytes)
            {
                asides.push((header.tick, *topic, bytes.clone()));
            }
        }
    }
    asides
}

fn marks_in_journal(evidence: &Evidence) -> Vec<(u32, Vec<u8>)> {
    let robot = evidence.journals.iter().find(|(run, _)| run.node == NodeName::RobotSim);
    let mut marks = Vec::new();
    let (mut newest, mut next) = (BEFORE, 0);
    for part in robot.map(|(_, parts)| parts).into_iter().flatten() {
        for (entry, index) in part.entries.iter().zip(part.first..) {
            // A part that was sent twice holds nothing new.
            if index < next {
                continue;
            }
            next = index + 1;
            match &entry.what {
                Happening::Output {
                    topic: Topic::State,
                    bytes,
                } => newest = codec::peek(bytes).map_or(newest, |(_, header)| header.tick),
                Happening::Sample {
                    topic: Topic::Trial,
                    bytes,
                } => marks.push((newest, bytes.clone())),
                _ => {}
            }
        }
    }
    marks
}

fn marks_as_they_arrived(recording: &Recording) -> Vec<(u32, Vec<u8>)> {
    let mut newest = BEFORE;
    let mut marks = Vec::new();
    for message in &recording.messages {
        match message.topic {
            Topic::State => newest = message.header.tick,
            Topic::Trial => marks.push((newest, message.bytes.clone())),
            _ => {}
        }
    }
    marks
}

fn by_stamp(recording: &Recording) -> VecDeque<Word> {
    let mut arrived = BTreeMap::new();
    for state in recording
        .messages
        .iter()
        .filter(|message| message.topic == Topic::State)
    {
        arrived.insert((state.header.session, state.header.seq), state.at);
    }
    let lag = |message: &Recorded| {
        let command = decode::<Command>(&message.bytes).ok()?;
        let seen = command.body.seen?;
        arrived.get(&(seen.session, seen.seq)).map(|at| message.at.since(*at))
    };
    let said = recording
        .messages
        .iter()
        .filter(|message| matches!(message.topic, Topic::Command | Topic::Trial));
    said.map(|message| Word {
        at: message.at,
        topic: message.topic,
        bytes: message.bytes.clone(),
        lag: lag(message),
    })
    .collect()
}

impl Player for RecordedHuman {
    fn name(&self) -> NodeName {
        NodeName::Operator
    }

    fn hears(&self, topic: Topic) -> bool {
        topic == Topic::State
    }

    fn deadline(&self) -> Option<Stamp> {
        match &self.words {
            Words::ByTick(_) => None,
            Words::ByStamp { words, .. } => words.front().map(|word| word.at),
        }
    }

    fn take(&mut self, now: Stamp, input: Input<'_>, said: &mut Said) {
        let heard = match input {
            Input::Sample {
                topic: Topic::State,
                bytes,
            } => codec::peek(bytes).ok().map(|(_, header)| header),
            _ => None,
        };
        match &mut self.words {
            Words::ByTick(words) => {
                let answers = heard.and_then(|header| words.remove(&header.tick));
                said.extend(answers.into_iter().flatten());
            }
            Words::ByStamp { words, seen } => {
                if let Some(header) = heard {
                    if seen.len() == REMEMBERED {
                        seen.pop_front();
                    }
                    seen.push_back((now, header.id()));
                }
                while let Some(word) = words.pop_front_if(|word| word.at <= now) {
                    said.push_back((word.topic, word.now(now, seen)));
                }
            }
        }
    }
}

impl Word {
    /// What is said now: a command answers the state that is as old as the one it answered then.
    fn now(self, now: Stamp, seen: &VecDeque<(Stamp, MessageId)>) -> Vec<u8> {
        let Ok(mut command) = decode::<Command>(&self.bytes) else {
            return self.bytes;
        };
        command.body.seen = self.lag.and_then(|lag| {
            let answered = seen.iter().rev().find(|(at, _)| now.since(*at) >= lag);
            answered.map(|(_, id)| *id)
        });
        let mut bytes = Vec::new();
        encode(&command, &mut bytes);
        bytes
    }
}

/// When the recorded human and the recorded robot said their last words, by the recorder's clock.
pub(super) fn last_word(recording: &Recording) -> Stamp {
    let of_loop = |message: &&Recorded| matches!(message.topic, Topic::Command | Topic::State);
    let ends = recording.messages.iter().rev().find(of_loop);
    ends.map_or(Stamp(0), |message| message.at)
}

/// Where the recording begins.
pub(super) fn first_state(recording: &Recording) -> Option<State> {
    let first = recording
        .messages
        .iter()
        .find(|message| message.topic == Topic::State)?;
    decode::<State>(&first.bytes).ok().map(|state| state.body)
}
