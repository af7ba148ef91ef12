//! What arrived on each topic, and what did not.
//!
//! A gap in a stream's sequence numbers counts as missed until the number turns up late. The last 64 numbers of a
//! sender's run are remembered one by one, so that a repeated message is told from a late one; further back it is
//! taken for late.

mod clocks;
mod gaps;
mod journal;

use std::collections::BTreeMap;

use tandem_wire::{Header, NodeName, Session, Stamp, Topic};

use crate::budget::{Budget, HopBudget, Offset};
use crate::heard::{JournalPart, Sample};
pub use clocks::ClockOffset;
use clocks::Clocks;
use gaps::Gaps;
use journal::Journal;

/// Runs of senders that are remembered per topic. Two operators may send at once; more than four are told apart no
/// longer, which makes their counts too high rather than the table too large.
const RUNS: usize = 4;

/// How one message stands in its stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// The next one, or the first of a sender's run.
    Next,
    /// Newer than all before, but this many between were missed.
    AfterGap(u64),
    /// Older than the newest, and new to us.
    Late,
    /// Heard before.
    Repeated,
}

/// The counts of one topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StreamCount {
    /// Which topic.
    pub topic: Topic,
    /// Messages read, repeated ones included.
    pub received: u64,
    /// Sequence numbers that never came.
    pub missed: u64,
    /// Messages that came after a later one.
    pub late: u64,
    /// Messages that came twice.
    pub repeated: u64,
    /// Samples that could not be read.
    pub unreadable: u64,
    /// Runs of senders.
    pub runs: u64,
}

/// The counts of one node's journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JournalCount {
    /// Whose journal.
    pub node: NodeName,
    /// Entries received.
    pub entries: u64,
    /// Entries that its writer lost.
    pub lost: u64,
    /// Entries before the last received one of a run that never came, those from before the recorder did included.
    pub missed: u64,
}

/// All counts, in a fixed order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Per topic.
    pub streams: Vec<StreamCount>,
    /// Per journal.
    pub journals: Vec<JournalCount>,
    /// Which numbers never came, by topic and run; only the newest of very many.
    pub gaps: Vec<Gap>,
    /// Gaps that are not among them.
    pub gaps_forgotten: u64,
    /// What is known of the senders' clocks; nothing in lockstep, where stamps are no times.
    pub clocks: Vec<ClockOffset>,
    /// What the nodes say of each other's clocks.
    pub offsets: Vec<Offset>,
    /// How long each hop of the loop took.
    pub hops: Vec<HopBudget>,
}

/// Numbers that never came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gap {
    /// On which topic.
    pub topic: Topic,
    /// In which run of its sender.
    pub session: Session,
    /// The first missing sequence number; of a journal, the first missing entry's index.
    pub first: u64,
    /// The last missing one.
    pub last: u64,
}

/// Keeps the counts.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tally {
    streams: BTreeMap<Topic, Stream>,
    journals: BTreeMap<NodeName, Journal>,
    clocks: Clocks,
    budget: Budget,
}

#[derive(Clone, Debug)]
struct Stream {
    count: StreamCount,
    runs: Vec<Run>,
    /// Gaps of runs that are no longer told apart.
    forgotten: u64,
}

#[derive(Clone, Debug)]
struct Run {
    session: Session,
    first: u64,
    newest: u64,
    /// Bit `i` says whether number `newest − i` was heard.
    heard: u64,
    gaps: Gaps,
}

impl Tally {
    /// Counts a message that was read.
    pub(crate) fn count(&mut self, topic: Topic, header: &Header) -> Place {
        let stream = self.stream(topic);
        stream.count.received += 1;
        let place = stream.place(header);
        match place {
            Place::Next => {}
            Place::AfterGap(missed) => stream.count.missed = stream.count.missed.saturating_add(missed),
            Place::Late => stream.count.late += 1,
            Place::Repeated => stream.count.repeated += 1,
        }
        place
    }

    /// Takes in when a message arrived that is new, where stamps are times.
    pub(crate) fn time(&mut self, now: Stamp, topic: Topic, header: &Header) {
        self.clocks.hear(now, topic, header);
    }

    /// Takes in what a new message says of hops and clocks, where stamps are times.
    pub(crate) fn budget(&mut self, sample: &Sample) {
        self.budget.hear(sample);
    }

    /// Counts a sample that could not be read, and says how many there were before it.
    pub(crate) fn count_unreadable(&mut self, topic: Topic) -> u64 {
        let count = &mut self.stream(topic).count;
        count.unreadable += 1;
        count.unreadable - 1
    }

    /// Counts part of a journal.
    pub(crate) fn count_journal(&mut self, part: &JournalPart) {
        let journal = self
            .journals
            .entry(part.node)
            .or_insert_with(|| Journal::new(part.node));
        journal.add(part);
    }

    /// The counts now.
    pub(crate) fn counts(&self) -> Counts {
        Counts {
            streams: self.streams.values().map(|stream| stream.count).collect(),
            journals: self.journals.values().map(Journal::count).collect(),
            gaps: self.gaps().collect(),
            gaps_forgotten: self.gaps_forgotten(),
            clocks: self.clocks.offsets(),
            offsets: self.budget.offsets(),
            hops: self.budget.hops(),
        }
    }

