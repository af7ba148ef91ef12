//! What every receiver that moves something checks, in one place: who, in which order, how fresh, pressed anew.
//!
//! [`Guard`] watches one stream by the *receiver's* clock. [`Echoes`] tells how old the knowledge of a message's
//! maker was. [`Rearm`] makes motion wait for a fresh press after any stop. The arbiter applies them to commands
//! and proposals, the robot again to setpoints.

use bincode::{Decode, Encode};

use crate::{Deadman, Header, Malformed, Memory, MessageId, Nanos, Remember, Seq, Session, Stamp};

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

/// Admits one stream's messages in order and knows when the stream is lost.
#[derive(Clone, Debug, PartialEq)]
pub struct Guard {
    timeout: Nanos,
    newest: Option<MessageId>,
    arrived: Stamp,
}

impl Guard {
    /// A guard for a stream that is lost after `timeout` of silence.
    #[must_use]
    pub const fn new(timeout: Nanos) -> Self {
        Self {
            timeout,
            newest: None,
            arrived: Stamp(0),
        }
    }

    /// Takes in a message that arrived at `now`, or says why it must be dropped.
    ///
    /// A new session is admitted only once the old one is lost, so two senders never alternate.
    ///
    /// # Errors
    /// The reason why the message must be dropped.
    pub fn admit(&mut self, now: Stamp, header: &Header) -> Result<(), Refusal> {
        if let Some(newest) = self.newest {
            if newest.session != header.session {
                if !self.is_lost(now) {
                    return Err(Refusal::ForeignSession);
                }
            } else if header.seq == newest.seq {
                return Err(Refusal::Duplicate);
            } else if header.seq < newest.seq {
                return Err(Refusal::OutOfOrder);
            }
        }
        self.newest = Some(header.id());
        self.arrived = now;
        Ok(())
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
            newest,
            arrived,
        } = self;
        memory.part(newest)?;
        memory.part(arrived)
    }
}

/// Timeout of a stream: 100 ms, or two and a half of its periods if that is longer.
#[must_use]
pub const fn stream_timeout(floor: Nanos, period: Nanos) -> Nanos {
    let periods = period.saturating_mul(5) / 2;
    if periods > floor { periods } else { floor }
}

/// How many states [`Echoes`] remembers: 5 s at 50 Hz, ten times the default limit on loop age.
const REMEMBERED: usize = 256;

/// Remembers when states were sent (or seen), to tell how old the state was that an answer was made from.
///
/// A backlog that arrives in order looks fresh; its echoes do not.
#[derive(Clone, Debug, PartialEq)]
pub struct Echoes {
    session: Option<Session>,
    slots: Vec<(Seq, Stamp)>,
}

impl Default for Echoes {
    fn default() -> Self {
        Self {
            session: None,
            slots: vec![(Seq(0), Stamp(0)); REMEMBERED],
        }
    }
}

impl Echoes {
    /// Notes that state `id` was sent, or first seen, at `now`. Another session forgets the one before.
    pub fn note(&mut self, now: Stamp, id: MessageId) {
        if self.session != Some(id.session) {
            self.session = Some(id.session);
            self.slots.fill((Seq(0), Stamp(0)));
        }
        self.slots[slot(id.seq)] = (id.seq, now);
    }

    /// How long ago state `id` was noted; `None` if it is unknown or forgotten.
    #[must_use]
    pub fn age(&self, now: Stamp, id: MessageId) -> Option<Nanos> {
        let (seq, noted) = self.slots[slot(id.seq)];
        (self.session == Some(id.session) && seq == id.seq && seq != Seq(0)).then(|| now.since(noted))
    }

    /// Refuses an answer made from no state, an unknown one, or one older than `limit`.
    ///
    /// # Errors
    /// [`Refusal::LoopTooOld`].
    pub fn admit(&self, now: Stamp, seen: Option<MessageId>, limit: Nanos) -> Result<Nanos, Refusal> {
        match seen.and_then(|id| self.age(now, id)) {
            Some(age) if age <= limit => Ok(age),
            _ => Err(Refusal::LoopTooOld),
        }
    }
}

impl Remember for Echoes {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self { session, slots } = self;
        memory.part(session)?;
        memory.part(slots)?;
        memory.check(slots.len() == REMEMBERED)
    }
}

