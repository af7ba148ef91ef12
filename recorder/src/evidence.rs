//! What a session file holds for executing its nodes again: configurations, models, journals.
//!
//! The counterpart of [`SessionFile`](crate::SessionFile) for one purpose. The file is read once from its beginning,
//! so that one whose writer was killed, without summary or with half a chunk at its end, gives what it still holds.
//! Nothing here judges: what is missing shows as a gap in a journal, what is broken as a [`Fault`].

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io::Read;

use mcap::McapError;
use mcap::records::{Metadata, Record};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use sha2::{Digest, Sha256};
use tandem_wire::{JournalBatch, Malformed, NodeName, Session, Topic, decode, keys};

use crate::reader::protobuf;
use crate::session_file::{JOURNAL_ENCODING, hex};

/// No record of an honest session file is longer: a model has at most 16 MiB, a chunk's record is not held whole.
const RECORD_LIMIT: usize = 64 << 20;
/// What stands before a node's name in the name of its metadata record.
const NODE_RECORD: &str = "tandem.node.";

/// One run of one node: a node that was started again has two.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Run {
    /// Which node.
    pub node: NodeName,
    /// Which run of it.
    pub session: Session,
}

/// What it takes to build a node again, as it said itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecordedNode {
    /// Its effective configuration, as TOML.
    pub config: String,
    /// The seed of its random numbers.
    pub seed: u64,
    /// Version and git revision of the program.
    pub build: String,
    /// SHA-256 of its model, in hexadecimal digits.
    pub model: Option<String>,
}

/// Something in the file that cannot be read. What can be is read all the same.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The file ends, or makes no sense any more, after so many records.
    Ends {
        /// Records that were read.
        records: u64,
        /// What the reader says.
        why: String,
    },
    /// Part of a journal is no message.
    Journal {
        /// Whose journal.
        node: NodeName,
        /// What is wrong with it.
        why: Malformed,
    },
    /// A node's metadata record lacks a field, or holds no number where one belongs.
    Node {
        /// The record's name.
        record: String,
    },
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ends { records, why } => write!(f, "the file cannot be read beyond its record {records} ({why})"),
            Self::Journal { node, why } => write!(f, "part of the journal of {node} cannot be read ({why})"),
            Self::Node { record } => write!(f, "the metadata record {record} is not complete"),
        }
    }
}

/// Why there is no evidence at all.
#[derive(Debug, thiserror::Error)]
pub enum NoEvidence {
    /// It does not begin as an MCAP file does.
    #[error("not an MCAP file, or not even its first record")]
    NotMcap,
    /// The file cannot be read.
    #[error("cannot read the file")]
    Unreadable(#[from] std::io::Error),
}

/// What a session file holds for executing its nodes again.
#[derive(Clone, Debug, Default)]
pub struct Evidence {
    /// How to build each node.
    pub nodes: BTreeMap<Run, RecordedNode>,
    /// Each node's journal, by the index of each part's first entry. Parts may be missing or there twice.
    pub journals: BTreeMap<Run, Vec<JournalBatch>>,
    /// The topics of which there are messages, and in which runs of their senders.
    pub heard: BTreeSet<(Topic, Session)>,
    /// What is broken.
    pub faults: Vec<Fault>,
    models: BTreeMap<String, Vec<u8>>,
}

impl Evidence {
    /// Reads a session file from its first byte.
    ///
    /// # Errors
    /// If it is no MCAP file, or the system cannot read it.
    pub fn read(from: impl Read) -> Result<Self, NoEvidence> {
        Self::read_parts([from])
    }

    /// Reads the parts of one session, each from its first byte, in their order.
    ///
    /// # Errors
    /// If one of them is no MCAP file, or the system cannot read it.
    pub fn read_parts(parts: impl IntoIterator<Item = impl Read>) -> Result<Self, NoEvidence> {
        let mut reading = Reading::default();
        for part in parts {
            reading.read(part)?;
        }
        for journal in reading.evidence.journals.values_mut() {
            journal.sort_by_key(|part| part.first);
        }
        Ok(reading.evidence)
    }

