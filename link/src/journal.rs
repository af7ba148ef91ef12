//! The journal on its way out: a queue, a thread, and batches into the spool and over the network in the bulk class.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::Thread;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender, TryRecvError, bounded};
use tandem_wire::{
    Happening, JournalBatch, JournalEntry, Message as _, NodeName, Numbering, Pace, Stamp, Topic, encode,
};
use zenoh::Wait;
use zenoh::pubsub::Publisher;
use zenoh::query::Queryable;

use crate::answer::answer_journal;
use crate::faults::Faults;
use crate::net::{Link, LinkError};
use crate::running::ShellOptions;
use crate::spool::{ANSWER_BYTES, LINGER, Spool};

/// Entries that may wait for the thread: ten seconds of a node at 400 entries a second.
const QUEUE: usize = 4096;
/// A batch holds this many bytes at most, or one longer entry, and its first entry is about this old.
const BATCH_BYTES: usize = 32 * 1024;
/// An entry of more bytes is lost: no batch with it could be read again, nor any answer across it. Twice the longest
/// message that a node of the loop hears.
const ENTRY_BYTES: usize = JournalBatch::MAX_BYTES / 2;
/// What stands before the entries of a batch, and more.
const AROUND_BYTES: usize = 64;
const _: () = assert!(
    ANSWER_BYTES + (ENTRY_BYTES + AROUND_BYTES) as u64 <= JournalBatch::MAX_BYTES as u64,
    "an answer can be read, whatever its last batch is"
);
/// The thread sleeps for so long between batches, so that no entry costs its node a wake-up unless the queue is half full.
/// It is what a killed process loses, far below the second that is promised.
const BATCH_AGE: Duration = Duration::from_millis(200);
/// How long a closing node waits for its journal to get out.
const CLOSE_LIMIT: Duration = Duration::from_secs(2);
/// How often a closing node says how far its journal goes.
const REPEAT: Duration = Duration::from_millis(100);

/// What became of a journal.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JournalReport {
    /// Entries written.
    pub entries: u64,
    /// Entries lost because the thread could not keep up, or because they were far too long.
    pub lost: u64,
    /// Whether the disk failed; from then on the journal was only sent.
    pub disk_failed: bool,
    /// Where it is kept, because a recorder was there and did not take all of it.
    pub kept: Option<PathBuf>,
}

/// The node's end of the journal. Writing never blocks in real time; in lockstep it waits rather than loses.
pub(crate) struct Journal {
    sender: Option<Sender<Item>>,
    carrier: Thread,
    done: Receiver<()>,
    pace: Pace,
    report: JournalReport,
    shared: Arc<Shared>,
    spool: Option<Arc<Mutex<Spool>>>,
    _answers: Option<Queryable<()>>,
}

struct Item {
    index: u64,
    entry: JournalEntry,
}

/// What the node's thread and the journal's tell each other.
#[derive(Default)]
struct Shared {
    /// Whether to wait, at the end, for a recorder that has everything.
    linger: AtomicBool,
    taken: AtomicBool,
    disk_failed: AtomicBool,
}

impl Journal {
    pub(crate) fn start(link: &Link, node: NodeName, options: &ShellOptions) -> Result<Self, LinkError> {
        let (pace, session) = (options.timing.pace, options.info.session);
        let topic = Topic::Journal(node);
        let publisher = link.publisher(topic, pace)?;
        let spool = open_spool(node, options)?;
        let (heard, asked) = bounded(QUEUE);
        let answers = match &spool {
            Some(spool) => Some(answer_journal(link, node, session, Arc::clone(spool), heard)?),
            None => None,
        };
        let (sender, receiver) = bounded(QUEUE);
        let (finished, done) = bounded(1);
        let shared = Arc::new(Shared::default());
        let mut carrier = Carrier {
            publisher,
            numbering: Numbering::new(session),
            spool: spool.clone(),
            shared: Arc::clone(&shared),
            asked,
            faults: options.faults,
            bytes: Vec::new(),
            batches: 0,
        };
        let carry = move || {
            let end = carrier.forward(&receiver);
            carrier.linger(end);
            // Nobody may be waiting any more.
            let _ = finished.send(());
        };
        let thread = std::thread::Builder::new().name("journal".into()).spawn(carry);
        let thread = thread.map_err(|error| LinkError::Declare {
            key: topic.key(&link.robot),
            reason: error.to_string(),
        })?;
        Ok(Self {
            sender: Some(sender),
            carrier: thread.thread().clone(),
            done,
            pace,
            report: JournalReport::default(),
            shared,
            spool,
            _answers: answers,
        })
    }

