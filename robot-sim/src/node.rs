//! The step machine: one named handler per event, the watchdog, and what is published.

mod lockstep;
mod memory;
mod publishing;

use std::sync::Arc;

use tandem_wire::{
    Emergency, Envelope, Latch, MILLISECOND, Motion, Node, Numbering, Outbox, Pace, Reason, Refusal, Refusals, Scene,
    Session, Setpoint, Stamp, State, Timing, Topic, Trial, Unreadable,
};

use crate::config::{LinkName, RobotSimSettings, Surroundings, UnusableScene};
use crate::hearing::Hearing;
use crate::inner::Inner;
use crate::pulse::Pulse;
use crate::trials::Running;

/// Everything that can happen to the robot.
#[derive(Clone, Debug, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "a setpoint is half a kilobyte; a box would allocate for every one"
)]
pub enum Event {
    /// What shall be done.
    Setpoint(Envelope<Setpoint>),
    /// A trial begins or ends.
    Trial(Envelope<Trial>),
    /// An emergency stop, or its end.
    Emergency(Envelope<Emergency>),
    /// Bytes that are no message.
    Unreadable(Unreadable),
    /// The deadline has come.
    Wake,
    /// Somebody's token appeared or vanished, which decides nothing here.
    Presence,
    /// The process is about to end.
    Stop,
    /// In lockstep: the sample of a tick does not come now.
    Missed {
        /// Whose sample.
        topic: Topic,
        /// Which tick's.
        tick: u32,
    },
}

/// Everything that the robot can cause.
#[derive(Clone, Debug, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "nearly every output is a state; a box would allocate for every one"
)]
pub enum Output {
    /// What the arm does.
    State(Envelope<State>),
    /// What stands around it.
    Scene(Envelope<Arc<Scene>>),
}

/// The simulated robot; see the [crate's page](crate) for its states.
#[derive(Clone, Debug)]
pub struct RobotSim {
    timing: Timing,
    surroundings: Surroundings,
    states: Numbering,
    scenes: Numbering,
    hearing: Hearing,
    inner: Inner,
    motion: Motion,
    /// Why the robot stopped by itself, until a state has told it.
    untold: Option<Reason>,
    latch: Latch,
    pulse: Pulse,
    trial: Running,
    /// Control periods since the session began.
    tick: u32,
    /// Whether lockstep has begun: the state of `tick` is out, its setpoint awaited.
    in_step: bool,
    next_state: Stamp,
    next_scene: Stamp,
    closed: bool,
}

impl RobotSim {
    /// A robot that numbers its messages in `session` and stands at the start.
    ///
    /// # Errors
    /// When settings that are each in range cannot be used together, or the start cannot be reached.
    pub fn new(session: Session, timing: Timing, settings: &RobotSimSettings) -> Result<Self, UnusableScene> {
        let surroundings = settings.surroundings(&timing)?;
        let mut inner = Inner::standing(surroundings.start, &surroundings.scene.obstacles);
        let tick = match timing.pace {
            Pace::Lockstep => timing.first_tick,
            Pace::Real => 0,
        };
        inner.skip_to(Stamp::of_tick(tick, timing.period).0 / MILLISECOND);
        Ok(Self {
            timing,
            states: Numbering::new(session),
            scenes: Numbering::new(session),
            hearing: Hearing::new(&timing),
            inner,
            motion: Motion::Held(Reason::NoSetpointYet),
            untold: None,
            latch: Latch::default(),
            pulse: Pulse::default(),
            trial: Running::default(),
            tick,
            in_step: false,
            next_state: Stamp(0),
            next_scene: Stamp(0),
            closed: false,
            surroundings,
        })
    }

    /// Whether the robot lets itself move.
    #[must_use]
    pub const fn motion(&self) -> Motion {
        self.motion
    }

    /// What was dropped so far.
    #[must_use]
    pub fn refused(&self) -> Refusals {
        self.hearing.refused()
    }

    /// Joint angles and speeds, for tests and simulations that look inside.
    #[must_use]
    pub fn arm(&self) -> &crate::arm::Arm {
        self.inner.arm()
    }

