//! What nodes kept of their journals on their own disks, for a recording that lacks some of it.
//!
//! A kept file is a row of records: the length of a batch (32 bits, little-endian), and the batch as it travels.

use std::collections::BTreeMap;
use std::io::{self, Read};

use tandem_wire::{JournalBatch, Message as _, NodeName, Session, decode};

use crate::heard::JournalPart;

impl JournalPart {
    /// Reads the parts of a journal that a node kept in a file, and says whether the file makes sense to its end: one
    /// whose node was killed may break off.
    ///
    /// # Errors
    /// If the system cannot read it.
    pub fn read_kept(node: NodeName, mut file: impl Read) -> io::Result<(Vec<Self>, bool)> {
        let mut parts = Vec::new();
        loop {
            let mut head = Vec::new();
            (&mut file).take(4).read_to_end(&mut head)?;
            let Some(length) = head.first_chunk().copied().map(u32::from_le_bytes) else {
                return Ok((parts, head.is_empty()));
            };
            let mut bytes = Vec::new();
            let limit = u64::from(length).min(JournalBatch::MAX_BYTES as u64);
            (&mut file).take(limit).read_to_end(&mut bytes)?;
            let Ok(batch) = decode::<JournalBatch>(&bytes) else {
                return Ok((parts, false));
            };
            parts.push(Self {
                node,
                header: batch.header,
                first: batch.body.first,
                entries: batch.body.entries.len() as u64,
                lost: batch.body.lost,
                bytes,
            });
        }
    }
}

/// Which entries of each journal are there.
#[derive(Default)]
pub(super) struct Coverage(BTreeMap<(NodeName, Session), Vec<(u64, u64)>>);

impl Coverage {
    pub(super) fn add(&mut self, node: NodeName, session: Session, first: u64, entries: u64) {
        let ranges = self.0.entry((node, session)).or_default();
        match ranges.last_mut() {
            Some(last) if last.1 == first => last.1 = first.saturating_add(entries),
            _ => ranges.push((first, first.saturating_add(entries))),
        }
    }

    /// Whether the recording knows this run of the node.
    pub(super) fn knows(&self, part: &JournalPart) -> bool {
        self.0.contains_key(&(part.node, part.header.session))
    }

    /// How many entries of this part are not there.
    pub(super) fn lacks(&self, part: &JournalPart) -> u64 {
        let behind = part.first.saturating_add(part.entries);
        let mut ranges = self
            .0
            .get(&(part.node, part.header.session))
            .cloned()
            .unwrap_or_default();
        ranges.sort_unstable();
        let mut at = part.first;
        let mut there = 0;
        for (first, end) in ranges {
            let (from, to) = (first.max(at), end.min(behind));
            if from < to {
                there += to - from;
                at = to;
            }
        }
        part.entries.saturating_sub(there)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::{Header, Seq, Stamp};

    fn part(first: u64, entries: u64) -> JournalPart {
        let header = Header {
            tick: 0,
            session: Session(5),
            seq: Seq(1),
            sent: Stamp(0),
        };
        JournalPart {
            node: NodeName::Arbiter,
            header,
            first,
            entries,
            lost: 0,
            bytes: Vec::new(),
        }
    }

    #[test]
    fn what_is_there_twice_or_in_pieces_is_there() {
        let mut coverage = Coverage::default();
        assert!(!coverage.knows(&part(0, 1)));
        for (first, entries) in [(0, 10), (10, 5), (30, 10), (12, 2)] {
            coverage.add(NodeName::Arbiter, Session(5), first, entries);
        }
        for (first, entries, lacking) in [(0, 15, 0), (5, 20, 10), (15, 15, 15), (28, 4, 2), (50, 1, 1)] {
            assert_eq!(coverage.lacks(&part(first, entries)), lacking, "{first} {entries}");
        }
    }

    #[test]
    fn a_kept_file_that_breaks_off_gives_what_is_whole() {
        let (parts, is_whole) = JournalPart::read_kept(NodeName::Arbiter, &b""[..]).unwrap();
        assert!(parts.is_empty() && is_whole);
        for broken in [&b"\x01\x00"[..], b"\x05\x00\x00\x00abc", b"\xff\xff\xff\xffabc"] {
            let (parts, is_whole) = JournalPart::read_kept(NodeName::Arbiter, broken).unwrap();
            assert!(parts.is_empty() && !is_whole);
        }
    }
}