    pub(crate) fn write(&mut self, at: Stamp, wall: Stamp, what: Happening) {
        let Some(sender) = &self.sender else { return };
        let item = Item {
            index: self.report.entries,
            entry: JournalEntry { at, wall, what },
        };
        let sent = match self.pace {
            _ if entry_bytes(&item.entry) > ENTRY_BYTES => false,
            Pace::Lockstep => sender.send(item).is_ok(),
            Pace::Real => sender.try_send(item).is_ok(),
        };
        // Once, not with each entry from then on.
        if sender.len() == QUEUE / 2 {
            self.carrier.unpark();
        }
        self.report.entries += 1;
        self.report.lost += u64::from(!sent);
    }

    /// Sends what is left, and waits, within limits, until a recorder has all of it. Where there never was one
    /// (`recorded` is false), nobody wants what is kept.
    pub(crate) fn close(mut self, recorded: bool, recorder_there: bool) -> JournalReport {
        let linger = recorder_there && self.spool.is_some();
        self.shared.linger.store(linger, Ordering::Release);
        self.sender = None;
        self.carrier.unpark();
        // A thread that is still stuck in Zenoh after the limit is left behind.
        let _ = self.done.recv_timeout(CLOSE_LIMIT + Duration::from_nanos(LINGER));
        let taken = self.shared.taken.load(Ordering::Acquire);
        self.report.disk_failed = self.shared.disk_failed.load(Ordering::Acquire);
        if let Some(mut spool) = self.spool.as_ref().and_then(|spool| spool.lock().ok()) {
            if taken || !recorded {
                spool.remove();
            } else {
                self.report.kept = Some(spool.folder().to_owned());
            }
        }
        self.report
    }
}

fn open_spool(node: NodeName, options: &ShellOptions) -> Result<Option<Arc<Mutex<Spool>>>, LinkError> {
    if options.spool.limit_bytes == 0 {
        return Ok(None);
    }
    let refused = |source| LinkError::Spool {
        folder: options.spool.folder.clone(),
        source,
    };
    let spool = Spool::create(&options.spool, node, options.info.session).map_err(refused)?;
    Ok(Some(Arc::new(Mutex::new(spool))))
}

/// The journal's thread.
struct Carrier {
    publisher: Publisher<'static>,
    numbering: Numbering,
    spool: Option<Arc<Mutex<Spool>>>,
    shared: Arc<Shared>,
    asked: Receiver<u64>,
    faults: Faults,
    bytes: Vec<u8>,
    batches: u32,
}

impl Carrier {
    /// Carries entries until the node's end is dropped; the index behind the last one.
    fn forward(&mut self, receiver: &Receiver<Item>) -> u64 {
        let mut expected = 0;
        let mut held = None;
        while let Some(first) = held.take().or_else(|| Self::next(receiver)) {
            let at = first.entry.at;
            let mut batch = JournalBatch {
                first: first.index,
                lost: first.index - expected,
                entries: vec![first.entry],
            };
            held = fill(&mut batch, receiver);
            expected = batch.first + batch.entries.len() as u64;
            self.carry(at, batch);
        }
        expected
    }

    /// The next entry, once some have gathered; `None` after the node's end.
    fn next(receiver: &Receiver<Item>) -> Option<Item> {
        loop {
            match receiver.try_recv() {
                Ok(item) => return Some(item),
                Err(TryRecvError::Disconnected) => return None,
                Err(TryRecvError::Empty) => std::thread::park_timeout(BATCH_AGE),
            }
        }
    }

    /// Onto the disk first: what a recorder misses it can ask for from then on.
    fn carry(&mut self, at: Stamp, batch: JournalBatch) {
        let message = self.numbering.envelope(at, 0, batch);
        encode(&message, &mut self.bytes);
        if let Some(mut spool) = self.spool.as_ref().and_then(|spool| spool.lock().ok())
            && !self.shared.disk_failed.load(Ordering::Relaxed)
            && spool.keep(&message.body, &self.bytes).is_err()
        {
            self.shared.disk_failed.store(true, Ordering::Release);
        }
        self.batches = self.batches.wrapping_add(1);
        if !self.faults.loses_batch(self.batches) {
            // A session that is gone takes the journal's tail with it; the recorder sees the gap.
            let _ = self.publisher.put(self.bytes.as_slice()).wait();
        }
    }

    /// Says again and again how far the journal goes, with a batch without entries, until somebody asks for what lies
    /// behind it: that recorder has everything.
    fn linger(&mut self, end: u64) {
        if !self.shared.linger.load(Ordering::Acquire) {
            return;
        }
        let until = Instant::now() + Duration::from_nanos(LINGER);
        while Instant::now() < until {
            let mark = JournalBatch {
                first: end,
                ..JournalBatch::default()
            };
            encode(&self.numbering.envelope(Stamp(0), 0, mark), &mut self.bytes);
            // As above.
            let _ = self.publisher.put(self.bytes.as_slice()).wait();
            let repeat = (Instant::now() + REPEAT).min(until);
            while let Ok(first) = self.asked.recv_deadline(repeat) {
                if first >= end {
                    self.shared.taken.store(true, Ordering::Release);
                    return;
                }
            }
        }
    }
}

