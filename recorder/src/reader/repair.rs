//! A damaged file made whole: everything that can be read, written anew with index and end, and what nodes kept of their
//! journals, where the file lacks it.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{Read, Seek, Write};

use mcap::records::{MessageHeader, Metadata, Record};
use mcap::{Attachment, Compression, McapError, WriteOptions};
use tandem_wire::{JournalBatch, Nanos, NodeName, Topic, decode, keys};

use super::damage::{Damage, ReadError};
use super::records;
use super::spool::Coverage;
use crate::heard::JournalPart;
use crate::session_file::JOURNAL_ENCODING;

/// What a repair came to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Repaired {
    /// Messages that the new file holds.
    pub messages: u64,
    /// Messages that were left out because their channel is unknown.
    pub left_out: u64,
    /// Entries of journals that were lacking and are there now.
    pub merged: u64,
    /// Parts of journals of runs that the file knows nothing of, left out.
    pub strange: u64,
    /// What was wrong.
    pub damage: Vec<Damage>,
}

/// Why a file could not be repaired.
#[derive(Debug, thiserror::Error)]
pub enum RepairError {
    /// There is nothing to repair.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The new file could not take it.
    #[error("the repaired file cannot be written")]
    Write(#[from] McapError),
}

/// Writes what can be read of `file`, a whole session, to `to`: see [`Repair::part`].
///
/// # Errors
/// If `file` is no MCAP file, or `to` cannot be written.
pub fn repair<W: Write + Seek>(file: impl Read + Seek, kept: &[JournalPart], to: W) -> Result<Repaired, RepairError> {
    Repair::default().part(file, kept, to)
}

/// Mends the files of one session, which together say what of its journals is lacking.
#[derive(Default)]
pub struct Repair(Coverage);

impl Repair {
    /// Writes what can be read of `file` to `to`: channels, messages, metadata and attachments as they are; behind them
    /// those of the `kept` parts of journals that neither it nor the files before it have.
    ///
    /// # Errors
    /// If `file` is no MCAP file, or `to` cannot be written.
    pub fn part<W: Write + Seek>(
        &mut self,
        file: impl Read + Seek,
        kept: &[JournalPart],
        to: W,
    ) -> Result<Repaired, RepairError> {
        mend(&mut self.0, file, kept, to)
    }
}

fn mend<W: Write + Seek>(
    coverage: &mut Coverage,
    mut file: impl Read + Seek,
    kept: &[JournalPart],
    to: W,
) -> Result<Repaired, RepairError> {
    let writer = WriteOptions::new()
        .compression(Some(Compression::Zstd))
        .compression_threads(0)
        .library(concat!("tandem session repair ", env!("CARGO_PKG_VERSION")))
        .create(to)?;
    let mut copy = Copy {
        writer,
        schemas: BTreeMap::new(),
        channels: BTreeMap::new(),
        journals: BTreeMap::new(),
        coverage,
        last: 0,
        messages: 0,
        left_out: 0,
        failed: None,
    };
    records::summary(&mut file, |record| copy.take(record));
    let mut damage = records::walk(&mut file, |_, record| copy.take(record))?;
    if copy.left_out > 0 {
        let messages = copy.left_out;
        damage.push(Damage::UnknownChannel { messages });
    }
    if let Some(error) = copy.failed.take() {
        return Err(error.into());
    }
    let (merged, strange) = copy.merge(kept)?;
    Ok(Repaired {
        merged,
        strange,
        ..copy.finish(damage)?
    })
}

struct Copy<'a, W: Write + Seek> {
    writer: mcap::Writer<W>,
    /// The old file's numbers and the new file's.
    schemas: BTreeMap<u16, u16>,
    channels: BTreeMap<u16, u16>,
    /// The new file's numbers of the journals' channels.
    journals: BTreeMap<u16, NodeName>,
    coverage: &'a mut Coverage,
    /// The last arrival.
    last: Nanos,
    messages: u64,
    left_out: u64,
    failed: Option<McapError>,
}

impl<W: Write + Seek> Copy<'_, W> {
    fn take(&mut self, record: Record<'_>) {
        if self.failed.is_none() {
            self.failed = self.write(record).err();
        }
    }

    fn write(&mut self, record: Record<'_>) -> Result<(), McapError> {
        match record {
            Record::Schema { header, data } => {
                let id = self.writer.add_schema(&header.name, &header.encoding, &data)?;
                self.schemas.insert(header.id, id);
            }
            Record::Channel(channel) => {
                // A schema that is lost leaves a channel without one: its messages are kept.
                let schema = self.schemas.get(&channel.schema_id).copied().unwrap_or(0);
                if self.channels.contains_key(&channel.id) {
                    return Ok(());
                }
                let encoding = &channel.message_encoding;
                let id = self
                    .writer
                    .add_channel(schema, &channel.topic, encoding, &channel.metadata)?;
                if let (true, Some((_, Topic::Journal(node)))) =
                    (encoding == JOURNAL_ENCODING, keys::parse(&channel.topic))
                {
                    self.journals.insert(id, node);
                }
                self.channels.insert(channel.id, id);
            }
            Record::Message { mut header, data } => match self.channels.get(&header.channel_id) {
                Some(id) => {
                    header.channel_id = *id;
                    self.last = self.last.max(header.log_time);
                    if let Some(node) = self.journals.get(id)
                        && let Ok(batch) = decode::<JournalBatch>(&data)
                    {
                        let entries = batch.body.entries.len() as u64;
                        self.coverage
                            .add(*node, batch.header.session, batch.body.first, entries);
                    }
                    self.writer.write_to_known_channel(&header, &data)?;
                    self.messages += 1;
                }
                None => self.left_out += 1,
            },
            Record::Metadata(metadata) => self.writer.write_metadata(&metadata)?,
            Record::Attachment { header, data, .. } => self.writer.attach(&Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name,
                media_type: header.media_type,
                data: Cow::Owned(data.into_owned()),
            })?,
            _ => {}
        }
        Ok(())
    }

    /// Writes the parts that the file lacks, as if they had come last; how many entries, and how many parts are of runs
    /// that are not in this file.
    fn merge(&mut self, kept: &[JournalPart]) -> Result<(u64, u64), McapError> {
        let (mut merged, mut strange) = (0, 0);
        for part in kept {
            let lacking = self.coverage.lacks(part);
            let channel = self.journals.iter().find(|(_, node)| **node == part.node);
            let Some((id, _)) = channel.filter(|_| self.coverage.knows(part)) else {
                strange += 1;
                continue;
            };
            if lacking == 0 {
                continue;
            }
            let header = MessageHeader {
                channel_id: *id,
                sequence: 0,
                log_time: self.last,
                publish_time: self.last,
            };
            self.writer.write_to_known_channel(&header, &part.bytes)?;
            self.coverage
                .add(part.node, part.header.session, part.first, part.entries);
            self.messages += 1;
            merged += lacking;
        }
        Ok((merged, strange))
    }

    fn finish(mut self, damage: Vec<Damage>) -> Result<Repaired, RepairError> {
        if !damage.is_empty() {
            let said = damage.iter().enumerate();
            let metadata = said
                .map(|(index, what)| (format!("damage.{index}"), what.to_string()))
                .collect();
            let name = "tandem.repair".to_owned();
            self.writer.write_metadata(&Metadata { name, metadata })?;
        }
        self.writer.finish()?;
        Ok(Repaired {
            messages: self.messages,
            left_out: self.left_out,
            merged: 0,
            strange: 0,
            damage,
        })
    }
}
