//! What the arbiter has heard and may act on: the first two steps of the safety order, for all three streams.
//!
//! A message is admitted only if its maker had seen a recent state, if it comes from the sender that is being
//! listened to, and in order. What was admitted serves until the next message of its stream, or until the stream is
//! lost. All ages are by the arbiter's own clock.

use bincode::{Decode, Encode};
use tandem_wire::{
    Command, Echoes, Envelope, Guard, Guidance, Header, Malformed, Memory, MessageId, Nanos, Pace, Proposal, Reason,
    Refusal, Refusals, Remember, Stamp, State, StateGuard, Timing, Used, Vec3,
};

use crate::lease::{Desk, Tenure, Terms};

/// The three streams.
#[derive(Clone, Debug)]
pub(crate) struct Hearing {
    pace: Pace,
    loop_age_limit: Nanos,
    stream_period: Nanos,
    states: StateGuard,
    operators: Desk,
    proposals: Guard,
    echoes: Echoes,
    robot: Option<Robot>,
    proposal: Option<Heard<Proposal>>,
    refused: Refusals,
}

/// A message that serves until the next one of its stream.
#[derive(Clone, Copy, Debug, Encode, Decode)]
pub(crate) struct Heard<M> {
    pub(crate) header: Header,
    pub(crate) body: M,
    pub(crate) arrived: Stamp,
}

/// What the newest state told.
#[derive(Clone, Copy, Debug, Encode, Decode)]
pub(crate) struct Robot {
    pub(crate) id: MessageId,
    pub(crate) tick: u32,
    /// Where the tool's tip is.
    pub(crate) tool: Vec3,
    /// Number and first tick.
    pub(crate) trial: (u32, u32),
    /// The first state seen in this trial: guidance that answers an earlier one belongs to the trial before.
    trial_since: MessageId,
}

/// What an admitted message changed besides taking the place of the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Change {
    None,
    /// Another sender, or another trial.
    Anew,
}

impl Hearing {
    pub(crate) fn new(timing: &Timing, terms: Terms) -> Self {
        let guard = Guard::new(timing.stream_timeout());
        Self {
            pace: timing.pace,
            loop_age_limit: timing.loop_age_limit,
            stream_period: timing.stream_period.max(1),
            states: StateGuard::new(timing),
            operators: Desk::new(guard.clone(), terms),
            proposals: guard,
            echoes: Echoes::default(),
            robot: None,
            proposal: None,
            refused: Refusals::default(),
        }
    }

    /// Takes in a command; says what it means for who drives.
    pub(crate) fn admit_command(&mut self, now: Stamp, command: &Envelope<Command>) -> Result<Tenure, Refusal> {
        if let Err(why) = self.check_loop(now, command.body.seen) {
            self.operators.note_too_old(command.header.session);
            return Err(why);
        }
        self.operators.admit(now, command)
    }

    /// The operators, and who of them drives.
    pub(crate) fn operators(&self) -> &Desk {
        &self.operators
    }

    /// The same, to hear what they claim.
    pub(crate) fn operators_mut(&mut self) -> &mut Desk {
        &mut self.operators
    }

    /// Ends a lease whose holder has fallen silent; says whether it did.
    pub(crate) fn expire_lease(&mut self, now: Stamp) -> bool {
        self.operators.expire(now)
    }

    /// Takes in a proposal.
    pub(crate) fn admit_proposal(&mut self, now: Stamp, proposal: &Envelope<Proposal>) -> Result<(), Refusal> {
        self.check_loop(now, proposal.body.seen)?;
        // In lockstep a predictor answers a tick whose state it missed, too. That is nothing new, and does not look fresh.
        let before = self.proposal.filter(|_| self.pace == Pace::Lockstep);
        if before.is_some_and(|before| same_source(&before, proposal)) {
            return Ok(());
        }
        self.proposals.admit(now, &proposal.header)?;
        self.proposal = Some(Heard::new(now, proposal));
        Ok(())
    }

    /// Takes in a state. [`Change::Anew`] if it begins another trial, or comes from another run of the robot.
    pub(crate) fn admit_state(&mut self, now: Stamp, state: &Envelope<State>) -> Result<Change, Refusal> {
        self.states.admit(now, &state.header)?;
        let id = state.header.id();
        self.echoes.note(now, id);
        let trial = (state.body.trial, state.body.trial_start);
        let same = self
            .robot
            .filter(|before| before.trial == trial && before.id.session == id.session);
        self.robot = Some(Robot {
            id,
            tick: state.header.tick,
            tool: state.body.tool.position,
            trial,
            trial_since: same.map_or(id, |before| before.trial_since),
        });
        Ok(if same.is_some() { Change::None } else { Change::Anew })
    }

    /// Counts a dropped message.
    pub(crate) fn refuse(&mut self, why: Refusal) {
        self.refused.add(why);
    }

    /// What was dropped so far.
    pub(crate) fn refused(&self) -> Refusals {
        self.refused
    }

    /// The newest state.
    pub(crate) fn robot(&self) -> Option<Robot> {
        self.robot
    }

    /// The newest command, unless the stream is lost.
    pub(crate) fn command(&self, now: Stamp) -> Option<Heard<Command>> {
        let lost = self.operators.stream().is_lost(now);
        self.operators.command().filter(|_| !lost)
    }

