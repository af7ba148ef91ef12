//! A sink behind a bounded queue, on a thread that nobody has to wait for.

mod ending;
mod sink;
mod worker;

#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};

use super::shared::{Kind, Shared};
use super::{Notice, OpenError};
use crate::heard::{Entry, Heard};
use ending::Ending;
pub(super) use sink::Sink;
use worker::Worker;

/// How much may wait for a sink, and how long what it took may lie unflushed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    pub(super) messages: usize,
    pub(super) bytes: usize,
    pub(super) flush: Duration,
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

pub(super) fn weight_bytes(heard: &Heard) -> usize {
    match &heard.entry {
        Entry::Sample(sample) => sample.weight_bytes(),
        Entry::Note(_) | Entry::Counts(_) => size_of::<Heard>(),
    }
}