    fn gaps(&self) -> impl Iterator<Item = Gap> + '_ {
        let of_streams = self.streams.iter().flat_map(|(topic, stream)| {
            let gaps = |run: &'_ Run| (*topic, run.session, run.gaps.clone());
            stream.runs.iter().map(gaps)
        });
        let of_journals = self.journals.values().flat_map(|journal| {
            let gaps =
                |(session, gaps): (Session, &Gaps)| (Topic::Journal(journal.count().node), session, gaps.clone());
            journal.gaps().map(gaps)
        });
        of_streams.chain(of_journals).flat_map(|(topic, session, gaps)| {
            let gap = |(first, end): (u64, u64)| Gap {
                topic,
                session,
                first,
                last: end - 1,
            };
            gaps.ranges().map(gap).collect::<Vec<_>>()
        })
    }

    fn gaps_forgotten(&self) -> u64 {
        let of_runs = |stream: &Stream| stream.runs.iter().map(|run| run.gaps.forgotten()).sum::<u64>();
        let of_streams = self.streams.values().map(|stream| stream.forgotten + of_runs(stream));
        let of_journals = self.journals.values().map(Journal::forgotten);
        of_streams.chain(of_journals).sum()
    }

    fn stream(&mut self, topic: Topic) -> &mut Stream {
        self.streams.entry(topic).or_insert_with(|| Stream {
            count: StreamCount {
                topic,
                received: 0,
                missed: 0,
                late: 0,
                repeated: 0,
                unreadable: 0,
                runs: 0,
            },
            runs: Vec::with_capacity(RUNS),
            forgotten: 0,
        })
    }
}

impl Stream {
    fn place(&mut self, header: &Header) -> Place {
        let seq = header.seq.0;
        let Some(run) = self.runs.iter_mut().find(|run| run.session == header.session) else {
            self.count.runs += 1;
            if self.runs.len() == RUNS {
                let oldest = self.runs.remove(0);
                self.forgotten += oldest.gaps.forgotten() + oldest.gaps.ranges().count() as u64;
            }
            self.runs.push(Run {
                session: header.session,
                first: seq,
                newest: seq,
                heard: 1,
                gaps: Gaps::default(),
            });
            return Place::Next;
        };
        let place = run.place(seq);
        // Before the run's first message nothing was counted as missed, so nothing is given back.
        if place == Place::Late && seq > run.first && run.newest - seq < u64::from(u64::BITS) {
            self.count.missed = self.count.missed.saturating_sub(1);
            run.gaps.fill(seq, seq + 1);
        }
        place
    }
}

impl Run {
    fn place(&mut self, seq: u64) -> Place {
        if let Some(ahead) = seq.checked_sub(self.newest).filter(|ahead| *ahead > 0) {
            let shifted = u32::try_from(ahead)
                .ok()
                .and_then(|ahead| self.heard.checked_shl(ahead));
            self.heard = shifted.unwrap_or(0) | 1;
            if ahead > 1 {
                self.gaps.add(self.newest + 1, seq);
            }
            self.newest = seq;
            return if ahead == 1 {
                Place::Next
            } else {
                Place::AfterGap(ahead - 1)
            };
        }
        let behind = self.newest - seq;
        let Some(bit) = u32::try_from(behind).ok().and_then(|behind| 1_u64.checked_shl(behind)) else {
            return Place::Late;
        };
        if self.heard & bit == 0 {
            self.heard |= bit;
            Place::Late
        } else {
            Place::Repeated
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::{Seq, Stamp};

    fn header(session: u64, seq: u64) -> Header {
        Header {
            tick: 0,
            session: Session(session),
            seq: Seq(seq),
            sent: Stamp(0),
        }
    }

    fn state_count(tally: &Tally) -> StreamCount {
        tally.counts().streams[0]
    }

    #[test]
    fn a_gap_is_missed_until_it_arrives_late() {
        let mut tally = Tally::default();
        let mut hear = |seq| tally.count(Topic::State, &header(1, seq));
        assert_eq!(hear(5), Place::Next);
        assert_eq!(hear(8), Place::AfterGap(2));
        assert_eq!(hear(6), Place::Late);
        assert_eq!(hear(6), Place::Repeated);
        assert_eq!(hear(4), Place::Late);
        let count = state_count(&tally);
        assert_eq!((count.received, count.missed, count.late, count.repeated), (5, 1, 2, 1));
        let gaps: Vec<_> = tally.gaps().map(|gap| (gap.topic, gap.first, gap.last)).collect();
        assert_eq!(gaps, [(Topic::State, 7, 7)], "and which one it is, is known");
    }

    #[test]
    fn a_restarted_sender_leaves_no_gap() {
        let mut tally = Tally::default();
        for (session, seq) in [(1, 90), (2, 1), (1, 91), (2, 2)] {
            assert_eq!(tally.count(Topic::State, &header(session, seq)), Place::Next);
        }
        assert_eq!(state_count(&tally).runs, 2);
    }
}
