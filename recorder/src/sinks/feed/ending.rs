//! The end of a sink: its thread is waited for, up to a limit.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

use crossbeam_channel::{Receiver, TryRecvError, select};

use super::Line;
use crate::sinks::Ended;

/// A sink that was told to end.
pub(in crate::sinks) struct Ending {
    pub(super) name: &'static str,
    pub(super) path: Option<PathBuf>,
    pub(super) line: Arc<Line>,
    pub(super) ended: Receiver<()>,
}

impl Ending {
    /// Waits until the sink has ended or `until` comes, and says whether that came.
    pub(in crate::sinks) fn wait(self, until: &Receiver<Instant>) -> (Ended, bool) {
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
