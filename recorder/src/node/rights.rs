//! Who may drive, and whether everything must stand, in words and once.
//!
//! Operators claim, the arbiter grants: what was granted stands in every setpoint. Whoever presses a button or stops the
//! robot says so again and again until it is heard; only what is new is worth a line.

use tandem_wire::{Claim, Emergency, Envelope, Label, Latch, Lease, NodeName, Session, Topic, Wish};

use super::notes::{info, warning};
use crate::heard::{Level, Note};

/// A press may be heard before the claim that comes with it, which tells the name: so many setpoints are waited for it.
const NAMED_WITHIN: u32 = 25;

#[derive(Clone, Debug, Default)]
pub(super) struct Rights {
    lease: Option<Lease>,
    /// Setpoints so far in which a new holder has no name.
    nameless: u32,
    asks: Option<Label>,
    claim: Option<(Session, Claim)>,
    stop: Latch,
}

impl Rights {
    /// What an operator wants. That it presses to drive shows in what it gets.
    pub(super) fn hear_claim(&mut self, message: &Envelope<Claim>) -> Option<Note> {
        let claim = (message.header.session, message.body);
        if self.claim.replace(claim) == Some(claim) {
            return None;
        }
        let who = called(message.body.name);
        let text = match message.body.wish {
            Wish::Drive => return None,
            Wish::Release => format!("{who} gives the lease up"),
            Wish::TakeOver => format!("{who} asks to take the lease over"),
        };
        Some(info(NodeName::Operator, text))
    }

    /// Who would like to have the lease, as a setpoint says it.
    pub(super) fn hear_asking(&mut self, asks: Option<Label>) -> Option<Note> {
        let is_news = std::mem::replace(&mut self.asks, asks) != asks;
        let name = asks.filter(|_| is_news)?;
        let text = format!("{} asks for the lease", called(name));
        Some(info(NodeName::Arbiter, text))
    }

    /// Who holds the lease, as a setpoint says it.
    pub(super) fn hear_lease(&mut self, lease: Option<Lease>) -> Option<Note> {
        if self.lease == lease {
            return None;
        }
        if lease.is_some_and(|lease| lease.name.is_empty()) && self.nameless < NAMED_WITHIN {
            self.nameless += 1;
            return None;
        }
        self.nameless = 0;
        self.lease = lease;
        let text = match lease {
            Some(Lease { number, name, .. }) => format!("{} holds the lease, grant {number}", called(name)),
            None => "nobody holds the lease".to_owned(),
        };
        Some(info(NodeName::Arbiter, text))
    }

    /// An emergency stop, or its end.
    pub(super) fn hear_emergency(&mut self, message: &Envelope<Emergency>) -> Option<Note> {
        let is_again = self.stop.is_of(message.header.session) && message.body.topic() == Topic::Emergency;
        if !self.stop.hear(message) || is_again {
            return None;
        }
        let about = NodeName::Operator;
        Some(match message.body {
            Emergency::Stop { by } => Note {
                level: Level::Error,
                about,
                is_routine: false,
                text: format!("emergency stop pressed by {}", called(by)),
            },
            Emergency::Clear { by, .. } => warning(about, format!("the emergency stop is cleared by {}", called(by))),
        })
    }
}

fn called(name: Label) -> String {
    match name.is_empty() {
        true => "somebody without a name".to_owned(),
        false => name.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::{Header, MessageId, Seq};

    fn header(seq: u64) -> Header {
        Header {
            session: Session(7),
            seq: Seq(seq),
            ..Header::default()
        }
    }

    #[test]
    fn a_stop_that_is_said_again_and_again_is_noted_once_and_so_is_its_end() {
        let mut rights = Rights::default();
        let mut hear = |seq, body| {
            let note = rights.hear_emergency(&Envelope {
                header: header(seq),
                body,
            });
            note.map(|note| note.text).unwrap_or_default()
        };
        let by = Label::new("ada");
        let stop = MessageId {
            session: Session(7),
            seq: Seq(2),
        };
        assert_eq!(hear(1, Emergency::Stop { by }), "emergency stop pressed by ada");
        assert_eq!(hear(2, Emergency::Stop { by }), "");
        assert_eq!(
            hear(3, Emergency::Clear { stop, by }),
            "the emergency stop is cleared by ada"
        );
        assert_eq!(hear(4, Emergency::Clear { stop, by }), "");
    }

    #[test]
    fn the_lease_is_noted_when_it_changes_hands() {
        let mut rights = Rights::default();
        let mut hear = |lease| rights.hear_lease(lease).map(|note| note.text).unwrap_or_default();
        let lease = |number, name| {
            Some(Lease {
                number,
                holder: Session(7),
                name: Label::new(name),
            })
        };
        assert_eq!(hear(None), "");
        assert_eq!(hear(lease(1, "ada")), "ada holds the lease, grant 1");
        assert_eq!(hear(lease(1, "ada")), "");
        assert_eq!(hear(None), "nobody holds the lease");
        assert_eq!(hear(lease(2, "")), "", "its name may still be under way");
        assert_eq!(hear(lease(2, "bob")), "bob holds the lease, grant 2");
        for _ in 0..NAMED_WITHIN {
            assert_eq!(hear(lease(3, "")), "");
        }
        assert_eq!(hear(lease(3, "")), "somebody without a name holds the lease, grant 3");
    }
}
