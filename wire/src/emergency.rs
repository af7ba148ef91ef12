//! The emergency stop: anyone may set it, it stays until somebody clears it on purpose.
//!
//! Arbiter and robot each latch it, from its own key or from each other's setpoints and states; so one of them may be
//! started again and still knows, and whoever comes late sees it in every state.
//!
//! ```text
//!              Stop, or a setpoint or state that tells of one
//!   Clear ─────────────────────────────────────────────────────▶ Latched(newest stop)
//!     ▲                 Clear that names this stop                  │ ▲
//!     └─────────────────────────────────────────────────────────────┘ └─ another Stop
//! ```

use bincode::{Decode, Encode};

use crate::{Envelope, Label, MessageId, Motion, Reason};

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

/// Holds the newest emergency stop until it is cleared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub struct Latch {
    stop: Option<Stop>,
    /// The last stop that was cleared: what is still under way must not set it again.
    cleared: Option<MessageId>,
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
            Motion::Held(Reason::EmergencyStop { stop, by }) if self.stop.is_none() => self.set(Stop { id: stop, by }),
            _ => false,
        }
    }

    /// Why nothing may move, while a stop is in force.
    #[must_use]
    pub fn reason(&self) -> Option<Reason> {
        self.stop.map(|Stop { id, by }| Reason::EmergencyStop { stop: id, by })
    }

    fn set(&mut self, stop: Stop) -> bool {
        let is_repeated = |before: MessageId| {
            let behind = before.seq.0.checked_sub(stop.id.seq.0);
            before.session == stop.id.session && behind.is_some_and(|behind| behind <= REPEATED)
        };
        if self.cleared.is_some_and(is_repeated) || self.stop.is_some_and(|before| is_repeated(before.id)) {
            return false;
        }
        self.stop = Some(stop);
        true
    }

    fn clear(&mut self, named: MessageId) -> bool {
        let meant = self.stop.is_some_and(|Stop { id, .. }| {
            let ahead = named.seq.0.checked_sub(id.seq.0);
            id.session == named.session && ahead.is_some_and(|ahead| ahead <= REPEATED)
        });
        if meant {
            (self.stop, self.cleared) = (None, Some(named));
        }
        meant
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
        assert!(stop(&mut latch, id(2, 1)), "a second one takes its place");
        assert!(!clear(&mut latch, id(1, 1)) && latch.reason().is_some());
        assert!(clear(&mut latch, id(2, 1)) && latch.reason().is_none());
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
