//! A sink behind a bounded queue, on a thread that nobody has to wait for.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender, TryRecvError, bounded, select, tick};

use super::{Drops, Ended, Notice, OpenError};
use crate::heard::{Entry, Heard};

/// Something that takes what was heard. It may fail, and it may block: it has a thread of its own.
pub(super) trait Sink: Send + 'static {
    /// Called once, on the sink's own thread.
    fn begin(&mut self) -> Result<(), Notice> {
        Ok(())
    }

    /// Takes one thing; `drops` so far go with the counts.
    fn take(&mut self, heard: &Arc<Heard>, drops: Drops) -> Result<(), Notice>;

    /// Puts everything taken so far beyond the reach of a crash. Also called when there is nothing new.
    fn flush(&mut self) -> Result<(), Notice>;

    /// Ends the sink in good order, after failures too.
    fn close(self) -> Result<(), Notice>;
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
    session_file: AtomicU64,
    views: AtomicU64,
    tell: Sender<Notice>,
}

impl Shared {
    pub(super) fn new(tell: Sender<Notice>) -> Self {
        Self {
            session_file: AtomicU64::new(0),
            views: AtomicU64::new(0),
            tell,
        }
    }

    pub(super) fn drops(&self) -> Drops {
        Drops {
            session_file: self.session_file.load(Ordering::Relaxed),
            views: self.views.load(Ordering::Relaxed),
        }
    }

    pub(super) fn count_drops(&self, kind: Kind, number: u64) {
        let counter = match kind {
            Kind::SessionFile => &self.session_file,
            Kind::View => &self.views,
        };
        counter.fetch_add(number, Ordering::Relaxed);
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
    fn drop_one(&self) {
        self.dropped.fetch_add(1, Ordering::Relaxed);
        self.shared.count_drops(self.kind, 1);
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
        if has_room && self.queue.try_send(heard).is_ok() {
            return;
        }
        self.line.waiting_bytes.fetch_sub(weight, Ordering::Relaxed);
        self.line.drop_one();
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
    /// Waits until the sink has ended or `until` comes.
    pub(super) fn wait(self, until: &Receiver<Instant>) -> Ended {
        let in_time = match self.ended.try_recv() {
            Ok(()) => true,
            Err(TryRecvError::Disconnected) => false,
            Err(TryRecvError::Empty) => select! {
                recv(self.ended) -> end => end.is_ok(),
                recv(until) -> _ => false,
            },
        };
        Ended {
            sink: self.name.to_owned(),
            path: self.path,
            messages: in_time.then(|| self.line.taken.load(Ordering::Relaxed)),
            dropped: self.line.dropped.load(Ordering::Relaxed),
        }
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
    }

    fn take<S: Sink>(&mut self, sink: &mut S, heard: &Arc<Heard>) {
        self.line
            .waiting_bytes
            .fetch_sub(weight_bytes(heard), Ordering::Relaxed);
        if !self.is_broken {
            let taken = sink.take(heard, self.line.shared.drops());
            self.note(taken);
        }
        if self.is_broken {
            self.line.drop_one();
        } else {
            self.line.taken.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn note(&mut self, result: Result<(), Notice>) {
        if let Err(notice) = result {
            self.is_broken = true;
            self.line.shared.say(notice);
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
        fn take(&mut self, _: &Arc<Heard>, _: Drops) -> Result<(), Notice> {
            self.go.recv().ok();
            let sink = "the fake".to_owned();
            let why = "it was told to".to_owned();
            if self.fails {
                Err(Notice::Failed { sink, why })
            } else {
                Ok(())
            }
        }

        fn flush(&mut self) -> Result<(), Notice> {
            Ok(())
        }

        fn close(self) -> Result<(), Notice> {
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
        let drops = shared.drops().views;
        assert_eq!(feed.room(), 0);
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
        let ended = feed.end().wait(&never());
        assert_eq!(ended.messages, Some(100 - drops));
        assert_eq!(ended.dropped, drops);
    }

    #[test]
    fn a_sink_that_never_ends_is_left_behind() {
        let (mut feed, _allow, _, _told) = start(false);
        feed.offer(heard());
        let now = crossbeam_channel::after(Duration::ZERO);
        assert_eq!(feed.end().wait(&now).messages, None);
    }

    #[test]
    fn a_sink_that_fails_says_so_once_and_counts_the_rest() {
        let (mut feed, allow, shared, told) = start(true);
        for _ in 0..3 {
            allow.send(()).unwrap();
            feed.offer(heard());
        }
        let ended = feed.end().wait(&never());
        assert_eq!((ended.messages, ended.dropped, shared.drops().views), (Some(0), 3, 3));
        assert_eq!(told.try_iter().count(), 1);
    }

    #[test]
    fn memory_bounds_the_queue_as_well() {
        let (mut feed, _allow, shared, _told) = start(false);
        feed.limits.bytes = 1;
        feed.line.waiting_bytes.store(1, Ordering::Relaxed);
        feed.offer(heard());
        assert_eq!(shared.drops().views, 1);
    }
}
