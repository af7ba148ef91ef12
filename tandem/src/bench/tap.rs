//! A robot that notes when a setpoint made of a new command reaches it.

use std::sync::{Arc, Mutex, PoisonError};

use serde::{Deserialize, Serialize};
use tandem_robot_sim::{Event, Output, RobotSim};
use tandem_wire::{
    Input, Malformed, Memory, MessageId, Nanos, Node, NodeName, Outbox, Ports, Question, Remember, Stamp, Topic, Turn,
};

/// A command that reached a robot.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Arrival {
    /// Which robot.
    pub(super) robot: u32,
    /// Its number in the operator's stream.
    pub(super) number: u64,
    /// When it was sent, by the operator's clock.
    pub(super) sent_ns: u64,
    /// When the robot took up the setpoint made of it, by the robot's.
    pub(super) arrived_ns: u64,
}

/// Where robots of one process note it.
#[derive(Clone, Default)]
pub(super) struct Arrivals(Arc<Mutex<Vec<Arrival>>>);

impl Arrivals {
    pub(super) fn note(&self, arrival: Arrival) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(arrival);
    }

    pub(super) fn take(&self) -> Vec<Arrival> {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// The robot, unchanged but for that, with a clock of its own: it is so much ahead of the process's. Robots that share a
/// process would otherwise all send their states at the same instant, as robots on machines of their own do not.
pub(super) struct Tapped {
    robot: RobotSim,
    ahead: Nanos,
    index: u32,
    arrivals: Arrivals,
    newest: Option<MessageId>,
}

impl Tapped {
    pub(super) const fn new(robot: RobotSim, index: u32, ahead: Nanos, arrivals: Arrivals) -> Self {
        Self {
            robot,
            ahead,
            index,
            arrivals,
            newest: None,
        }
    }
}

impl Node for Tapped {
    type Event = Event;
    type Output = Output;

    fn step(&mut self, now: Stamp, event: Event, outbox: &mut Outbox<Output>) {
        if let Event::Setpoint(setpoint) = &event
            && let Some(used) = setpoint.body.command
            && self.newest.replace(used.id) != Some(used.id)
        {
            self.arrivals.note(Arrival {
                robot: self.index,
                number: used.id.seq.0,
                sent_ns: used.sent.0,
                arrived_ns: now.0,
            });
        }
        self.robot.step(now.after(self.ahead), event, outbox);
    }

    fn deadline(&self) -> Option<Stamp> {
        let due = self.robot.deadline()?;
        Some(Stamp(due.0.saturating_sub(self.ahead)))
    }

    fn trial(&self) -> u32 {
        self.robot.trial()
    }
}

impl Remember for Tapped {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        self.robot.remember(memory)
    }
}

impl Ports for Tapped {
    const NAME: NodeName = RobotSim::NAME;
    const TURN: Turn = RobotSim::TURN;
    const INPUTS: &'static [Topic] = RobotSim::INPUTS;
    const OUTPUTS: &'static [Topic] = RobotSim::OUTPUTS;

    fn event(input: Input<'_>) -> Event {
        RobotSim::event(input)
    }

    fn sample(output: &Output, bytes: &mut Vec<u8>) -> Option<Topic> {
        RobotSim::sample(output, bytes)
    }

    fn question(output: &Output) -> Option<Question> {
        RobotSim::question(output)
    }
}
