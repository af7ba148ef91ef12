//! The step machine: one named handler per event, and the arbitration that they lead to.

mod lockstep;

use tandem_wire::{
    Claim, Command, Deadman, Emergency, Envelope, Finite, Label, Latch, Limited, Malformed, Memory, Motion, Nanos,
    Node, Numbering, Outbox, Pace, Proposal, Reason, Refusal, Remember, Session, Setpoint, Stamp, State, Timing, Topic,
    Unreadable, Vec3,
};

use crate::authority::{Authority, Helm};
use crate::barrier::Barrier;
use crate::config::{ArbiterSettings, WorkspaceTurnedOver};
use crate::hearing::{Change, Hearing};
use crate::lease::Tenure;
use crate::limits::Limits;
use crate::weight::Weight;

/// Everything that can happen to the arbiter.
#[derive(Clone, Debug, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "a state is a kilobyte; a box would allocate for every one of them"
)]
pub enum Event {
    /// The operator's command.
    Command(Envelope<Command>),
    /// The predictor's proposal.
    Proposal(Envelope<Proposal>),
    /// The robot's state.
    State(Envelope<State>),
    /// An operator says something about the lease.
    Claim(Envelope<Claim>),
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

/// Everything that the arbiter can cause.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Output {
    /// A decision, with the record of why.
    Setpoint(Envelope<Setpoint>),
}

/// The arbiter; see the [crate's page](crate) for its states.
#[derive(Clone, Debug)]
pub struct Arbiter {
    timing: Timing,
    numbering: Numbering,
    hearing: Hearing,
    helm: Helm,
    weight: Weight,
    limits: Limits,
    latch: Latch,
    supervisors: Vec<Label>,
    /// How often setpoints are repeated while motion is permitted.
    setpoint_period: Option<Nanos>,
    /// When the last setpoint was sent.
    sent: Option<Stamp>,
    barrier: Barrier,
}

/// No hand and no arm is this fast, in metres per second; beyond it a blend could overflow.
const ABSURD_SPEED: f64 = 1e3;

impl Arbiter {
    /// An arbiter that numbers its setpoints in `session`.
    ///
    /// # Errors
    /// When the workspace is turned over; everything else was checked when `settings` were read.
    pub fn new(session: Session, timing: Timing, settings: &ArbiterSettings) -> Result<Self, WorkspaceTurnedOver> {
        Ok(Self {
            timing,
            numbering: Numbering::new(session),
            hearing: Hearing::new(&timing, settings.terms()),
            helm: Helm::new(),
            weight: Weight::new(settings.weight_rules(&timing)),
            limits: Limits::new(settings.bounds(&timing)?),
            latch: Latch::default(),
            supervisors: settings.supervisors.iter().map(|name| Label::new(name)).collect(),
            setpoint_period: settings.setpoint_period(),
            sent: None,
            barrier: Barrier::default(),
        })
    }

    /// Who is in charge.
    #[must_use]
    pub fn authority(&self) -> Authority {
        self.helm.authority()
    }

    fn on_command(&mut self, now: Stamp, command: &Envelope<Command>, outbox: &mut Outbox<Output>) {
        let tick = command.header.tick;
        let silent = self.in_lockstep(|| self.hearing.command_silence(now));
        match self.hearing.admit_command(now, command) {
            Err(why) => return self.on_refused_command(now, &command.header, why, outbox),
            Ok(Tenure::Watching) => return,
            Ok(Tenure::Anew { pressed: true }) => self.helm.hand_over(),
            Ok(Tenure::Anew { pressed: false } | Tenure::GivenUp) => self.helm.change_hands(),
            Ok(Tenure::Same) => {}
        }
        match self.timing.pace {
            Pace::Real => {
                self.hear(now, command.body.deadman);
                self.publish(now, outbox);
            }
            Pace::Lockstep if self.barrier.command.is_late(tick) => {
                self.stop_after(silent);
                self.hear(now, command.body.deadman);
            }
            Pace::Lockstep => {
                self.barrier.command.come(tick);
                self.barrier.keep_command_loss(silent);
                self.barrier.keep_deadman(command.body.deadman);
                self.answer_tick(now, outbox);
            }
        }
    }

    fn hear(&mut self, now: Stamp, deadman: Deadman) {
        match self.forbidden(now) {
            None => self.helm.hear(deadman),
            // A loss was noticed before this command was looked at.
            Some(reason) => drop(self.helm.stop(reason)),
        }
    }

