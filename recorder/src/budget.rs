//! Where the time goes between a hand and the arm, and back: every hop of the loop, from the messages' own stamps.
//!
//! ```text
//!   device ─▶ operator ─▶ arbiter ─▶ robot ─▶ operator
//!    device   ·  command  · decision ·  setpoint  · uptake · report  ·  state
//!               └──────── command to motion ───────┘
//!               └──────────────────────── loop ─────────────────────────────┘
//! ```
//!
//! | hop | from | to | by whose clock |
//! | --- | --- | --- | --- |
//! | device | a device's sample arrives | the command made of it is sent | the operator's |
//! | command | the command is sent | it arrives at the arbiter | two, corrected by their offset |
//! | decision | the command arrives | the setpoint made of it is sent | the arbiter's |
//! | setpoint | the setpoint is sent | it arrives at the robot | two, corrected |
//! | uptake | the setpoint arrives | the first inner tick under it | the robot's |
//! | report | that tick | the first state that says so is sent | the robot's |
//! | state | a state is sent | it arrives at the operator | two, corrected |
//! | command to motion | the command is sent | the first inner tick under it | two, corrected |
//! | loop | a state is sent | the setpoint made of the command that answers it arrives | the robot's |
//!
//! Where one clock sees both ends nothing is corrected and nothing is uncertain: so the loop's time is taken from the round
//! trip alone. Where two are needed, [`ClockReport`]s give the offset, and the figure is uncertain by as much as the offset
//! is; a process's own nodes share a clock. A hop whose offset nobody knows is not measured.
//!
//! [`Budget`] is pure and takes what anybody hears who listens to a robot; device and state need the operator's journal.

mod hop;
mod offsets;

use std::collections::VecDeque;

use tandem_wire::{
    ClockReport, Command, Envelope, Happening, JournalBatch, MessageId, Nanos, NodeName, Setpoint, Stamp, State, Topic,
    codec, decode,
};

use crate::heard::{JournalPart, Sample};
pub use hop::{Basis, Hop, HopBudget, Percentiles};
use hop::{Measured, Timings};
pub use offsets::Offset;
use offsets::Offsets;

/// Messages that are remembered until somebody refers to them: five seconds' worth at 50 Hz.
const MEMORY: usize = 256;

/// Keeps the budget.
#[derive(Clone, Debug, Default)]
pub struct Budget {
    offsets: Offsets,
    timings: Timings,
    /// Which state each command answers.
    commands: Recent<MessageId>,
    /// When each setpoint was sent.
    setpoints: Recent<Stamp>,
    /// When each state was sent.
    states: Recent<Stamp>,
    /// The newest command that a setpoint was made of, the newest setpoint and command that the robot obeyed.
    decided: Option<MessageId>,
    obeyed: Option<MessageId>,
    moved: Option<MessageId>,
    /// When the newest sample of the device arrived, until a command is made of it.
    touched: Option<Stamp>,
}

impl Budget {
    /// Takes in a message that was heard for the first time.
    pub fn hear(&mut self, sample: &Sample) {
        match sample {
            Sample::Command(message) => self.hear_command(message),
            Sample::Setpoint(message) => self.hear_setpoint(message),
            Sample::State(message) => self.hear_state(message),
            Sample::Clock(node, message) => self.hear_clocks(*node, message),
            Sample::Journal(part) if part.node == NodeName::Operator => self.hear_journal(part),
            _ => {}
        }
    }

    /// Every hop that was measured at all, in the loop's order.
    #[must_use]
    pub fn hops(&self) -> Vec<HopBudget> {
        self.timings.hops()
    }

    /// What every node last said of every other's clock.
    #[must_use]
    pub fn offsets(&self) -> Vec<Offset> {
        self.offsets.all()
    }

    fn hear_clocks(&mut self, node: NodeName, message: &Envelope<ClockReport>) {
        self.offsets.hear(node, message.header.session, &message.body);
    }

    fn hear_command(&mut self, message: &Envelope<Command>) {
        if let Some(seen) = message.body.seen {
            self.commands.keep(message.header.id(), seen);
        }
    }

