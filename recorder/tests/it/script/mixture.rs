//! States and setpoints between other messages, for whoever measures a load: those of the wire's golden bytes, in which
//! everything is there that a message can say.

use tandem_wire::{Envelope, Message, Seq, Setpoint, Stamp, State, Topic, decode, encode};

const GOLDEN: &str = include_str!("../../../../wire/tests/golden.txt");

/// So many of a hundred messages are states and setpoints in turns, evenly spread.
pub(crate) struct Mixture {
    converted: u64,
    number: u64,
    state: Envelope<State>,
    setpoint: Envelope<Setpoint>,
}

impl Mixture {
    pub(crate) fn new(converted: u64) -> Self {
        Self {
            converted: converted.min(100),
            number: 0,
            state: golden("state"),
            setpoint: golden("setpoint"),
        }
    }

    /// The next message, sent at `now`; `None` where another is due. Each stream is numbered without a gap.
    pub(crate) fn next(&mut self, now: Stamp) -> Option<(Topic, Vec<u8>)> {
        let before = self.number * self.converted / 100;
        self.number += 1;
        if self.number * self.converted / 100 == before {
            return None;
        }
        let seq = Seq(before / 2 + 1);
        Some(match before % 2 {
            0 => (Topic::State, numbered(&mut self.state, seq, now)),
            _ => (Topic::Setpoint, numbered(&mut self.setpoint, seq, now)),
        })
    }
}

/// A message with a golden block of its own: its name, then its bytes in hexadecimal digits.
fn golden<M: Message>(name: &str) -> Envelope<M> {
    let mut blocks = GOLDEN.split("\n\n").filter_map(|block| block.split_once('\n'));
    let block = blocks.find(|(called, _)| *called == name);
    let (_, digits) = block.expect("every message has its golden bytes");
    let digits: Vec<char> = digits.chars().filter(|digit| !digit.is_whitespace()).collect();
    let byte = |pair: &[char]| u8::from_str_radix(&pair.iter().collect::<String>(), 16);
    let bytes: Result<Vec<u8>, _> = digits.chunks(2).map(byte).collect();
    decode(&bytes.expect("hexadecimal digits")).expect("golden bytes follow the layout")
}

fn numbered<M: Message>(message: &mut Envelope<M>, seq: Seq, sent: Stamp) -> Vec<u8> {
    (message.header.seq, message.header.sent) = (seq, sent);
    let mut bytes = Vec::new();
    encode(message, &mut bytes);
    bytes
}
