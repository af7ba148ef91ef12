//! What all sinks share: the counts of what was dropped, how the session file is doing, and what is to be said.

use std::sync::atomic::{AtomicU8, Ordering};

use crossbeam_channel::Sender;
use tandem_wire::{Condition, Topic};

use super::Notice;
use super::drops::{Counter, Drops, Lost};
use crate::heard::{Entry, Heard};

/// Which of the two drop counters a sink counts into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    SessionFile,
    View,
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

    /// Counts one thing that a sink of this kind did not take.
    pub(super) fn drop_one(&self, kind: Kind, heard: &Heard) {
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
