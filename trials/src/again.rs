//! One node following its own journal: every input stepped, every output and every snapshot compared.
//!
//! ```text
//!               first entry, or a snapshot
//!   Waiting ────────────────────────────────▶ Following ── every entry ──┐
//!      ▲                                       │    ▲───────────────────┘
//!      └───────── entries are missing ─────────┘
//! ```
//!
//! A node that is built anew is at its first entry, so a journal that is there from entry 0 needs no snapshot. One that
//! begins later, or goes on behind a gap, is taken up again at the next snapshot. Snapshots on the way are compared: a
//! difference in what a node carries on shows there before any output does.

use std::collections::VecDeque;

use tandem_wire::{
    Happening, Input, JournalBatch, JournalEntry, Nanos, Outbox, Ports, Stamp, Topic, restore, snapshot,
};

use crate::fields::{Comparison, compare};
use crate::verdict::{Difference, Divergence, Missing, Verdict};

/// What was executed of a run.
#[derive(Clone, Debug, Default)]
pub(crate) struct Ran {
    pub(crate) steps: u64,
    pub(crate) outputs: u64,
    /// Snapshots compared, and the same.
    pub(crate) snapshots: u64,
    /// Time executed, without what lies in gaps.
    pub(crate) span: Nanos,
    pub(crate) stopped: bool,
    /// The entries at which a snapshot was gone on from.
    pub(crate) resumed: Vec<u64>,
    now: Option<Stamp>,
}

/// Follows a journal entry by entry, with nodes that `build` makes.
pub(crate) fn follow<N: Ports>(
    build: impl Fn() -> Result<N, Missing>,
    journal: &[JournalBatch],
    tick: &mut dyn FnMut(u64),
) -> Result<(Verdict, Ran), Missing> {
    let mut again = Again::new(build()?);
    let mut next = 0_u64;
    for part in journal {
        for (entry, index) in part.entries.iter().zip(part.first..) {
            // A part that was sent twice holds what has been executed already.
            if index < next {
                continue;
            }
            if index > next {
                again.miss(gap(next, index, part));
            }
            if let Err(divergence) = again.take(&build, index, entry)? {
                return Ok((Verdict::Diverged(divergence), again.ran));
            }
            next = index.saturating_add(1);
        }
        // Without entries it says how far the journal went.
        if part.entries.is_empty() && part.first > next {
            again.miss(Missing::End { from: next });
        }
        tick(part.entries.len() as u64);
    }
    Ok((again.verdict(next), again.ran))
}

fn gap(next: u64, index: u64, part: &JournalBatch) -> Missing {
    if next == 0 {
        return Missing::Beginning { first: index };
    }
    Missing::Gap {
        from: next,
        to: index - 1,
        lost: part.lost.min(index - next),
    }
}

/// A node at work again.
struct Again<N: Ports> {
    /// None behind a gap, until a snapshot comes.
    node: Option<N>,
    outbox: Outbox<N::Output>,
    /// What it answered to the last input and the journal has not confirmed yet.
    unconfirmed: VecDeque<(Topic, Vec<u8>)>,
    /// The largest difference that was small enough, and where it was.
    closest: Option<(f64, String)>,
    /// What is missing first.
    missing: Option<Missing>,
    bytes: Vec<u8>,
    ran: Ran,
}

type Taken = Result<(), Box<Divergence>>;

impl<N: Ports> Again<N> {
    fn new(node: N) -> Self {
        Self {
            node: Some(node),
            outbox: Outbox::default(),
            unconfirmed: VecDeque::new(),
            closest: None,
            missing: None,
            bytes: Vec::new(),
            ran: Ran::default(),
        }
    }

    /// Entries are not there: only a snapshot can tell what the node carried past them.
    fn miss(&mut self, missing: Missing) {
        self.node = None;
        self.unconfirmed.clear();
        self.ran.now = None;
        self.missing.get_or_insert(missing);
    }

    fn take(
        &mut self,
        build: impl Fn() -> Result<N, Missing>,
        index: u64,
        entry: &JournalEntry,
    ) -> Result<Taken, Missing> {
        Ok(match &entry.what {
            Happening::Output { topic, bytes } => self.confirm(index, *topic, bytes),
            Happening::Snapshot { bytes } if self.node.is_none() => {
                self.resume(build()?, index, bytes);
                Ok(())
            }
            Happening::Snapshot { bytes } => self.compare_state(index, bytes),
            what => match what.input() {
                Some(input) => self.step(index, entry.at, input),
                None => Ok(()),
            },
        })
    }

