//! A sink behind a bounded queue, on a thread that nobody has to wait for.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender, TryRecvError, TrySendError, bounded, select, tick};

use tandem_wire::{Condition, Topic};

use super::drops::{Counter, Drops, Lost};
use super::{Ended, Notice, OpenError};
use crate::heard::{Entry, Heard};

/// Something that takes what was heard. It may fail, and it may block: it has a thread of its own.
pub(super) trait Sink: Send + 'static {
    /// Called once, on the sink's own thread.
    fn begin(&mut self) -> Result<(), Notice> {
        Ok(())
    }

    /// Takes one thing, and says whether it is kept. One that is not counts as dropped; an error ends the sink.
    fn take(&mut self, heard: &Arc<Heard>) -> Result<bool, Notice>;

    /// Puts everything taken so far beyond the reach of a crash. Also called when there is nothing new.
    fn flush(&mut self) -> Result<(), Notice>;

    /// Ends the sink in good order, after failures too.
    fn close(&mut self) -> Result<(), Notice>;

    /// How many things, taken and said to be kept, turned out to be lost.
    fn lost_later(&self) -> u64 {
        0
    }
}

/// Which of the two drop counters a sink counts into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    SessionFile,
    View,
}

/// How much may wait for a sink, and how long what it took may lie unflushed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    pub(super) messages: usize,
    pub(super) bytes: usize,
    pub(super) flush: Duration,
}

/// What all sinks share.
#[derive(Debug)]
pub(super) struct Shared {
    session_file: Counter,
    views: Counter,
    /// What the session file says of itself; see [`Condition`].
    condition: AtomicU8,
    tell: Sender<Notice>,
}

const CONDITIONS: [Condition; 3] = [Condition::Kept, Condition::NoSpace, Condition::Failing];

impl Shared {
    pub(super) fn new(tell: Sender<Notice>) -> Self {
        Self {
            session_file: Counter::default(),
            views: Counter::default(),
            condition: AtomicU8::new(0),
            tell,
        }
    }

    pub(super) fn drops(&self) -> Drops {
        Drops {
            session_file: self.session_file.lost(),
            views: self.views.lost(),
        }
    }

    /// The drops so far, for what goes with them; counting them up for every message would cost more than the message.
    pub(super) fn drops_for(&self, heard: &Heard) -> Drops {
        match &heard.entry {
            Entry::Counts(_) => self.drops(),
            Entry::Sample(_) | Entry::Note(_) => Drops::default(),
        }
    }

    fn drop_one(&self, kind: Kind, heard: &Heard) {
        match kind {
            Kind::SessionFile => self.session_file.count(heard),
            Kind::View => self.views.count(heard),
        }
    }

    /// Counts what a viewer missed.
    pub(super) fn miss(&self, number: u64) {
        self.views.count_untold(number);
    }

    /// Counts what was lost before any sink.
    pub(super) fn lose_before(&self, kind: Kind, topic: Topic, number: u64) {
        match kind {
            Kind::SessionFile => self.session_file.count_topic(topic, number),
            Kind::View => self.views.count_topic(topic, number),
        }
    }

    /// Counts what seemed to be in the session file and is not.
    pub(super) fn lose(&self, lost: &Lost) {
        self.session_file.count_all(lost);
    }

    pub(super) fn set_condition(&self, condition: Condition) {
        let known = CONDITIONS.iter().position(|known| *known == condition);
        let place = known.and_then(|place| u8::try_from(place).ok()).unwrap_or(0);
        self.condition.store(place, Ordering::Relaxed);
    }

    pub(super) fn condition(&self) -> Condition {
        let place = usize::from(self.condition.load(Ordering::Relaxed));
        CONDITIONS.get(place).copied().unwrap_or_default()
    }

    pub(super) fn say(&self, notice: Notice) {
        // A queue of notices that nobody reads is no reason to wait either.
        self.tell.try_send(notice).ok();
    }
}

/// What the feeding side and the thread have in common.
struct Line {
    kind: Kind,
    waiting_bytes: AtomicUsize,
    dropped: AtomicU64,
    taken: AtomicU64,
    shared: Arc<Shared>,
}

impl Line {
    fn drop_one(&self, heard: &Heard) {
        self.dropped.fetch_add(1, Ordering::Relaxed);
        self.shared.drop_one(self.kind, heard);
    }
}

/// The feeding side of a sink.
pub(super) struct Feed {
    name: &'static str,
    path: Option<PathBuf>,
    limits: Limits,
    line: Arc<Line>,
    queue: Sender<Arc<Heard>>,
    ended: Receiver<()>,
    is_behind: bool,
}