fn slot(seq: Seq) -> usize {
    usize::try_from(seq.0 % REMEMBERED as u64).expect("a remainder of 256 fits")
}

/// Makes motion wait for a fresh press of the deadman after any stop, and at the very start.
///
/// Presses are numbered, so a lost "released" cannot hide that the human let go and pressed again.
///
/// ```text
///            held p         another press
///   Fresh ──────────▶ Spent ─────────────▶ Armed ── stop ──▶ Fresh
///     └── released ──▶ Open ──── press ──────┘
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub enum Rearm {
    /// Nothing seen since the start or the last stop: a press that is already held when we first look does not count.
    #[default]
    Fresh,
    /// This press was held when we first looked.
    Spent(u32),
    /// Seen released: the next press counts.
    Open,
    /// This press permits motion.
    Armed(u32),
}

impl Rearm {
    /// Takes in the deadman's position; says which press permits motion, if one does.
    pub fn see(&mut self, deadman: Deadman) -> Option<u32> {
        *self = match (*self, deadman) {
            (_, Deadman::Released) => Self::Open,
            (Self::Open, Deadman::Held { press }) => Self::Armed(press),
            (Self::Fresh, Deadman::Held { press }) => Self::Spent(press),
            (Self::Armed(old) | Self::Spent(old), Deadman::Held { press }) if old != press => Self::Armed(press),
            (same, Deadman::Held { .. }) => same,
        };
        match *self {
            Self::Armed(press) => Some(press),
            _ => None,
        }
    }

    /// Motion was stopped, or another sender is being listened to: whatever is held by now does not count.
    pub const fn spend(&mut self) {
        *self = Self::Fresh;
    }

    /// Whether motion is permitted.
    #[must_use]
    pub const fn is_armed(&self) -> bool {
        matches!(self, Self::Armed(_))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MILLISECOND;

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
    fn refused_messages_do_not_keep_a_stream_alive() {
        let mut guard = Guard::new(100 * MILLISECOND);
        guard.admit(at(0), &header(1, 5)).unwrap();
        for millis in 1..=101 {
            let _ = guard.admit(at(millis), &header(1, 5));
        }
        assert!(guard.is_lost(at(101)));
    }

    #[test]
    fn an_echo_tells_how_old_the_state_was() {
        let mut echoes = Echoes::default();
        let id = |seq| MessageId {
            session: Session(7),
            seq: Seq(seq),
        };
        echoes.note(at(10), id(1));
        assert_eq!(
            echoes.admit(at(60), Some(id(1)), 50 * MILLISECOND),
            Ok(50 * MILLISECOND)
        );
        assert_eq!(
            echoes.admit(at(61), Some(id(1)), 50 * MILLISECOND),
            Err(Refusal::LoopTooOld)
        );
        assert_eq!(
            echoes.admit(at(10), Some(id(2)), 50 * MILLISECOND),
            Err(Refusal::LoopTooOld)
        );
        assert_eq!(echoes.admit(at(10), None, 50 * MILLISECOND), Err(Refusal::LoopTooOld));
        echoes.note(
            at(20),
            MessageId {
                session: Session(8),
                seq: Seq(1),
            },
        );
        assert_eq!(echoes.age(at(20), id(1)), None);
    }

    #[test]
    fn a_press_held_since_before_we_looked_does_not_count() {
        let mut rearm = Rearm::default();
        assert_eq!(rearm.see(Deadman::Held { press: 1 }), None);
        assert_eq!(rearm.see(Deadman::Held { press: 2 }), Some(2));
    }

    #[test]
    fn after_a_stop_the_same_press_does_not_count() {
        let mut rearm = Rearm::default();
        rearm.see(Deadman::Released);
        assert_eq!(rearm.see(Deadman::Held { press: 1 }), Some(1));
        rearm.spend();
        assert_eq!(rearm.see(Deadman::Held { press: 1 }), None);
        assert_eq!(rearm.see(Deadman::Held { press: 2 }), Some(2));
        rearm.spend();
        rearm.see(Deadman::Released);
        assert_eq!(rearm.see(Deadman::Held { press: 2 }), Some(2));
    }
}
