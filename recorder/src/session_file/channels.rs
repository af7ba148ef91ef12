//! The MCAP writer and its channels; each is declared with its schema when its first message comes.

use std::collections::BTreeMap;
use std::io::{Seek, Write};

use foxglove::Encode;
use mcap::records::Metadata;
use mcap::{Attachment, Compression, WriteOptions};
use tandem_wire::{NodeName, RobotName, Topic};

use super::times::Times;
use super::{JOURNAL_ENCODING, WriteError, journal_schema};
use crate::heard::JournalPart;

/// What a session file is written through.
pub(super) struct Channels<W: Write + Seek> {
    writer: mcap::Writer<W>,
    robot: RobotName,
    protobuf: BTreeMap<&'static str, u16>,
    journals: BTreeMap<NodeName, u16>,
    messages: u64,
    buffer: Vec<u8>,
}

impl<W: Write + Seek> Channels<W> {
    pub(super) fn begin(to: W, chunk_bytes: u64, robot: RobotName) -> Result<Self, WriteError> {
        let options = WriteOptions::new()
            .compression(Some(Compression::Zstd))
            // Every chunk is written in one piece behind the last, so that what a crash leaves is a whole file cut short.
            .disable_seeking(true)
            // A pool of compressors costs megabytes and saves nothing at a few hundred kilobytes a second.
            .compression_threads(0)
            .chunk_size(Some(chunk_bytes))
            .library(concat!("tandem-recorder ", env!("CARGO_PKG_VERSION")));
        Ok(Self {
            writer: options.create(to)?,
            robot,
            protobuf: BTreeMap::new(),
            journals: BTreeMap::new(),
            messages: 0,
            buffer: Vec::with_capacity(4096),
        })
    }

    /// Puts a message on the channel of that name.
    pub(super) fn put<T: Encode>(
        &mut self,
        channel: &'static str,
        times: Times,
        message: &T,
    ) -> Result<(), WriteError> {
        let id = self.channel::<T>(channel)?;
        self.buffer.clear();
        message.encode(&mut self.buffer).map_err(|error| WriteError::Encode {
            channel,
            what: error.to_string(),
        })?;
        self.writer.write_to_known_channel(&times.header(id), &self.buffer)?;
        self.messages += 1;
        Ok(())
    }

    /// Puts a part of a journal, as it travelled, on its node's channel.
    pub(super) fn put_journal(&mut self, times: Times, part: &JournalPart) -> Result<(), WriteError> {
        let id = self.journal(part.node)?;
        self.writer.write_to_known_channel(&times.header(id), &part.bytes)?;
        self.messages += 1;
        Ok(())
    }

    pub(super) fn attach(&mut self, attachment: &Attachment<'_>) -> Result<(), WriteError> {
        Ok(self.writer.attach(attachment)?)
    }

    pub(super) fn write_metadata(
        &mut self,
        name: String,
        metadata: BTreeMap<String, String>,
    ) -> Result<(), WriteError> {
        Ok(self.writer.write_metadata(&Metadata { name, metadata })?)
    }

    /// Ends the chunk and hands everything so far to the operating system.
    pub(super) fn flush(&mut self) -> Result<(), WriteError> {
        Ok(self.writer.flush()?)
    }

    /// Writes the index and the end.
    pub(super) fn finish(mut self) -> Result<W, WriteError> {
        self.writer.finish()?;
        Ok(self.writer.into_inner())
    }

    /// Gives back what it was written to, as it is.
    pub(super) fn abandon(self) -> W {
        self.writer.into_inner()
    }

    /// How many messages were put.
    pub(super) const fn messages(&self) -> u64 {
        self.messages
    }

    fn channel<T: Encode>(&mut self, name: &'static str) -> Result<u16, WriteError> {
        if let Some(id) = self.protobuf.get(name) {
            return Ok(*id);
        }
        let schema = T::get_schema().expect("every type that is put on a channel derives its schema");
        let schema = self.writer.add_schema(&schema.name, &schema.encoding, &schema.data)?;
        let topic = format!("{}/{}/{name}", tandem_wire::keys::ROOT, self.robot);
        let encoding = T::get_message_encoding();
        let id = self.writer.add_channel(schema, &topic, &encoding, &BTreeMap::new())?;
        self.protobuf.insert(name, id);
        Ok(id)
    }

    fn journal(&mut self, node: NodeName) -> Result<u16, WriteError> {
        if let Some(id) = self.journals.get(&node) {
            return Ok(*id);
        }
        let text = journal_schema::text();
        let schema = self.writer.add_schema("tandem.JournalBatch", "text", text.as_bytes())?;
        let topic = Topic::Journal(node).key(&self.robot);
        let id = self
            .writer
            .add_channel(schema, &topic, JOURNAL_ENCODING, &BTreeMap::new())?;
        self.journals.insert(node, id);
        Ok(id)
    }
}
