//! The 1 kHz loop: the arm and the setpoint in force, advanced lazily from one event to the next.

use bincode::{Decode, Encode};
use tandem_wire::{Clearance, Cylinder, Envelope, MILLISECOND, Malformed, Memory, Obeyed, Remember, Setpoint, Stamp};

use crate::arm::{Arm, Drive, ToolBounds};
use crate::kinematics::{Frames, forward};
use crate::panda::PerJoint;
use crate::scene::closer_than;

/// Arm, setpoint and what is watched at every tick.
#[derive(Clone, Debug)]
pub(crate) struct Inner {
    arm: Arm,
    /// Ticks since the session began, skipped ones included.
    ticks: u64,
    /// The setpoint that the next plan takes up.
    waiting: Option<Waiting>,
    obeyed: Option<Obeyed>,
    /// The smallest clearance since the last report.
    closest: Option<Clearance>,
}

#[derive(Clone, Copy, Debug, Encode, Decode)]
struct Waiting {
    setpoint: Envelope<Setpoint>,
    arrived: Stamp,
}

impl Inner {
    pub(crate) fn standing(angles: PerJoint, obstacles: &[Cylinder]) -> Self {
        let arm = Arm::standing(angles);
        let closest = closer_than(None, &forward(arm.angles()), obstacles);
        Self {
            arm,
            ticks: 0,
            waiting: None,
            obeyed: None,
            closest,
        }
    }

    /// Puts the arm elsewhere, at rest, and forgets what it was told.
    pub(crate) fn jump_to(&mut self, angles: PerJoint, obstacles: &[Cylinder]) {
        *self = Self {
            ticks: self.ticks,
            ..Self::standing(angles, obstacles)
        };
    }

    pub(crate) fn arm(&self) -> &Arm {
        &self.arm
    }

    pub(crate) fn obeyed(&self) -> Option<Obeyed> {
        self.obeyed
    }

    /// The instant that the arm has reached.
    pub(crate) fn time(&self) -> Stamp {
        Stamp(self.ticks.saturating_mul(MILLISECOND))
    }

    /// Has the next plan take up this setpoint.
    pub(crate) fn obey(&mut self, setpoint: Envelope<Setpoint>, arrived: Stamp) {
        self.waiting = Some(Waiting { setpoint, arrived });
    }

    /// Whether further ticks without permission would change nothing.
    pub(crate) fn is_idle(&self) -> bool {
        self.arm.is_at_rest() && self.waiting.is_none()
    }

    /// Lets time pass until `ticks` without moving the arm.
    pub(crate) fn skip_to(&mut self, ticks: u64) {
        self.ticks = self.ticks.max(ticks);
        self.arm.idle();
    }

    /// Ticks since the session began.
    pub(crate) fn ticks(&self) -> u64 {
        self.ticks
    }

    /// One millisecond.
    pub(crate) fn tick(&mut self, permitted: bool, bounds: &ToolBounds, obstacles: &[Cylinder]) {
        if self.arm.plans_next() {
            self.take_up();
        }
        let drive = match self.obeyed {
            Some(obeyed) if permitted => Drive::Follow(obeyed.setpoint.velocity),
            _ => Drive::Stop,
        };
        self.arm.tick(drive, bounds);
        self.ticks = self.ticks.saturating_add(1);
        self.closest = closer_than(self.closest, &forward(self.arm.angles()), obstacles);
    }

    fn take_up(&mut self) {
        if let Some(Waiting { setpoint, arrived }) = self.waiting.take() {
            let moved = self.time().max(arrived);
            self.obeyed = Some(Obeyed {
                id: setpoint.header.id(),
                arrived,
                moved,
                setpoint: setpoint.body,
            });
        }
    }

    /// The frames now, the clearance now and the smallest one since the last time this was asked.
    pub(crate) fn look(&mut self, obstacles: &[Cylinder]) -> (Frames, Option<Clearance>, Option<Clearance>) {
        let frames = forward(self.arm.angles());
        let now = closer_than(None, &frames, obstacles);
        let closest = std::mem::replace(&mut self.closest, now);
        (frames, now, closest)
    }
}

/// Time ends behind this tick, and sums of stamps stay below it: some three hundred years.
const LAST_TICK: u64 = u64::MAX / MILLISECOND / 2;

impl Remember for Inner {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            arm,
            ticks,
            waiting,
            obeyed,
            closest,
        } = self;
        arm.remember(memory)?;
        memory.part(ticks)?;
        memory.check(*ticks <= LAST_TICK)?;
        memory.part(waiting)?;
        memory.part(obeyed)?;
        memory.part(closest)
    }
}
