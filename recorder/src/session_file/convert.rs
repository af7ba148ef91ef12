//! Our messages in our own protobuf: every field, under the name and in the unit that the schema promises.
//!
//! There is a file for each sender, named as its crate; here stands what several say.

mod arbiter;
mod clock;
mod counts;
mod operator;
mod predictor;
mod robot_sim;

use tandem_wire as wire;

use super::schemas::{Header, MessageId, Motion, Refusals};

impl From<&wire::Header> for Header {
    fn from(header: &wire::Header) -> Self {
        Self {
            tick: header.tick,
            session: header.session.0,
            sequence: header.seq.0,
            sent_ns: header.sent.0,
        }
    }
}

impl From<wire::MessageId> for MessageId {
    fn from(id: wire::MessageId) -> Self {
        Self {
            session: id.session.0,
            sequence: id.seq.0,
        }
    }
}

impl From<wire::Motion> for Motion {
    fn from(motion: wire::Motion) -> Self {
        let press = match motion {
            wire::Motion::Permitted { press } => press,
            wire::Motion::Held(_) => 0,
        };
        Self {
            permitted: motion.is_permitted(),
            press,
            held_because: motion.reason().map(|reason| reason.to_string()).unwrap_or_default(),
        }
    }
}

impl From<&wire::Refusals> for Refusals {
    fn from(refused: &wire::Refusals) -> Self {
        Self {
            count: refused.count,
            last: refused.last.map(|why| why.to_string()).unwrap_or_default(),
        }
    }
}
