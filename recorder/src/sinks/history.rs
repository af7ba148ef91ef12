//! What a viewer is shown again: the newest of what was heard, bounded in bytes, read by whoever keeps up.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tandem_wire::Trial;

use super::feed::weight_bytes;
use crate::heard::{Entry, Heard, Sample};

/// How much a reader takes at a time: enough to be quick, little enough to notice soon that it is no longer wanted.
const BATCH: usize = 64;

/// One writer that never waits for readers, and readers that each have a place of their own.
#[derive(Debug)]
pub(super) struct History {
    kept: Mutex<Kept>,
    grew: Condvar,
    limit_bytes: usize,
}

#[derive(Debug, Default)]
struct Kept {
    entries: VecDeque<Arc<Heard>>,
    /// The place of the first of them.
    first: u64,
    bytes: usize,
    /// Without these the rest would hang in the air, so they are kept after their time.
    landmarks: Landmarks,
    is_ended: bool,
}

/// The newest of each that has left the entries.
#[derive(Clone, Debug, Default)]
struct Landmarks {
    trial: Option<Arc<Heard>>,
    scene: Option<Arc<Heard>>,
    forecast: Option<Arc<Heard>>,
}

/// What a reader gets.
#[derive(Debug)]
pub(super) struct Page {
    /// In order.
    pub(super) entries: Vec<Arc<Heard>>,
    /// Where to go on.
    pub(super) next: u64,
    /// How many were gone before they were read.
    pub(super) missed: u64,
    /// Nothing more will come.
    pub(super) is_last: bool,
}

impl History {
    pub(super) fn new(limit_bytes: usize) -> Self {
        Self {
            kept: Mutex::default(),
            grew: Condvar::new(),
            limit_bytes,
        }
    }

    /// Adds one; what no longer fits is forgotten, oldest first.
    pub(super) fn push(&self, heard: Arc<Heard>) {
        let mut kept = self.lock();
        kept.bytes += weight_bytes(&heard);
        kept.entries.push_back(heard);
        while kept.bytes > self.limit_bytes && kept.entries.len() > 1 {
            kept.forget_one();
        }
        drop(kept);
        self.grew.notify_all();
    }

    /// Says that nothing more will come.
    pub(super) fn end(&self) {
        self.lock().is_ended = true;
        self.grew.notify_all();
    }

    /// What follows `place`; waits up to `limit` for it.
    pub(super) fn read(&self, place: u64, limit: Duration) -> Page {
        let kept = self.lock();
        let waits = |kept: &mut Kept| kept.next() <= place && !kept.is_ended;
        let waited = self.grew.wait_timeout_while(kept, limit, waits);
        let (kept, _) = waited.unwrap_or_else(PoisonError::into_inner);
        kept.page(place)
    }

    /// A reader that panicked leaves nothing half done here.
    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Kept {
    fn next(&self) -> u64 {
        self.first + self.entries.len() as u64
    }

    fn forget_one(&mut self) {
        let Some(heard) = self.entries.pop_front() else {
            return;
        };
        self.first += 1;
        self.bytes = self.bytes.saturating_sub(weight_bytes(&heard));
        let Entry::Sample(sample) = &heard.entry else {
            return;
        };
        match sample {
            Sample::Scene(_) => self.landmarks.scene = Some(heard),
            Sample::Forecast(_) => self.landmarks.forecast = Some(heard),
            // Its repetitions are later than the beginning.
            Sample::Trial(message)
                if matches!(message.body, Trial::Begin { .. }) && !self.landmarks.is_of(&message.body) =>
            {
                self.landmarks.forecast = None;
                self.landmarks.trial = Some(heard);
            }
            _ => {}
        }
    }

    fn page(&self, place: u64) -> Page {
        let missed = self.first.saturating_sub(place);
        let from = place.max(self.first);
        let skip = usize::try_from(from - self.first).unwrap_or(usize::MAX);
        let landmarks = if missed > 0 { self.landmarks.in_order() } else { vec![] };
        let fresh = self.entries.iter().skip(skip).take(BATCH).cloned();
        let entries: Vec<_> = landmarks.into_iter().chain(fresh).collect();
        let next = (from + BATCH as u64).min(self.next()).max(place);
        Page {
            entries,
            next,
            missed,
            is_last: self.is_ended && next >= self.next(),
        }
    }
}

impl Landmarks {
    fn is_of(&self, trial: &Trial) -> bool {
        let known = self.trial.as_ref().map(|heard| &heard.entry);
        matches!(known, Some(Entry::Sample(Sample::Trial(message))) if message.body == *trial)
    }

    fn in_order(&self) -> Vec<Arc<Heard>> {
        let all = [&self.scene, &self.trial, &self.forecast];
        let mut all: Vec<_> = all.into_iter().flatten().cloned().collect();
        all.sort_by_key(|heard| heard.at);
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::{NodeName, Stamp};

    use crate::heard::{Level, Note};

    fn note(at: u64) -> Arc<Heard> {
        let note = Note {
            level: Level::Info,
            about: NodeName::Recorder,
            is_routine: false,
            text: String::new(),
        };
        Arc::new(Heard {
            at: Stamp(at),
            session_time: Stamp(at),
            tick: 0,
            entry: Entry::Note(note),
        })
    }

    #[test]
    fn a_reader_that_comes_late_reads_all_that_is_kept_and_knows_what_is_gone() {
        let history = History::new(10 * weight_bytes(&note(0)));
        for at in 0..25 {
            history.push(note(at));
        }
        let page = history.read(0, Duration::ZERO);
        assert_eq!((page.entries.len(), page.next, page.missed), (10, 25, 15));
        assert_eq!(page.entries[0].at, Stamp(15));
        assert!(!page.is_last);
        history.end();
        let page = history.read(25, Duration::from_secs(60));
        assert_eq!((page.entries.len(), page.missed, page.is_last), (0, 0, true));
    }

    #[test]
    fn two_readers_do_not_disturb_each_other() {
        let history = History::new(1 << 20);
        for at in 0..100 {
            history.push(note(at));
        }
        let first = history.read(0, Duration::ZERO);
        assert_eq!((first.entries.len(), first.next), (BATCH, BATCH as u64));
        assert_eq!(history.read(first.next, Duration::ZERO).next, 100);
        assert_eq!(history.read(0, Duration::ZERO).entries.len(), BATCH);
    }
}
