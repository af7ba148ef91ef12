//! What is done with one input, in either pace: journal, step, publish, journal.

use tandem_wire::{Delivery, Happening, Input, Nanos, Node, NodeName, Outbox, Ports, SECOND, Stamp, Topic, snapshot};
use zenoh::Wait;
use zenoh::pubsub::Publisher;

use crate::Clock;
use crate::answer::Asker;
use crate::impairment::Impairment;
use crate::journal::Journal;
use crate::running::{Item, Report, ShellOptions};

/// A journal holds a snapshot of its node at least this often, by the node's own time: what a recorder that came late, or
/// a gap, can cost an execution of the session.
const SNAPSHOT_EVERY: Nanos = 10 * SECOND;

/// A node, and all that it must not know.
pub(crate) struct Shell<N: Node, F> {
    pub(crate) node: N,
    pub(crate) line: Impairment,
    pub(crate) options: ShellOptions,
    pub(crate) clock: Clock,
    pub(crate) now: Stamp,
    /// Inputs that were taken up too late to be of use.
    pub(crate) late: u64,
    pub(crate) voice: Voice<F>,
    outbox: Outbox<N::Output>,
    steps: u64,
    /// The trial at the last snapshot, and when the next one is due at the latest.
    trial: u32,
    next_snapshot: Stamp,
    recorder: Recorded,
    /// Items taken up.
    items: u64,
}

/// Where a node's outputs go.
pub(crate) struct Voice<F> {
    pub(crate) publishers: Vec<(Topic, Publisher<'static>)>,
    pub(crate) journal: Option<Journal>,
    pub(crate) asker: Asker,
    pub(crate) local: F,
    /// Whether anything was said that somebody may owe an answer to.
    pub(crate) spoke: bool,
    pub(crate) bytes: Vec<u8>,
}

/// Whether a recorder listens, and ever did.
#[derive(Clone, Copy, Debug, Default)]
struct Recorded {
    ever: bool,
    there: bool,
}

impl<N: Ports, F: FnMut(Stamp, N::Output)> Shell<N, F> {
    pub(crate) fn new(node: N, options: ShellOptions, voice: Voice<F>) -> Self {
        Self {
            node,
            line: Impairment::new(&options.impairment, N::NAME, options.timing),
            options,
            clock: Clock::of_process(),
            now: Stamp(0),
            late: 0,
            voice,
            outbox: Outbox::default(),
            steps: 0,
            trial: 0,
            next_snapshot: Stamp(0),
            recorder: Recorded::default(),
            items: 0,
        }
    }

    /// Whether an item is lost on purpose; notes what the shell itself wants to know of the others.
    pub(crate) fn loses(&mut self, item: &Item) -> bool {
        self.items = self.items.wrapping_add(1);
        if self.options.faults.loses_sample(self.items, item) {
            return true;
        }
        if let Item::Presence {
            peer: NodeName::Recorder,
            alive,
        } = item
        {
            self.recorder = Recorded {
                ever: true,
                there: *alive,
            };
        }
        false
    }

    /// The node takes in an input at `now`, which is `wall` on the process's clock; what it answers goes out.
    pub(crate) fn step(&mut self, now: Stamp, wall: Stamp, input: Input<'_>) {
        self.now = now;
        if let Some(journal) = &mut self.voice.journal {
            journal.write(now, wall, Happening::from(input));
        }
        self.node.step(now, N::event(input), &mut self.outbox);
        self.steps += 1;
        for output in self.outbox.drain() {
            self.voice.say::<N>(now, self.clock, output);
        }
        self.keep_snapshot();
    }

    /// Writes into the journal what the node carries on: at the start, where a trial begins, and now and then. Between
    /// these instants nothing is allocated for it.
    pub(crate) fn keep_snapshot(&mut self) {
        let Some(journal) = &mut self.voice.journal else { return };
        let before = std::mem::replace(&mut self.trial, self.node.trial());
        let begun = self.trial != 0 && self.trial != before;
        if !begun && self.now < self.next_snapshot {
            return;
        }
        self.next_snapshot = self.now.after(SNAPSHOT_EVERY);
        let mut bytes = Vec::new();
        snapshot(&mut self.node, &mut bytes);
        journal.write(self.now, self.clock.now(), Happening::Snapshot { bytes });
    }

    pub(crate) fn end(self, awaited: Option<NodeName>) -> Report {
        let Recorded { ever, there } = self.recorder;
        let journal = self.voice.journal.map(|journal| journal.close(ever, there));
        Report {
            steps: self.steps,
            dropped: self.late,
            journal: journal.unwrap_or_default(),
            awaited,
        }
    }
}

impl<F> Voice<F> {
    fn say<N>(&mut self, now: Stamp, clock: Clock, output: N::Output)
    where
        N: Ports,
        F: FnMut(Stamp, N::Output),
    {
        if let Some(topic) = N::sample(&output, &mut self.bytes) {
            // Nobody owes an answer to what is only for the record.
            self.spoke |= topic.delivery() != Delivery::Bulk;
            // Publish first: nothing that is only for the record may delay the robot. The clock is read before,
            // for a latency that begins when publishing ends would be too short.
            let wall = clock.now();
            if let Some((_, publisher)) = self.publishers.iter().find(|(name, _)| *name == topic) {
                // A closed session is noticed by everyone's timeouts.
                let _ = publisher.put(self.bytes.as_slice()).wait();
            }
            if let Some(journal) = &mut self.journal {
                let bytes = self.bytes.clone();
                journal.write(now, wall, Happening::Output { topic, bytes });
            }
        }
        if let Some(question) = N::question(&output) {
            self.asker.ask(question);
        }
        (self.local)(now, output);
    }
}