    fn on_setpoint(&mut self, now: Stamp, setpoint: Envelope<Setpoint>, outbox: &mut Outbox<Output>) {
        let lockstep = self.timing.pace == Pace::Lockstep;
        // Decoding lets no such number in; an event made in this process may hold one.
        if !setpoint.body.velocity.is_finite() {
            return self.hearing.refuse(Refusal::Unreadable);
        }
        if lockstep && (!self.in_step || setpoint.header.tick != self.tick) {
            return self.hearing.refuse(Refusal::OutOfOrder);
        }
        match self.hearing.admit(now, &setpoint) {
            Err(why) => {
                self.hearing.refuse(why);
                let answers = lockstep && why == Refusal::LoopTooOld && self.hearing.listens_to(&setpoint.header);
                if !answers {
                    return;
                }
            }
            Ok(motion) => self.obey(now, motion, setpoint),
        }
        if lockstep {
            self.finish_period(outbox);
        }
    }

    fn obey(&mut self, now: Stamp, motion: Motion, setpoint: Envelope<Setpoint>) {
        let was_permitted = self.motion.is_permitted();
        self.motion = match (motion, self.untold) {
            // The next setpoint may come within a millisecond, and what it says would hide this.
            (Motion::Held(_), Some(reason)) => Motion::Held(reason),
            _ => motion,
        };
        if setpoint.body.motion.is_permitted() && self.trial.number == 0 {
            self.hold(Reason::NoTrial);
        }
        self.pulse.beat();
        if self.motion.is_permitted() && !was_permitted {
            self.pulse.begin();
        }
        self.latch.hear_of(setpoint.body.motion);
        self.keep_stopped();
        self.inner.obey(setpoint, now);
    }

    fn on_trial(&mut self, trial: &Envelope<Trial>) {
        if self.trial.take(trial) {
            self.end_trial();
        }
    }

    /// An emergency stop does not wait for the arbiter, nor its acknowledgement for the next state that is due.
    fn on_emergency(&mut self, now: Stamp, emergency: &Envelope<Emergency>, outbox: &mut Outbox<Output>) {
        if !self.latch.hear(emergency) {
            return;
        }
        self.motion = Motion::Held(Reason::AwaitingPress);
        self.hearing.forget_press();
        self.keep_stopped();
        if self.timing.pace == Pace::Real {
            self.publish_state(now, outbox);
        }
    }

    /// While an emergency stop is in force nothing else is said about motion, and no press counts.
    fn keep_stopped(&mut self) {
        if let Some(reason) = self.latch.reason() {
            self.motion = Motion::Held(reason);
            self.hearing.forget_press();
        }
    }

    /// The process ends, and nothing will ramp the arm down once it has: so its ramp is simulated ahead, and told.
    fn on_stop(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        self.hold(Reason::ShuttingDown);
        self.publish_state(now, outbox);
        self.in_step = false;
        let mut left = self.surroundings.stop_ticks_max;
        while left > 0 && !self.inner.is_idle() {
            // In lockstep time stands still, and there is only one more state to tell.
            let until = match self.timing.pace {
                Pace::Real => self.next_state.max(self.inner.time().after(MILLISECOND)),
                Pace::Lockstep => Stamp(u64::MAX),
            };
            let before = left;
            left = self.run_to(until.0 / MILLISECOND, left);
            if left == before {
                // At the end of all time none is left to come to rest in.
                break;
            }
            self.publish_state(self.time(self.inner.time()), outbox);
        }
        self.closed = true;
    }

    fn end_trial(&mut self) {
        self.trial.number = 0;
        if self.motion.is_permitted() {
            self.hold(Reason::TrialOver);
        }
    }

    fn hold(&mut self, reason: Reason) {
        self.motion = Motion::Held(reason);
        self.hearing.spend_press();
        self.keep_stopped();
    }

    /// Simulates every inner tick up to `now` under what was known then. If the process slept for so long that this
    /// would take too many, what is left of a motion is made up for in the next steps; a standing arm skips the time.
    fn catch_up(&mut self, now: Stamp) {
        let target = now.0 / MILLISECOND;
        self.run_to(target, self.surroundings.stop_ticks_max);
        if self.inner.ticks() < target && self.is_standing() {
            self.inner.skip_to(target);
            self.watch(now);
        }
    }

    /// Simulates inner ticks up to `target`, no more than `limit` of them, and says how many of these are left. Ends
    /// early if further ones would change nothing.
    fn run_to(&mut self, target: u64, limit: u32) -> u32 {
        let mut left = limit;
        loop {
            self.watch(self.inner.time());
            if left == 0 || self.inner.ticks() >= target || self.is_standing() {
                return left;
            }
            self.count_arrivals();
            let permitted = self.motion.is_permitted();
            self.inner
                .tick(permitted, &self.surroundings.bounds, &self.surroundings.scene.obstacles);
            left -= 1;
        }
    }

