//! What a later part of a session begins with: which part it is, and what holds at its beginning.

use std::collections::BTreeMap;
use std::sync::Arc;

use tandem_wire::{Happening, JournalBatch, JournalEntry, NodeName, Numbering, Session, Stamp};

use crate::heard::{Entry, Heard, JournalPart};

/// The record that a later part of a session has.
pub(crate) const PART: &str = "tandem.part";

pub(super) fn fields(number: u32, at: Stamp) -> BTreeMap<String, String> {
    BTreeMap::from([
        ("number".to_owned(), number.to_string()),
        ("begins_ns".to_owned(), at.0.to_string()),
    ])
}

/// The lasting messages as arrived at `at`.
pub(super) fn renewed(at: Stamp, lasting: &[Arc<Heard>]) -> impl Iterator<Item = Heard> {
    lasting.iter().map(move |heard| Heard {
        at,
        ..Heard::clone(heard)
    })
}

/// The same as they travelled, as a journal of the recorder's; none without any.
pub(super) fn journal(at: Stamp, lasting: &[Arc<Heard>]) -> Option<JournalPart> {
    let samples = lasting.iter().filter_map(|heard| match &heard.entry {
        Entry::Sample(sample) => sample.travelled(),
        Entry::Note(_) | Entry::Counts(_) => None,
    });
    let entry = |(topic, bytes)| JournalEntry {
        at,
        wall: at,
        what: Happening::Sample { topic, bytes },
    };
    let body = JournalBatch {
        first: 0,
        lost: 0,
        entries: samples.map(entry).collect(),
    };
    if body.entries.is_empty() {
        return None;
    }
    let batch = Numbering::new(Session(0)).envelope(at, 0, body);
    Some(JournalPart::of(NodeName::Recorder, &batch))
}
