//! Lockstep: a tick is answered once, when its three streams have come to it or are known not to.

use tandem_wire::{Header, Outbox, Pace, Reason, Refusal, Stamp, Topic};

use super::{Arbiter, Output};
use crate::barrier::Complete;

impl Arbiter {
    pub(super) fn on_refused_command(
        &mut self,
        now: Stamp,
        header: &Header,
        why: Refusal,
        outbox: &mut Outbox<Output>,
    ) {
        self.hearing.refuse(why);
        if why == Refusal::LoopTooOld && self.hearing.operators().listens_to(header.session) {
            // In lockstep the operator has answered its tick all the same.
            self.barrier.command.come(header.tick);
            self.answer_tick(now, outbox);
        }
    }

    /// In lockstep: a sample does not come in time. Its tick is answered with what was heard before, by its age.
    pub(super) fn on_missed(&mut self, now: Stamp, topic: Topic, tick: u32, outbox: &mut Outbox<Output>) {
        if self.timing.pace != Pace::Lockstep {
            return;
        }
        match topic {
            Topic::Command => self.barrier.command.miss(tick),
            Topic::Proposal => self.barrier.proposal.miss(tick),
            Topic::State => {
                self.barrier.state.miss(tick);
                self.hearing.miss_state(tick);
            }
            _ => {}
        }
        self.answer_tick(now, outbox);
    }

    /// In lockstep, answers once state, command and proposal of one tick are there, or known not to come.
    pub(super) fn answer_tick(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        if self.timing.pace != Pace::Lockstep {
            return;
        }
        let Some(Complete { tick, deadman, loss }) = self.barrier.complete() else {
            return;
        };
        self.expire_lease(now);
        self.stop_after(loss);
        match deadman {
            Some(deadman) => self.hear(now, deadman),
            None => self.stop_after(self.forbidden(now)),
        }
        self.publish_for(now, tick, outbox);
    }

    /// What is asked for in lockstep only: in real time losses were looked for before.
    pub(super) fn in_lockstep(&self, loss: impl FnOnce() -> Option<Reason>) -> Option<Reason> {
        match self.timing.pace {
            Pace::Lockstep => loss(),
            Pace::Real => None,
        }
    }

    /// A stream that is heard again had been lost: whatever is pressed by now does not count.
    pub(super) fn stop_after(&mut self, loss: Option<Reason>) {
        if let Some(reason) = loss {
            self.helm.stop(reason);
        }
    }
}
