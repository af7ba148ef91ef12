//! The driver's states, and what they are in words.

use std::fmt;

use tandem_wire::{Nanos, Reason, SECOND, Vec3, seconds};

/// How long the tool may take to come nearer to the path.
pub(super) const NO_PROGRESS: Nanos = 3 * SECOND;

/// What the person asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wish {
    /// Hold the deadman: begin, or go on.
    Go,
    /// Let go of it.
    Stop,
}

/// Where it stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Phase {
    /// No state of the robot has come yet.
    Looking,
    /// The deadman is released, and why.
    Waiting(Pause),
    /// The deadman is held; nobody has permitted motion yet.
    Asking,
    /// On the straight line to the path; the distance left, in metres.
    Easing(f64),
    /// On the path.
    Following,
    /// It is over.
    Ended(End),
}

/// Why the deadman is released.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pause {
    /// It was never held.
    Ready,
    /// The person let go.
    Stopped,
    /// Arbiter or robot hold motion.
    Held(Reason),
    /// The tool is this far from where the recording has it, in metres.
    Astray(f64),
    /// The tool has not come nearer to the path for three seconds.
    NoProgress,
}

/// How it ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum End {
    /// The path was driven to its end.
    Arrived,
    /// The robot stands elsewhere: how far, and how far it may be, in metres.
    TooFar {
        /// The tool's distance from the path.
        distance: f64,
        /// The largest that is eased in over.
        limit: f64,
    },
    /// The arm is bent another way.
    OtherPosture {
        /// Which joint differs most, from 1.
        joint: usize,
        /// By how much, in radians.
        by: f64,
        /// By how much it may.
        limit: f64,
    },
    /// The robot fell silent.
    Silent {
        /// For how long.
        nanos: Nanos,
        /// Whether it was ever heard.
        ever: bool,
    },
}

/// What the hand does now.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hand {
    /// Whether the deadman is held.
    pub held: bool,
    /// Presses so far, modulo 256.
    pub presses: u8,
    /// Velocity of the tool, in the base frame, in metres per second.
    pub velocity: Vec3,
}

/// How far the tool was from the recorded path while it was followed, in metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation {
    sum: f64,
    /// States that were looked at.
    pub count: u32,
    /// The largest distance from the nearest place on the path.
    pub largest: f64,
    /// The largest distance from where the recording was at that moment: lateness counts, too.
    pub largest_in_time: f64,
}

impl Deviation {
    pub(super) const NONE: Self = Self {
        sum: 0.0,
        count: 0,
        largest: 0.0,
        largest_in_time: 0.0,
    };

    /// The mean distance from the nearest place on the path.
    #[must_use]
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / f64::from(self.count))
    }

    pub(super) fn add(&mut self, distance: f64, in_time: f64) {
        self.sum += distance;
        self.count += 1;
        self.largest = self.largest.max(distance);
        self.largest_in_time = self.largest_in_time.max(in_time);
    }
}

impl fmt::Display for Pause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Ready => f.write_str("ready"),
            Self::Stopped => f.write_str("stopped"),
            Self::Held(reason) => write!(f, "held: {reason}"),
            Self::Astray(distance) => write!(
                f,
                "stopped: the tool is {:.0} mm from where the recording has it",
                distance * 1e3
            ),
            Self::NoProgress => write!(
                f,
                "stopped: the tool has not come nearer to the recorded path for {:.0} s",
                seconds(NO_PROGRESS)
            ),
        }
    }
}

impl fmt::Display for End {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Arrived => f.write_str("driven to the end of the recorded path"),
            Self::TooFar { distance, limit } => write!(
                f,
                "the tool is {:.0} mm from the recorded position, more than the {:.0} mm that it would be eased in over; \
                 bring it nearer, or set replay.ease_in_within_mm",
                distance * 1e3,
                limit * 1e3
            ),
            Self::OtherPosture { joint, by, limit } => write!(
                f,
                "joint {joint} differs by {by:.2} rad from the recorded posture, more than the {limit:.2} rad that are \
                 allowed; bring the arm into that posture, or set replay.joints_within_rad"
            ),
            Self::Silent { ever: false, nanos } => write!(
                f,
                "no robot of this name has said anything for {:.0} s: is it running, and is the name right?",
                seconds(nanos)
            ),
            Self::Silent { nanos, .. } => write!(f, "the robot has said nothing for {:.1} s", seconds(nanos)),
        }
    }
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Looking => f.write_str("looking for the robot"),
            Self::Waiting(pause) => pause.fmt(f),
            Self::Asking => f.write_str("waiting for the robot's permission"),
            Self::Easing(distance) => write!(f, "easing in, {:.0} mm to go", distance * 1e3),
            Self::Following => f.write_str("driving"),
            Self::Ended(end) => end.fmt(f),
        }
    }
}