    fn on_claim(&mut self, now: Stamp, claim: &Envelope<Claim>, outbox: &mut Outbox<Output>) {
        let may_take_over = self.supervisors.contains(&claim.body.name);
        let reason = match self.hearing.operators_mut().claim(now, claim, may_take_over) {
            Err(why) => return self.hearing.refuse(why),
            Ok(Tenure::Same | Tenure::Watching) => return,
            Ok(Tenure::Anew { .. }) => Reason::SecondOperator,
            Ok(Tenure::GivenUp) => Reason::NoLease,
        };
        self.helm.change_hands();
        self.stop(now, reason, outbox);
    }

    fn on_emergency(&mut self, now: Stamp, emergency: &Envelope<Emergency>, outbox: &mut Outbox<Output>) {
        if self.latch.hear(emergency) {
            self.stop(now, self.latch.reason().unwrap_or(Reason::AwaitingPress), outbox);
        }
    }

    /// Stops, and says so at once. In lockstep the next setpoint says so.
    fn stop(&mut self, now: Stamp, reason: Reason, outbox: &mut Outbox<Output>) {
        self.helm.stop(reason);
        if self.timing.pace == Pace::Real {
            self.publish(now, outbox);
        }
    }

    /// What forbids motion now, whoever presses.
    fn forbidden(&self, now: Stamp) -> Option<Reason> {
        self.latch.reason().or_else(|| self.hearing.forbidden(now))
    }

    fn on_proposal(&mut self, now: Stamp, proposal: &Envelope<Proposal>, outbox: &mut Outbox<Output>) {
        if let Err(why) = self.hearing.admit_proposal(now, proposal) {
            self.hearing.refuse(why);
            if why != Refusal::LoopTooOld {
                return;
            }
        }
        self.barrier.proposal.come(proposal.header.tick);
        self.answer_tick(now, outbox);
    }

    fn on_state(&mut self, now: Stamp, state: &Envelope<State>, outbox: &mut Outbox<Output>) {
        let tick = state.header.tick;
        let silent = self.in_lockstep(|| self.hearing.state_loss(now));
        match self.hearing.admit_state(now, state) {
            Err(why) => return self.hearing.refuse(why),
            Ok(Change::Anew) => {
                self.weight.reset();
                self.limits.forget();
            }
            Ok(Change::None) => {}
        }
        self.latch.hear_of(state.body.motion);
        if self.timing.pace == Pace::Real {
            return;
        }
        if self.barrier.state.is_late(tick) {
            return self.stop_after(silent);
        }
        self.barrier.state.come(tick);
        self.barrier.keep_state_loss(silent);
        self.answer_tick(now, outbox);
    }

    fn on_wake(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        if self.repeat_at().is_some_and(|due| now >= due) {
            self.publish(now, outbox);
        }
    }

    fn on_stop(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        self.helm.close();
        self.publish(now, outbox);
    }

    /// Looks for losses before anything else, so that no event slips in under a stream that is already gone.
    fn watch(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        if self.timing.pace == Pace::Real
            && let Some(reason) = self.forbidden(now)
            && self.helm.stop(reason)
        {
            self.publish(now, outbox);
        }
        // In lockstep silence is told tick by tick, and looked for where the tick is answered.
        if self.timing.pace == Pace::Real {
            self.expire_lease(now);
        }
    }

    fn expire_lease(&mut self, now: Stamp) {
        if self.hearing.expire_lease(now) {
            self.helm.change_hands();
        }
    }

    /// When to say again that motion is held for want of a stream, or, where that is asked for, that it is permitted;
    /// `None` while commands come and are answered.
    fn repeat_at(&self) -> Option<Stamp> {
        match self.helm.authority() {
            Authority::Held(reason) if self.timing.pace == Pace::Real && is_silence(reason) => {
                Some(self.sent.map_or(Stamp(0), |sent| sent.after(self.timing.stream_period)))
            }
            Authority::Human { .. } | Authority::Shared { .. } if self.timing.pace == Pace::Real => self
                .setpoint_period
                .zip(self.sent)
                .map(|(period, sent)| next_multiple(sent, period)),
            _ => None,
        }
    }

    fn publish(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        let tick = self.hearing.robot().map_or(0, |robot| robot.tick);
        self.publish_for(now, tick, outbox);
    }

    fn publish_for(&mut self, now: Stamp, tick: u32, outbox: &mut Outbox<Output>) {
        self.sent = Some(now);
        if let Some(reason) = self.latch.reason()
            && self.helm.authority() != Authority::Closed
        {
            self.helm.stop(reason);
        }
        let setpoint = self.arbitrate(now);
        outbox.push(Output::Setpoint(self.numbering.envelope(now, tick, setpoint)));
    }