    /// The model file with this SHA-256, if it is attached and whole.
    #[must_use]
    pub fn model(&self, sha256: &str) -> Option<&[u8]> {
        self.models.get(sha256).map(Vec::as_slice)
    }
}

#[derive(Default)]
struct Reading {
    evidence: Evidence,
    /// What a channel carries, by its number.
    channels: BTreeMap<u16, Carried>,
    records: u64,
}

#[derive(Clone, Copy)]
struct Carried {
    topic: Topic,
    /// The bytes are those that travelled.
    raw: bool,
}

impl Reading {
    fn read(&mut self, mut from: impl Read) -> Result<(), NoEvidence> {
        let options = LinearReaderOptions::default()
            .with_validate_chunk_crcs(true)
            // Besides chunks: a model or a configuration that was changed is no evidence.
            .with_validate_data_section_crc(true)
            .with_record_length_limit(RECORD_LIMIT);
        let mut reader = LinearReader::new_with_options(options);
        // Another file numbers its channels anew.
        self.channels.clear();
        self.records = 0;
        while let Some(event) = reader.next_event() {
            match event {
                Ok(LinearReadEvent::ReadRequest(wanted)) => {
                    let read = from.read(reader.insert(wanted))?;
                    reader.notify_read(read);
                }
                Ok(LinearReadEvent::Record { data, opcode }) => match mcap::parse_record(opcode, data) {
                    Ok(record) => self.take(record),
                    Err(error) => {
                        self.end(&error);
                        break;
                    }
                },
                Err(_) if self.records == 0 => return Err(NoEvidence::NotMcap),
                Err(error) => {
                    self.end(&error);
                    break;
                }
            }
        }
        Ok(())
    }

    fn take(&mut self, record: Record<'_>) {
        self.records += 1;
        match record {
            Record::Channel(channel) => {
                if let Some((_, topic)) = keys::parse(&channel.topic) {
                    let raw = channel.message_encoding == JOURNAL_ENCODING;
                    self.channels.insert(channel.id, Carried { topic, raw });
                }
            }
            Record::Message { header, data } => {
                let carried = self.channels.get(&header.channel_id).copied();
                match carried.map(|carried| (carried.topic, carried.raw)) {
                    // On its own journal the recorder repeats what holds when a part begins: nothing to execute.
                    None | Some((Topic::Journal(NodeName::Recorder), true)) => {}
                    Some((Topic::Journal(node), true)) => self.take_journal(node, &data),
                    Some((topic, _)) => self.hear(topic, &data),
                }
            }
            Record::Attachment { data, .. } => {
                let hash = hex(&Sha256::digest(&data));
                self.evidence.models.insert(hash, data.into_owned());
            }
            Record::Metadata(record) => self.take_metadata(record),
            _ => {}
        }
    }

    /// Whoever says something ran, whether the file has its journal or not. A header that cannot be read is nobody's that
    /// is known.
    fn hear(&mut self, topic: Topic, message: &[u8]) {
        let header = protobuf::header(message).unwrap_or_default();
        self.evidence.heard.insert((topic, header.session));
    }

    fn take_journal(&mut self, node: NodeName, bytes: &[u8]) {
        match decode::<JournalBatch>(bytes) {
            Ok(part) => {
                let session = part.header.session;
                let journal = self.evidence.journals.entry(Run { node, session });
                journal.or_default().push(part.body);
            }
            Err(why) => self.evidence.faults.push(Fault::Journal { node, why }),
        }
    }

    fn take_metadata(&mut self, record: Metadata) {
        let named = record.name.strip_prefix(NODE_RECORD);
        let Some(node) = named.and_then(|name| NodeName::ALL.into_iter().find(|node| node.as_str() == name)) else {
            return;
        };
        match recorded(node, record.metadata) {
            Some((run, recorded)) => {
                self.evidence.nodes.insert(run, recorded);
            }
            None => self.evidence.faults.push(Fault::Node { record: record.name }),
        }
    }

    fn end(&mut self, error: &McapError) {
        self.evidence.faults.push(Fault::Ends {
            records: self.records,
            why: error.to_string(),
        });
    }
}

fn recorded(node: NodeName, mut fields: BTreeMap<String, String>) -> Option<(Run, RecordedNode)> {
    let session = Session(fields.get("session")?.parse().ok()?);
    let recorded = RecordedNode {
        seed: fields.get("seed")?.parse().ok()?,
        config: fields.remove("config")?,
        build: fields.remove("build")?,
        model: fields.remove("model_sha256"),
    };
    Some((Run { node, session }, recorded))
}
