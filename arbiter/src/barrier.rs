//! Lockstep's barrier: a tick is answered once all three streams have come to it, or are known not to come.
//!
//! Whatever hangs on the order in which the streams of one tick arrive waits here until they are all there.

use bincode::{Decode, Encode};
use tandem_wire::{Deadman, Malformed, Memory, Reason, Remember};

/// How far a stream has come.
#[derive(Clone, Copy, Debug, Default, Encode, Decode)]
pub(crate) struct Progress {
    /// The newest tick that came, or is known not to come.
    at: Option<u32>,
    /// The newest tick that is known not to come in time: its sample is late, and so are earlier ones.
    missed: Option<u32>,
}

impl Progress {
    /// Whether a sample of `tick` is late: that tick was answered without it.
    pub(crate) fn is_late(&self, tick: u32) -> bool {
        self.missed.is_some_and(|missed| tick <= missed)
    }

    /// The sample of `tick` came. A late one is no progress.
    pub(crate) fn come(&mut self, tick: u32) {
        if !self.is_late(tick) {
            self.at = Some(tick);
        }
    }

    /// The sample of `tick` does not come in time.
    pub(crate) const fn miss(&mut self, tick: u32) {
        self.at = Some(tick);
        self.missed = Some(tick);
    }
}

/// The three streams' progress, and what waits for the tick to be complete.
#[derive(Clone, Debug, Default)]
pub(crate) struct Barrier {
    pub(crate) command: Progress,
    pub(crate) proposal: Progress,
    pub(crate) state: Progress,
    answered: Option<u32>,
    deadman: Option<Deadman>,
    loss: Option<Reason>,
}

/// What waited for a tick to be complete.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Complete {
    pub(crate) tick: u32,
    /// How the deadman stands in the tick's command, if it came.
    pub(crate) deadman: Option<Deadman>,
    /// A stream had been lost before its sample of this tick came.
    pub(crate) loss: Option<Reason>,
}

impl Barrier {
    /// Keeps a command's deadman until all that was said in its tick is there.
    pub(crate) const fn keep_deadman(&mut self, deadman: Deadman) {
        self.deadman = Some(deadman);
    }

    /// Keeps the loss of the commands that ended with this tick's. One of the states goes before.
    pub(crate) fn keep_command_loss(&mut self, loss: Option<Reason>) {
        self.loss = self.loss.or(loss);
    }

    /// Keeps the loss of the states that ended with this tick's.
    pub(crate) fn keep_state_loss(&mut self, loss: Option<Reason>) {
        self.loss = loss.or(self.loss);
    }

    /// The tick that all three have come to, once.
    pub(crate) fn complete(&mut self) -> Option<Complete> {
        let tick = self.state.at?;
        let together = self.command.at == Some(tick) && self.proposal.at == Some(tick);
        if !together || self.answered == Some(tick) {
            return None;
        }
        self.answered = Some(tick);
        Some(Complete {
            tick,
            deadman: self.deadman.take(),
            loss: self.loss.take(),
        })
    }
}

impl Remember for Barrier {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            command,
            proposal,
            state,
            answered,
            deadman,
            loss,
        } = self;
        memory.part(command)?;
        memory.part(proposal)?;
        memory.part(state)?;
        memory.part(answered)?;
        memory.part(deadman)?;
        memory.part(loss)
    }
}