/// A sink that was told to end.
pub(super) struct Ending {
    name: &'static str,
    path: Option<PathBuf>,
    line: Arc<Line>,
    ended: Receiver<()>,
}

impl Feed {
    pub(super) fn start<S: Sink>(
        name: &'static str,
        path: Option<PathBuf>,
        kind: Kind,
        limits: Limits,
        shared: &Arc<Shared>,
        sink: S,
    ) -> Result<Self, OpenError> {
        let (queue, items) = bounded(limits.messages);
        let (end, ended) = bounded(1);
        let line = Arc::new(Line {
            kind,
            waiting_bytes: AtomicUsize::new(0),
            dropped: AtomicU64::new(0),
            taken: AtomicU64::new(0),
            shared: Arc::clone(shared),
        });
        let worker = Worker {
            line: Arc::clone(&line),
            items,
            flush: limits.flush,
            is_broken: false,
        };
        thread::Builder::new()
            .name(format!("recorder: {name}"))
            .spawn(move || {
                worker.run(sink);
                end.try_send(()).ok();
            })
            .map_err(|source| OpenError::Thread { source })?;
        Ok(Self {
            name,
            path,
            limits,
            line,
            queue,
            ended,
            is_behind: false,
        })
    }

    /// Passes it on if there is room; else drops it, counts it, and says so the first time.
    pub(super) fn offer(&mut self, heard: Arc<Heard>) {
        let weight = weight_bytes(&heard);
        let waiting = self.line.waiting_bytes.fetch_add(weight, Ordering::Relaxed);
        let has_room = waiting == 0 || waiting.saturating_add(weight) <= self.limits.bytes;
        let refused = if has_room {
            self.queue.try_send(heard).err().map(TrySendError::into_inner)
        } else {
            Some(heard)
        };
        let Some(heard) = refused else { return };
        self.line.waiting_bytes.fetch_sub(weight, Ordering::Relaxed);
        self.line.drop_one(&heard);
        if !self.is_behind {
            self.is_behind = true;
            self.line.shared.say(Notice::Behind {
                sink: self.name.to_owned(),
            });
        }
    }

    /// How many it can still take; none while the queue's memory is half used.
    pub(super) fn room(&self) -> usize {
        let waiting = self.line.waiting_bytes.load(Ordering::Relaxed);
        let free = self.limits.messages.saturating_sub(self.queue.len());
        if waiting > self.limits.bytes / 2 { 0 } else { free }
    }

    /// Lets the thread empty its queue and end.
    pub(super) fn end(self) -> Ending {
        Ending {
            name: self.name,
            path: self.path,
            line: self.line,
            ended: self.ended,
        }
    }
}

impl Ending {
    /// Waits until the sink has ended or `until` comes, and says whether that came.
    pub(super) fn wait(self, until: &Receiver<Instant>) -> (Ended, bool) {
        let (in_time, is_time_up) = match self.ended.try_recv() {
            Ok(()) => (true, false),
            Err(TryRecvError::Disconnected) => (false, false),
            Err(TryRecvError::Empty) => select! {
                recv(self.ended) -> end => (end.is_ok(), false),
                recv(until) -> _ => (false, true),
            },
        };
        let ended = Ended {
            sink: self.name.to_owned(),
            path: self.path,
            messages: in_time.then(|| self.line.taken.load(Ordering::Relaxed)),
            dropped: self.line.dropped.load(Ordering::Relaxed),
        };
        (ended, is_time_up)
    }
}

/// The thread's side.
struct Worker {
    line: Arc<Line>,
    items: Receiver<Arc<Heard>>,
    flush: Duration,
    /// The sink has failed: what still comes is only counted.
    is_broken: bool,
}

impl Worker {
    fn run<S: Sink>(mut self, mut sink: S) {
        let begun = sink.begin();
        self.note(begun);
        let flushes = tick(self.flush);
        loop {
            select! {
                recv(self.items) -> item => match item {
                    Ok(heard) => self.take(&mut sink, &heard),
                    Err(_) => break,
                },
                recv(flushes) -> _ => if !self.is_broken {
                    let flushed = sink.flush();
                    self.note(flushed);
                },
            }
        }
        let closed = sink.close();
        if !self.is_broken {
            self.note(closed);
        }
        let lost = sink.lost_later();
        self.line.taken.fetch_sub(lost, Ordering::Relaxed);
        self.line.dropped.fetch_add(lost, Ordering::Relaxed);
    }

