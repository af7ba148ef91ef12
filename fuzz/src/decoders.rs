//! Everything that reads a single message's bytes.

use tandem_operator::DeviceSample;
use tandem_wire::codec::{self, Message};
use tandem_wire::{
    Claim, ClockReport, Command, Emergency, Forecast, JournalBatch, NodeInfo, Pong, Proposal, Scene, Setpoint, State,
    Storage, Topic, Trial, decode, encode, keys,
};

use crate::chance::Chance;
use crate::{Target, mutate, seeds};

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
    fn read<M: Message>(&mut self) -> bool {
        let Ok(message) = decode::<M>(&self.bytes) else {
            return false;
        };
        encode(&message, &mut self.again);
        assert_eq!(self.again, self.bytes, "read, and written otherwise");
        true
    }

    fn read_as(&mut self, topic: Topic) -> bool {
        match topic {
            Topic::Command => self.read::<Command>(),
            Topic::Proposal => self.read::<Proposal>(),
            Topic::Forecast => self.read::<Forecast>(),
            Topic::Setpoint => self.read::<Setpoint>(),
            Topic::State => self.read::<State>(),
            Topic::Scene => self.read::<Scene>(),
            Topic::Trial => self.read::<Trial>(),
            Topic::Lease => self.read::<Claim>(),
            Topic::Emergency => self.read::<Emergency>(),
            Topic::Journal(_) => self.read::<JournalBatch>(),
            Topic::Info(_) => self.read::<NodeInfo>(),
            Topic::Storage => self.read::<Storage>(),
            Topic::Clock(_) => self.read::<ClockReport>(),
            Topic::Ping(_) => self.read::<Pong>(),
            Topic::Alive(_) | Topic::Device => {
                let sample = DeviceSample::from_bytes(&self.bytes);
                sample.is_ok_and(|sample| sample.to_bytes() == self.bytes[..])
            }
        }
    }
}

impl Target for Decoders {
    fn name(&self) -> &'static str {
        "decoders"
    }

    fn run(&mut self, seed: u64) -> u64 {
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
        let is_read = self.read_as(*topic);
        if codec::peek(&self.bytes).is_err() {
            assert!(!is_read, "a body was read behind a header that cannot be");
        }
        if chance.once_in(8) {
            self.bytes.truncate(chance.below(8));
            self.read_as(Topic::Device);
        }
        if chance.once_in(8) {
            let mut key = topic.suffix().into_bytes();
            key.splice(..0, *b"tandem/robot/");
            mutate::damage(&mut key, 3, &mut chance);
            if let Some((robot, topic)) = keys::parse(&String::from_utf8_lossy(&key)) {
                assert_eq!(keys::parse(&topic.key(&robot)), Some((robot, topic)));
            }
        }
        1
    }
}
