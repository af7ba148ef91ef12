//! What is missing of the nodes' journals, and the questions that fetch it.
//!
//! A node sends its journal live and keeps it for a while. Whatever was not heard (a gap, a beginning from before the
//! recorder came, an end that was lost) is asked for, and asked again a few times where no answer comes. Only what was
//! asked for is taken.
//!
//! Journals take turns: the next question is put when the one before is answered, or has been waiting for a while. An
//! answer may fill the queue of bulk traffic on its way, and Zenoh drops what finds it full: of four nodes that answered at
//! once two were not heard, nor that their answers had ended, which costs six seconds.
//!
//! ```text
//!   part ──▶ something is missing ──▶ question ──▶ answer: taken out of what is missing ──┐
//!                   ▲                     └──── none: again in a second, thrice ──┐       │
//!                   └─────────────────────────────────────────────────────────────┴───────┘
//! ```
//!
//! A node that ends removes what it kept once it hears that a recorder has everything, so that is said only where it is
//! true: nothing is missing, nothing was given up, and the shell has looked at the session file since and found that it
//! lost nothing. A look is taken whenever the counts are passed on.

mod journal;
mod missing;

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use tandem_wire::{NodeName, Outbox, Question, Session, Stamp};

use crate::heard::{JournalPart, Note};
use crate::node::Output;
use journal::Journal;
pub(crate) use journal::Worth;

/// Journals that are looked after: each run of each node has one. The one that was silent longest makes room.
const JOURNALS: usize = 16;

/// What is missing of all journals.
#[derive(Clone, Debug, Default)]
pub(crate) struct Filling {
    journals: BTreeMap<(NodeName, Session), Journal>,
    /// The recording ends: what is missing at the end of each journal is asked for once.
    closing: bool,
    /// The session file has lost something of what came.
    loses: bool,
    /// Looks at the session file: how many are due to counts that were passed on, and how many came. They come in their
    /// order and some may fail to, so the `n`-th that comes is of the `n`-th counts or later ones.
    looks_due: u64,
    looks: u64,
    /// What a person should know and was not told yet.
    notes: Vec<Note>,
}

/// What a node's word of how far its journal goes is good for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct End {
    /// It was not said before.
    pub(crate) is_new: bool,
    /// Everything up to there has come: a look at the session file is due, which tells whether it is kept.
    pub(crate) is_whole: bool,
}

impl Filling {
    /// Takes in a part that a node sent by itself.
    pub(crate) fn hear(&mut self, now: Stamp, part: &JournalPart, outbox: &mut Outbox<Output>) {
        self.journal(part).hear(now, part);
        self.ask(now, outbox);
    }

    /// Takes in how far a journal goes: its node ends, and waits for somebody who has everything. Where everything came,
    /// the counts are to be passed on.
    pub(crate) fn hear_end(&mut self, now: Stamp, part: &JournalPart, outbox: &mut Outbox<Output>) -> End {
        let (loses, look) = (self.loses, self.looks_due + 1);
        let journal = self.journal(part);
        let is_new = journal.hear_end(now, part);
        let is_whole = journal.is_whole() && !loses;
        if is_whole {
            journal.await_look(look);
        }
        self.ask(now, outbox);
        End { is_new, is_whole }
    }

    /// The counts are passed on, with which the shell looks at the session file.
    pub(crate) const fn expect_look(&mut self) {
        self.looks_due += 1;
    }

    /// The shell has looked at the session file, and whether it `loses` some of what comes.
    pub(crate) fn look(&mut self, loses: bool, outbox: &mut Outbox<Output>) {
        self.loses = loses;
        self.looks = (self.looks + 1).min(self.looks_due);
        if loses {
            return;
        }
        for (&(node, session), journal) in &mut self.journals {
            if let Some(behind) = journal.confirm(self.looks) {
                let (first, last) = (behind, behind);
                outbox.push(Output::Ask(Question {
                    node,
                    session,
                    first,
                    last,
                }));
            }
        }
    }

    /// What a person should know and was not told yet.
    pub(crate) fn take_notes(&mut self) -> Vec<Note> {
        std::mem::take(&mut self.notes)
    }

    fn journal(&mut self, part: &JournalPart) -> &mut Journal {
        let key = (part.node, part.header.session);
        if !self.journals.contains_key(&key) {
            self.make_room();
        }
        self.journals.entry(key).or_default()
    }

    /// Takes in the answer to a question.
    pub(crate) fn answer(&mut self, now: Stamp, part: &JournalPart, outbox: &mut Outbox<Output>) -> Worth {
        let journal = self.journals.get_mut(&(part.node, part.header.session));
        let worth = journal.map_or_else(Worth::default, |journal| journal.answer(now, part));
        self.ask(now, outbox);
        worth
    }

    /// A node appeared or vanished. One that is heard again is there again.
    pub(crate) fn presence(&mut self, node: NodeName, alive: bool) {
        let of_node = self.journals.iter_mut().filter(|((name, _), _)| *name == node);
        for (_, journal) in of_node.filter(|_| !alive) {
            self.notes.extend(journal.vanish(node));
        }
    }

    /// The recording ends.
    pub(crate) fn close(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        self.closing = true;
        self.ask(now, outbox);
    }

    /// Whether the recording ends and no question is open any more.
    pub(crate) fn is_settled(&self) -> bool {
        self.closing && self.journals.values().all(Journal::is_settled)
    }

    /// When a question is due, or an answer overdue.
    pub(crate) fn deadline(&self) -> Option<Stamp> {
        let held = self.held_up().unwrap_or_default();
        let deadlines = self.journals.values();
        deadlines
            .filter_map(|journal| journal.deadline(self.closing, held))
            .min()
    }

    /// Puts the question that is due: where several are, to whom none was put for longest.
    pub(crate) fn ask(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        for (&(node, _), journal) in &mut self.journals {
            self.notes.extend(journal.expire(now, node));
        }
        if self.held_up().is_some_and(|until| now < until) {
            return;
        }
        let (closing, loses) = (self.closing, self.loses);
        let due = self
            .journals
            .iter_mut()
            .filter(|(_, journal)| journal.is_due(now, closing));
        if let Some((&(node, session), journal)) = due.min_by_key(|(_, journal)| journal.turn()) {
            let (first, last) = journal.ask(now, loses);
            outbox.push(Output::Ask(Question {
                node,
                session,
                first,
                last,
            }));
        }
    }

    /// Until when an open question holds the others up.
    fn held_up(&self) -> Option<Stamp> {
        self.journals.values().filter_map(Journal::holds_up).max()
    }

    fn make_room(&mut self) {
        if self.journals.len() >= JOURNALS {
            let silent = self.journals.iter().min_by_key(|(_, journal)| journal.heard());
            if let Some(key) = silent.map(|(key, _)| *key) {
                self.journals.remove(&key);
            }
        }
    }
}
