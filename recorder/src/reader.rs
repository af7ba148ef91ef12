//! Reads a session file back, whole or damaged.
//!
//! Two things are put together. The protobuf channels say *when* every message reached the recorder; the journals hold
//! its *bytes as they travelled*. A message is played and exported from its bytes, because those are exact, checked by
//! the same decoder as live traffic, and independent of how the protobuf schemas grow. A message that stands in a
//! journal but never reached the recorder is put where it belongs by its sender's stamp and the smallest delay that
//! messages of that sender had.
//!
//! Reading is total: of a file that was cut anywhere, or holds chunks that cannot be unpacked, what can be read is
//! read, and [`Recording::damage`] says what is missing. The whole file is held in memory once, and every message once
//! more.

mod protobuf;
mod records;
mod repair;

use std::collections::{BTreeMap, BTreeSet};

use mcap::records::Record;
use tandem_wire::{Happening, Header, JournalBatch, Nanos, NodeName, RobotName, Session, Stamp, Topic, decode, keys};

use crate::heard::{JournalPart, Level};
use crate::session_file::{COUNTS, JOURNAL_ENCODING, PART};
use crate::tally::{Counts, Tally};

pub use records::{Damage, ReadError};
pub use repair::{RepairError, Repaired, repair};

/// A session as its file holds it.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    /// Whose session it is.
    pub robot: Option<RobotName>,
    /// Version and git revision of the recorder.
    pub recorder_build: String,
    /// The wall clock at the recorder's zero, in nanoseconds since 1970.
    pub epoch_unix_nanos: u64,
    /// What it takes to build the nodes again.
    pub nodes: BTreeMap<NodeName, NodeRecord>,
    /// The attached model files by name.
    pub models: BTreeMap<String, Vec<u8>>,
    /// Every message that can be played, by arrival; equal arrivals in the order of the file.
    pub messages: Vec<Recorded>,
    /// What the recorder noted for people.
    pub notes: Vec<Noted>,
    /// Every channel of the file.
    pub channels: Vec<ChannelRead>,
    /// What was received and missed, counted anew from the file.
    pub counts: Counts,
    /// What the recorder wrote last of what it received and lost; `closed` says whether that was at the end. Empty if it
    /// never did.
    pub closing: BTreeMap<String, String>,
    /// Which part of its session the first file read is, if it is not the first.
    pub first_part: Option<String>,
    /// What is missing from the file or cannot be read.
    pub damage: Vec<Damage>,
}

/// One message as it travelled.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// When it reached the recorder, by the recorder's clock.
    pub at: Stamp,
    /// On which topic.
    pub topic: Topic,
    /// Its header.
    pub header: Header,
    /// Its bytes, header included.
    pub bytes: Vec<u8>,
}

/// What the file knows of a node.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NodeRecord {
    /// Its run.
    pub session: String,
    /// The seed of its random numbers.
    pub seed: String,
    /// Version and git revision.
    pub build: String,
    /// Its configuration, as TOML.
    pub config: String,
    /// SHA-256 of its model, in hexadecimal digits, if it has one.
    pub model_sha256: Option<String>,
}

/// A line for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Noted {
    /// When, by the recorder's clock.
    pub at: Stamp,
    /// How much it matters.
    pub level: Level,
    /// Which node it is about.
    pub about: String,
    /// The words.
    pub text: String,
}

/// A channel and what is on it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ChannelRead {
    /// The channel's topic, `tandem/<robot>/…` for ours.
    pub topic: String,
    /// How its messages are encoded.
    pub encoding: String,
    /// How many messages it holds.
    pub messages: u64,
    /// The first arrival, in nanoseconds since 1970.
    pub first: Nanos,
    /// The last one.
    pub last: Nanos,
}

impl ChannelRead {
    /// Messages a second between the first and the last; `None` for fewer than two.
    #[must_use]
    pub fn rate_hz(&self) -> Option<f64> {
        let span = tandem_wire::seconds(self.last.saturating_sub(self.first));
        (self.messages > 1 && span > 0.0).then(|| (self.messages - 1) as f64 / span)
    }
}

