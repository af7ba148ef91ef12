//! What is missing of the nodes' journals, and the questions that fetch it.
//!
//! A node sends its journal live and keeps it for a while. Whatever was not heard (a gap, a beginning from before the
//! recorder came, an end that was lost) is asked for, one question at a time for each journal, and asked again a few
//! times where no answer comes. Only what was asked for is taken.
//!
//! ```text
//!   part ──▶ something is missing ──▶ question ──▶ answer: taken out of what is missing ──┐
//!                   ▲                     └──── none: again in a second, thrice ──┐       │
//!                   └─────────────────────────────────────────────────────────────┴───────┘
//! ```

use std::collections::BTreeMap;

use tandem_wire::{Nanos, NodeName, Outbox, Question, SECOND, Session, Stamp, seconds};

use crate::heard::{JournalPart, Level, Note};
use crate::node::Output;

/// Journals that are looked after: each run of each node has one. The one that was silent longest makes room.
const JOURNALS: usize = 16;
/// Gaps of one journal that are told apart; the last ones of more are asked for together with what lies between.
const GAPS: usize = 64;
/// An answer that takes longer does not come.
const PATIENCE: Nanos = 6 * SECOND;
/// Unanswered questions are put again after this time, so often.
const AGAIN: Nanos = SECOND;
const TRIES: u32 = 3;

/// What is missing of all journals.
#[derive(Clone, Debug, Default)]
pub(crate) struct Filling {
    journals: BTreeMap<(NodeName, Session), Journal>,
    /// The recording ends: what is missing at the end of each journal is asked for once.
    closing: bool,
}

#[derive(Clone, Debug, Default)]
struct Journal {
    heard: Stamp,
    /// The index behind the last entry that is known of.
    next: u64,
    /// Half-open ranges of indices, oldest first.
    missing: Vec<(u64, u64)>,
    asked: Option<Asked>,
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

impl Filling {
    /// Takes in a part that a node sent by itself.
    pub(crate) fn hear(&mut self, now: Stamp, part: &JournalPart, outbox: &mut Outbox<Output>) {
        let key = (part.node, part.header.session);
        if !self.journals.contains_key(&key) {
            self.make_room();
        }
        let journal = self.journals.entry(key).or_default();
        journal.hear(now, part);
        // A node that ends says how far its journal goes, and waits for somebody who has everything.
        if part.entries == 0 && journal.missing.is_empty() && journal.asked.is_none() {
            outbox.push(Output::Ask(Question {
                node: part.node,
                session: part.header.session,
                first: journal.next,
                last: journal.next,
            }));
        }
        self.ask(now, outbox);
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
            journal.gone = true;
            journal.asked = None;
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
        self.journals.values().filter_map(Journal::deadline).min()
    }

    /// Puts the questions that are due.
    pub(crate) fn ask(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        for (&(node, session), journal) in &mut self.journals {
            journal.expire(now);
            if let Some((first, last)) = journal.ask(now, self.closing) {
                outbox.push(Output::Ask(Question {
                    node,
                    session,
                    first,
                    last,
                }));
            }
        }
    }

    fn make_room(&mut self) {
        if self.journals.len() >= JOURNALS {
            let silent = self.journals.iter().min_by_key(|(_, journal)| journal.heard);
            if let Some(key) = silent.map(|(key, _)| *key) {
                self.journals.remove(&key);
            }
        }
    }
}

impl Journal {
    fn hear(&mut self, now: Stamp, part: &JournalPart) {
        let behind = part.first.saturating_add(part.entries);
        if part.first > self.next {
            self.miss(self.next, part.first);
        } else {
            self.remove(part.first, behind);
        }
        self.next = self.next.max(behind);
        self.heard = now;
        self.gone = false;
    }

    fn miss(&mut self, from: u64, to: u64) {
        let full = self.missing.len() >= GAPS;
        match self.missing.last_mut() {
            Some(last) if full => last.1 = to,
            _ => self.missing.push((from, to)),
        }
    }

