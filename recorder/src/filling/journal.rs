//! One journal: what was heard of it, the question that is open, and what an answer is worth.

use tandem_wire::{Nanos, NodeName, SECOND, Stamp, seconds};

use super::missing::Missing;
use crate::heard::{JournalPart, Level, Note};

/// An answer that takes longer does not come.
const PATIENCE: Nanos = 6 * SECOND;
/// An open question holds those to other nodes up for no longer.
const TURN: Nanos = SECOND / 5;
/// Unanswered questions are put again after this time, so often.
const AGAIN: Nanos = SECOND;
pub(super) const TRIES: u32 = 3;

/// What is known and missing of one run of one node.
#[derive(Clone, Debug, Default)]
pub(super) struct Journal {
    heard: Stamp,
    /// The index behind the last entry that is known of.
    next: u64,
    missing: Missing,
    asked: Option<Asked>,
    /// When the last question was put.
    turn: Stamp,
    tries: u32,
    again: Stamp,
    /// Its node vanished: nobody answers.
    gone: bool,
    end_asked: bool,
    /// When the first question was put, and how many entries have come since.
    fetching: Option<(Stamp, u64)>,
}

#[derive(Clone, Copy, Debug)]
struct Asked {
    first: u64,
    last: u64,
    at: Stamp,
}

/// What an answer was worth.
#[derive(Clone, Debug, Default)]
pub(crate) struct Worth {
    /// Whether it was asked for and holds entries.
    pub(crate) take: bool,
    /// What a person should know.
    pub(crate) note: Option<Note>,
}

impl Journal {
    /// Takes in a part that its node sent by itself.
    pub(super) fn hear(&mut self, now: Stamp, part: &JournalPart) {
        let behind = part.first.saturating_add(part.entries);
        if part.first > self.next {
            self.missing.add(self.next, part.first);
        } else {
            self.missing.remove(part.first, behind);
        }
        self.next = self.next.max(behind);
        self.heard = now;
        self.gone = false;
    }

    /// Its node is gone, and with it the answer to what is asked.
    pub(super) fn vanish(&mut self) {
        self.gone = true;
        self.asked = None;
    }

    /// The index behind its last entry, if none before it is missing.
    pub(super) fn whole(&self) -> Option<u64> {
        (self.missing.is_empty() && self.asked.is_none()).then_some(self.next)
    }

    pub(super) const fn heard(&self) -> Stamp {
        self.heard
    }

    /// Until when its open question holds those to other nodes up.
    pub(super) fn holds_up(&self) -> Option<Stamp> {
        Some(self.asked?.at.after(TURN))
    }

    /// When the last question was put.
    pub(super) const fn turn(&self) -> Stamp {
        self.turn
    }

    /// Whether a question is due.
    pub(super) fn is_due(&self, now: Stamp, closing: bool) -> bool {
        self.due(closing).is_some_and(|due| due <= now)
    }

    /// From when a question is due.
    fn due(&self, closing: bool) -> Option<Stamp> {
        let is_idle = !self.gone && self.asked.is_none();
        (is_idle && (!self.missing.is_empty() || self.wants_end(closing))).then_some(self.again)
    }

    const fn wants_end(&self, closing: bool) -> bool {
        closing && !self.end_asked
    }

    /// The question that is due, which is then open.
    pub(super) fn ask(&mut self, now: Stamp) -> (u64, u64) {
        let (first, last) = match self.missing.oldest() {
            Some((from, to)) => (from, to.saturating_sub(1)),
            None => {
                self.end_asked = true;
                (self.next, u64::MAX)
            }
        };
        self.asked = Some(Asked { first, last, at: now });
        self.turn = now;
        if !self.missing.is_empty() {
            self.fetching.get_or_insert((now, 0));
        }
        (first, last)
    }

    /// Takes in the answer to a question.
    pub(super) fn answer(&mut self, now: Stamp, part: &JournalPart) -> Worth {
        let behind = part.first.saturating_add(part.entries);
        let asked = self.asked.filter(|asked| {
            let limit = asked.last.saturating_add(1);
            (asked.first..=limit).contains(&part.first) && behind <= limit
        });
        let Some(asked) = asked else { return Worth::default() };
        self.asked = None;
        self.heard = now;
        if part.entries == 0 && part.first == asked.first {
            self.unanswered(now, asked);
            return Worth::default();
        }
        self.tries = 0;
        let gone_for_good = self.missing.overlap(asked.first, part.first);
        self.missing.remove(asked.first, behind);
        self.next = self.next.max(behind);
        if let Some((_, came)) = &mut self.fetching {
            *came += part.entries;
        }
        Worth {
            take: part.entries > 0,
            note: match gone_for_good {
                0 => self.fetched(now, part.node),
                count => Some(cannot_be_had(part.node, count)),
            },
        }
    }

    /// Nobody answered, or nothing is there.
    fn unanswered(&mut self, now: Stamp, asked: Asked) {
        let limit = asked.last.saturating_add(1);
        if self.missing.overlap(asked.first, limit) == 0 {
            return;
        }
        self.tries += 1;
        self.again = now.after(AGAIN);
        if self.tries >= TRIES {
            self.tries = 0;
            self.missing.remove(asked.first, limit);
        }
    }

    fn fetched(&mut self, now: Stamp, node: NodeName) -> Option<Note> {
        if !self.missing.is_empty() {
            return None;
        }
        let (began, entries) = self.fetching.take()?;
        let took = seconds(now.since(began));
        Some(Note {
            level: Level::Info,
            about: node,
            is_routine: true,
            text: format!("{entries} entries of its journal that were missed have been fetched, in {took:.3} s"),
        })
    }

    /// Gives an answer up that is overdue.
    pub(super) fn expire(&mut self, now: Stamp) {
        if let Some(asked) = self.asked
            && now >= asked.at.after(PATIENCE)
        {
            self.asked = None;
            self.unanswered(now, asked);
        }
    }

    /// At the end of the recording: whether no question is open any more.
    pub(super) fn is_settled(&self) -> bool {
        self.gone || (self.missing.is_empty() && self.asked.is_none() && self.end_asked)
    }

    /// When a question is due, others holding it up until `held`, or an answer overdue.
    pub(super) fn deadline(&self, closing: bool, held: Stamp) -> Option<Stamp> {
        match self.asked {
            Some(asked) => Some(asked.at.after(PATIENCE)),
            None => Some(self.due(closing)?.max(held)),
        }
    }
}

fn cannot_be_had(node: NodeName, count: u64) -> Note {
    Note {
        level: Level::Warning,
        about: node,
        is_routine: false,
        text: format!("{count} entries of its journal cannot be had any more"),
    }
}