impl Recording {
    /// Reads the bytes of a session file.
    ///
    /// # Errors
    /// If there is no session in it at all. What is merely damaged is read as far as it goes.
    pub fn read(file: &[u8]) -> Result<Self, ReadError> {
        let mut parts = PartsReader::default();
        parts.add(file)?;
        parts.finish()
    }
}

/// Reads the parts of one session together, in their order. One part is held in memory at a time.
#[derive(Default)]
pub struct PartsReader {
    gathering: Gathering,
    parts: usize,
    damage: Vec<(usize, Damage)>,
}

impl PartsReader {
    /// Reads the next part. A part of another session is left out, which is said as [`Damage::OtherSession`].
    ///
    /// # Errors
    /// If it is no MCAP file; then what was read before stands as it was.
    pub fn add(&mut self, file: &[u8]) -> Result<(), ReadError> {
        let gathering = &mut self.gathering;
        gathering.begin_part(self.parts > 0);
        records::summary(file, |record| gathering.introduce(&record));
        let damage = records::walk(file, |record| gathering.take(record))?;
        self.parts += 1;
        let number = self.parts;
        if gathering.is_stranger {
            self.damage.push((number, Damage::OtherSession));
        } else {
            self.damage.extend(damage.into_iter().map(|damage| (number, damage)));
        }
        Ok(())
    }

    /// Puts together what was read.
    ///
    /// # Errors
    /// If there is no session in it at all.
    pub fn finish(self) -> Result<Recording, ReadError> {
        let is_whole = self.parts < 2;
        let place = |(part, damage)| match is_whole {
            true => damage,
            false => Damage::InPart {
                part,
                what: Box::new(damage),
            },
        };
        let damage = self.damage.into_iter().map(place).collect();
        let recording = self.gathering.assemble(damage);
        let is_session = recording.robot.is_some() || !recording.messages.is_empty();
        is_session.then_some(recording).ok_or(ReadError::NoSession)
    }
}

/// What is collected while the file is walked through.
#[derive(Default)]
struct Gathering {
    recording: Recording,
    channels: BTreeMap<u16, Known>,
    heard: Vec<(Nanos, Topic, Header)>,
    bodies: BTreeMap<(Topic, Session, u64), Vec<u8>>,
    tally: Tally,
    unknown: u64,
    unreadable_journals: u64,
    layout: Option<String>,
    /// Not the first file that is read.
    is_later: bool,
    /// The file belongs to another session.
    is_stranger: bool,
    /// When this part begins, in nanoseconds since 1970, if it is a later one of its session.
    begins: Option<Nanos>,
    /// What lasts, and so stands at the beginning of every part.
    lasting: BTreeSet<(Topic, Session, u64)>,
}

#[derive(Clone, Copy)]
struct Known {
    index: usize,
    kind: Kind,
}

#[derive(Clone, Copy)]
enum Kind {
    Message(Topic),
    Journal(NodeName),
    Log,
    Other,
}

impl Gathering {
    /// Another file numbers its channels anew.
    fn begin_part(&mut self, is_later: bool) {
        self.channels.clear();
        (self.is_later, self.is_stranger, self.begins) = (is_later, false, None);
    }

    fn take(&mut self, record: Record<'_>) {
        match record {
            _ if self.is_stranger => {}
            Record::Message { header, data } => self.message(&header, &data),
            Record::Metadata(metadata) => self.metadata(&metadata.name, metadata.metadata),
            Record::Attachment { header, data, .. } => {
                self.recording.models.insert(header.name, data.into_owned());
            }
            record => self.introduce(&record),
        }
    }