    fn remove(&mut self, from: u64, to: u64) {
        let parts = |&(low, high): &(u64, u64)| {
            let left = (low, high.min(from).max(low));
            let right = (low.max(to).min(high), high);
            if to <= low || from >= high {
                [(low, high), (high, high)]
            } else {
                [left, right]
            }
        };
        let left = self.missing.iter().flat_map(parts).filter(|(low, high)| low < high);
        self.missing = left.collect();
    }

    /// The next question, which is then open.
    fn ask(&mut self, now: Stamp, closing: bool) -> Option<(u64, u64)> {
        if self.gone || self.asked.is_some() || now < self.again {
            return None;
        }
        let (first, last) = match self.missing.first() {
            Some(&(from, to)) => (from, to.saturating_sub(1)),
            None if closing && !self.end_asked => {
                self.end_asked = true;
                (self.next, u64::MAX)
            }
            None => return None,
        };
        self.asked = Some(Asked { first, last, at: now });
        if !self.missing.is_empty() {
            self.fetching.get_or_insert((now, 0));
        }
        Some((first, last))
    }

    fn answer(&mut self, now: Stamp, part: &JournalPart) -> Worth {
        let behind = part.first.saturating_add(part.entries);
        let asked = self.asked.filter(|asked| {
            let limit = asked.last.saturating_add(1);
            (asked.first..=limit).contains(&part.first) && behind <= limit
        });
        let Some(asked) = asked else { return Worth::default() };
        self.asked = None;
        self.heard = now;
        if part.entries == 0 && part.first == asked.first {
            return self.unanswered(now, asked);
        }
        self.tries = 0;
        let gone_for_good = self.overlap(asked.first, part.first);
        self.remove(asked.first, behind);
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
    fn unanswered(&mut self, now: Stamp, asked: Asked) -> Worth {
        let limit = asked.last.saturating_add(1);
        let missing = self.overlap(asked.first, limit);
        if missing == 0 {
            return Worth::default();
        }
        self.tries += 1;
        self.again = now.after(AGAIN);
        if self.tries >= TRIES {
            self.tries = 0;
            self.remove(asked.first, limit);
        }
        Worth::default()
    }

    /// How many of `from..to` are missing.
    fn overlap(&self, from: u64, to: u64) -> u64 {
        let each = |&(low, high): &(u64, u64)| high.min(to).saturating_sub(low.max(from));
        self.missing.iter().map(each).sum()
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
            text: format!("{entries} entries of its journal that were missed have been fetched, in {took:.3} s"),
        })
    }

    fn expire(&mut self, now: Stamp) {
        if let Some(asked) = self.asked
            && now >= asked.at.after(PATIENCE)
        {
            self.asked = None;
            // What it was worth is nothing, and nobody needs to read that.
            let _ = self.unanswered(now, asked);
        }
    }

    fn is_settled(&self) -> bool {
        self.gone || (self.missing.is_empty() && self.asked.is_none() && self.end_asked)
    }

    fn deadline(&self) -> Option<Stamp> {
        match self.asked {
            _ if self.gone => None,
            Some(asked) => Some(asked.at.after(PATIENCE)),
            None if self.missing.is_empty() => None,
            None => Some(self.again),
        }
    }
}

