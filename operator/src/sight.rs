//! What the operator sees of the robot: the newest state, read for whoever steers.

use bincode::{Decode, Encode};
use tandem_wire::{
    Envelope, Header, Label, Lease, Malformed, Memory, MessageId, Motion, Refusal, Remember, Seq, Session, State,
    TaskFrame, Vec3,
};

/// The newest state, as far as the operator cares.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct Seen {
    /// Which state.
    pub id: MessageId,
    /// Its control period.
    pub tick: u32,
    /// The running trial; 0 if none runs.
    pub trial: u32,
    /// Where the tool's tip is, in the base frame.
    pub tool: Vec3,
    /// Whether the robot moves, and if not, why.
    pub motion: Motion,
    /// The human's weight in the setpoint in force; 1 if there is none.
    pub weight: f64,
    /// Whether the robot has a say in that setpoint.
    pub guided: bool,
    /// Who may drive, by that setpoint.
    pub lease: Option<Lease>,
    /// Who would like to have it, by that setpoint.
    pub asks: Option<Label>,
    /// Whether the arbiter, when it made that setpoint, had last refused an operator for want of a place.
    pub crowded: bool,
}

/// Whether there is a picture of the robot.
///
/// ```text
///         state             silence
///  Never ───────▶ Live ────────────────▶ Lost
///                  ▲                      │
///                  └──────── state ───────┘
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub(crate) enum Picture {
    Never,
    Live(Seen),
    Lost(Seen),
}

impl Picture {
    /// The newest state, however old.
    pub(crate) const fn newest(&self) -> Option<&Seen> {
        match self {
            Self::Never => None,
            Self::Live(seen) | Self::Lost(seen) => Some(seen),
        }
    }

    /// The newest state, if states keep arriving.
    pub(crate) const fn live(&self) -> Option<&Seen> {
        match self {
            Self::Live(seen) => Some(seen),
            Self::Never | Self::Lost(_) => None,
        }
    }
}

/// One state as a human in the plane of the task sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sight {
    /// The control period.
    pub(crate) tick: u32,
    /// How many control periods later than the state before; decisions advance only if it is not zero.
    pub(crate) passed: u32,
    /// Whether the robot was started anew since the state before.
    pub(crate) new_robot: bool,
    /// The running trial.
    pub(crate) trial: u32,
    /// The control period in which it began: another sender may begin one of the same number.
    pub(crate) trial_start: u32,
    /// Where the tool is, in task coordinates.
    pub(crate) tool: [f64; 2],
    /// Whether the robot moves, and if not, why.
    pub(crate) motion: Motion,
    /// What the robot wants, once there is a forecast.
    pub(crate) guide: Option<Guide>,
    /// The human's weight in the setpoint in force.
    pub(crate) weight: f64,
}

/// The robot's guidance in the setpoint in force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Guide {
    /// The phase by now, in steps.
    pub(crate) phase: f64,
    /// The robot's velocity, in the plane of the task.
    pub(crate) velocity: [f64; 2],
}

/// Turns states into sights.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Eyes {
    frame: TaskFrame,
    session: Option<Session>,
    ticks: Ticks,
}

impl Eyes {
    pub(crate) fn new(frame: TaskFrame) -> Self {
        Self {
            frame,
            session: None,
            ticks: Ticks::default(),
        }
    }

    /// Takes in an admitted state.
    pub(crate) fn see(&mut self, state: &Envelope<State>) -> (Seen, Sight) {
        let Envelope { header, body } = state;
        let new_robot = self.session != Some(header.session);
        if new_robot {
            self.session = Some(header.session);
            self.ticks = Ticks::default();
        }
        let passed = self.ticks.note(header);
        let setpoint = body.obeys.as_ref().map(|obeyed| &obeyed.setpoint);
        let seen = Seen {
            id: header.id(),
            tick: header.tick,
            trial: body.trial,
            tool: body.tool.position,
            motion: body.motion,
            weight: setpoint.map_or(1.0, |setpoint| setpoint.weight.0),
            guided: setpoint.is_some_and(|setpoint| setpoint.guidance.is_some()),
            lease: setpoint.and_then(|setpoint| setpoint.lease),
            asks: setpoint.and_then(|setpoint| setpoint.asks),
            crowded: setpoint.is_some_and(|setpoint| setpoint.refused.last == Some(Refusal::NoSeat)),
        };
        let sight = Sight {
            tick: header.tick,
            passed,
            new_robot,
            trial: body.trial,
            trial_start: body.trial_start,
            tool: self.frame.to_task(seen.tool),
            motion: body.motion,
            guide: self.guide(header, body),
            weight: seen.weight,
        };
        (seen, sight)
    }

    /// The guidance in force, its phase brought forward to now: it advances by a step in every period in which the
    /// robot moves, and the setpoint was made from an earlier state. One from before this trial guides no more.
    fn guide(&self, header: &Header, state: &State) -> Option<Guide> {
        let setpoint = &state.obeys.as_ref()?.setpoint;
        let guidance = setpoint.guidance.as_ref()?;
        let made = self.ticks.of(header, setpoint.seen?)?;
        if made < state.trial_start {
            return None;
        }
        let passed = if state.motion.is_permitted() {
            header.tick.saturating_sub(made)
        } else {
            0
        };
        Some(Guide {
            phase: guidance.phase.0 + f64::from(passed),
            velocity: [
                guidance.velocity.dot(self.frame.x_axis),
                guidance.velocity.dot(self.frame.y_axis),
            ],
        })
    }
}

impl Remember for Eyes {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            frame: _,
            session,
            ticks: Ticks { first },
        } = self;
        memory.part(session)?;
        memory.part(first)?;
        memory.check(first.len() <= REMEMBERED)
    }
}

/// How many control periods are remembered: more than any state within the limit on loop age needs.
const REMEMBERED: usize = 16;

/// The first state of each of the last control periods, oldest first.
#[derive(Clone, Debug, Default, PartialEq)]
struct Ticks {
    first: Vec<(Seq, u32)>,
}

impl Ticks {
    /// Notes a state; says how many periods later it is than the one before. The first one is new in any case.
    fn note(&mut self, header: &Header) -> u32 {
        let passed = match self.first.last() {
            Some(&(_, tick)) if tick == header.tick => return 0,
            Some(&(_, tick)) => header.tick.saturating_sub(tick).max(1),
            None => 1,
        };
        if self.first.len() == REMEMBERED {
            self.first.remove(0);
        }
        self.first.push((header.seq, header.tick));
        passed
    }

    /// The period of state `id`; `None` if it is another robot's or forgotten.
    fn of(&self, newest: &Header, id: MessageId) -> Option<u32> {
        let known = id.session == newest.session && id.seq <= newest.seq;
        let period = self.first.iter().rev().find(|(first, _)| *first <= id.seq);
        period.filter(|_| known).map(|&(_, tick)| tick)
    }
}
