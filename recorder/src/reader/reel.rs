//! Single messages from files that are not held in memory.

use std::collections::{BTreeMap, VecDeque};
use std::io::{self, Read, Seek};

use mcap::records::Record;
use tandem_wire::{Happening, JournalBatch, JournalEntry, NodeName, Topic, codec, decode};

use super::Recorded;
use super::records::{self, Spot};

/// Unpacked chunks are kept while they have at most this many bytes together: those that were needed last, so that the
/// journals of several nodes, which lie beside each other, are unpacked once.
const KEPT_BYTES: usize = 8 << 20;

/// Where a message's bytes stand: in which file, which chunk, which part of a journal, which entry.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    chunk: u64,
    message: u32,
    entry: u32,
    part: u16,
}

impl Place {
    pub(super) const fn new(part: u16, spot: Spot, entry: u32) -> Self {
        Self {
            chunk: spot.at,
            message: spot.nth,
            entry,
            part,
        }
    }
}

/// Why a message could not be fetched.
#[derive(Debug, thiserror::Error)]
pub enum ReelError {
    /// The system would not read the file.
    #[error("the session file cannot be read on; is its disk still there?")]
    System(#[from] io::Error),
    /// What was seen there before is there no more.
    #[error("the session file has changed since it was opened: leave it alone, and begin again")]
    Changed,
}

/// The files of a session, in the order in which they were read.
pub struct Reel<F> {
    files: Vec<F>,
    /// The newest last.
    pages: VecDeque<Page>,
}

/// The journals' parts of a chunk.
struct Page {
    part: u16,
    chunk: u64,
    bytes: usize,
    batches: BTreeMap<u32, Batch>,
}

enum Batch {
    /// As it travelled.
    Packed(Vec<u8>),
    Open(Vec<JournalEntry>),
}

impl<F: Read + Seek> Reel<F> {
    /// The files that the places refer to, every one that [`PartsReader::add`](super::PartsReader::add) took, in order.
    #[must_use]
    pub const fn new(files: Vec<F>) -> Self {
        Self {
            files,
            pages: VecDeque::new(),
        }
    }

    /// The message with its bytes. Costs the reading and unpacking of a chunk where the last ones were others.
    ///
    /// # Errors
    /// If the file cannot be read, or is not what it was.
    pub fn fetch(&mut self, message: &Recorded<Place>) -> Result<Recorded, ReelError> {
        let Recorded { at, topic, header, .. } = *message;
        let bytes = self.bytes(message.bytes)?.ok_or(ReelError::Changed)?;
        // Another file may stand there by now.
        let is_same = codec::peek(&bytes).is_ok_and(|(_, read)| read == header);
        is_same
            .then_some(Recorded {
                at,
                topic,
                header,
                bytes,
            })
            .ok_or(ReelError::Changed)
    }

    fn bytes(&mut self, place: Place) -> Result<Option<Vec<u8>>, ReelError> {
        let is_wanted = |page: &Page| page.part == place.part && page.chunk == place.chunk;
        match self.pages.iter().position(is_wanted) {
            Some(index) => {
                let page = self.pages.remove(index);
                self.pages.extend(page);
            }
            None => self.turn_to(place)?,
        }
        let page = self.pages.back_mut();
        Ok(page.and_then(|page| page.bytes(place)))
    }

    fn turn_to(&mut self, place: Place) -> Result<(), ReelError> {
        let file = self.files.get_mut(usize::from(place.part)).ok_or(ReelError::Changed)?;
        let mut batches = BTreeMap::new();
        let mut bytes = 0;
        records::at(file, place.chunk, |spot, record| {
            if let Record::Message { data, .. } = record
                && is_journal(&data)
            {
                bytes += data.len();
                batches.insert(spot.nth, Batch::Packed(data.into_owned()));
            }
        })?;
        self.pages.push_back(Page {
            part: place.part,
            chunk: place.chunk,
            bytes,
            batches,
        });
        while self.pages.len() > 1 && self.pages.iter().map(|page| page.bytes).sum::<usize>() > KEPT_BYTES {
            self.pages.pop_front();
        }
        Ok(())
    }
}

/// Journals alone hold bytes as they travelled; whose it is makes no difference.
fn is_journal(data: &[u8]) -> bool {
    let kind = Topic::Journal(NodeName::Operator).kind();
    codec::peek(data).is_ok_and(|(read, _)| read == kind)
}

impl Page {
    fn bytes(&mut self, place: Place) -> Option<Vec<u8>> {
        let batch = self.batches.get_mut(&place.message)?;
        if let Batch::Packed(bytes) = batch {
            *batch = Batch::Open(decode::<JournalBatch>(bytes).ok()?.body.entries);
        }
        let Batch::Open(entries) = batch else { return None };
        match &entries.get(usize::try_from(place.entry).ok()?)?.what {
            Happening::Sample { bytes, .. } | Happening::Output { bytes, .. } => Some(bytes.clone()),
            _ => None,
        }
    }
}
