//! The journal on its way out: a queue, a thread, and batches in the bulk class.

use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender, bounded};
use tandem_wire::{Happening, JournalBatch, JournalEntry, Numbering, Pace, Session, Stamp, encode};
use zenoh::Wait;
use zenoh::pubsub::Publisher;

/// Entries that may wait for the thread: ten seconds of a node at 400 entries a second.
const QUEUE: usize = 4096;
/// A batch is sent when it holds this many bytes, or when its first entry is this old.
const BATCH_BYTES: usize = 32 * 1024;
const BATCH_AGE: Duration = Duration::from_millis(50);
/// How long a closing node waits for its journal to get out.
const CLOSE_LIMIT: Duration = Duration::from_secs(2);

/// What became of a journal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct JournalReport {
    /// Entries written.
    pub entries: u64,
    /// Entries lost because the thread could not keep up.
    pub lost: u64,
}

/// The node's end of the journal. Writing never blocks in real time; in lockstep it waits rather than loses.
pub(crate) struct Journal {
    sender: Option<Sender<Item>>,
    done: Receiver<()>,
    pace: Pace,
    report: JournalReport,
}

struct Item {
    index: u64,
    entry: JournalEntry,
}

impl Journal {
    pub(crate) fn start(publisher: Publisher<'static>, session: Session, pace: Pace) -> std::io::Result<Self> {
        let (sender, receiver) = bounded(QUEUE);
        let (finished, done) = bounded(1);
        std::thread::Builder::new().name("journal".into()).spawn(move || {
            forward(&receiver, &publisher, session);
            // Nobody may be waiting any more.
            let _ = finished.send(());
        })?;
        Ok(Self {
            sender: Some(sender),
            done,
            pace,
            report: JournalReport::default(),
        })
    }

    pub(crate) fn write(&mut self, at: Stamp, wall: Stamp, what: Happening) {
        let Some(sender) = &self.sender else { return };
        let item = Item {
            index: self.report.entries,
            entry: JournalEntry { at, wall, what },
        };
        let sent = match self.pace {
            Pace::Lockstep => sender.send(item).is_ok(),
            Pace::Real => sender.try_send(item).is_ok(),
        };
        self.report.entries += 1;
        self.report.lost += u64::from(!sent);
    }

    /// Sends what is left, waiting no longer than [`CLOSE_LIMIT`].
    pub(crate) fn close(mut self) -> JournalReport {
        self.sender = None;
        // A thread that is still stuck in Zenoh after the limit is left behind.
        let _ = self.done.recv_timeout(CLOSE_LIMIT);
        self.report
    }
}

fn forward(receiver: &Receiver<Item>, publisher: &Publisher<'static>, session: Session) {
    let mut numbering = Numbering::new(session);
    let mut expected = 0;
    let mut held = None;
    let mut bytes = Vec::new();
    while let Some(first) = held.take().or_else(|| receiver.recv().ok()) {
        let at = first.entry.at;
        let mut batch = JournalBatch {
            first: first.index,
            lost: first.index - expected,
            entries: vec![first.entry],
        };
        held = fill(&mut batch, receiver);
        expected = batch.first + batch.entries.len() as u64;
        encode(&numbering.envelope(at, 0, batch), &mut bytes);
        // A session that is gone takes the journal's tail with it; the recorder sees the gap.
        let _ = publisher.put(bytes.as_slice()).wait();
    }
}

/// Adds what arrives until the batch is full or old. A gap ends the batch too: the entry behind it is handed back.
fn fill(batch: &mut JournalBatch, receiver: &Receiver<Item>) -> Option<Item> {
    let ready = Instant::now() + BATCH_AGE;
    let mut size: usize = batch.entries.iter().map(entry_bytes).sum();
    while size < BATCH_BYTES {
        let item = receiver.recv_deadline(ready).ok()?;
        if item.index != batch.first + batch.entries.len() as u64 {
            return Some(item);
        }
        size += entry_bytes(&item.entry);
        batch.entries.push(item.entry);
    }
    None
}

fn entry_bytes(entry: &JournalEntry) -> usize {
    match &entry.what {
        Happening::Sample { bytes, .. } | Happening::Output { bytes, .. } | Happening::Snapshot { bytes } => {
            40 + bytes.len()
        }
        Happening::Wake | Happening::Presence { .. } | Happening::Stop | Happening::Missed { .. } => 24,
    }
}
