//! What the robot has heard and may obey: the safety order's checks again, at the last hop.
//!
//! A setpoint is admitted only if its maker and whoever it obeys had seen a recent state of this robot, if it comes from
//! the sender that is being listened to, and in order; all ages are by the robot's own clock. Whether an admitted setpoint
//! may move the arm is then for [`Permission`] to say.

use bincode::{Decode, Encode};
use tandem_wire::{
    Deadman, Echoes, Envelope, Guard, Header, Lease, Malformed, Memory, MessageId, Motion, Nanos, Rearm, Reason,
    Refusal, Refusals, Remember, SECOND, Seq, Setpoint, Stamp, Timing,
};

/// Another arbiter is listened to after so much silence of the one before. One that falters on a busy machine stops the arm,
/// and shall not have lost its place to a stranger's setpoints by the time it speaks again.
const SUCCESSION: Nanos = SECOND;

/// The stream of setpoints, as the robot hears it.
#[derive(Clone, Debug)]
pub(crate) struct Hearing {
    loop_age_limit: Nanos,
    setpoints: Guard,
    /// Whether the stream has begun and was not lost since.
    alive: bool,
    echoes: Echoes,
    /// The last state before the arm was put at its start: answers to it or to earlier ones speak of another place.
    outdated: Seq,
    /// The newest state.
    newest: Seq,
    /// A setpoint was dropped for its loop age since the last one that was admitted.
    too_old: bool,
    permission: Permission,
    /// The newest lease of the arbiter's run that is listened to.
    lease: Option<Lease>,
    refused: Refusals,
}

impl Hearing {
    pub(crate) fn new(timing: &Timing) -> Self {
        Self {
            loop_age_limit: timing.loop_age_limit,
            setpoints: Guard::new(timing.stream_timeout()).with_succession_after(SUCCESSION),
            alive: false,
            echoes: Echoes::default(),
            outdated: Seq(0),
            newest: Seq(0),
            too_old: false,
            permission: Permission::default(),
            lease: None,
            refused: Refusals::default(),
        }
    }

    /// Takes in a setpoint and says whether the arm may move under it.
    pub(crate) fn admit(&mut self, now: Stamp, setpoint: &Envelope<Setpoint>) -> Result<Motion, Refusal> {
        if let Err(why) = self.check_loops(now, &setpoint.body) {
            self.too_old = true;
            return Err(why);
        }
        let before = self.setpoints.session();
        let same = before == Some(setpoint.header.session);
        let hands = self.check_lease(setpoint.body.lease, same)?;
        self.setpoints.admit(now, &setpoint.header)?;
        self.too_old = false;
        self.alive = true;
        if !same {
            self.permission.forget();
            self.lease = None;
        }
        if hands == Hands::Others {
            self.permission.change_hands();
        }
        self.lease = setpoint.body.lease.or(self.lease);
        let motion = match setpoint.body.motion {
            // An arbiter that obeys somebody without a lease is wrong.
            Motion::Permitted { .. } if setpoint.body.lease.is_none() => Motion::Held(Reason::NoLease),
            motion => motion,
        };
        Ok(self.permission.hear(motion))
    }

    /// Refuses a lease that a later one of the same arbiter has outdated, or that differs from the one of its number.
    ///
    /// Only while the stream lives: one forged lease of a high number would else have every true one refused for good.
    fn check_lease(&self, lease: Option<Lease>, same_arbiter: bool) -> Result<Hands, Refusal> {
        let (Some(known), Some(new)) = (self.lease, lease) else {
            return Ok(if lease.is_some() { Hands::Others } else { Hands::Same });
        };
        let same = (new.number, new.holder) == (known.number, known.holder);
        match (same_arbiter, same) {
            (true, true) => Ok(Hands::Same),
            (true, false) if self.alive && new.number <= known.number => Err(Refusal::SecondOperator),
            _ => Ok(Hands::Others),
        }
    }

    /// The arbiter's picture must be recent, and so must the operator's behind a motion. The arbiter tells the age of a command
    /// from when it heard the state itself, which may have been late; here it is told from when the state was sent.
    fn check_loops(&self, now: Stamp, setpoint: &Setpoint) -> Result<(), Refusal> {
        self.check_loop(now, setpoint.seen)?;
        match setpoint.command {
            Some(command) if setpoint.motion.is_permitted() => self.check_loop(now, command.seen),
            _ => Ok(()),
        }
    }

    fn check_loop(&self, now: Stamp, seen: Option<MessageId>) -> Result<(), Refusal> {
        if seen.is_some_and(|seen| seen.seq <= self.outdated) {
            return Err(Refusal::LoopTooOld);
        }
        self.echoes.admit(now, seen, self.loop_age_limit).map(|_age| ())
    }

    /// Whether a message comes from whoever is listened to, if anybody is.
    pub(crate) fn listens_to(&self, header: &Header) -> bool {
        self.setpoints.session().is_none_or(|session| session == header.session)
    }

    /// Counts a dropped message.
    pub(crate) fn refuse(&mut self, why: Refusal) {
        self.refused.add(why);
    }

    /// What was dropped so far.
    pub(crate) fn refused(&self) -> Refusals {
        self.refused
    }

    /// Remembers that a state was sent.
    pub(crate) fn note_state(&mut self, now: Stamp, id: MessageId) {
        self.newest = id.seq;
        self.echoes.note(now, id);
    }

    /// Reports the loss of the stream, once.
    pub(crate) fn newly_lost(&mut self, now: Stamp) -> Option<Reason> {
        if !self.alive || !self.setpoints.is_lost(now) {
            return None;
        }
        self.alive = false;
        self.permission.forget();
        let silent = self.setpoints.silent(now).unwrap_or_default();
        Some(if self.too_old {
            Reason::LoopTooOld
        } else {
            Reason::SetpointLost { silent }
        })
    }