/// Adds what waits until the batch is full. The entry that has no room any more is handed back, and so is one behind a
/// gap.
fn fill(batch: &mut JournalBatch, receiver: &Receiver<Item>) -> Option<Item> {
    let mut size: usize = batch.entries.iter().map(entry_bytes).sum();
    loop {
        let item = receiver.try_recv().ok()?;
        size += entry_bytes(&item.entry);
        if size > BATCH_BYTES || item.index != batch.first + batch.entries.len() as u64 {
            return Some(item);
        }
        batch.entries.push(item.entry);
    }
}

/// At least as many bytes as it takes in a batch.
const fn entry_bytes(entry: &JournalEntry) -> usize {
    match &entry.what {
        Happening::Sample { bytes, .. } | Happening::Output { bytes, .. } | Happening::Snapshot { bytes } => {
            40 + bytes.len()
        }
        Happening::Wake | Happening::Presence { .. } | Happening::Stop | Happening::Missed { .. } => 32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spool::SpoolOptions;
    use tandem_wire::{Session, decode};

    fn item(index: u64, length: usize) -> Item {
        let entry = JournalEntry {
            at: Stamp(index),
            wall: Stamp(0),
            what: Happening::Snapshot {
                bytes: vec![7; length - 40],
            },
        };
        Item { index, entry }
    }

    /// The batches that are made of entries of these lengths, all of which wait.
    fn batches(lengths: &[usize]) -> Vec<JournalBatch> {
        let (sender, receiver) = bounded(lengths.len());
        for (&length, index) in lengths.iter().zip(0..) {
            sender.try_send(item(index, length)).expect("room for all");
        }
        let (mut batches, mut held) = (Vec::new(), None);
        while let Some(Item { index, entry }) = held.take().or_else(|| receiver.try_recv().ok()) {
            let mut batch = JournalBatch {
                first: index,
                lost: 0,
                entries: vec![entry],
            };
            held = fill(&mut batch, &receiver);
            batches.push(batch);
        }
        batches
    }

    #[test]
    fn a_batch_is_full_before_it_is_too_long_and_only_a_longer_entry_has_one_for_itself() {
        let made = batches(&[BATCH_BYTES / 2, BATCH_BYTES / 2, 40, ENTRY_BYTES, ENTRY_BYTES, 50]);
        let shape: Vec<_> = made.iter().map(|batch| (batch.first, batch.entries.len())).collect();
        assert_eq!(shape, [(0, 2), (2, 1), (3, 1), (4, 1), (5, 1)]);
    }

    #[test]
    fn an_entry_that_no_batch_could_hold_is_lost_and_counted() {
        let (sender, receiver) = bounded(2);
        let mut journal = Journal {
            sender: Some(sender),
            carrier: std::thread::current(),
            done: bounded(1).1,
            pace: Pace::Lockstep,
            report: JournalReport::default(),
            shared: Arc::default(),
            spool: None,
            _answers: None,
        };
        for length in [JournalBatch::MAX_BYTES + 1, 1] {
            let bytes = vec![0; length];
            journal.write(Stamp(0), Stamp(0), Happening::Snapshot { bytes });
        }
        assert_eq!((journal.report.entries, journal.report.lost), (2, 1));
        let indices: Vec<_> = receiver.try_iter().map(|item| item.index).collect();
        assert_eq!(indices, [1], "the gap shows");
    }

    #[test]
    fn whatever_is_kept_can_be_given_out_and_read_again() {
        let folder = tempfile::tempdir().expect("a folder");
        let options = SpoolOptions {
            folder: folder.path().join("journals"),
            limit_bytes: 64 << 20,
        };
        let mut spool = Spool::create(&options, NodeName::Arbiter, Session(3)).expect("a file");
        let mut numbering = Numbering::new(Session(3));
        let mut bytes = Vec::new();
        // Just too short for an answer, and then the longest.
        let short = usize::try_from(ANSWER_BYTES).expect("a small number") / BATCH_BYTES - 1;
        let lengths: Vec<_> = [BATCH_BYTES]
            .repeat(short)
            .into_iter()
            .chain([ENTRY_BYTES; 2])
            .collect();
        for batch in batches(&lengths) {
            encode(&numbering.envelope(Stamp(0), 0, batch.clone()), &mut bytes);
            spool.keep(&batch, &bytes).expect("room on the disk");
        }
        let mut next = 0;
        while next < lengths.len() as u64 {
            let answer = spool.answer(next, u64::MAX).expect("its own parts can be read");
            next = answer.first + answer.entries.len() as u64;
            encode(&numbering.envelope(Stamp(0), 0, answer), &mut bytes);
            decode::<JournalBatch>(&bytes).expect("whoever asked can read it");
        }
    }
}