    fn introduce(&mut self, record: &Record<'_>) {
        let Record::Channel(channel) = record else { return };
        if self.channels.contains_key(&channel.id) || self.is_stranger {
            return;
        }
        let parsed = keys::parse(&channel.topic);
        if self.recording.robot.is_none() {
            self.recording.robot = parsed.as_ref().map(|(robot, _)| robot.clone());
        }
        let kind = match parsed {
            Some((_, Topic::Journal(node))) if channel.message_encoding == JOURNAL_ENCODING => Kind::Journal(node),
            Some((_, topic)) if is_played(topic) => Kind::Message(topic),
            None if channel.topic.starts_with(keys::ROOT) && channel.topic.ends_with("/log") => Kind::Log,
            _ => Kind::Other,
        };
        let same = |known: &ChannelRead| known.topic == channel.topic && known.encoding == channel.message_encoding;
        let known = self.recording.channels.iter().position(same);
        let index = known.unwrap_or(self.recording.channels.len());
        self.channels.insert(channel.id, Known { index, kind });
        if known.is_some() {
            return;
        }
        self.recording.channels.push(ChannelRead {
            topic: channel.topic.clone(),
            encoding: channel.message_encoding.clone(),
            ..ChannelRead::default()
        });
    }

    fn message(&mut self, header: &mcap::records::MessageHeader, data: &[u8]) {
        let Some(known) = self.channels.get(&header.channel_id).copied() else {
            self.unknown += 1;
            return;
        };
        if let Kind::Message(topic) = known.kind
            && is_lasting(topic)
            && self.is_repeated(topic, header.log_time, data)
        {
            return;
        }
        if let Some(channel) = self.recording.channels.get_mut(known.index) {
            let first = if channel.messages == 0 {
                header.log_time
            } else {
                channel.first
            };
            channel.first = first.min(header.log_time);
            channel.last = channel.last.max(header.log_time);
            channel.messages += 1;
        }
        match known.kind {
            Kind::Message(topic) => {
                if let Some(read) = protobuf::header(data) {
                    self.tally.count(topic, &read);
                    self.heard.push((header.log_time, topic, read));
                }
            }
            Kind::Journal(node) => self.journal(node, data),
            Kind::Log => {
                let (level, about, text) = protobuf::log_line(data);
                // The epoch may not be known yet: made relative at the end.
                let at = Stamp(header.log_time);
                self.recording.notes.push(Noted { at, level, about, text });
            }
            Kind::Other => {}
        }
    }

    /// Whether this only stands here so that the part can be read alone, and was read before.
    fn is_repeated(&mut self, topic: Topic, log_time: Nanos, data: &[u8]) -> bool {
        let Some(header) = protobuf::header(data) else {
            return false;
        };
        let is_new = self.lasting.insert((topic, header.session, header.seq.0));
        self.is_later && !is_new && self.begins == Some(log_time)
    }

    fn journal(&mut self, node: NodeName, bytes: &[u8]) {
        let Ok(batch) = decode::<JournalBatch>(bytes) else {
            self.unreadable_journals += 1;
            return;
        };
        // The recorder's own holds what lasts when a part begins, and no part of it can be missing.
        if node != NodeName::Recorder {
            self.tally.count_journal(&JournalPart {
                node,
                header: batch.header,
                first: batch.body.first,
                entries: batch.body.entries.len() as u64,
                lost: batch.body.lost,
                bytes: Vec::new(),
            });
        }
        for entry in batch.body.entries {
            let (Happening::Sample { topic, bytes } | Happening::Output { topic, bytes }) = entry.what else {
                continue;
            };
            if let (true, Ok((_, header))) = (is_played(topic), tandem_wire::codec::peek(&bytes)) {
                self.bodies
                    .entry((topic, header.session, header.seq.0))
                    .or_insert(bytes);
            }
        }
    }

