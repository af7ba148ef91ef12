//! How old the knowledge of a message's maker was.

use super::Refusal;
use crate::{Malformed, Memory, MessageId, Nanos, Remember, Seq, Session, Stamp};

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MILLISECOND;

    fn at(millis: u64) -> Stamp {
        Stamp(millis * MILLISECOND)
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
}