    /// One millisecond of a link on which one setpoint is expected in each. In lockstep nothing is timed.
    fn count_arrivals(&mut self) {
        if !self.is_pulsed() || !self.motion.is_permitted() {
            return self.pulse.rest();
        }
        if let Some(in_a_row) = self.pulse.tick() {
            self.hearing.forget_press();
            self.stop_by_itself(Reason::SetpointsMissed { in_a_row });
        }
    }

    fn is_pulsed(&self) -> bool {
        self.surroundings.link == LinkName::Franka && self.timing.pace == Pace::Real
    }

    fn is_standing(&self) -> bool {
        !self.motion.is_permitted() && self.inner.is_idle()
    }

    /// The watchdog, asked at every inner tick. In lockstep only a bad line makes silence, and virtual time tells it.
    fn watch(&mut self, now: Stamp) {
        if (self.timing.pace == Pace::Real || self.in_step)
            && let Some(reason) = self.hearing.newly_lost(now)
        {
            self.stop_by_itself(reason);
            self.keep_stopped();
        }
    }

    fn stop_by_itself(&mut self, reason: Reason) {
        if self.motion.is_permitted() {
            self.untold = Some(reason);
        }
        self.motion = Motion::Held(reason);
    }

    /// Begins the trial that waits for it, once the arm stands. In lockstep time stands still too, so there it need
    /// not be waited for.
    fn begin_pending_trial(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        let lockstep = self.timing.pace == Pace::Lockstep;
        if !(lockstep || self.is_standing()) {
            return;
        }
        let Some(number) = self.trial.pending.take() else {
            return;
        };
        self.hearing.spend_press();
        self.hearing.outdate_states();
        self.inner
            .jump_to(self.surroundings.start, &self.surroundings.scene.obstacles);
        if lockstep && self.in_step {
            // The state of this tick is out and speaks of the old place; the trial starts with the next one.
            self.tick = self.tick.saturating_add(1);
            self.inner
                .skip_to(Stamp::of_tick(self.tick, self.timing.period).0 / MILLISECOND);
        }
        let now = if lockstep {
            Stamp::of_tick(self.tick, self.timing.period)
        } else {
            now
        };
        self.in_step = lockstep;
        self.trial.number = number;
        self.trial.start = self.tick;
        self.publish_scene(now, outbox);
        self.publish_state(now, outbox);
    }

    /// In lockstep the robot's own ticks are the time, whatever the caller's clock says.
    fn time(&self, now: Stamp) -> Stamp {
        match self.timing.pace {
            Pace::Real => now.max(self.inner.time()),
            Pace::Lockstep => Stamp::of_tick(self.tick, self.timing.period),
        }
    }
}

impl Node for RobotSim {
    type Event = Event;
    type Output = Output;

    fn step(&mut self, now: Stamp, event: Event, outbox: &mut Outbox<Output>) {
        if self.closed {
            return;
        }
        let within = self.is_within_period(now);
        let (at, now) = (now, self.time(now));
        if self.timing.pace == Pace::Real {
            self.catch_up(now);
            self.tick = u32::try_from(now.0 / self.timing.period.max(1)).unwrap_or(u32::MAX);
        }
        match event {
            Event::Setpoint(setpoint) if within => self.on_late_setpoint(at, setpoint),
            Event::Setpoint(setpoint) => self.on_setpoint(now, setpoint, outbox),
            Event::Trial(trial) => self.on_trial(&trial),
            Event::Emergency(emergency) => self.on_emergency(now, &emergency, outbox),
            Event::Unreadable(_) => self.hearing.refuse(Refusal::Unreadable),
            Event::Missed { topic, tick } => self.on_missed(topic, tick, outbox),
            Event::Wake | Event::Presence => {}
            Event::Stop => return self.on_stop(now, outbox),
        }
        self.begin_pending_trial(now, outbox);
        self.publish_due(now, outbox);
    }

    fn deadline(&self) -> Option<Stamp> {
        let streams = self.timing.pace == Pace::Real && !self.closed;
        streams.then(|| self.next_state.min(self.next_scene))
    }

    fn trial(&self) -> u32 {
        self.trial.number
    }
}
