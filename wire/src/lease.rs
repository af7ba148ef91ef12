//! Who may drive a robot: one operator holds its lease, the others watch.
//!
//! The arbiter grants it, because it is the one who obeys commands, and every setpoint carries it, so that the robot can
//! check it again and everybody who sees a state knows who drives.

use bincode::{Decode, Encode};

use crate::{Envelope, Label, Malformed, Session, Topic, decode};

/// The right to drive, as it was granted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub struct Lease {
    /// Counts the grants of one arbiter's run, from 1: a later one outdates all before.
    pub number: u32,
    /// The operator's run that holds it.
    pub holder: Session,
    /// What the holder is called, as far as it has said so.
    pub name: Label,
}

/// What an operator wants of the lease. Whoever presses while nobody holds it gets it without asking.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub enum Wish {
    /// To drive: sent with each press, so that the arbiter knows the name.
    Drive,
    /// To give the lease up.
    Release,
    /// To take it from whoever holds it; only a supervisor may.
    TakeOver,
}

/// An operator says something about the lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub struct Claim {
    /// What it wants.
    pub wish: Wish,
    /// What it is called.
    pub name: Label,
}

impl Claim {
    /// Where it counts. Not everybody who may drive may take the lease away, so that a take-over has a key of its own.
    #[must_use]
    pub const fn topic(&self) -> Topic {
        match self.wish {
            Wish::TakeOver => Topic::TakeOver,
            Wish::Drive | Wish::Release => Topic::Lease,
        }
    }

    /// Reads what came on `topic`.
    ///
    /// # Errors
    /// If it is none, or has no force there.
    pub fn read(topic: Topic, bytes: &[u8]) -> Result<Envelope<Self>, Malformed> {
        let message: Envelope<Self> = decode(bytes)?;
        if message.body.topic() == topic {
            Ok(message)
        } else {
            Err(Malformed::Key)
        }
    }
}
