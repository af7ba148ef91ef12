//! What every receiver that moves something checks, in one place: who, in which order, how fresh, pressed anew.
//!
//! [`Guard`] watches one stream by the *receiver's* clock. [`Echoes`] tells how old the knowledge of a message's
//! maker was. [`Rearm`] makes motion wait for a fresh press after any stop. The arbiter applies them to commands
//! and proposals, the robot again to setpoints. [`StateGuard`] is the guard of whoever counts by the robot's ticks.

mod echoes;
mod rearm;
mod states;

pub use echoes::Echoes;
pub use rearm::Rearm;
pub use states::StateGuard;

use bincode::{Decode, Encode};

use crate::{Header, MILLISECOND, Malformed, Memory, MessageId, Nanos, Remember, Session, Stamp};

/// Why a message was dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode, thiserror::Error)]
pub enum Refusal {
    /// It could not be read.
    #[error("unreadable")]
    Unreadable,
    /// Its number was seen before.
    #[error("duplicate")]
    Duplicate,
    /// A later one came first.
    #[error("out of order")]
    OutOfOrder,
    /// It comes from another run than the one that is being listened to.
    #[error("from another sender")]
    ForeignSession,
    /// Its maker had seen only an old state, or none, or one of another robot.
    #[error("made from a state that is too old")]
    LoopTooOld,
    /// Its number or its tick is further on than its sender can have come since the last one.
    #[error("numbered further ahead than time allows")]
    TooFarAhead,
    /// Another operator holds the lease.
    #[error("another operator holds the lease")]
    SecondOperator,
    /// A take-over by somebody who is no supervisor.
    #[error("not a supervisor: only the names in arbiter.supervisors may take the lease over")]
    NotSupervisor,
    /// As many operators are heard as the arbiter hears at a time.
    #[error("as many operators are there as the arbiter hears at a time: one of them has to leave first")]
    NoSeat,
}

impl From<Malformed> for Refusal {
    fn from(_: Malformed) -> Self {
        Self::Unreadable
    }
}

/// How many messages were dropped, and why the last one was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub struct Refusals {
    /// How many.
    pub count: u64,
    /// Why the last one.
    pub last: Option<Refusal>,
}

impl Refusals {
    /// Counts one more.
    pub fn add(&mut self, why: Refusal) {
        self.count = self.count.saturating_add(1);
        self.last = Some(why);
    }
}

/// Twice as fast as the fastest stream, so that numbers which ran ahead, because a line
/// delivered what it had queued and then what is, are caught up with and not refused for ever.
const FASTEST_PERIOD: Nanos = MILLISECOND / 2;
/// Numbers may run ahead of the time that has passed by so many: what a burst overtook or a full queue dropped.
const LEAP: u64 = 50;

/// Admits one stream's messages in order and knows when the stream is lost.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
pub struct Guard {
    timeout: Nanos,
    /// For so long another sender has to wait after the last message of the one before.
    succession: Nanos,
    newest: Option<MessageId>,
    /// The newest of the sender whose place the present one took: it may come back as soon as this one is lost.
    before: Option<MessageId>,
    arrived: Stamp,
}

impl Guard {
    /// A guard for a stream that is lost after `timeout` of silence.
    #[must_use]
    pub const fn new(timeout: Nanos) -> Self {
        Self {
            timeout,
            succession: timeout,
            newest: None,
            before: None,
            arrived: Stamp(0),
        }
    }

    /// Lets a stranger in only after `silence`, if that is longer than the timeout: a sender that falters shall not have lost its
    /// place to whoever comes by. If it has lost it all the same, it may take it back after the timeout.
    #[must_use]
    pub const fn with_succession_after(mut self, silence: Nanos) -> Self {
        if silence > self.timeout {
            self.succession = silence;
        }
        self
    }

