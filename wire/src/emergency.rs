//! The emergency stop: anyone may set it, it stays until somebody clears it on purpose.
//!
//! Arbiter and robot each latch it, from its own key or from each other's setpoints and states; so one of them may be
//! started again and still knows, and whoever comes late sees it in every state.
//!
//! ```text
//!              Stop, or a setpoint or state that tells of one
//!   Clear ─────────────────────────────────────────────────────▶ Latched(stops) ─┐ another sender's Stop,
//!     ▲                 Clear that names the last of them             │   ▲      │ Clear that names one of several
//!     └───────────────────────────────────────────────────────────────┘   └──────┘
//! ```
//!
//! Where several people have stopped, each stop has to be cleared, as with buttons on a wall.

use bincode::{Decode, Encode};

use crate::{Envelope, Label, Malformed, MessageId, Motion, Reason, Session, Topic, decode};

/// Stop at once, or stop no longer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub enum Emergency {
    /// Bring the robot to rest and hold it. Its message's identity names the stop.
    Stop {
        /// Who says so.
        by: Label,
    },
    /// The stop of this name may end; motion then needs a fresh press.
    Clear {
        /// The stop, as states name it.
        stop: MessageId,
        /// Who says so.
        by: Label,
    },
}

impl Emergency {
    /// Where it counts. Whoever may stop may not therefore let go, so that the two have keys of their own.
    #[must_use]
    pub const fn topic(&self) -> Topic {
        match self {
            Self::Stop { .. } => Topic::Emergency,
            Self::Clear { .. } => Topic::AllClear,
        }
    }

    /// Reads what came on `topic`.
    ///
    /// # Errors
    /// If it is none, or has no force there.
    pub fn read(topic: Topic, bytes: &[u8]) -> Result<Envelope<Self>, Malformed> {
        let message: Envelope<Self> = decode(bytes)?;
        if message.body.topic() == topic {
            Ok(message)
        } else {
            Err(Malformed::Key)
        }
    }
}

/// A stop in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
struct Stop {
    id: MessageId,
    by: Label,
}

/// Whoever stops repeats itself until it is heard; a clear of a repetition clears the ones before it, and ones that were
/// missed up to here. No further: a stop that was forged with the last number there is, and cleared, must not make all
/// that its owner says later a repetition of it.
const REPEATED: u64 = 200;

/// Whether a stop of this name is `named`, or came up to [`REPEATED`] before it from the same sender.
fn is_covered(stop: MessageId, named: MessageId) -> bool {
    let ahead = named.seq.0.checked_sub(stop.seq.0);
    stop.session == named.session && ahead.is_some_and(|ahead| ahead <= REPEATED)
}

/// The stops of so many senders are kept apart; that of a further one takes the place of the newest.
const SENDERS: usize = 4;

/// Holds every sender's emergency stop until it is cleared itself, and tells the one that was heard last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub struct Latch {
    /// One of each sender, the one that was heard last in front.
    stops: [Option<Stop>; SENDERS],
    /// The last ones that were cleared: what is still under way must not set them again.
    cleared: [Option<MessageId>; SENDERS],
}

impl Latch {
    /// Takes in a message; says whether anything changed.
    pub fn hear(&mut self, message: &Envelope<Emergency>) -> bool {
        match message.body {
            Emergency::Stop { by } => self.set(Stop {
                id: message.header.id(),
                by,
            }),
            Emergency::Clear { stop, .. } => self.clear(stop),
        }
    }

    /// Takes in what a setpoint or state says about motion: its maker may know of a stop that was missed here.
    pub fn hear_of(&mut self, motion: Motion) -> bool {
        match motion {
            Motion::Held(Reason::EmergencyStop { stop, by }) if self.place_of(stop.session).is_none() => {
                self.set(Stop { id: stop, by })
            }
            _ => false,
        }
    }

    /// Why nothing may move, while a stop is in force.
    #[must_use]
    pub fn reason(&self) -> Option<Reason> {
        self.stops[0].map(|Stop { id, by }| Reason::EmergencyStop { stop: id, by })
    }

    /// Whether a stop of this sender's is in force.
    #[must_use]
    pub fn is_of(&self, sender: Session) -> bool {
        self.place_of(sender).is_some()
    }

    fn place_of(&self, sender: Session) -> Option<usize> {
        let is_theirs = |stop: &Option<Stop>| stop.is_some_and(|stop| stop.id.session == sender);
        self.stops.iter().position(is_theirs)
    }

    fn set(&mut self, stop: Stop) -> bool {
        let known = self.place_of(stop.id.session);
        let before = known.and_then(|place| self.stops[place]).map(|before| before.id);
        let mut settled = self.cleared.into_iter().flatten().chain(before);
        if settled.any(|settled| is_covered(stop.id, settled)) {
            return false;
        }
        let free = self.stops.iter().position(Option::is_none);
        // In front even of those that it does not replace: whoever says it waits to see it told.
        self.stops[..=known.or(free).unwrap_or(0)].rotate_right(1);
        self.stops[0] = Some(stop);
        true
    }

