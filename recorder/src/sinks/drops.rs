//! What never reached a sink, per channel: of a full queue or a failed disk one wants to know what is missing.

use std::sync::atomic::{AtomicU64, Ordering};

use tandem_wire::{Ports, Topic};

use crate::heard::{Entry, Heard};
use crate::node::Recorder;

const TOPICS: &[Topic] = Recorder::INPUTS;
/// The recorder's own notes and counts.
const OWN: usize = TOPICS.len();
/// Of these only the number is known.
const UNTOLD: usize = OWN + 1;
const SLOTS: usize = UNTOLD + 1;

/// Messages that are missing, by what they were about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lost([u64; SLOTS]);

impl Lost {
    /// All of them.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.0.iter().fold(0, |sum, number| sum.saturating_add(*number))
    }

    /// The channels of which something is missing, by the end of their key (`state`, `journal/arbiter`, …), and how
    /// much; `log` stands for the recorder's own notes and counts, `unknown` for what was not told apart.
    pub fn by_channel(&self) -> impl Iterator<Item = (String, u64)> + '_ {
        let name = |slot: usize| match TOPICS.get(slot) {
            Some(topic) => topic.suffix(),
            None if slot == OWN => "log".to_owned(),
            None => "unknown".to_owned(),
        };
        let missing = self.0.iter().enumerate().filter(|(_, number)| **number > 0);
        missing.map(move |(slot, number)| (name(slot), *number))
    }

    pub(super) fn add(&mut self, heard: &Heard) {
        if let Some(number) = self.0.get_mut(slot(heard)) {
            *number += 1;
        }
    }
}

/// What never reached a sink because its queue was full or the sink had failed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Drops {
    /// Missing from the session file.
    pub session_file: Lost,
    /// Missing from views, all taken together.
    pub views: Lost,
}

/// The same, while several threads count.
#[derive(Debug, Default)]
pub(super) struct Counter([AtomicU64; SLOTS]);

impl Counter {
    pub(super) fn count(&self, heard: &Heard) {
        self.add(slot(heard), 1);
    }

    pub(super) fn count_topic(&self, topic: Topic, number: u64) {
        self.add(place(topic), number);
    }

    pub(super) fn count_untold(&self, number: u64) {
        self.add(UNTOLD, number);
    }

    pub(super) fn count_all(&self, lost: &Lost) {
        for (slot, number) in lost.0.iter().enumerate() {
            self.add(slot, *number);
        }
    }

    pub(super) fn lost(&self) -> Lost {
        Lost(std::array::from_fn(|slot| {
            self.0.get(slot).map_or(0, |number| number.load(Ordering::Relaxed))
        }))
    }

    fn add(&self, slot: usize, number: u64) {
        if let Some(count) = self.0.get(slot) {
            count.fetch_add(number, Ordering::Relaxed);
        }
    }
}

fn slot(heard: &Heard) -> usize {
    match &heard.entry {
        Entry::Sample(sample) => place(sample.topic()),
        Entry::Note(_) | Entry::Counts(_) => OWN,
    }
}

fn place(topic: Topic) -> usize {
    TOPICS.iter().position(|known| *known == topic).unwrap_or(UNTOLD)
}
