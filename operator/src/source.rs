//! Where motion comes from.

use tandem_wire::{Deadman, Malformed, Memory, Remember, Stamp, Vec3};

use crate::config::MAX_SPEED;
use crate::device::{Asked, DeviceSample, Keyboard};
use crate::human::SimulatedHuman;
use crate::played::{Played, PlayedSample};
use crate::sight::Sight;
use crate::status::Activity;

/// Somebody, or something, that steers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Source {
    /// A simulated human: decides once per control period.
    Simulated(Box<SimulatedHuman>),
    /// A local device: its keys count at once.
    Device(Keyboard),
    /// A recording that is played.
    Played(Played),
}

impl Source {
    /// Shows it a state.
    pub(crate) fn see(&mut self, sight: &Sight) {
        match self {
            Self::Simulated(human) => human.see(sight),
            Self::Device(_) | Self::Played(_) => {}
        }
    }

    /// Tells it that states stopped arriving.
    pub(crate) fn go_blind(&mut self) {
        match self {
            Self::Simulated(human) => human.go_blind(),
            Self::Device(keyboard) => keyboard.hand_mut().go_blind(),
            Self::Played(played) => played.hand_mut().go_blind(),
        }
    }

    /// Hands it a device's sample; says what that asks for.
    pub(crate) fn take(&mut self, now: Stamp, sample: DeviceSample, has_picture: bool) -> Asked {
        match self {
            Self::Simulated(_) | Self::Played(_) => Asked::default(),
            Self::Device(keyboard) => keyboard.take(now, sample, has_picture),
        }
    }

    /// Hands it a sample of a recording.
    pub(crate) fn take_played(&mut self, now: Stamp, sample: PlayedSample, has_picture: bool) {
        match self {
            Self::Played(played) => played.take(now, sample, has_picture),
            Self::Simulated(_) | Self::Device(_) => {}
        }
    }

    /// Lets time pass.
    pub(crate) fn expire(&mut self, now: Stamp) {
        match self {
            Self::Simulated(_) => {}
            Self::Device(keyboard) => keyboard.expire(now),
            Self::Played(played) => {
                played.hand_mut().expire(now);
            }
        }
    }

    /// When it changes by itself.
    pub(crate) fn deadline(&self) -> Option<Stamp> {
        match self {
            Self::Simulated(_) => None,
            Self::Device(keyboard) => keyboard.hand().deadline(),
            Self::Played(played) => played.hand().deadline(),
        }
    }

    /// The velocity it wants, in the base frame; zero unless its deadman is held.
    pub(crate) fn velocity(&self) -> Vec3 {
        let wanted = match self {
            Self::Simulated(human) => human.velocity(),
            Self::Device(keyboard) => keyboard.velocity(),
            Self::Played(played) => played.velocity(),
        };
        wanted.capped(MAX_SPEED)
    }

    /// Its deadman.
    pub(crate) fn deadman(&self) -> Deadman {
        match self {
            Self::Simulated(human) => human.deadman(),
            Self::Device(keyboard) => keyboard.hand().deadman(),
            Self::Played(played) => played.hand().deadman(),
        }
    }

    /// Where it wishes the tool to be, if that can be known.
    pub(crate) fn wish(&self) -> Option<Vec3> {
        match self {
            Self::Simulated(human) => human.wish(),
            Self::Device(_) | Self::Played(_) => None,
        }
    }

    /// What it is doing.
    pub(crate) fn activity(&self) -> Activity {
        match self {
            Self::Simulated(human) => Activity::Simulated(human.doing()),
            Self::Device(keyboard) => Activity::Keyboard(keyboard.hand().handling()),
            Self::Played(played) => Activity::Played(played.hand().handling()),
        }
    }
}

impl Remember for Source {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        match self {
            Self::Simulated(human) => human.remember(memory),
            Self::Device(keyboard) => keyboard.remember(memory),
            Self::Played(played) => played.remember(memory),
        }
    }
}
