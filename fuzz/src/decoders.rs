//! Everything that reads a single message's bytes.

use tandem_operator::DeviceSample;
use tandem_wire::codec::{self, Message};
use tandem_wire::{
    Claim, ClockReport, Command, Emergency, Forecast, JournalBatch, Malformed, NodeInfo, Pong, Proposal, Scene,
    Setpoint, State, Storage, Topic, Trial, decode, encode, keys,
};

use crate::chance::Chance;
use crate::{Target, Tried, count, mutate, seeds};

/// Every message's bytes, damaged; keys; a keyboard's samples.
pub(crate) struct Decoders {
    bytes: Vec<u8>,
    again: Vec<u8>,
}

impl Decoders {
    pub(crate) const fn new() -> Self {
        Self {
            bytes: Vec::new(),
            again: Vec::new(),
        }
    }

    /// What is read is written again the same: nothing in the bytes goes unread.
    fn read<M: Message>(&mut self) -> Result<(), Malformed> {
        encode(&decode::<M>(&self.bytes)?, &mut self.again);
        assert_eq!(self.again, self.bytes, "read, and written otherwise");
        Ok(())
    }

    fn read_as(&mut self, topic: Topic) -> Result<(), Malformed> {
        match topic {
            Topic::Command => self.read::<Command>(),
            Topic::Proposal => self.read::<Proposal>(),
            Topic::Forecast => self.read::<Forecast>(),
            Topic::Setpoint => self.read::<Setpoint>(),
            Topic::State => self.read::<State>(),
            Topic::Scene => self.read::<Scene>(),
            Topic::Trial => self.read::<Trial>(),
            Topic::Lease | Topic::TakeOver => self.read::<Claim>(),
            Topic::Emergency | Topic::AllClear => self.read::<Emergency>(),
            Topic::Journal(_) => self.read::<JournalBatch>(),
            Topic::Info(_) => self.read::<NodeInfo>(),
            Topic::Storage => self.read::<Storage>(),
            Topic::Clock(_) => self.read::<ClockReport>(),
            Topic::Ping(_) => self.read::<Pong>(),
            Topic::Alive(_) | Topic::Device => {
                let sample = DeviceSample::from_bytes(&self.bytes)?;
                assert_eq!(sample.to_bytes(), self.bytes[..], "read, and written otherwise");
                Ok(())
            }
        }
    }
}

/// What the decoder of a topic is called.
pub(crate) const fn name(topic: Topic) -> &'static str {
    match topic {
        Topic::Command => "command",
        Topic::Proposal => "proposal",
        Topic::Forecast => "forecast",
        Topic::Setpoint => "setpoint",
        Topic::State => "state",
        Topic::Scene => "scene",
        Topic::Trial => "trial",
        Topic::Lease | Topic::TakeOver => "claim",
        Topic::Emergency | Topic::AllClear => "emergency",
        Topic::Journal(_) => "journal",
        Topic::Info(_) => "info",
        Topic::Storage => "storage",
        Topic::Clock(_) => "clock",
        Topic::Ping(_) => "pong",
        Topic::Alive(_) | Topic::Device => "device",
    }
}

/// Decodes `bytes` as what belongs on `topic`; what is read is written again the same.
///
/// # Panics
/// When it is not.
pub(crate) fn try_one(topic: Topic, bytes: &[u8]) -> Result<(), Malformed> {
    let mut decoders = Decoders::new();
    decoders.bytes.extend_from_slice(bytes);
    decoders.read_as(topic)
}

impl Target for Decoders {
    fn name(&self) -> &'static str {
        "decoders"
    }

    fn run(&mut self, seed: u64, tried: &mut Tried) {
        let mut chance = Chance::new(seed);
        let (topic, golden) = chance.pick(seeds::messages());
        self.bytes.clone_from(golden);
        mutate::damage(&mut self.bytes, 4, &mut chance);
        // Under the key of another kind it is refused, whatever it is.
        let topic = if chance.once_in(16) {
            &seeds::messages()[0].0
        } else {
            topic
        };
        count(tried, name(*topic));
        let read = self.read_as(*topic);
        if codec::peek(&self.bytes).is_err() {
            assert!(read.is_err(), "a body was read behind a header that cannot be");
        }
        if chance.once_in(8) {
            self.bytes.truncate(chance.below(8));
            count(tried, name(Topic::Device));
            self.read_as(Topic::Device).ok();
        }
        if chance.once_in(8) {
            count(tried, "keys");
            let mut key = topic.suffix().into_bytes();
            key.splice(..0, *b"tandem/robot/");
            mutate::damage(&mut key, 3, &mut chance);
            if let Some((robot, topic)) = keys::parse(&String::from_utf8_lossy(&key)) {
                assert_eq!(keys::parse(&topic.key(&robot)), Some((robot, topic)));
            }
        }
    }
}
