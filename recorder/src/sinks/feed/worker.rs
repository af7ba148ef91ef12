//! The thread's side of a sink: takes what waits, flushes by the clock, and counts what a failed sink misses.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use crossbeam_channel::{Receiver, select, tick};

use super::{Line, Sink, weight_bytes};
use crate::heard::Heard;
use crate::sinks::Notice;

pub(super) struct Worker {
    pub(super) line: Arc<Line>,
    pub(super) items: Receiver<Arc<Heard>>,
    pub(super) flush: Duration,
    /// The sink has failed: what still comes is only counted.
    pub(super) is_broken: bool,
}

impl Worker {
    pub(super) fn run<S: Sink>(mut self, mut sink: S) {
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
