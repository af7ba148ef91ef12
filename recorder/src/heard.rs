//! What the recorder passes on: everything it heard, and what it noticed about it.

use std::fmt;

use tandem_wire::{
    Claim, ClockReport, Command, Emergency, Envelope, Forecast, Header, JournalBatch, NodeInfo, NodeName, Proposal,
    Scene, Setpoint, Stamp, State, Topic, Trial, encode,
};

use crate::tally::Counts;

/// One thing to be kept, and when it happened.
#[derive(Clone, Debug, PartialEq)]
pub struct Heard {
    /// When it reached the recorder, by the recorder's clock.
    pub at: Stamp,
    /// Where it belongs on the session's time axis: `tick · period` in lockstep, the arrival in real time.
    pub session_time: Stamp,
    /// The control period it belongs to.
    pub tick: u32,
    /// What it is.
    pub entry: Entry,
}

/// What was heard or noticed.
#[derive(Clone, Debug, PartialEq)]
pub enum Entry {
    /// A message.
    Sample(Sample),
    /// Something a person wants to read.
    Note(Note),
    /// What was received so far, and what was not.
    Counts(Counts),
}

/// A message of any topic.
#[derive(Clone, Debug, PartialEq)]
pub enum Sample {
    /// What the human wants.
    Command(Envelope<Command>),
    /// What the robot would do.
    Proposal(Envelope<Proposal>),
    /// A whole forecast.
    Forecast(Envelope<Forecast>),
    /// One arbitration.
    Setpoint(Box<Envelope<Setpoint>>),
    /// What the arm does.
    State(Box<Envelope<State>>),
    /// The surroundings.
    Scene(Envelope<Scene>),
    /// A trial begins or ends.
    Trial(Envelope<Trial>),
    /// An operator wants to drive, or no longer.
    Claim(Envelope<Claim>),
    /// Somebody stops the robot at once, or clears that.
    Emergency(Envelope<Emergency>),
    /// Part of a node's journal, kept as the bytes that travelled.
    Journal(JournalPart),
    /// How to build a node again.
    Info(NodeName, Envelope<NodeInfo>),
    /// What a node knows of its peers' clocks.
    Clock(NodeName, Envelope<ClockReport>),
}

/// Part of a node's journal.
#[derive(Clone, Debug, PartialEq)]
pub struct JournalPart {
    /// Whose journal.
    pub node: NodeName,
    /// Who, which and when.
    pub header: Header,
    /// The index of the first entry.
    pub first: u64,
    /// How many entries.
    pub entries: u64,
    /// Entries that its writer lost before this part.
    pub lost: u64,
    /// The message as it travelled, header included.
    pub bytes: Vec<u8>,
}

impl JournalPart {
    /// The part as it travels.
    pub(crate) fn of(node: NodeName, batch: &Envelope<JournalBatch>) -> Self {
        let mut bytes = Vec::new();
        encode(batch, &mut bytes);
        Self {
            node,
            header: batch.header,
            first: batch.body.first,
            entries: batch.body.entries.len() as u64,
            lost: batch.body.lost,
            bytes,
        }
    }
}

impl Sample {
    /// The topic it came on.
    #[must_use]
    pub const fn topic(&self) -> Topic {
        match self {
            Self::Command(_) => Topic::Command,
            Self::Proposal(_) => Topic::Proposal,
            Self::Forecast(_) => Topic::Forecast,
            Self::Setpoint(_) => Topic::Setpoint,
            Self::State(_) => Topic::State,
            Self::Scene(_) => Topic::Scene,
            Self::Trial(_) => Topic::Trial,
            Self::Claim(message) => message.body.topic(),
            Self::Emergency(message) => message.body.topic(),
            Self::Journal(part) => Topic::Journal(part.node),
            Self::Info(node, _) => Topic::Info(*node),
            Self::Clock(node, _) => Topic::Clock(*node),
        }
    }

    /// Its header.
    #[must_use]
    pub const fn header(&self) -> &Header {
        match self {
            Self::Command(message) => &message.header,
            Self::Proposal(message) => &message.header,
            Self::Forecast(message) => &message.header,
            Self::Setpoint(message) => &message.header,
            Self::State(message) => &message.header,
            Self::Scene(message) => &message.header,
            Self::Trial(message) => &message.header,
            Self::Claim(message) => &message.header,
            Self::Emergency(message) => &message.header,
            Self::Journal(part) => &part.header,
            Self::Info(_, message) => &message.header,
            Self::Clock(_, message) => &message.header,
        }
    }

    /// Where and as which bytes it travelled: written anew, they are the same. `None` for what is kept as bytes or
    /// as a record of its own.
    #[must_use]
    pub(crate) fn travelled(&self) -> Option<(Topic, Vec<u8>)> {
        let mut bytes = Vec::new();
        match self {
            Self::Command(message) => encode(message, &mut bytes),
            Self::Proposal(message) => encode(message, &mut bytes),
            Self::Forecast(message) => encode(message, &mut bytes),
            Self::Setpoint(message) => encode(message, &mut bytes),
            Self::State(message) => encode(message, &mut bytes),
            Self::Scene(message) => encode(message, &mut bytes),
            Self::Trial(message) => encode(message, &mut bytes),
            Self::Claim(message) => encode(message, &mut bytes),
            Self::Emergency(message) => encode(message, &mut bytes),
            Self::Clock(_, message) => encode(message, &mut bytes),
            Self::Journal(_) | Self::Info(..) => return None,
        }
        Some((self.topic(), bytes))
    }

    /// About how much memory it holds, to bound a queue of them.
    #[must_use]
    pub fn weight_bytes(&self) -> usize {
        let behind = match self {
            Self::State(message) => size_of_val(message.as_ref()),
            Self::Setpoint(message) => size_of_val(message.as_ref()),
            Self::Forecast(message) => size_of_val(message.body.points.as_slice()),
            Self::Journal(part) => part.bytes.len(),
            Self::Info(_, message) => message.body.model.len() + message.body.config.len(),
            Self::Clock(_, message) => size_of_val(message.body.peers.as_slice()),
            _ => 0,
        };
        size_of::<Heard>() + behind
    }
}

/// How much a note matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// The course of things: a trial begins, a forecast is made.
    Info,
    /// Motion was stopped, or something was lost.
    Warning,
    /// Contact.
    Error,
}

/// Something a person wants to read, in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// How much it matters.
    pub level: Level,
    /// Which node it is about.
    pub about: NodeName,
    /// Whether it is the course of things while no trial runs: the arm stands, nodes come and go.
    pub is_routine: bool,
    /// The words.
    pub text: String,
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.about, self.text)
    }
}
