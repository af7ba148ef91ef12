//! What came of one node's journal, in however many runs of it.
//!
//! Every run's journal begins with entry 0, so what lies before the first part that was heard is missing like any other
//! gap, until it is fetched.

use tandem_wire::{NodeName, Session};

use super::gaps::Gaps;
use super::{JournalCount, RUNS};
use crate::heard::JournalPart;

#[derive(Clone, Debug)]
pub(super) struct Journal {
    count: JournalCount,
    runs: Vec<Run>,
    /// Gaps of runs that are no longer told apart.
    forgotten: u64,
}

#[derive(Clone, Debug)]
struct Run {
    session: Session,
    /// The index behind the last entry that came.
    next: u64,
    /// Indices that have not come.
    gaps: Gaps,
}

impl Journal {
    pub(super) const fn new(node: NodeName) -> Self {
        Self {
            count: JournalCount {
                node,
                entries: 0,
                lost: 0,
                missed: 0,
            },
            runs: Vec::new(),
            forgotten: 0,
        }
    }

    pub(super) const fn count(&self) -> JournalCount {
        self.count
    }

    /// What is missing of each run.
    pub(super) fn gaps(&self) -> impl Iterator<Item = (Session, &Gaps)> + '_ {
        self.runs.iter().map(|run| (run.session, &run.gaps))
    }

    pub(super) fn forgotten(&self) -> u64 {
        self.forgotten + self.runs.iter().map(|run| run.gaps.forgotten()).sum::<u64>()
    }

    pub(super) fn add(&mut self, part: &JournalPart) {
        let at = self.place(part.header.session);
        let (run, count) = (&mut self.runs[at], &mut self.count);
        let end = part.first.saturating_add(part.entries);
        if part.first >= run.next {
            let missing = part.first - run.next;
            // What the writer lost has indices too, and is lost rather than on its way.
            let lost = part.lost.min(missing);
            count.lost = count.lost.saturating_add(lost);
            if missing > lost {
                count.missed = count.missed.saturating_add(missing - lost);
                run.gaps.add(run.next, part.first - lost);
            }
            count.entries += part.entries;
            run.next = end;
        } else {
            let filled = run.gaps.fill(part.first, end);
            // A part may go on beyond what was known to be there.
            let beyond = end.saturating_sub(run.next);
            run.next = run.next.max(end);
            count.missed = count.missed.saturating_sub(filled);
            count.entries += filled + beyond;
        }
    }

    /// Where a run stands among those told apart; the oldest makes room.
    fn place(&mut self, session: Session) -> usize {
        if let Some(at) = self.runs.iter().position(|run| run.session == session) {
            return at;
        }
        if self.runs.len() == RUNS {
            let oldest = self.runs.remove(0);
            self.forgotten += oldest.gaps.forgotten() + oldest.gaps.ranges().count() as u64;
        }
        self.runs.push(Run {
            session,
            next: 0,
            gaps: Gaps::default(),
        });
        self.runs.len() - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::{Header, Seq, Stamp};

    fn hear(journal: &mut Journal, session: u64, first: u64, entries: u64, lost: u64) -> (u64, u64, u64) {
        journal.add(&JournalPart {
            node: NodeName::Arbiter,
            header: Header {
                tick: 0,
                session: Session(session),
                seq: Seq(1),
                sent: Stamp(0),
            },
            first,
            entries,
            lost,
            bytes: Vec::new(),
        });
        let count = journal.count();
        (count.entries, count.lost, count.missed)
    }

    #[test]
    fn a_part_fetched_later_closes_its_gap() {
        let mut journal = Journal::new(NodeName::Arbiter);
        let mut hear = |first, entries, lost| hear(&mut journal, 1, first, entries, lost);
        assert_eq!(hear(0, 10, 0), (10, 0, 0));
        assert_eq!(hear(25, 5, 3), (15, 3, 12));
        assert_eq!(hear(12, 4, 0), (19, 3, 8));
        assert_eq!(hear(12, 4, 0), (19, 3, 8), "again");
        assert_eq!(hear(5, 17, 0), (27, 3, 0));
    }

    #[test]
    fn a_beginning_is_missing_until_it_is_fetched_and_then_counts() {
        let mut journal = Journal::new(NodeName::Arbiter);
        assert_eq!(hear(&mut journal, 1, 100, 10, 0), (10, 0, 100));
        assert_eq!(hear(&mut journal, 1, 0, 60, 0), (70, 0, 40));
        assert_eq!(hear(&mut journal, 1, 60, 40, 0), (110, 0, 0));
        assert_eq!(
            hear(&mut journal, 1, 105, 10, 0),
            (115, 0, 0),
            "it overlaps what is there"
        );
        assert_eq!(journal.gaps().flat_map(|(_, gaps)| gaps.ranges()).count(), 0);
    }

    #[test]
    fn what_is_fetched_of_an_earlier_run_belongs_to_it() {
        let mut journal = Journal::new(NodeName::Arbiter);
        assert_eq!(hear(&mut journal, 1, 10, 10, 0), (10, 0, 10));
        assert_eq!(hear(&mut journal, 2, 0, 5, 0), (15, 0, 10));
        assert_eq!(hear(&mut journal, 1, 0, 10, 0), (25, 0, 0));
        assert_eq!(hear(&mut journal, 2, 5, 5, 0), (30, 0, 0));
    }
}
