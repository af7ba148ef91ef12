//! What is collected while files are walked through, and how it is put together.

use std::collections::{BTreeMap, BTreeSet};

use mcap::records::Record;
use tandem_wire::{Happening, Header, JournalBatch, Nanos, NodeName, Seq, Session, Stamp, Topic, decode, keys};

use super::damage::Damage;
use super::records::Spot;
use super::{ChannelRead, Keep, NodeRecord, Noted, OffsetRead, PLAYED, Place, Recorded, Recording, protobuf};
use crate::heard::JournalPart;
use crate::session_file::{COUNTS, JOURNAL_ENCODING, PART};
use crate::tally::Tally;

/// What is collected while the file is walked through.
#[derive(Default)]
pub(super) struct Gathering<B> {
    recording: Recording<B>,
    channels: BTreeMap<u16, Known>,
    heard: Vec<(Nanos, Topic, Header)>,
    /// `None` once its message has them.
    bodies: BTreeMap<(Topic, Session, u64), Option<Body<B>>>,
    tally: Tally,
    unknown: u64,
    unreadable_journals: u64,
    layout: Option<String>,
    /// Which file is read, from 0.
    part: u16,
    /// The file belongs to another session.
    is_stranger: bool,
    /// When this part begins, in nanoseconds since 1970, if it is a later one of its session.
    begins: Option<Nanos>,
    /// What lasts, and so stands at the beginning of every part.
    lasting: BTreeSet<(Topic, Session, u64)>,
}

/// What a journal holds of a message, and its header but for what the message is found by.
struct Body<B> {
    tick: u32,
    sent: Stamp,
    kept: B,
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
    Clocks,
    Log,
    Other,
}

impl<B: Keep> Gathering<B> {
    /// Another file numbers its channels anew.
    pub(super) fn begin_part(&mut self, part: u16) {
        self.channels.clear();
        (self.part, self.is_stranger, self.begins) = (part, false, None);
    }

    pub(super) const fn is_stranger(&self) -> bool {
        self.is_stranger
    }

    pub(super) fn take(&mut self, spot: Spot, record: Record<'_>) {
        match record {
            _ if self.is_stranger => {}
            Record::Message { header, data } => self.message(spot, &header, &data),
            Record::Metadata(metadata) => self.metadata(&metadata.name, metadata.metadata),
            Record::Attachment { header, data, .. } => {
                self.recording.models.insert(header.name, data.into_owned());
            }
            record => self.introduce(&record),
        }
    }

    pub(super) fn introduce(&mut self, record: &Record<'_>) {
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
            Some((_, topic)) if PLAYED.contains(&topic) => Kind::Message(topic),
            Some((_, Topic::Clock(NodeName::Recorder))) => Kind::Clocks,
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

    fn message(&mut self, spot: Spot, header: &mcap::records::MessageHeader, data: &[u8]) {
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
            Kind::Journal(node) => self.journal(node, spot, data),
            Kind::Clocks => {
                // The epoch may not be known yet: made relative at the end.
                let at = Stamp(header.log_time);
                let offsets = protobuf::clocks(data).map(|(session, offset, uncertainty)| OffsetRead {
                    at,
                    session,
                    offset,
                    uncertainty,
                });
                self.recording.offsets.extend(offsets);
            }
            Kind::Log => {
                let (level, about, text) = protobuf::log_line(data);
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
        self.part > 0 && !is_new && self.begins == Some(log_time)
    }

    fn journal(&mut self, node: NodeName, spot: Spot, bytes: &[u8]) {
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
        for (entry, index) in batch.body.entries.into_iter().zip(0..) {
            let (Happening::Sample { topic, bytes } | Happening::Output { topic, bytes }) = entry.what else {
                continue;
            };
            if let (true, Ok((_, header))) = (PLAYED.contains(&topic), tandem_wire::codec::peek(&bytes)) {
                let place = Place::new(self.part, spot, index);
                self.bodies
                    .entry((topic, header.session, header.seq.0))
                    .or_insert_with(|| {
                        Some(Body {
                            tick: header.tick,
                            sent: header.sent,
                            kept: B::keep(bytes, place),
                        })
                    });
            }
        }
    }

    fn metadata(&mut self, name: &str, mut fields: BTreeMap<String, String>) {
        let mut take = |key: &str| fields.remove(key).unwrap_or_default();
        match name {
            "tandem.session" => {
                let epoch = take("epoch_unix_nanos").parse().unwrap_or(0);
                if self.part > 0 && epoch != self.recording.epoch_unix_nanos {
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

    pub(super) fn assemble(mut self, damage: Vec<Damage>) -> Recording<B> {
        let first = self.heard.iter().map(|(log, ..)| *log).min().unwrap_or(0);
        if self.recording.epoch_unix_nanos == 0 {
            self.recording.epoch_unix_nanos = first;
        }
        let epoch = self.recording.epoch_unix_nanos;
        for note in &mut self.recording.notes {
            note.at.0 = note.at.0.saturating_sub(epoch);
        }
        for offset in &mut self.recording.offsets {
            offset.at.0 = offset.at.0.saturating_sub(epoch);
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
        let mut delays = BTreeMap::<Session, i128>::new();
        let mut without_body = BTreeSet::new();
        for (log, topic, header) in std::mem::take(&mut self.heard) {
            let at = Stamp(log.saturating_sub(epoch));
            let delay = i128::from(at.0) - i128::from(header.sent.0);
            let least = delays.entry(header.session).or_insert(delay);
            *least = delay.min(*least);
            let id = (topic, header.session, header.seq.0);
            let bytes = match self.bodies.get_mut(&id).map(Option::take) {
                Some(Some(body)) => Some(body.kept),
                None if without_body.insert(id) => None,
                // Heard before.
                _ => continue,
            };
            self.tally.time(at, topic, &header);
            self.recording.messages.extend(bytes.map(|bytes| Recorded {
                at,
                topic,
                header,
                bytes,
            }));
        }
        self.place_unheard(&delays);
        self.recording.messages.sort_by_key(|message| message.at);
        without_body.len() as u64
    }

    /// What stands in a journal and was never heard: its sender's stamp says where it belongs, by the least delay of what was
    /// heard of that sender; negative if its clock is ahead of the recorder's.
    fn place_unheard(&mut self, delays: &BTreeMap<Session, i128>) {
        for ((topic, session, seq), unheard) in std::mem::take(&mut self.bodies) {
            if let (Some(delay), Some(Body { tick, sent, kept })) = (delays.get(&session), unheard) {
                let header = Header {
                    tick,
                    session,
                    seq: Seq(seq),
                    sent,
                };
                self.recording.messages.push(Recorded {
                    at: Stamp(u64::try_from(i128::from(sent.0) + delay).unwrap_or(0)),
                    topic,
                    header,
                    bytes: kept,
                });
            }
        }
    }
}

/// What holds until the next of its kind, and so is repeated at the beginning of every part.
const fn is_lasting(topic: Topic) -> bool {
    matches!(topic, Topic::Scene | Topic::Trial | Topic::Forecast)
}