fn cannot_be_had(node: NodeName, count: u64) -> Note {
    Note {
        level: Level::Warning,
        about: node,
        text: format!("{count} entries of its journal cannot be had any more"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::{Header, Seq};

    fn part(first: u64, entries: u64) -> JournalPart {
        JournalPart {
            node: NodeName::Arbiter,
            header: Header {
                tick: 0,
                session: Session(5),
                seq: Seq(0),
                sent: Stamp(0),
            },
            first,
            entries,
            lost: 0,
            bytes: Vec::new(),
        }
    }

    /// The questions that hearing, or being answered, leads to.
    fn after(filling: &mut Filling, step: impl FnOnce(&mut Filling, &mut Outbox<Output>)) -> Vec<(u64, u64)> {
        let mut outbox = Outbox::default();
        step(filling, &mut outbox);
        let question = |output| match output {
            Output::Ask(question) => Some((question.first, question.last)),
            _ => None,
        };
        outbox.drain().filter_map(question).collect()
    }

    fn hear(filling: &mut Filling, at: u64, first: u64, entries: u64) -> Vec<(u64, u64)> {
        after(filling, |filling, outbox| {
            filling.hear(Stamp(at), &part(first, entries), outbox)
        })
    }

    fn answer(filling: &mut Filling, at: u64, first: u64, entries: u64) -> (bool, Vec<(u64, u64)>) {
        let mut take = false;
        let asked = after(filling, |filling, outbox| {
            take = filling.answer(Stamp(at), &part(first, entries), outbox).take;
        });
        (take, asked)
    }

    #[test]
    fn a_late_start_and_a_gap_are_asked_for_one_after_the_other_until_they_are_there() {
        let mut filling = Filling::default();
        assert_eq!(hear(&mut filling, 0, 100, 10), [(0, 99)]);
        assert_eq!(hear(&mut filling, 1, 120, 10), []);
        assert_eq!(answer(&mut filling, 2, 0, 60), (true, vec![(60, 99)]));
        assert_eq!(answer(&mut filling, 3, 60, 40), (true, vec![(110, 119)]));
        assert_eq!(answer(&mut filling, 4, 110, 10), (true, vec![]));
        assert_eq!(filling.deadline(), None);
    }

    #[test]
    fn what_was_not_asked_for_is_not_taken() {
        let mut filling = Filling::default();
        assert_eq!(answer(&mut filling, 0, 0, 10), (false, vec![]));
        hear(&mut filling, 0, 50, 10);
        for (first, entries) in [(60, 5), (40, 11), (u64::MAX, 2)] {
            assert!(!answer(&mut filling, 1, first, entries).0, "{first} {entries}");
        }
        assert!(answer(&mut filling, 1, 0, 50).0);
    }

    #[test]
    fn what_cannot_be_had_any_more_is_said_and_not_asked_for_again() {
        let mut filling = Filling::default();
        hear(&mut filling, 0, 100, 10);
        let mut outbox = Outbox::default();
        let worth = filling.answer(Stamp(1), &part(70, 30), &mut outbox);
        let words = worth.note.map(|note| note.text).unwrap_or_default();
        assert!(worth.take && words.starts_with("70 entries"), "{words}");
        assert_eq!((outbox.as_slice().len(), filling.deadline()), (0, None));
    }

    #[test]
    fn silence_is_asked_thrice() {
        let mut filling = Filling::default();
        assert_eq!(hear(&mut filling, 0, 10, 10), [(0, 9)]);
        let mut now = 0;
        for _ in 1..TRIES {
            assert_eq!(answer(&mut filling, now, 0, 0), (false, vec![]));
            now = filling.deadline().expect("another try").0;
            assert_eq!(
                after(&mut filling, |filling, outbox| filling.ask(Stamp(now), outbox)),
                [(0, 9)]
            );
        }
        answer(&mut filling, now, 0, 0);
        assert_eq!(filling.deadline(), None);
    }

    #[test]
    fn whoever_ends_hears_that_everything_is_there_only_once_it_is() {
        let mut filling = Filling::default();
        hear(&mut filling, 0, 0, 10);
        assert_eq!(hear(&mut filling, 1, 20, 0), [(10, 19)]);
        assert_eq!(hear(&mut filling, 2, 20, 0), []);
        answer(&mut filling, 3, 10, 10);
        assert_eq!(hear(&mut filling, 4, 20, 0), [(20, 20)]);
    }

    #[test]
    fn at_the_end_each_journal_that_is_still_written_is_asked_for_its_tail_once() {
        let mut filling = Filling::default();
        hear(&mut filling, 0, 0, 10);
        assert!(!filling.is_settled());
        let close = |filling: &mut Filling| after(filling, |filling, outbox| filling.close(Stamp(1), outbox));
        assert_eq!(close(&mut filling), [(10, u64::MAX)]);
        assert!(!filling.is_settled());
        assert_eq!(answer(&mut filling, 2, 10, 4), (true, vec![]));
        assert!(filling.is_settled());
        let mut vanished = Filling::default();
        hear(&mut vanished, 0, 0, 10);
        vanished.presence(NodeName::Arbiter, false);
        assert_eq!(close(&mut vanished), []);
        assert!(vanished.is_settled());
    }
}