    fn hear_setpoint(&mut self, message: &Envelope<Setpoint>) {
        self.setpoints.keep(message.header.id(), message.header.sent);
        // A command is decided upon again and again while no other comes: the first time counts.
        let Some(used) = message.body.command.filter(|used| self.decided != Some(used.id)) else {
            return;
        };
        self.decided = Some(used.id);
        self.timings.add(Hop::Decision, Measured::exact(used.age));
        let arrived = Stamp(message.header.sent.0.saturating_sub(used.age));
        let travelled = self
            .offsets
            .travelled((used.id.session, used.sent), (message.header.session, arrived));
        self.timings.extend(Hop::Command, travelled);
    }

    fn hear_state(&mut self, message: &Envelope<State>) {
        let (state, header) = (&message.body, &message.header);
        self.states.keep(header.id(), header.sent);
        let Some(obeyed) = state.obeys.filter(|obeyed| self.obeyed != Some(obeyed.id)) else {
            return;
        };
        self.obeyed = Some(obeyed.id);
        self.timings
            .add(Hop::Uptake, Measured::exact(obeyed.moved.since(obeyed.arrived)));
        self.timings
            .add(Hop::Report, Measured::exact(header.sent.since(obeyed.moved)));
        if let Some(sent) = self.setpoints.find(obeyed.id) {
            let travelled = self
                .offsets
                .travelled((obeyed.id.session, sent), (header.session, obeyed.arrived));
            self.timings.extend(Hop::Setpoint, travelled);
        }
        let used = obeyed.setpoint.command.filter(|used| self.moved != Some(used.id));
        let Some(used) = used else { return };
        self.moved = Some(used.id);
        let travelled = self
            .offsets
            .travelled((used.id.session, used.sent), (header.session, obeyed.moved));
        self.timings.extend(Hop::CommandToMotion, travelled);
        let answered = self.commands.find(used.id);
        let begun = answered.filter(|seen| seen.session == header.session);
        if let Some(begun) = begun.and_then(|seen| self.states.find(seen)) {
            self.timings
                .add(Hop::Loop, Measured::exact(obeyed.arrived.since(begun)));
        }
    }

    /// The operator's journal says when a device's samples and the robot's states reached it.
    fn hear_journal(&mut self, part: &JournalPart) {
        let Ok(batch) = decode::<JournalBatch>(&part.bytes) else {
            return;
        };
        for entry in &batch.body.entries {
            match &entry.what {
                Happening::Sample {
                    topic: Topic::Device, ..
                } => self.touched = Some(entry.wall),
                Happening::Output {
                    topic: Topic::Command, ..
                } => {
                    if let Some(touched) = self.touched.take() {
                        self.timings
                            .add(Hop::Device, Measured::exact(entry.wall.since(touched)));
                    }
                }
                Happening::Sample {
                    topic: Topic::State,
                    bytes,
                } => {
                    if let Ok((_, header)) = codec::peek(bytes) {
                        let arrived = (batch.header.session, entry.wall);
                        let travelled = self.offsets.travelled((header.session, header.sent), arrived);
                        self.timings.extend(Hop::State, travelled);
                    }
                }
                _ => {}
            }
        }
    }
}

/// The newest messages by name.
#[derive(Clone, Debug)]
struct Recent<T>(VecDeque<(MessageId, T)>);

impl<T> Default for Recent<T> {
    fn default() -> Self {
        Self(VecDeque::with_capacity(MEMORY))
    }
}

impl<T: Copy> Recent<T> {
    fn keep(&mut self, id: MessageId, what: T) {
        if self.0.len() == MEMORY {
            self.0.pop_front();
        }
        self.0.push_back((id, what));
    }

    fn find(&self, wanted: MessageId) -> Option<T> {
        // What is asked for is nearly always among the newest.
        let found = self.0.iter().rev().find(|(id, _)| *id == wanted);
        found.map(|(_, what)| *what)
    }
}

/// A duration that may have come out below zero, for an offset is uncertain.
fn clamped(nanos: i128) -> Nanos {
    Nanos::try_from(nanos.max(0)).unwrap_or(Nanos::MAX)
}

#[cfg(test)]
mod tests;
