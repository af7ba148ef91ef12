//! The bytes at the recorder's edge: every topic comes in; out go how the session file is doing, and questions.

use tandem_wire::{
    Claim, Emergency, Envelope, Input, JournalBatch, Malformed, Message, NodeName, Ports, Question, Topic, Turn,
    Unreadable, codec, decode, encode,
};

use crate::heard::{JournalPart, Sample};
use crate::node::{Event, Output, Recorder};

impl Ports for Recorder {
    const NAME: NodeName = NodeName::Recorder;
    const TURN: Turn = Turn::InBatches;
    const INPUTS: &'static [Topic] = &[
        Topic::Command,
        Topic::Proposal,
        Topic::Forecast,
        Topic::Setpoint,
        Topic::State,
        Topic::Scene,
        Topic::Trial,
        Topic::Lease,
        Topic::TakeOver,
        Topic::Emergency,
        Topic::AllClear,
        Topic::Journal(NodeName::Operator),
        Topic::Journal(NodeName::Predictor),
        Topic::Journal(NodeName::Arbiter),
        Topic::Journal(NodeName::RobotSim),
        Topic::Info(NodeName::Operator),
        Topic::Info(NodeName::Predictor),
        Topic::Info(NodeName::Arbiter),
        Topic::Info(NodeName::RobotSim),
        Topic::Info(NodeName::Recorder),
        Topic::Clock(NodeName::Operator),
        Topic::Clock(NodeName::Predictor),
        Topic::Clock(NodeName::Arbiter),
        Topic::Clock(NodeName::RobotSim),
        Topic::Clock(NodeName::Recorder),
        // What the shell finds when it looks at the session file; it stays in this process.
        Topic::Device,
    ];
    const OUTPUTS: &'static [Topic] = &[Topic::Storage];

    fn event(input: Input<'_>) -> Event {
        match input {
            Input::Sample {
                topic: Topic::Device,
                bytes,
            } => match codec::from_bytes(bytes) {
                Ok(storage) => Event::Storage(storage),
                Err(why) => Event::Unreadable(Unreadable {
                    topic: Topic::Device,
                    why,
                }),
            },
            Input::Sample { topic, bytes } => match Sample::read(topic, bytes) {
                Ok(sample) => Event::Sample(sample),
                Err(why) => Event::Unreadable(Unreadable { topic, why }),
            },
            // No line to the recorder is bad on purpose.
            Input::Wake | Input::Missed { .. } => Event::Wake,
            Input::Presence { peer, alive } => Event::Presence { peer, alive },
            Input::Stop => Event::Stop,
        }
    }

    fn sample(output: &Output, bytes: &mut Vec<u8>) -> Option<Topic> {
        match output {
            Output::Say(storage) => {
                encode(storage, bytes);
                Some(Topic::Storage)
            }
            Output::Write(_) | Output::Show(_) | Output::Ask(_) => {
                bytes.clear();
                None
            }
        }
    }

    fn question(output: &Output) -> Option<Question> {
        match output {
            Output::Ask(question) => Some(*question),
            Output::Write(_) | Output::Show(_) | Output::Say(_) => None,
        }
    }
}

impl Sample {
    /// Reads a message of any topic that a recorder hears.
    ///
    /// # Errors
    /// If it does not follow its layout, or a recorder does not hear the topic.
    pub fn read(topic: Topic, bytes: &[u8]) -> Result<Self, Malformed> {
        Ok(match topic {
            Topic::Command => Self::Command(decode(bytes)?),
            Topic::Proposal => Self::Proposal(decode(bytes)?),
            Topic::Forecast => Self::Forecast(decode(bytes)?),
            Topic::Setpoint => Self::Setpoint(Box::new(decode(bytes)?)),
            Topic::State => Self::State(Box::new(decode(bytes)?)),
            Topic::Scene => Self::Scene(decode(bytes)?),
            Topic::Trial => Self::Trial(decode(bytes)?),
            Topic::Journal(node) => Self::Journal(journal_part(node, bytes)?),
            Topic::Info(node) => Self::Info(node, decode(bytes)?),
            Topic::Lease | Topic::TakeOver => Self::Claim(Claim::read(topic, bytes)?),
            Topic::Emergency | Topic::AllClear => Self::Emergency(Emergency::read(topic, bytes)?),
            Topic::Clock(node) => Self::Clock(node, decode(bytes)?),
            Topic::Alive(_) | Topic::Device | Topic::Storage | Topic::Ping(_) => {
                return Err(Malformed::Topic);
            }
        })
    }
}

/// Reads a batch to see that it is whole, and keeps its bytes: a later execution wants them as they travelled.
fn journal_part(node: NodeName, bytes: &[u8]) -> Result<JournalPart, Malformed> {
    let Envelope { header, body } = decode::<JournalBatch>(bytes)?;
    Ok(JournalPart {
        node,
        header,
        first: body.first,
        entries: body.entries.len() as u64,
        lost: body.lost,
        bytes: bytes.to_vec(),
    })
}

const _: () = assert!(
    JournalBatch::MAX_BYTES <= 1 << 22,
    "the queues are sized for parts of at most 4 MiB"
);