    fn take<S: Sink>(&mut self, sink: &mut S, heard: &Arc<Heard>) {
        self.line
            .waiting_bytes
            .fetch_sub(weight_bytes(heard), Ordering::Relaxed);
        let taken = if self.is_broken { Ok(false) } else { sink.take(heard) };
        if self.note(taken).unwrap_or(false) {
            self.line.taken.fetch_add(1, Ordering::Relaxed);
        } else {
            self.line.drop_one(heard);
        }
    }

    fn note<T>(&mut self, result: Result<T, Notice>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(notice) => {
                self.is_broken = true;
                self.line.shared.say(notice);
                None
            }
        }
    }
}

pub(super) fn weight_bytes(heard: &Heard) -> usize {
    match &heard.entry {
        Entry::Sample(sample) => sample.weight_bytes(),
        Entry::Note(_) | Entry::Counts(_) => size_of::<Heard>(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crossbeam_channel::never;
    use tandem_wire::{NodeName, Stamp};

    use crate::heard::{Level, Note};

    /// A sink that takes nothing until it is allowed to, and fails if it is told to.
    struct Stalled {
        go: Receiver<()>,
        fails: bool,
    }

    impl Sink for Stalled {
        fn take(&mut self, _: &Arc<Heard>) -> Result<bool, Notice> {
            self.go.recv().ok();
            let sink = "the fake".to_owned();
            let why = "it was told to".to_owned();
            if self.fails {
                Err(Notice::Failed { sink, why })
            } else {
                Ok(true)
            }
        }

        fn flush(&mut self) -> Result<(), Notice> {
            Ok(())
        }

        fn close(&mut self) -> Result<(), Notice> {
            Ok(())
        }
    }

    fn heard() -> Arc<Heard> {
        let note = Note {
            level: Level::Info,
            about: NodeName::Recorder,
            text: String::new(),
        };
        Arc::new(Heard {
            at: Stamp(0),
            session_time: Stamp(0),
            tick: 0,
            entry: Entry::Note(note),
        })
    }

    fn start(fails: bool) -> (Feed, Sender<()>, Arc<Shared>, Receiver<Notice>) {
        let (allow, go) = bounded(1000);
        let (tell, told) = bounded(8);
        let shared = Arc::new(Shared::new(tell));
        let limits = Limits {
            messages: 4,
            bytes: 1 << 20,
            flush: Duration::from_secs(1),
        };
        let feed = Feed::start("the fake", None, Kind::View, limits, &shared, Stalled { go, fails }).unwrap();
        (feed, allow, shared, told)
    }

    #[test]
    fn a_stalled_sink_costs_drops_and_no_time() {
        let (mut feed, allow, shared, told) = start(false);
        // This returns at all: the sink waits for a word that comes only below.
        for _ in 0..100 {
            feed.offer(heard());
        }
        let drops = shared.drops().views.total();
        assert!(feed.room() <= 1, "the thread may take its first one this late");
        assert!(
            (95..=96).contains(&drops),
            "four wait, one may be in its hands, {drops} were dropped"
        );
        let said: Vec<_> = told.try_iter().collect();
        assert_eq!(
            said,
            [Notice::Behind {
                sink: "the fake".into()
            }],
            "once"
        );
        drop(allow);
        let (ended, _) = feed.end().wait(&never());
        assert_eq!(ended.messages, Some(100 - drops));
        assert_eq!(ended.dropped, drops);
    }

    #[test]
    fn a_sink_that_never_ends_is_left_behind() {
        let (mut feed, _allow, _, _told) = start(false);
        feed.offer(heard());
        let now = crossbeam_channel::after(Duration::ZERO);
        let (ended, is_time_up) = feed.end().wait(&now);
        assert_eq!((ended.messages, is_time_up), (None, true));
    }

    #[test]
    fn a_sink_that_fails_says_so_once_and_counts_the_rest() {
        let (mut feed, allow, shared, told) = start(true);
        for _ in 0..3 {
            allow.send(()).unwrap();
            feed.offer(heard());
        }
        let (ended, _) = feed.end().wait(&never());
        assert_eq!(
            (ended.messages, ended.dropped, shared.drops().views.total()),
            (Some(0), 3, 3)
        );
        assert_eq!(told.try_iter().count(), 1);
    }

    #[test]
    fn memory_bounds_the_queue_as_well() {
        let (mut feed, _allow, shared, _told) = start(false);
        feed.limits.bytes = 1;
        feed.line.waiting_bytes.store(1, Ordering::Relaxed);
        feed.offer(heard());
        assert_eq!(
            shared.drops().views.by_channel().collect::<Vec<_>>(),
            [("log".to_owned(), 1)]
        );
    }
}
