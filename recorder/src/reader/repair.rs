//! A damaged file made whole: everything that can be read, written anew with index and end.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{Read, Seek, Write};

use mcap::records::{Metadata, Record};
use mcap::{Attachment, Compression, McapError, WriteOptions};

use super::damage::{Damage, ReadError};
use super::records;

/// What a repair came to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Repaired {
    /// Messages that the new file holds.
    pub messages: u64,
    /// Messages that were left out because their channel is unknown.
    pub left_out: u64,
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

/// Writes what can be read of `file` to `to`: channels, messages, metadata and attachments as they are.
///
/// # Errors
/// If `file` is no MCAP file, or `to` cannot be written.
pub fn repair<W: Write + Seek>(mut file: impl Read + Seek, to: W) -> Result<Repaired, RepairError> {
    let writer = WriteOptions::new()
        .compression(Some(Compression::Zstd))
        .compression_threads(0)
        .library(concat!("tandem session repair ", env!("CARGO_PKG_VERSION")))
        .create(to)?;
    let mut copy = Copy {
        writer,
        schemas: BTreeMap::new(),
        channels: BTreeMap::new(),
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
    copy.finish(damage)
}

struct Copy<W: Write + Seek> {
    writer: mcap::Writer<W>,
    /// The old file's numbers and the new file's.
    schemas: BTreeMap<u16, u16>,
    channels: BTreeMap<u16, u16>,
    messages: u64,
    left_out: u64,
    failed: Option<McapError>,
}

impl<W: Write + Seek> Copy<W> {
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
                self.channels.insert(channel.id, id);
            }
            Record::Message { mut header, data } => match self.channels.get(&header.channel_id) {
                Some(id) => {
                    header.channel_id = *id;
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

    fn finish(mut self, damage: Vec<Damage>) -> Result<Repaired, RepairError> {
        if let Some(error) = self.failed {
            return Err(error.into());
        }
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
            damage,
        })
    }
}