    /// Takes in a message that arrived at `now`, or says why it must be dropped.
    ///
    /// A new session is admitted only once the old one is lost (or [longer](Self::with_succession_after)), so two senders never
    /// alternate. A number may run ahead only as far as time allows: one forged message of the last number there is must not
    /// make all others stragglers.
    ///
    /// # Errors
    /// The reason why the message must be dropped.
    pub fn admit(&mut self, now: Stamp, header: &Header) -> Result<(), Refusal> {
        if let Some(newest) = self.newest {
            if newest.session != header.session {
                self.change(now, header)?;
            } else if header.seq == newest.seq {
                return Err(Refusal::Duplicate);
            } else if header.seq < newest.seq {
                return Err(Refusal::OutOfOrder);
            } else if header.seq.0 - newest.seq.0 > self.leap(now) {
                return Err(Refusal::TooFarAhead);
            }
        }
        self.newest = Some(header.id());
        self.arrived = now;
        Ok(())
    }

    /// Another sender takes the place, if it may.
    fn change(&mut self, now: Stamp, header: &Header) -> Result<(), Refusal> {
        let returning = self.before.filter(|before| before.session == header.session);
        let wait = if returning.is_some() {
            self.timeout
        } else {
            self.succession
        };
        if now.since(self.arrived) <= wait {
            return Err(Refusal::ForeignSession);
        }
        if returning.is_some_and(|before| header.seq <= before.seq) {
            return Err(Refusal::OutOfOrder);
        }
        // Whoever had only slipped in is a stranger again.
        self.before = self.newest.filter(|_| returning.is_none());
        Ok(())
    }

    /// How far the numbers may have run on since the last admitted message.
    const fn leap(&self, now: Stamp) -> u64 {
        LEAP.saturating_add(now.since(self.arrived) / FASTEST_PERIOD)
    }

    /// How long the stream has been silent; `None` before its first message.
    #[must_use]
    pub fn silent(&self, now: Stamp) -> Option<Nanos> {
        self.newest.map(|_| now.since(self.arrived))
    }

    /// Whether the stream is lost, or has never begun.
    #[must_use]
    pub fn is_lost(&self, now: Stamp) -> bool {
        self.silent(now).is_none_or(|silent| silent > self.timeout)
    }

    /// When the stream will be lost unless something arrives; `None` before its first message.
    #[must_use]
    pub fn deadline(&self) -> Option<Stamp> {
        self.newest.map(|_| self.arrived.after(self.timeout).after(1))
    }

    /// The newest admitted message.
    #[must_use]
    pub const fn newest(&self) -> Option<MessageId> {
        self.newest
    }

    /// The run that is being listened to.
    #[must_use]
    pub fn session(&self) -> Option<Session> {
        self.newest.map(|id| id.session)
    }
}

impl Remember for Guard {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            timeout: _,
            succession: _,
            newest,
            before,
            arrived,
        } = self;
        memory.part(newest)?;
        memory.part(before)?;
        memory.part(arrived)
    }
}