    /// One arbitration: `limits(ω·human + (1 − ω)·robot)`, or zero while motion is held.
    fn arbitrate(&mut self, now: Stamp) -> Setpoint {
        let (command, proposal) = (self.hearing.command(now), self.hearing.proposal(now));
        let guided = proposal.and_then(|proposal| self.hearing.guidance(&proposal));
        self.helm.guide(guided.is_some());
        let human = command.map_or(Vec3::ZERO, |command| command.body.velocity.capped(ABSURD_SPEED));
        let robot = guided.map_or(Vec3::ZERO, |(_, guidance)| guidance.velocity.capped(ABSURD_SPEED));
        let weight = self.weight.decide(guided, human);
        let blended = human * weight + robot * (1.0 - weight);
        let (velocity, limited) = self.limit(now, blended);
        Setpoint {
            velocity,
            motion: self.motion(),
            lease: self.hearing.operators().lease(),
            asks: self.hearing.operators().asks(now),
            law: self.weight.law(),
            weight: Finite(weight),
            human,
            guidance: guided.map(|(_, guidance)| guidance),
            blended,
            limited,
            command: command.map(|command| command.used(now, command.body.seen)),
            proposal: proposal.map(|proposal| proposal.used(now, proposal.body.seen)),
            seen: self.hearing.robot().map(|robot| robot.id),
            refused: self.hearing.refused(),
        }
    }

    /// What the setpoint says about motion. An emergency stop is told to the last: the robot may not have heard of it.
    fn motion(&self) -> Motion {
        self.latch
            .reason()
            .map_or_else(|| self.helm.authority().motion(), Motion::Held)
    }

    fn limit(&mut self, now: Stamp, blended: Vec3) -> (Vec3, Limited) {
        match self.hearing.robot() {
            Some(robot) if self.helm.authority().motion().is_permitted() => self.limits.apply(now, robot.tool, blended),
            _ => {
                self.limits.rest(now);
                (Vec3::ZERO, Limited::default())
            }
        }
    }
}

/// The first multiple of `period` after `sent`: what a late wake-up costs is not carried on.
fn next_multiple(sent: Stamp, period: Nanos) -> Stamp {
    Stamp((sent.0 / period).saturating_add(1).saturating_mul(period))
}

/// Whether motion is held because something is not heard, so that no command will come to be answered.
fn is_silence(reason: Reason) -> bool {
    matches!(
        reason,
        Reason::NoCommandYet
            | Reason::CommandLost { .. }
            | Reason::StateLost { .. }
            | Reason::LoopTooOld
            | Reason::NoLease
            | Reason::EmergencyStop { .. }
    )
}

impl Remember for Arbiter {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            timing: _,
            numbering,
            hearing,
            helm,
            weight,
            limits,
            latch,
            supervisors: _,
            setpoint_period: _,
            sent,
            barrier,
        } = self;
        numbering.remember(memory)?;
        hearing.remember(memory)?;
        helm.remember(memory)?;
        weight.remember(memory)?;
        limits.remember(memory)?;
        memory.part(latch)?;
        memory.part(sent)?;
        barrier.remember(memory)
    }
}

impl Node for Arbiter {
    type Event = Event;
    type Output = Output;

    fn step(&mut self, now: Stamp, event: Event, outbox: &mut Outbox<Output>) {
        if self.helm.authority() == Authority::Closed {
            return;
        }
        self.watch(now, outbox);
        match event {
            Event::Command(command) => self.on_command(now, &command, outbox),
            Event::Proposal(proposal) => self.on_proposal(now, &proposal, outbox),
            Event::State(state) => self.on_state(now, &state, outbox),
            Event::Claim(claim) => self.on_claim(now, &claim, outbox),
            Event::Emergency(emergency) => self.on_emergency(now, &emergency, outbox),
            Event::Unreadable(_) => self.hearing.refuse(Refusal::Unreadable),
            Event::Wake => self.on_wake(now, outbox),
            Event::Presence => {}
            Event::Missed { topic, tick } => self.on_missed(now, topic, tick, outbox),
            Event::Stop => self.on_stop(now, outbox),
        }
    }

    fn deadline(&self) -> Option<Stamp> {
        match (self.timing.pace, self.helm.authority()) {
            (Pace::Lockstep, _) | (_, Authority::Closed) => None,
            _ => match (self.repeat_at(), self.hearing.loss_at()) {
                (Some(repeat), Some(loss)) if self.helm.authority().motion().is_permitted() => Some(repeat.min(loss)),
                (repeat, loss) => repeat.or(loss),
            },
        }
    }

    fn trial(&self) -> u32 {
        self.hearing.robot().map_or(0, |robot| robot.trial.0)
    }
}
