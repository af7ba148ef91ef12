//! What a node's journal is kept in on this machine until a recorder has all of it.
//!
//! A handful of files, each a row of records: the length of a batch in bytes (32 bits, little-endian) and the batch as it
//! travels, header included. The newest file is written to; where all of them together exceed the limit, the oldest goes.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use tandem_wire::{Happening, JournalBatch, JournalEntry, Nanos, NodeName, SECOND, Session, decode};

use crate::LinkSettings;

/// So many files share the limit: what goes at once is a quarter of it.
const FILES: u64 = 4;
/// An answer holds about this many bytes, and at most a batch more: small enough to slip between other messages of its class.
pub(crate) const ANSWER_BYTES: u64 = 256 * 1024;
/// How long a closing node waits for a recorder to say that it has everything.
pub(crate) const LINGER: Nanos = 3 * SECOND / 2;

/// Where a node keeps its journal, and how much of it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SpoolOptions {
    /// The folder, made if it is not there.
    pub folder: PathBuf,
    /// The most that is kept, in bytes; 0 keeps nothing.
    pub limit_bytes: u64,
}

impl SpoolOptions {
    /// What the settings ask for, for a process whose nodes run in `session`.
    #[must_use]
    pub fn new(settings: &LinkSettings, session: Session) -> Self {
        let folder = match settings.spool.as_str() {
            "" => std::env::temp_dir().join(format!("tandem-journals-{:016x}", session.0)),
            folder => PathBuf::from(folder),
        };
        Self {
            folder,
            limit_bytes: settings.spool_mib << 20,
        }
    }
}

/// A journal on disk.
#[derive(Debug)]
pub(crate) struct Spool {
    folder: PathBuf,
    name: String,
    limit_bytes: u64,
    files: VecDeque<Kept>,
    made: u64,
    /// The index behind the last entry.
    next: u64,
}

#[derive(Debug)]
struct Kept {
    path: PathBuf,
    file: File,
    bytes: u64,
    parts: Vec<Part>,
}

/// Where a batch stands.
#[derive(Clone, Copy, Debug)]
struct Part {
    first: u64,
    behind: u64,
    at: u64,
    length: u32,
    /// The first snapshot in it.
    snapshot: Option<u64>,
}

impl Spool {
    /// Makes the folder and the first file.
    pub(crate) fn create(options: &SpoolOptions, node: NodeName, session: Session) -> std::io::Result<Self> {
        std::fs::create_dir_all(&options.folder)?;
        let mut spool = Self {
            folder: options.folder.clone(),
            name: format!("{node}-{:016x}", session.0),
            limit_bytes: options.limit_bytes,
            files: VecDeque::new(),
            made: 0,
            next: 0,
        };
        spool.begin_file()?;
        Ok(spool)
    }

    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Keeps a batch; `message` is the same as bytes.
    pub(crate) fn keep(&mut self, batch: &JournalBatch, message: &[u8]) -> std::io::Result<()> {
        let too_long = |error| std::io::Error::new(std::io::ErrorKind::InvalidInput, error);
        let length = u32::try_from(message.len()).map_err(too_long)?;
        let share = self.limit_bytes / FILES;
        if self.files.back().is_none_or(|kept| kept.bytes >= share) {
            self.begin_file()?;
        }
        let Some(kept) = self.files.back_mut() else {
            return Ok(());
        };
        kept.file.seek(SeekFrom::Start(kept.bytes))?;
        kept.file.write_all(&length.to_le_bytes())?;
        kept.file.write_all(message)?;
        self.next = batch.first + batch.entries.len() as u64;
        kept.parts.push(Part {
            first: batch.first,
            behind: self.next,
            at: kept.bytes + 4,
            length,
            snapshot: first_snapshot(batch),
        });
        kept.bytes += 4 + u64::from(length);
        Ok(())
    }

    fn begin_file(&mut self) -> std::io::Result<()> {
        let path = self.folder.join(format!("{}.{}.journal", self.name, self.made));
        let file = File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(true)
            .open(&path)?;
        self.made += 1;
        self.files.push_back(Kept {
            path,
            file,
            bytes: 0,
            parts: Vec::new(),
        });
        if self.files.len() as u64 > FILES
            && let Some(oldest) = self.files.pop_front()
        {
            std::fs::remove_file(oldest.path)?;
        }
        Ok(())
    }

    /// Consecutive entries from `first` to at most `last`, as many as fit into an answer. Where `first` is not kept any
    /// more, it begins with the first snapshot that is. Without entries it says in its `first` up to where none are.
    pub(crate) fn answer(&mut self, first: u64, last: u64) -> std::io::Result<JournalBatch> {
        let mut answer = JournalBatch::default();
        let begin = self.begin(first).unwrap_or(self.next);
        answer.first = begin.min(last.saturating_add(1)).max(first);
        if begin > last {
            return Ok(answer);
        }
        let mut bytes = 0;
        for kept in &mut self.files {
            for part in &kept.parts {
                let wanted = answer.first + answer.entries.len() as u64;
                if part.behind <= wanted {
                    continue;
                }
                // What the node could not keep ends the answer, unless it lies before it.
                let gap = part.first > wanted;
                if wanted > last || bytes >= ANSWER_BYTES || (gap && !answer.entries.is_empty()) {
                    return Ok(answer);
                }
                answer.first = if gap { part.first } else { answer.first };
                answer.entries.extend(entries(&mut kept.file, part, wanted, last)?);
                bytes += u64::from(part.length);
            }
        }
        Ok(answer)
    }

