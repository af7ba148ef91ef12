//! Why the robot does not move, in words.

use std::fmt;

use bincode::{Decode, Encode};

use crate::Label;
use crate::stamp::{MessageId, Nanos, seconds};

/// Why motion is not permitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub enum Reason {
    /// Nobody has sent a command yet.
    NoCommandYet,
    /// No setpoint has arrived yet.
    NoSetpointYet,
    /// The command stream fell silent.
    CommandLost {
        /// How long it had been silent when motion was stopped, in nanoseconds.
        silent: Nanos,
    },
    /// The setpoint stream fell silent.
    SetpointLost {
        /// How long it had been silent when motion was stopped, in nanoseconds.
        silent: Nanos,
    },
    /// The state stream fell silent, so limits could not be checked.
    StateLost {
        /// How long it had been silent when motion was stopped, in nanoseconds.
        silent: Nanos,
    },
    /// The human let go.
    DeadmanReleased,
    /// Motion was stopped before; it needs a fresh press of the deadman.
    AwaitingPress,
    /// Commands arrive, but answer a state that is too old.
    LoopTooOld,
    /// The trial is over.
    TrialOver,
    /// No trial runs.
    NoTrial,
    /// The sender is shutting down.
    ShuttingDown,
    /// Another operator holds the lease, or has just taken it over.
    SecondOperator,
    /// Nobody holds the lease, or it was given up.
    NoLease,
    /// An emergency stop is in force until somebody clears it.
    EmergencyStop {
        /// Its name.
        stop: MessageId,
        /// Who stopped.
        by: Label,
    },
    /// Setpoints were expected every millisecond, and so many in a row did not come.
    SetpointsMissed {
        /// How many.
        in_a_row: u32,
    },
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let millis = |nanos: Nanos| seconds(nanos) * 1e3;
        match *self {
            Self::NoCommandYet => f.write_str("no command has arrived yet"),
            Self::NoSetpointYet => f.write_str("no setpoint has arrived yet"),
            Self::CommandLost { silent } => write!(f, "the operator's commands stopped {:.0} ms ago", millis(silent)),
            Self::SetpointLost { silent } => write!(f, "the arbiter's setpoints stopped {:.0} ms ago", millis(silent)),
            Self::StateLost { silent } => write!(f, "the robot's state stopped {:.0} ms ago", millis(silent)),
            Self::DeadmanReleased => f.write_str("the deadman is released"),
            Self::AwaitingPress => f.write_str("waiting for a fresh press of the deadman"),
            Self::LoopTooOld => f.write_str("commands answer a state that is too old"),
            Self::TrialOver => f.write_str("the trial is over"),
            Self::NoTrial => f.write_str("no trial is running"),
            Self::ShuttingDown => f.write_str("the node is shutting down"),
            Self::SetpointsMissed { in_a_row } => write!(f, "{in_a_row} setpoints in a row were missed"),
            Self::SecondOperator => f.write_str("another operator holds the lease"),
            Self::NoLease => f.write_str("nobody holds the lease"),
            Self::EmergencyStop { by, .. } if by.is_empty() => f.write_str("emergency stop"),
            Self::EmergencyStop { by, .. } => write!(f, "emergency stop by {by}"),
        }
    }
}

/// Whether motion is permitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub enum Motion {
    /// The human holds the deadman; the press is numbered.
    Permitted {
        /// Which press of the deadman permits it.
        press: u32,
    },
    /// The robot holds still, or is being brought to rest.
    Held(Reason),
}

impl Motion {
    /// Whether motion is permitted.
    #[must_use]
    pub const fn is_permitted(self) -> bool {
        matches!(self, Self::Permitted { .. })
    }

    /// Why not, if not.
    #[must_use]
    pub const fn reason(self) -> Option<Reason> {
        match self {
            Self::Permitted { .. } => None,
            Self::Held(reason) => Some(reason),
        }
    }
}
