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
    /// Some of it was asked for in vain: it will not be whole any more.
    lacks: bool,
    /// How far it goes, as its node said when it ended.
    end: Option<u64>,
    /// The look at the session file that will tell whether all of it is kept.
    look: Option<u64>,
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
        self.look = None;
        self.extend(now, part);
    }

    /// Takes in how far it goes, which its node says when it ends; whether that is new.
    pub(super) fn hear_end(&mut self, now: Stamp, part: &JournalPart) -> bool {
        self.extend(now, part);
        self.end.replace(part.first) != Some(part.first)
    }

    fn extend(&mut self, now: Stamp, part: &JournalPart) {
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
    pub(super) fn vanish(&mut self, node: NodeName) -> Option<Note> {
        let went = !std::mem::replace(&mut self.gone, true);
        self.asked = None;
        let missing = self.missing.overlap(0, u64::MAX);
        (went && missing > 0).then(|| vanished_with(node, missing))
    }

    /// Whether nothing before its last entry is missing.
    pub(super) fn is_whole(&self) -> bool {
        self.missing.is_empty() && self.asked.is_none() && !self.lacks
    }

    /// Once look number `look` has been taken, it may be said that everything is there.
    pub(super) fn await_look(&mut self, look: u64) {
        self.look.get_or_insert(look);
    }

    /// So many looks have been taken, at a file that kept everything: where everything is there, the index behind it.
    pub(super) fn confirm(&mut self, looks: u64) -> Option<u64> {
        let is_known = self.is_whole() && self.look.is_some_and(|look| look <= looks);
        is_known.then(|| {
            self.look = None;
            self.next
        })
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

    /// The question that is due, which is then open. One for the tail says by itself that everything before is there;
    /// where that is not so (the session file `loses` some, or answers never came), it begins with an entry that is.
    pub(super) fn ask(&mut self, now: Stamp, loses: bool) -> (u64, u64) {
        let (first, last) = match self.missing.oldest() {
            Some((from, to)) => (from, to.saturating_sub(1)),
            None => {
                self.end_asked = true;
                let back = u64::from(loses || self.lacks);
                (self.next.saturating_sub(back), u64::MAX)
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
        self.look = None;
        if part.entries == 0 && part.first == asked.first {
            return Worth {
                take: false,
                note: self.unanswered(now, part.node, asked),
            };
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
    fn unanswered(&mut self, now: Stamp, node: NodeName, asked: Asked) -> Option<Note> {
        let limit = asked.last.saturating_add(1);
        let missing = self.missing.overlap(asked.first, limit);
        if missing == 0 {
            return None;
        }
        self.tries += 1;
        self.again = now.after(AGAIN);
        if self.tries < TRIES {
            return None;
        }
        self.tries = 0;
        self.missing.remove(asked.first, limit);
        self.lacks = true;
        Some(asked_in_vain(node, missing))
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
    pub(super) fn expire(&mut self, now: Stamp, node: NodeName) -> Option<Note> {
        let asked = self.asked.take_if(|asked| now >= asked.at.after(PATIENCE))?;
        self.unanswered(now, node, asked)
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
    lacking(node, format!("{count} entries of its journal cannot be had any more"))
}

fn asked_in_vain(node: NodeName, count: u64) -> Note {
    let text = format!("{count} entries of its journal are missing: asked for {TRIES} times, nobody answered");
    lacking(node, text)
}

fn vanished_with(node: NodeName, count: u64) -> Note {
    let text = format!("{count} entries of its journal are missing: it vanished before they were fetched");
    lacking(node, text)
}

const fn lacking(about: NodeName, text: String) -> Note {
    Note {
        level: Level::Warning,
        about,
        is_routine: false,
        text,
    }
}