    /// Where an answer to a question for `first` begins.
    fn begin(&self, first: u64) -> Option<u64> {
        let mut parts = self.files.iter().flat_map(|kept| &kept.parts);
        let oldest = parts.clone().next()?;
        if first >= oldest.first {
            let part = parts.find(|part| part.behind > first)?;
            return Some(part.first.max(first));
        }
        parts.find_map(|part| part.snapshot)
    }

    /// Removes the files, and the folder if nothing else is in it.
    pub(crate) fn remove(&mut self) {
        for kept in self.files.drain(..) {
            // What cannot be removed stays; nobody needs it any more.
            let _ = std::fs::remove_file(kept.path);
        }
        let _ = std::fs::remove_dir(&self.folder);
    }
}

fn first_snapshot(batch: &JournalBatch) -> Option<u64> {
    let is_snapshot = |entry: &JournalEntry| matches!(entry.what, Happening::Snapshot { .. });
    let place = batch.entries.iter().position(is_snapshot)?;
    Some(batch.first + place as u64)
}

/// The entries of a part from `wanted` to `last`.
fn entries(file: &mut File, part: &Part, wanted: u64, last: u64) -> std::io::Result<Vec<JournalEntry>> {
    let mut bytes = vec![0; part.length as usize];
    file.seek(SeekFrom::Start(part.at))?;
    file.read_exact(&mut bytes)?;
    let batch = decode::<JournalBatch>(&bytes).map_err(std::io::Error::other)?.body;
    let indexed = batch.entries.into_iter().zip(batch.first..);
    let asked = indexed.filter(|(_, index)| (wanted..=last).contains(index));
    Ok(asked.map(|(entry, _)| entry).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::{Numbering, Stamp, encode};

    fn batch(first: u64, count: u64) -> JournalBatch {
        let entry = |index: u64| JournalEntry {
            at: Stamp(index),
            wall: Stamp(0),
            what: match index % 50 {
                0 => Happening::Snapshot { bytes: vec![7; 100] },
                _ => Happening::Wake,
            },
        };
        JournalBatch {
            first,
            lost: 0,
            entries: (first..first + count).map(entry).collect(),
        }
    }

    fn spool(folder: &Path, limit_bytes: u64, batches: &[(u64, u64)]) -> Spool {
        let options = SpoolOptions {
            folder: folder.join("journals"),
            limit_bytes,
        };
        let mut spool = Spool::create(&options, NodeName::Arbiter, Session(3)).unwrap();
        let mut numbering = Numbering::new(Session(3));
        let mut bytes = Vec::new();
        for &(first, count) in batches {
            let batch = batch(first, count);
            encode(&numbering.envelope(Stamp(0), 0, batch.clone()), &mut bytes);
            spool.keep(&batch, &bytes).unwrap();
        }
        spool
    }

    fn indices(answer: &JournalBatch) -> Vec<u64> {
        answer.entries.iter().map(|entry| entry.at.0).collect()
    }

    #[test]
    fn any_range_is_given_out_across_batches_and_nothing_beyond_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let mut spool = spool(folder.path(), 1 << 20, &[(0, 10), (10, 1), (11, 30)]);
        let answer = spool.answer(5, 20).unwrap();
        assert_eq!((answer.first, indices(&answer)), (5, (5..=20).collect()));
        let all = spool.answer(0, u64::MAX).unwrap();
        assert_eq!(indices(&all), (0..41).collect::<Vec<_>>());
        let beyond = spool.answer(41, u64::MAX).unwrap();
        assert_eq!((beyond.first, beyond.entries.len()), (41, 0));
    }

    #[test]
    fn what_the_node_lost_itself_is_jumped_over() {
        let folder = tempfile::tempdir().unwrap();
        let mut spool = spool(folder.path(), 1 << 20, &[(0, 10), (20, 10)]);
        assert_eq!(indices(&spool.answer(5, 29).unwrap()), (5..10).collect::<Vec<_>>());
        let behind = spool.answer(10, 29).unwrap();
        assert_eq!((behind.first, indices(&behind)), (20, (20..30).collect()));
        let none = spool.answer(12, 15).unwrap();
        assert_eq!((none.first, none.entries.len()), (16, 0));
    }

    #[test]
    fn the_oldest_goes_and_answers_then_begin_with_a_snapshot() {
        let folder = tempfile::tempdir().unwrap();
        let batches: Vec<_> = (0..100).map(|batch| (batch * 10, 10)).collect();
        let mut spool = spool(folder.path(), 16 * 1024, &batches);
        let on_disk: u64 = std::fs::read_dir(spool.folder())
            .unwrap()
            .map(|file| file.unwrap().metadata().unwrap().len())
            .sum();
        assert!(on_disk < 20 * 1024, "{on_disk}");
        let answer = spool.answer(0, u64::MAX).unwrap();
        assert!(answer.first > 0 && answer.first.is_multiple_of(50), "{}", answer.first);
        assert_eq!(indices(&answer), (answer.first..1000).collect::<Vec<_>>());
        let gone = spool.answer(0, 3).unwrap();
        assert_eq!((gone.first, gone.entries.len()), (4, 0));
        spool.remove();
        assert!(!folder.path().join("journals").exists());
    }
}