    fn clear(&mut self, named: MessageId) -> bool {
        let is_meant = |stop: &Option<Stop>| stop.is_some_and(|stop| is_covered(stop.id, named));
        let Some(place) = self.stops.iter().position(is_meant) else {
            return false;
        };
        self.stops[place] = None;
        self.stops[place..].rotate_left(1);
        self.cleared.rotate_right(1);
        self.cleared[0] = Some(named);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Header, Seq, Session};

    fn id(session: u64, seq: u64) -> MessageId {
        MessageId {
            session: Session(session),
            seq: Seq(seq),
        }
    }

    fn message(id: MessageId, body: Emergency) -> Envelope<Emergency> {
        let header = Header {
            session: id.session,
            seq: id.seq,
            ..Header::default()
        };
        Envelope { header, body }
    }

    fn stop(latch: &mut Latch, id: MessageId) -> bool {
        let by = Label::new("ada");
        latch.hear(&message(id, Emergency::Stop { by }))
    }

    fn clear(latch: &mut Latch, named: MessageId) -> bool {
        let by = Label::new("ada");
        latch.hear(&message(id(9, 1), Emergency::Clear { stop: named, by }))
    }

    #[test]
    fn a_stop_stays_until_it_is_cleared_by_its_name() {
        let mut latch = Latch::default();
        assert!(stop(&mut latch, id(1, 1)));
        assert!(!clear(&mut latch, id(2, 1)) && latch.reason().is_some());
        assert!(clear(&mut latch, id(1, 1)) && latch.reason().is_none());
    }

    /// Which stop is told.
    fn told(latch: &Latch) -> Option<MessageId> {
        match latch.reason() {
            Some(Reason::EmergencyStop { stop, .. }) => Some(stop),
            _ => None,
        }
    }

    #[test]
    fn where_several_stop_each_one_has_to_be_cleared() {
        let mut latch = Latch::default();
        assert!(stop(&mut latch, id(1, 1)) && stop(&mut latch, id(2, 1)));
        assert_eq!(told(&latch), Some(id(2, 1)));
        assert!(clear(&mut latch, id(2, 1)));
        assert_eq!(told(&latch), Some(id(1, 1)));
        assert!(!clear(&mut latch, id(2, 1)));
        assert!(clear(&mut latch, id(1, 1)) && told(&latch).is_none());
        let tells = |stop| {
            Motion::Held(Reason::EmergencyStop {
                stop,
                by: Label::default(),
            })
        };
        for late in [id(1, 1), id(2, 1)] {
            assert!(
                !latch.hear_of(tells(late)),
                "who has not heard of its end does not set it again"
            );
        }
    }

    #[test]
    fn whoever_repeats_itself_is_told_until_another_does() {
        let mut latch = Latch::default();
        assert!(stop(&mut latch, id(1, 1)) && stop(&mut latch, id(2, 1)) && stop(&mut latch, id(1, 2)));
        assert_eq!(told(&latch), Some(id(1, 2)));
        assert!(!stop(&mut latch, id(2, 1)), "the same message again is no repetition");
        assert!(clear(&mut latch, id(1, 2)) && clear(&mut latch, id(2, 1)) && told(&latch).is_none());
    }

    #[test]
    fn more_stops_than_are_kept_apart_still_hold() {
        let mut latch = Latch::default();
        assert!((1..=9).all(|sender| stop(&mut latch, id(sender, 1))));
        let mut cleared = 0;
        while let Some(next) = told(&latch) {
            assert!(clear(&mut latch, next));
            cleared += 1;
        }
        assert_eq!(cleared, SENDERS);
    }

    #[test]
    fn a_repetition_under_way_does_not_set_a_cleared_stop_again_but_a_new_one_does() {
        let mut latch = Latch::default();
        stop(&mut latch, id(1, 1));
        assert!(clear(&mut latch, id(1, 3)), "repetitions 2 and 3 were missed here");
        assert!(!stop(&mut latch, id(1, 2)) && latch.reason().is_none());
        let told = |seq| {
            let (stop, by) = (id(1, seq), Label::default());
            Motion::Held(Reason::EmergencyStop { stop, by })
        };
        assert!(!latch.hear_of(told(3)));
        assert!(stop(&mut latch, id(1, 4)));
    }

    #[test]
    fn a_forged_stop_that_was_cleared_does_not_silence_the_one_in_whose_name_it_came() {
        let mut latch = Latch::default();
        assert!(stop(&mut latch, id(1, u64::MAX)));
        assert!(clear(&mut latch, id(1, u64::MAX)) && latch.reason().is_none());
        assert!(stop(&mut latch, id(1, 5)) && latch.reason().is_some());
        assert!(clear(&mut latch, id(1, 5)) && latch.reason().is_none());
    }

    #[test]
    fn a_clear_cannot_be_given_in_advance() {
        let mut latch = Latch::default();
        assert!(!clear(&mut latch, id(1, 100)));
        assert!(stop(&mut latch, id(1, 1)));
        assert!(!clear(&mut latch, id(1, u64::MAX)) && latch.reason().is_some());
    }

    #[test]
    fn one_who_missed_it_learns_it_from_another() {
        let (mut knows, mut missed) = (Latch::default(), Latch::default());
        stop(&mut knows, id(1, 1));
        assert!(missed.hear_of(Motion::Held(knows.reason().expect("latched"))));
        assert_eq!(missed, knows);
    }
}
