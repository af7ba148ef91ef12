//! What the operator is doing, in one line for a screen.

use std::fmt;

use tandem_wire::{Condition, Deadman, Label, NodeName, Refusals, Session, Storage, Vec3};

use crate::hand::Handling;
use crate::human::{Doing, Ended, Waiting};
use crate::sight::Seen;

/// What the source of motion is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Activity {
    /// A simulated human steers.
    Simulated(Doing),
    /// Somebody steers with keys.
    Keyboard(Handling),
    /// A recording is played.
    Played(Handling),
}

/// The operator at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Status {
    /// What the source is doing.
    pub activity: Activity,
    /// The deadman as commanded.
    pub deadman: Deadman,
    /// The newest state, while states keep arriving.
    pub seen: Option<Seen>,
    /// The run of this operator, to know its own lease.
    pub session: Session,
    /// Where a simulated human that is driving wishes the tool to be at that state, in the base frame. No message tells.
    pub wish: Option<Vec3>,
    /// An emergency stop of this operator's is not acknowledged yet.
    pub unheard_stop: bool,
    /// Whether the session is recorded, as far as the recorder told.
    pub recording: Recording,
    /// Samples dropped so far.
    pub refused: Refusals,
}

/// What the operator knows of the recording. For the screen only: who drives does not depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Recording {
    /// Nothing was said: either all is well, or nobody records.
    #[default]
    Untold,
    /// The recorder's newest word.
    Told(Storage),
    /// The recorder was there and is gone.
    Gone,
}

impl Recording {
    pub(crate) fn hear_presence(&mut self, peer: NodeName, alive: bool) {
        match (peer, alive) {
            (NodeName::Recorder, false) => *self = Self::Gone,
            // A recorder that comes anew begins another file; its troubles it will tell.
            (NodeName::Recorder, true) => *self = Self::Untold,
            _ => {}
        }
    }
}

impl fmt::Display for Recording {
    /// Says what is wrong, and nothing when nothing is.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Told(storage) if storage.condition != Condition::Kept || storage.dropped > 0 => {
                write!(f, " · {storage}")
            }
            Self::Untold | Self::Told(_) => Ok(()),
            Self::Gone => f.write_str(" · NOT recorded, the recorder is gone"),
        }
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.line(f)?;
        self.recording.fmt(f)
    }
}

impl Status {
    fn own_lease(&self, asks: Option<Label>, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(" · you hold the lease")?;
        match asks {
            Some(name) if name.is_empty() => f.write_str(", another operator asks for it: L gives it up"),
            Some(name) => write!(f, ", {name} asks for it: L gives it up"),
            None => Ok(()),
        }
    }

    fn line(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.unheard_stop {
            f.write_str("EMERGENCY STOP NOT ACKNOWLEDGED, still calling · ")?;
        }
        write!(f, "{}", self.activity)?;
        let Some(seen) = &self.seen else {
            return f.write_str(" · no picture of the robot: its states stopped, so whatever is held counts as let go");
        };
        match seen.motion.reason() {
            Some(reason) => write!(f, " · robot holds: {reason}")?,
            None if seen.guided => write!(f, " · shared, ω {:.2}", seen.weight)?,
            None => write!(f, " · human alone, ω {:.2}", seen.weight)?,
        }
        let [x, y, z] = seen.tool.to_array();
        write!(f, " · tool {x:.3} {y:.3} {z:.3} m")?;
        match seen.lease {
            Some(lease) if lease.holder == self.session => self.own_lease(seen.asks, f)?,
            Some(lease) if lease.name.is_empty() => f.write_str(" · another operator holds the lease")?,
            Some(lease) => write!(f, " · {} holds the lease", lease.name)?,
            None => {}
        }
        if seen.crowded && seen.lease.is_none_or(|lease| lease.holder != self.session) {
            // Whom it refused it does not say; whoever presses in vain knows.
            f.write_str(" · too many operators: if your press does nothing, another one has to leave first")?;
        }
        match seen.trial {
            0 => f.write_str(" · no trial"),
            trial => write!(f, " · trial {trial}"),
        }
    }
}

impl fmt::Display for Activity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Simulated(doing) => doing.fmt(f),
            Self::Keyboard(handling) => f.write_str(match handling {
                Handling::Absent => "keyboard silent",
                Handling::Open => "no key held",
                Handling::Held => "you steer",
                Handling::Spent => "let go of all keys first",
            }),
            Self::Played(handling) => f.write_str(match handling {
                Handling::Absent => "no recording is played",
                Handling::Open => "the recording waits",
                Handling::Held => "the recording steers",
                Handling::Spent => "let go of the deadman first",
            }),
        }
    }
}

impl fmt::Display for Doing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Waiting(Waiting::NoTrial) => f.write_str("waiting for a trial"),
            Self::Waiting(Waiting::TrialBegun) => f.write_str("about to start"),
            Self::Waiting(Waiting::NotAtStart { distance }) => {
                write!(f, "waiting: the tool is {:.0} mm from its path's start", distance * 1e3)
            }
            Self::Driving { step } => write!(f, "driving, step {step:.0}"),
            Self::PressingAnew => f.write_str("pressing anew"),
            Self::Done(ended) => f.write_str(match ended {
                Ended::Arrived => "done: arrived",
                Ended::TimeUp => "done: out of time",
                Ended::GaveUp => "done: gave up on a robot that keeps stopping",
                Ended::TrialOver => "done: the trial is over",
            }),
        }
    }
}