    /// Goes on from a snapshot. One that cannot be read is passed over: a later one may do.
    fn resume(&mut self, mut node: N, index: u64, bytes: &[u8]) {
        if restore(&mut node, bytes).is_ok() {
            self.node = Some(node);
            self.ran.resumed.push(index);
        }
    }

    fn step(&mut self, index: u64, at: Stamp, input: Input<'_>) -> Taken {
        self.all_confirmed(index)?;
        let Some(node) = &mut self.node else { return Ok(()) };
        self.ran.span += self.ran.now.map_or(0, |before| at.since(before));
        self.ran.now = Some(at);
        self.ran.steps += 1;
        self.ran.stopped = input == Input::Stop;
        node.step(at, N::event(input), &mut self.outbox);
        for output in self.outbox.drain() {
            let mut bytes = Vec::new();
            if let Some(topic) = N::sample(&output, &mut bytes) {
                self.unconfirmed.push_back((topic, bytes));
            }
        }
        Ok(())
    }

    fn all_confirmed(&self, index: u64) -> Taken {
        match self.unconfirmed.front() {
            Some((topic, _)) => Err(self.divergence(index, *topic, Difference::Additional)),
            None => Ok(()),
        }
    }

    /// Compares what the node carries on with what it carried on then.
    fn compare_state(&mut self, index: u64, recorded: &[u8]) -> Taken {
        self.all_confirmed(index)?;
        let Some(node) = &mut self.node else { return Ok(()) };
        // Where numbers have come out a little differently, so have those that are carried on.
        if self.closest.is_some() {
            return Ok(());
        }
        snapshot(node, &mut self.bytes);
        if self.bytes == recorded {
            self.ran.snapshots += 1;
            return Ok(());
        }
        let same = self.bytes.iter().zip(recorded).take_while(|(now, then)| now == then);
        let difference = Difference::State {
            from: same.count(),
            recorded: recorded.len(),
            again: self.bytes.len(),
        };
        Err(self.divergence(index, Topic::Journal(N::NAME), difference))
    }

    /// Compares a recorded output with what came out now.
    fn confirm(&mut self, index: u64, topic: Topic, recorded: &[u8]) -> Taken {
        if self.node.is_none() {
            return Ok(());
        }
        let difference = match self.unconfirmed.pop_front() {
            None => Difference::Absent,
            Some((now, _)) if now != topic => Difference::Topic(now),
            Some((_, again)) if again == recorded => {
                self.ran.outputs += 1;
                return Ok(());
            }
            Some((_, again)) => match compare(topic, recorded, &again) {
                Comparison::Close { largest, path } => {
                    self.ran.outputs += 1;
                    if self.closest.as_ref().is_none_or(|(before, _)| largest > *before) {
                        self.closest = Some((largest, format!("{topic}.{path}")));
                    }
                    return Ok(());
                }
                Comparison::Differ(fields) => Difference::Fields(fields),
                Comparison::Opaque => Difference::Bytes,
            },
        };
        Err(self.divergence(index, topic, difference))
    }

    fn divergence(&self, entry: u64, topic: Topic, difference: Difference) -> Box<Divergence> {
        Box::new(Divergence {
            step: self.ran.steps,
            entry,
            at: self.ran.now.unwrap_or_default(),
            topic,
            difference,
        })
    }

    /// The verdict on a journal that ends before entry `next` and shows no divergence.
    fn verdict(&mut self, next: u64) -> Verdict {
        if let Some(missing) = self.missing.take() {
            return Verdict::Incomplete(missing);
        }
        // Answers that a killed node did not write down any more prove nothing; those of one that stopped do.
        if self.ran.stopped && !self.unconfirmed.is_empty() {
            return Verdict::Incomplete(Missing::End { from: next });
        }
        match &self.closest {
            None => Verdict::Identical,
            Some((largest, field)) => Verdict::Close {
                largest: *largest,
                field: field.clone(),
            },
        }
    }
}
