//! Who may drive a robot: one operator holds its lease, the others watch.
//!
//! The arbiter grants it, because it is the one who obeys commands, and every setpoint carries it, so that the robot can
//! check it again and everybody who sees a state knows who drives.

use bincode::{Decode, Encode};

use crate::{Label, Session};

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