/// Timeout of a stream: 100 ms, or two and a half of its periods if that is longer.
#[must_use]
pub const fn stream_timeout(floor: Nanos, period: Nanos) -> Nanos {
    let periods = period.saturating_mul(5) / 2;
    if periods > floor { periods } else { floor }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Seq;

    fn header(session: u64, seq: u64) -> Header {
        Header {
            session: Session(session),
            seq: Seq(seq),
            ..Header::default()
        }
    }

    fn at(millis: u64) -> Stamp {
        Stamp(millis * MILLISECOND)
    }

    #[test]
    fn repeats_and_stragglers_are_refused() {
        let mut guard = Guard::new(100 * MILLISECOND);
        assert_eq!(guard.admit(at(0), &header(1, 5)), Ok(()));
        assert_eq!(guard.admit(at(1), &header(1, 5)), Err(Refusal::Duplicate));
        assert_eq!(guard.admit(at(2), &header(1, 4)), Err(Refusal::OutOfOrder));
        assert_eq!(guard.admit(at(3), &header(1, 9)), Ok(()));
    }

    #[test]
    fn another_sender_waits_until_the_first_is_lost() {
        let mut guard = Guard::new(100 * MILLISECOND);
        guard.admit(at(0), &header(1, 5)).unwrap();
        assert_eq!(guard.admit(at(100), &header(2, 1)), Err(Refusal::ForeignSession));
        assert_eq!(guard.admit(at(101), &header(2, 1)), Ok(()));
    }

    #[test]
    fn a_sender_that_falters_keeps_its_place_for_as_long_as_it_is_given() {
        let mut guard = Guard::new(100 * MILLISECOND).with_succession_after(1000 * MILLISECOND);
        guard.admit(at(0), &header(1, 5)).unwrap();
        assert!(guard.is_lost(at(500)));
        assert_eq!(guard.admit(at(500), &header(2, 1)), Err(Refusal::ForeignSession));
        assert_eq!(guard.admit(at(900), &header(1, 6)), Ok(()));
        assert_eq!(guard.admit(at(1900), &header(2, 1)), Err(Refusal::ForeignSession));
        assert_eq!(guard.admit(at(1901), &header(2, 2)), Ok(()));
    }

    #[test]
    fn whoever_lost_its_place_takes_it_back_before_a_stranger_and_goes_on_counting() {
        let mut guard = Guard::new(100 * MILLISECOND).with_succession_after(1000 * MILLISECOND);
        guard.admit(at(0), &header(1, 5)).unwrap();
        assert_eq!(guard.admit(at(1001), &header(2, 1)), Ok(()));
        assert_eq!(guard.admit(at(1101), &header(1, 6)), Err(Refusal::ForeignSession));
        assert_eq!(guard.admit(at(1102), &header(3, 1)), Err(Refusal::ForeignSession));
        assert_eq!(
            guard.admit(at(1102), &header(1, 5)),
            Err(Refusal::OutOfOrder),
            "it was said before"
        );
        assert_eq!(guard.admit(at(1102), &header(1, 60)), Ok(()));
        assert_eq!(
            guard.admit(at(1300), &header(2, 2)),
            Err(Refusal::ForeignSession),
            "it had only slipped in"
        );
    }

    #[test]
    fn refused_messages_do_not_keep_a_stream_alive() {
        let mut guard = Guard::new(100 * MILLISECOND);
        guard.admit(at(0), &header(1, 5)).unwrap();
        for millis in 1..=101 {
            let _ = guard.admit(at(millis), &header(1, 5));
        }
        assert!(guard.is_lost(at(101)));
    }

    #[test]
    fn a_number_that_time_does_not_allow_is_refused_and_the_stream_goes_on() {
        let mut guard = Guard::new(100 * MILLISECOND);
        guard.admit(at(0), &header(1, 5)).unwrap();
        assert_eq!(guard.admit(at(1), &header(1, u64::MAX)), Err(Refusal::TooFarAhead));
        assert_eq!(guard.admit(at(20), &header(1, 6)), Ok(()));
        assert_eq!(guard.admit(at(40), &header(1, 6 + 50 + 41)), Err(Refusal::TooFarAhead));
        assert_eq!(guard.admit(at(40), &header(1, 6 + 50 + 40)), Ok(()));
    }

    #[test]
    fn the_fastest_stream_is_heard_again_behind_a_queued_burst() {
        let mut guard = Guard::new(100 * MILLISECOND);
        guard.admit(at(0), &header(1, 1)).unwrap();
        // A line that was cut for a second delivers a tenth of what it had queued, and then what is.
        for seq in 2..100 {
            assert_eq!(guard.admit(at(1000), &header(1, seq)), Ok(()));
        }
        let heard = (1001..4000).find(|&millis| guard.admit(at(millis), &header(1, millis)).is_ok());
        assert!(heard.is_some_and(|millis| millis < 2000), "{heard:?}");
    }

    #[test]
    fn after_an_outage_of_any_length_the_fastest_stream_is_still_in_time() {
        for seconds in [1, 60, 86_400] {
            let mut guard = Guard::new(100 * MILLISECOND);
            guard.admit(at(0), &header(1, 1)).unwrap();
            let lost = seconds * 1000;
            assert_eq!(guard.admit(at(lost), &header(1, 1 + lost)), Ok(()));
        }
    }
}