    fn metadata(&mut self, name: &str, mut fields: BTreeMap<String, String>) {
        let mut take = |key: &str| fields.remove(key).unwrap_or_default();
        match name {
            "tandem.session" => {
                let epoch = take("epoch_unix_nanos").parse().unwrap_or(0);
                if self.is_later && epoch != self.recording.epoch_unix_nanos {
                    self.is_stranger = true;
                    return;
                }
                self.recording.epoch_unix_nanos = epoch;
                self.recording.robot = take("robot").parse().ok().or(self.recording.robot.take());
                self.recording.recorder_build = take("recorder_build");
                self.layout = Some(take("layout_version"));
            }
            COUNTS => self.recording.closing = fields,
            PART => {
                self.recording.first_part.get_or_insert(take("number"));
                let begins: Option<Nanos> = take("begins_ns").parse().ok();
                self.begins = begins.map(|begins| self.recording.epoch_unix_nanos.saturating_add(begins));
            }
            _ => {
                let node = name.strip_prefix("tandem.node.");
                let node = node.and_then(|name| NodeName::ALL.into_iter().find(|node| node.as_str() == name));
                if let Some(node) = node {
                    let record = NodeRecord {
                        session: take("session"),
                        seed: take("seed"),
                        build: take("build"),
                        config: take("config"),
                        model_sha256: Some(take("model_sha256")).filter(|hash| !hash.is_empty()),
                    };
                    self.recording.nodes.insert(node, record);
                }
            }
        }
    }

    fn assemble(mut self, damage: Vec<Damage>) -> Recording {
        let first = self.heard.iter().map(|(log, ..)| *log).min().unwrap_or(0);
        if self.recording.epoch_unix_nanos == 0 {
            self.recording.epoch_unix_nanos = first;
        }
        let epoch = self.recording.epoch_unix_nanos;
        for note in &mut self.recording.notes {
            note.at.0 = note.at.0.saturating_sub(epoch);
        }
        self.recording.damage = damage;
        let without_body = self.join(epoch);
        self.recording.counts = self.tally.counts();
        let mut damaged = |is_so: bool, what: Damage| self.recording.damage.extend(is_so.then_some(what));
        damaged(self.unknown > 0, Damage::UnknownChannel { messages: self.unknown });
        let parts = self.unreadable_journals;
        damaged(parts > 0, Damage::Journal { parts });
        damaged(without_body > 0, Damage::WithoutBody { messages: without_body });
        if let Some(version) = self.layout
            && version != tandem_wire::codec::VERSION.to_string()
        {
            damaged(true, Damage::OtherLayout { version });
        }
        self.recording
    }

    /// Gives every message its arrival, and says how many have no bytes. A repeated message counts once.
    fn join(&mut self, epoch: Nanos) -> u64 {
        let mut without_body = 0;
        let mut delays = BTreeMap::<Session, Nanos>::new();
        let mut done = BTreeSet::new();
        for (log, topic, header) in &self.heard {
            let at = Stamp(log.saturating_sub(epoch));
            let delay = at.0.saturating_sub(header.sent.0);
            let least = delays.entry(header.session).or_insert(delay);
            *least = delay.min(*least);
            let id = (*topic, header.session, header.seq.0);
            if !done.insert(id) {
                continue;
            }
            self.tally.time(at, *topic, header);
            match self.bodies.remove(&id) {
                Some(bytes) => self.recording.messages.push(Recorded {
                    at,
                    topic: *topic,
                    header: *header,
                    bytes,
                }),
                None => without_body += 1,
            }
        }
        // What is left was never heard: its sender's stamp says where it belongs.
        for ((topic, session, _), bytes) in std::mem::take(&mut self.bodies) {
            if let (Some(delay), Ok((_, header))) = (delays.get(&session), tandem_wire::codec::peek(&bytes)) {
                self.recording.messages.push(Recorded {
                    at: header.sent.after(*delay),
                    topic,
                    header,
                    bytes,
                });
            }
        }
        self.recording.messages.sort_by_key(|message| message.at);
        without_body
    }
}

/// What holds until the next of its kind, and so is repeated at the beginning of every part.
const fn is_lasting(topic: Topic) -> bool {
    matches!(topic, Topic::Scene | Topic::Trial | Topic::Forecast)
}

/// What is a message of the loop, as opposed to what is about it.
const fn is_played(topic: Topic) -> bool {
    matches!(
        topic,
        Topic::Command
            | Topic::Proposal
            | Topic::Forecast
            | Topic::Setpoint
            | Topic::State
            | Topic::Scene
            | Topic::Trial
    )
}