    /// The robot stopped by itself: the press that permitted motion is spent.
    pub(crate) fn spend_press(&mut self) {
        self.permission.spend();
    }

    /// An emergency stop: a press that is held by now does not count, nor one that is made while it is in force.
    pub(crate) fn forget_press(&mut self) {
        self.permission.forget();
    }

    /// The arm was put elsewhere: answers to the states so far mean nothing any more.
    pub(crate) fn outdate_states(&mut self) {
        self.outdated = self.newest;
    }
}

/// Whether a setpoint speaks for the same holder of the lease as the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Hands {
    Same,
    Others,
}

impl Remember for Hearing {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            loop_age_limit: _,
            setpoints,
            alive,
            echoes,
            outdated,
            newest,
            too_old,
            permission,
            lease,
            refused,
        } = self;
        setpoints.remember(memory)?;
        memory.part(alive)?;
        echoes.remember(memory)?;
        memory.part(outdated)?;
        memory.part(newest)?;
        memory.part(too_old)?;
        memory.part(permission)?;
        memory.part(lease)?;
        memory.part(refused)
    }
}

/// Whether a press of the deadman permits motion: [`Rearm`], fed with what setpoints tell about it.
///
/// Setpoints do not carry the deadman itself. One that is held because the human let go says so; one that is held for
/// any other reason says at least that the press which permitted motion so far does no longer.
#[derive(Clone, Debug, Default, Encode, Decode)]
struct Permission {
    rearm: Rearm,
    /// The press that last permitted motion.
    last: Option<u32>,
}

impl Permission {
    fn hear(&mut self, motion: Motion) -> Motion {
        match motion {
            Motion::Held(reason) => {
                self.hear_held(reason);
                motion
            }
            Motion::Permitted { press } => match self.rearm.see(Deadman::Held { press }) {
                Some(press) => {
                    self.last = Some(press);
                    Motion::Permitted { press }
                }
                None => Motion::Held(Reason::AwaitingPress),
            },
        }
    }

    fn hear_held(&mut self, reason: Reason) {
        match (self.rearm, reason, self.last) {
            (_, Reason::DeadmanReleased, _) => {
                self.rearm.see(Deadman::Released);
            }
            (Rearm::Armed(_), ..) => self.rearm.exhaust(),
            // The sender is there and holds motion itself: it will permit only what it sees pressed after this.
            (Rearm::Fresh, _, last) => self.rearm = last.map_or(Rearm::Open, Rearm::Spent),
            (Rearm::Spent(_) | Rearm::Open, ..) => {}
        }
    }

    /// Any other press will do: nothing was missed in between.
    fn spend(&mut self) {
        self.rearm.exhaust();
    }

    /// Another operator drives from now on. Its press counts if the arbiter has held motion in between; presses of the one
    /// before have the same numbers and say nothing about it.
    fn change_hands(&mut self) {
        self.last = None;
        self.rearm = match self.rearm {
            Rearm::Armed(_) | Rearm::Fresh => Rearm::Fresh,
            Rearm::Spent(_) | Rearm::Open => Rearm::Open,
        };
    }

    /// Something was missed, or somebody else speaks: a press that is held by now does not count.
    fn forget(&mut self) {
        self.rearm.spend();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RELEASED: Motion = Motion::Held(Reason::DeadmanReleased);
    const AWAITING: Motion = Motion::Held(Reason::AwaitingPress);

    fn pressed(press: u32) -> Motion {
        Motion::Permitted { press }
    }

    #[test]
    fn the_first_thing_heard_cannot_be_a_press() {
        let mut permission = Permission::default();
        assert_eq!(permission.hear(pressed(4)), AWAITING);
        assert_eq!(permission.hear(pressed(5)), pressed(5));
    }

    #[test]
    fn a_sender_that_held_motion_may_permit_it() {
        for reason in [Reason::DeadmanReleased, Reason::NoCommandYet, Reason::AwaitingPress] {
            let mut permission = Permission::default();
            permission.hear(Motion::Held(reason));
            assert_eq!(permission.hear(pressed(1)), pressed(1));
        }
    }

    #[test]
    fn a_press_that_was_stopped_needs_a_release_or_another_one() {
        let mut permission = Permission::default();
        permission.hear(RELEASED);
        assert_eq!(permission.hear(pressed(1)), pressed(1));
        permission.hear(Motion::Held(Reason::LoopTooOld));
        assert_eq!(permission.hear(pressed(1)), AWAITING);
        permission.hear(RELEASED);
        assert_eq!(permission.hear(pressed(1)), pressed(1));
    }

    #[test]
    fn after_a_loss_a_press_made_meanwhile_does_not_count() {
        let mut permission = Permission::default();
        permission.hear(RELEASED);
        permission.hear(pressed(1));
        permission.forget();
        assert_eq!(permission.hear(pressed(2)), AWAITING);
        assert_eq!(permission.hear(pressed(3)), pressed(3));
    }

    #[test]
    fn after_a_loss_a_held_setpoint_does_not_bring_the_old_press_back() {
        let mut permission = Permission::default();
        permission.hear(RELEASED);
        permission.hear(pressed(1));
        permission.forget();
        permission.hear(Motion::Held(Reason::StateLost { silent: 1 }));
        assert_eq!(permission.hear(pressed(1)), AWAITING);
        assert_eq!(permission.hear(pressed(2)), pressed(2));
    }
}
