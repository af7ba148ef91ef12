//! Lockstep: a period is simulated once its setpoint has come, or is known not to come in time.

use tandem_wire::{Envelope, Outbox, Refusal, Setpoint, Stamp, Topic};

use super::{Output, RobotSim};

impl RobotSim {
    /// In lockstep: a setpoint that a bad line kept back comes within the period that has to do without it.
    pub(super) fn on_late_setpoint(&mut self, at: Stamp, setpoint: Envelope<Setpoint>) {
        if !setpoint.body.velocity.is_finite() {
            return self.hearing.refuse(Refusal::Unreadable);
        }
        self.catch_up(at);
        match self.hearing.admit(at, &setpoint) {
            Err(why) => self.hearing.refuse(why),
            Ok(motion) => self.obey(at, motion, setpoint),
        }
    }

    /// In lockstep: the setpoint of this period does not come any more. The arm goes on under the one before, by its age.
    pub(super) fn on_missed(&mut self, topic: Topic, tick: u32, outbox: &mut Outbox<Output>) {
        if topic == Topic::Setpoint && self.in_step && tick == self.tick {
            self.finish_period(outbox);
        }
    }

    /// Whether an instant of the shell's lies within the period at hand, behind its begin. The robot's own time does not.
    pub(super) fn is_within_period(&self, at: Stamp) -> bool {
        let [begin, end] =
            [self.tick, self.tick.saturating_add(1)].map(|tick| Stamp::of_tick(tick, self.timing.period));
        self.in_step && begin < at && at <= end
    }

    /// Lockstep: the rest of this period under the setpoint that just came, then the next state.
    pub(super) fn finish_period(&mut self, outbox: &mut Outbox<Output>) {
        let tick = self.tick.saturating_add(1);
        self.catch_up(Stamp::of_tick(tick, self.timing.period));
        self.tick = tick;
        self.publish_state(Stamp::of_tick(tick, self.timing.period), outbox);
    }
}
