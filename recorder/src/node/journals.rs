//! Parts of the nodes' journals that are more than a message among others, and what is said of the session file.

use std::sync::Arc;

use tandem_wire::{Condition, Outbox, Stamp, Storage};

use super::{Output, Recorder};
use crate::heard::{Entry, JournalPart, Sample};

impl Recorder {
    /// What was asked for is kept like what came by itself; the rest is nobody's.
    pub(super) fn on_answer(&mut self, now: Stamp, part: JournalPart, outbox: &mut Outbox<Output>) {
        let worth = self.filling.answer(now, &part, outbox);
        if worth.take {
            self.tally.count_journal(&part);
            self.write(now, Sample::Journal(part), outbox);
        }
        if let Some(note) = worth.note {
            self.note(now, note, outbox);
        }
    }

    /// A node ends, and says again and again how far its journal goes. That is written, once: should what lies before it
    /// never come, the file tells that it is missing.
    pub(super) fn on_end(&mut self, now: Stamp, sample: Sample, outbox: &mut Outbox<Output>) {
        let Sample::Journal(part) = &sample else { return };
        let end = self.filling.hear_end(now, part, outbox);
        if end.is_new {
            self.write(now, sample, outbox);
        }
        if end.is_whole {
            self.pass_on_counts(now, outbox);
        }
    }

    /// Others hear of the session file when something changes, and again and again while something is wrong, so that
    /// whoever comes late hears of it too.
    pub(super) fn on_storage(&mut self, now: Stamp, storage: Storage, outbox: &mut Outbox<Output>) {
        let loses = storage.dropped > 0 || storage.condition != Condition::Kept;
        self.filling.look(loses, outbox);
        let before = std::mem::replace(&mut self.storage, storage);
        if before != storage || storage.condition != Condition::Kept {
            outbox.push(Output::Say(self.sayings.envelope(now, self.tick, storage)));
        }
    }

    fn write(&self, now: Stamp, sample: Sample, outbox: &mut Outbox<Output>) {
        let heard = self.heard(now, self.tick, Entry::Sample(sample));
        outbox.push(Output::Write(Arc::new(heard)));
    }
}