    /// The newest proposal, unless the stream is lost.
    pub(crate) fn proposal(&self, now: Stamp) -> Option<Heard<Proposal>> {
        self.proposal.filter(|_| !self.proposals.is_lost(now))
    }

    /// The guidance of a proposal and its tick, if it belongs to the running trial.
    pub(crate) fn guidance(&self, proposal: &Heard<Proposal>) -> Option<(u32, Guidance)> {
        let (robot, seen) = (self.robot?, proposal.body.seen?);
        let of_this_trial = seen.session == robot.trial_since.session && seen.seq >= robot.trial_since.seq;
        let guidance = proposal.body.guidance.filter(|_| of_this_trial)?;
        Some((proposal.header.tick, guidance))
    }

    /// What forbids motion now, whoever presses.
    pub(crate) fn forbidden(&self, now: Stamp) -> Option<Reason> {
        let no_trial = self.robot.is_some_and(|robot| robot.trial.0 == 0);
        self.loss(now).or(no_trial.then_some(Reason::NoTrial))
    }

    /// The loss that forbids motion now.
    pub(crate) fn loss(&self, now: Stamp) -> Option<Reason> {
        let command = || self.command_silence(now).unwrap_or(Reason::NoCommandYet);
        let lost = self.operators.stream().is_lost(now);
        self.state_loss(now).or_else(|| lost.then(command))
    }

    /// The loss of the states, once they have begun.
    pub(crate) fn state_loss(&self, now: Stamp) -> Option<Reason> {
        let silent = self.states.silent(now)?;
        self.states.is_lost(now).then_some(Reason::StateLost { silent })
    }

    /// The loss of the commands of whoever is listened to, once they have begun.
    pub(crate) fn command_silence(&self, now: Stamp) -> Option<Reason> {
        let stream = self.operators.stream();
        match stream.silent(now) {
            _ if !stream.is_lost(now) => None,
            _ if self.operators.too_old() => Some(Reason::LoopTooOld),
            Some(silent) => Some(Reason::CommandLost { silent }),
            None => None,
        }
    }

    /// In lockstep: the state of a tick does not come in time.
    pub(crate) const fn miss_state(&mut self, tick: u32) {
        self.states.miss(tick);
    }

    /// When the next loss happens unless something arrives.
    pub(crate) fn loss_at(&self) -> Option<Stamp> {
        let stream = self.operators.stream().deadline();
        let losses = [self.states.deadline(), stream, self.operators.expires()];
        losses.into_iter().flatten().min()
    }

    /// Refuses what was made from a state that is too old.
    ///
    /// A state that we have not seen ourselves yet is not too old, as long as the robot can have sent it by now: the
    /// answer to it overtook it. In lockstep the state of the tick at hand comes before or behind the answer to it,
    /// which must make no difference: a state that we do not know is never too old there.
    fn check_loop(&self, now: Stamp, seen: Option<MessageId>) -> Result<(), Refusal> {
        if self.pace == Pace::Lockstep {
            return match seen.and_then(|seen| self.echoes.age(now, seen)) {
                Some(age) if age > self.loop_age_limit => Err(Refusal::LoopTooOld),
                _ => Ok(()),
            };
        }
        if seen.is_some_and(|seen| self.is_under_way(now, seen)) {
            return Ok(());
        }
        self.echoes.admit(now, seen, self.loop_age_limit).map(|_age| ())
    }

    /// Whether a state may be on its way here: numbered after the newest, but no further than the robot's states can
    /// have come since that one arrived. It is no older than the newest then, and states are not lost.
    fn is_under_way(&self, now: Stamp, seen: MessageId) -> bool {
        let Some((newest, silent)) = self.states.newest().zip(self.states.silent(now)) else {
            return false;
        };
        let ahead = seen.seq.0.saturating_sub(newest.seq.0);
        seen.session == newest.session && (1..=OVERTAKEN + silent / self.stream_period).contains(&ahead)
    }
}

/// Besides those that are due by the clock, so many states may be overtaken: a burst after a hiccup, a trial's first.
const OVERTAKEN: u64 = 5;

impl Remember for Hearing {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            pace: _,
            loop_age_limit: _,
            stream_period: _,
            states,
            operators,
            proposals,
            echoes,
            robot,
            proposal,
            refused,
        } = self;
        states.remember(memory)?;
        operators.remember(memory)?;
        proposals.remember(memory)?;
        echoes.remember(memory)?;
        memory.part(robot)?;
        memory.part(proposal)?;
        memory.part(refused)
    }
}

impl<M: Copy> Heard<M> {
    pub(crate) fn new(now: Stamp, message: &Envelope<M>) -> Self {
        Self {
            header: message.header,
            body: message.body,
            arrived: now,
        }
    }

    /// How the setpoint's record names it; `seen` is what it answers.
    pub(crate) fn used(&self, now: Stamp, seen: Option<MessageId>) -> Used {
        Used {
            id: self.header.id(),
            sent: self.header.sent,
            age: now.since(self.arrived),
            seen,
        }
    }
}

/// Whether a proposal was made by the same run of the predictor from the same state as the one before.
fn same_source(before: &Heard<Proposal>, proposal: &Envelope<Proposal>) -> bool {
    before.header.session == proposal.header.session && before.body.seen == proposal.body.seen
}
