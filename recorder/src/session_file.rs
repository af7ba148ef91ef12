//! The shape of a session file.
//!
//! An MCAP file in zstd chunks. On protobuf channels lies what people and tools read: every message in a schema of
//! ours that describes itself, named as its key (`tandem/<robot>/state`), and beside it, where tools draw by
//! themselves, Foxglove's standard schemas:
//!
//! | channel | schema | from |
//! | --- | --- | --- |
//! | `…/command`, `proposal`, `forecast`, `setpoint`, `state`, `scene`, `trial` | ours | the message of that name |
//! | `…/lease`, `estop` | ours | who wants to drive; who stopped the robot or cleared that |
//! | `…/counts` | ours | what was missed, unreadable or dropped, every second |
//! | `…/clock/<node>` | ours | what that node knows of its peers' clocks, every second |
//! | `…/frames` | `foxglove.FrameTransforms` | state: links, flange and tool in the base |
//! | `…/tool_pose` | `foxglove.PoseInFrame` | state |
//! | `…/forecast_path` | `foxglove.PosesInFrame` | forecast |
//! | `…/shapes` | `foxglove.SceneUpdate` | scene, forecast with its interval |
//! | `…/arm_points`, `scene_points`, `forecast_points` | `foxglove.PointCloud` | state, scene, forecast: the same for viewers that draw points but no shapes |
//! | `…/log` | `foxglove.Log` | trials, stops with their reason, losses |
//! | `…/journal/<node>` | bytes as they travelled | the journals, for executing the session again |
//!
//! What it takes to build a node again lies in a metadata record `tandem.node.<node>` and, for the model, in an
//! attachment named by its hash. `tandem.session` says whose session it is, `tandem.counts` what was lost (the last one
//! counts; `closed` says whether it is the end's), `tandem.part` in a later part which part it is.
//!
//! A message's `log_time` is its arrival at the recorder, its `publish_time` the sender's stamp, both counted from
//! the same wall-clock epoch: the sender's clock is its own, so across machines publish times carry its offset. The
//! timestamps inside Foxglove's messages are on the session's time axis, which in lockstep is `tick · period`.

mod cloud;
mod convert;
mod journal_schema;
mod losses;
mod schemas;
mod standard;

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{Seek, Write};
use std::sync::Arc;

use foxglove::Encode;
use foxglove::messages::Timestamp;
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, McapError, WriteOptions};
use sha2::{Digest, Sha256};
use tandem_wire::{
    Envelope, Happening, JournalBatch, JournalEntry, Nanos, NodeInfo, NodeName, Numbering, RobotName, SECOND, Scene,
    Seq, Session, Stamp, Topic,
};

use crate::heard::{Entry, Heard, JournalPart, Sample};
use crate::sinks::Drops;
use crate::tally::Counts;
use losses::Losses;

/// How the bytes on a journal channel are encoded.
pub const JOURNAL_ENCODING: &str = "x-tandem-wire-1";

/// What is lost is written down again at most this often: it ends a chunk.
const LOSSES_EVERY: Nanos = 10 * SECOND;
/// The record of what was received and lost.
pub(crate) const COUNTS: &str = "tandem.counts";
/// The record that a later part of a session has.
pub(crate) const PART: &str = "tandem.part";

/// Whose session it is, and where its time axis lies.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Provenance {
    /// Whose messages these are.
    pub robot: RobotName,
    /// Version and git revision of the recorder.
    pub build: String,
    /// The wall clock when the recorder's clock stood at zero, in nanoseconds since 1970.
    pub epoch_unix_nanos: u64,
}

/// Why a session file could not be written further.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The file could not take it.
    #[error("the session file cannot be written")]
    File(#[from] McapError),
    /// A message could not be encoded.
    #[error("channel {channel} cannot encode: {what}")]
    Encode {
        /// Which channel.
        channel: &'static str,
        /// What the encoder says.
        what: String,
    },
}

/// A session file being written.
pub struct SessionFile<W: Write + Seek> {
    writer: mcap::Writer<W>,
    provenance: Provenance,
    channels: BTreeMap<&'static str, u16>,
    journals: BTreeMap<NodeName, u16>,
    /// What was last written down as lost, and when.
    told: (Losses, Stamp),
    infos: BTreeMap<NodeName, NodeInfo>,
    /// The surroundings as last written: the arm's shape is part of them.
    scene: Option<Scene>,
    models: BTreeSet<[u8; 32]>,
    sequence: u32,
    messages: u64,
    buffer: Vec<u8>,
}

/// When a message happened, and which it is in its stream.
#[derive(Clone, Copy)]
struct Times {
    log: Nanos,
    publish: Nanos,
    sequence: u32,
    /// On the session's time axis, for Foxglove's messages.
    session: Timestamp,
}

impl<W: Write + Seek> SessionFile<W> {
    /// Begins a session file whose chunks are compressed and written once they reach `chunk_bytes`.
    ///
    /// # Errors
    /// If `to` cannot be written.
    pub fn begin(to: W, chunk_bytes: u64, provenance: Provenance) -> Result<Self, WriteError> {
        let options = WriteOptions::new()
            .compression(Some(Compression::Zstd))
            // Every chunk is written in one piece behind the last, so that what a crash leaves is a whole file cut short.
            .disable_seeking(true)
            // A pool of compressors costs megabytes and saves nothing at a few hundred kilobytes a second.
            .compression_threads(0)
            .chunk_size(Some(chunk_bytes))
            .library(concat!("tandem-recorder ", env!("CARGO_PKG_VERSION")));
        let mut file = Self {
            writer: options.create(to)?,
            provenance,
            channels: BTreeMap::new(),
            journals: BTreeMap::new(),
            told: (Losses::default(), Stamp(0)),
            infos: BTreeMap::new(),
            scene: None,
            models: BTreeSet::new(),
            sequence: 0,
            messages: 0,
            buffer: Vec::with_capacity(4096),
        };
        file.write_provenance()?;
        Ok(file)
    }

    /// Makes a file that was just begun the `number`th part of a session that has lasted until `at`: with `lasting`,
    /// what holds at its beginning (nodes, scene, trial, forecast), it can be read alone.
    ///
    /// The lasting messages stand on their channels once more, as arrived at `at`, and as they travelled on
    /// `journal/recorder`.
    ///
    /// # Errors
    /// If the file cannot take it.
    pub fn continue_session(&mut self, number: u32, at: Stamp, lasting: &[Arc<Heard>]) -> Result<(), WriteError> {
        let fields = BTreeMap::from([
            ("number".to_owned(), number.to_string()),
            ("begins_ns".to_owned(), at.0.to_string()),
        ]);
        self.write_metadata(PART.to_owned(), fields)?;
        let mut travelled = Vec::new();
        for heard in lasting {
            let Entry::Sample(sample) = &heard.entry else { continue };
            let heard = Heard {
                at,
                ..Heard::clone(heard)
            };
            self.write_sample(&heard, sample)?;
            travelled.extend(sample.travelled().map(|(topic, bytes)| JournalEntry {
                at,
                wall: at,
                what: Happening::Sample { topic, bytes },
            }));
        }
        if travelled.is_empty() {
            return Ok(());
        }
        let body = JournalBatch {
            first: 0,
            lost: 0,
            entries: travelled,
        };
        let part = JournalPart::of(NodeName::Recorder, &Numbering::new(Session(0)).envelope(at, 0, body));
        let sequence = Seq(number.into());
        let heard = Heard {
            at,
            session_time: at,
            tick: 0,
            entry: Entry::Sample(Sample::Journal(part)),
        };
        let Entry::Sample(Sample::Journal(part)) = &heard.entry else {
            return Ok(());
        };
        let times = self.times(&heard, at, sequence);
        self.put_journal(times, part)
    }

    /// Writes one thing that was heard; `drops` so far go with the counts.
    ///
    /// # Errors
    /// If the file cannot take it.
    pub fn write(&mut self, heard: &Heard, drops: Drops) -> Result<(), WriteError> {
        match &heard.entry {
            Entry::Sample(sample) => self.write_sample(heard, sample),
            Entry::Note(note) => {
                let times = self.own_times(heard);
                self.put("log", times, &standard::log_line(note, times.session))
            }
            Entry::Counts(counts) => {
                let times = self.own_times(heard);
                self.put("counts", times, &schemas::Counts::new(counts, drops))?;
                self.tell_losses(heard.at, counts, drops)
            }
        }
    }

    /// Ends the chunk and hands everything so far to the operating system, so that a crash cannot take it back.
    ///
    /// # Errors
    /// If the file cannot take it.
    pub fn flush(&mut self) -> Result<(), WriteError> {
        Ok(self.writer.flush()?)
    }

    /// Ends the file with what was lost, and returns how many messages it holds and what it was written to.
    ///
    /// # Errors
    /// If the file cannot take it.
    pub fn close(mut self, counts: &Counts, drops: Drops) -> Result<(u64, W), WriteError> {
        self.write_metadata(COUNTS.to_owned(), losses::fields(counts, drops, true))?;
        self.writer.finish()?;
        Ok((self.messages, self.writer.into_inner()))
    }

    /// Gives back what it was written to, as it is: after a failure, when no further byte may be written.
    #[must_use]
    pub fn abandon(self) -> W {
        self.writer.into_inner()
    }

    /// How many messages it holds. What was not flushed since may not survive a crash.
    #[must_use]
    pub const fn messages(&self) -> u64 {
        self.messages
    }

    /// Writes down what is lost so far if there is news, for the file may never be closed.
    fn tell_losses(&mut self, at: Stamp, counts: &Counts, drops: Drops) -> Result<(), WriteError> {
        let (told, when) = &self.told;
        let losses = Losses::new(counts, drops);
        if losses == *told || at.since(*when) < LOSSES_EVERY {
            return Ok(());
        }
        self.told = (losses, at);
        self.write_metadata(COUNTS.to_owned(), losses::fields(counts, drops, false))
    }

    fn write_sample(&mut self, heard: &Heard, sample: &Sample) -> Result<(), WriteError> {
        let header = sample.header();
        let times = self.times(heard, header.sent, header.seq);
        let time = times.session;
        match sample {
            Sample::Command(message) => self.put("command", times, &schemas::Command::from(message)),
            Sample::Proposal(message) => self.put("proposal", times, &schemas::Proposal::from(message)),
            Sample::Setpoint(message) => self.put("setpoint", times, &schemas::Setpoint::from(message.as_ref())),
            Sample::Trial(message) => self.put("trial", times, &schemas::Trial::from(message)),
            Sample::Claim(message) => self.put("lease", times, &schemas::Claim::from(message)),
            Sample::Emergency(message) => self.put("estop", times, &schemas::Emergency::from(message)),
            Sample::Forecast(message) => {
                self.put("forecast", times, &schemas::Forecast::from(message))?;
                self.put("forecast_points", times, &cloud::of_forecast(&message.body, time))?;
                self.put("forecast_path", times, &standard::forecast_path(&message.body, time))?;
                self.put("shapes", times, &standard::forecast_shapes(&message.body, time))
            }
            Sample::State(message) => {
                self.put("state", times, &schemas::State::from(message.as_ref()))?;
                self.put("frames", times, &standard::frames(&message.body, time))?;
                self.put("tool_pose", times, &standard::tool_pose(&message.body, time))?;
                match &self.scene {
                    Some(scene) => {
                        let points = cloud::of_arm(&scene.bodies, &message.body, time);
                        self.put("arm_points", times, &points)
                    }
                    None => Ok(()),
                }
            }
            Sample::Scene(message) => self.write_scene(times, message),
            Sample::Journal(part) => self.put_journal(times, part),
            Sample::Info(node, message) => self.keep_info(times, *node, &message.body),
            Sample::Clock(node, message) => {
                self.put(clock_channel(*node), times, &schemas::ClockReport::new(*node, message))
            }
        }
    }

    /// Every scene is written, its shapes only when they change: it is repeated every second.
    fn write_scene(&mut self, times: Times, message: &Envelope<Scene>) -> Result<(), WriteError> {
        self.put("scene", times, &schemas::Scene::from(message))?;
        if self.scene.as_ref() == Some(&message.body) {
            return Ok(());
        }
        self.scene = Some(message.body.clone());
        self.put("shapes", times, &standard::scene_shapes(&message.body, times.session))?;
        self.put("scene_points", times, &cloud::of_scene(&message.body, times.session))
    }

    fn put<T: Encode>(&mut self, channel: &'static str, times: Times, message: &T) -> Result<(), WriteError> {
        let id = self.channel::<T>(channel)?;
        self.buffer.clear();
        message.encode(&mut self.buffer).map_err(|error| WriteError::Encode {
            channel,
            what: error.to_string(),
        })?;
        self.writer
            .write_to_known_channel(&message_header(id, times), &self.buffer)?;
        self.messages += 1;
        Ok(())
    }

    fn put_journal(&mut self, times: Times, part: &JournalPart) -> Result<(), WriteError> {
        let id = match self.journals.get(&part.node) {
            Some(id) => *id,
            None => {
                let schema =
                    self.writer
                        .add_schema("tandem.JournalBatch", "text", journal_schema::text().as_bytes())?;
                let topic = Topic::Journal(part.node).key(&self.provenance.robot);
                let id = self
                    .writer
                    .add_channel(schema, &topic, JOURNAL_ENCODING, &BTreeMap::new())?;
                self.journals.insert(part.node, id);
                id
            }
        };
        self.writer
            .write_to_known_channel(&message_header(id, times), &part.bytes)?;
        self.messages += 1;
        Ok(())
    }

    /// Writes a node's information once, and again when it changes: it is asked for more often than that.
    fn keep_info(&mut self, times: Times, node: NodeName, info: &NodeInfo) -> Result<(), WriteError> {
        if self.infos.get(&node) == Some(info) {
            return Ok(());
        }
        let mut fields = BTreeMap::from([
            ("session".to_owned(), info.session.0.to_string()),
            ("seed".to_owned(), info.seed.to_string()),
            ("build".to_owned(), info.build.clone()),
            ("config".to_owned(), info.config.clone()),
        ]);
        if !info.model.is_empty() {
            let hash: [u8; 32] = Sha256::digest(&info.model).into();
            fields.insert("model_sha256".to_owned(), hex(&hash));
            self.attach_model(times, hash, &info.model)?;
        }
        self.write_metadata(format!("tandem.node.{node}"), fields)?;
        self.infos.insert(node, info.clone());
        Ok(())
    }

    fn attach_model(&mut self, times: Times, hash: [u8; 32], model: &[u8]) -> Result<(), WriteError> {
        if self.models.insert(hash) {
            self.writer.attach(&Attachment {
                log_time: times.log,
                create_time: times.log,
                name: format!("model-{}.cesn", hex(&hash[..8])),
                media_type: "application/octet-stream".to_owned(),
                data: Cow::Borrowed(model),
            })?;
        }
        Ok(())
    }

    fn write_provenance(&mut self) -> Result<(), WriteError> {
        let fields = BTreeMap::from([
            ("robot".to_owned(), self.provenance.robot.to_string()),
            ("recorder_build".to_owned(), self.provenance.build.clone()),
            (
                "epoch_unix_nanos".to_owned(),
                self.provenance.epoch_unix_nanos.to_string(),
            ),
            ("layout_version".to_owned(), tandem_wire::codec::VERSION.to_string()),
        ]);
        self.write_metadata("tandem.session".to_owned(), fields)
    }

    fn write_metadata(&mut self, name: String, metadata: BTreeMap<String, String>) -> Result<(), WriteError> {
        Ok(self.writer.write_metadata(&Metadata { name, metadata })?)
    }

    fn channel<T: Encode>(&mut self, name: &'static str) -> Result<u16, WriteError> {
        if let Some(id) = self.channels.get(name) {
            return Ok(*id);
        }
        let schema = T::get_schema().expect("every type that is put on a channel derives its schema");
        let schema = self.writer.add_schema(&schema.name, &schema.encoding, &schema.data)?;
        let topic = format!("{}/{}/{name}", tandem_wire::keys::ROOT, self.provenance.robot);
        let encoding = T::get_message_encoding();
        let id = self.writer.add_channel(schema, &topic, &encoding, &BTreeMap::new())?;
        self.channels.insert(name, id);
        Ok(id)
    }

    /// The times of what the recorder itself says.
    fn own_times(&mut self, heard: &Heard) -> Times {
        self.sequence = self.sequence.wrapping_add(1);
        self.times(heard, heard.at, Seq(self.sequence.into()))
    }

    fn times(&self, heard: &Heard, sent: Stamp, seq: Seq) -> Times {
        let epoch = self.provenance.epoch_unix_nanos;
        Times {
            log: epoch.saturating_add(heard.at.0),
            publish: epoch.saturating_add(sent.0),
            sequence: u32::try_from(seq.0 & u64::from(u32::MAX)).expect("masked to 32 bits"),
            session: standard::timestamp(epoch.saturating_add(heard.session_time.0)),
        }
    }
}

/// A channel's name is known when the program is built.
const fn clock_channel(node: NodeName) -> &'static str {
    match node {
        NodeName::Operator => "clock/operator",
        NodeName::Predictor => "clock/predictor",
        NodeName::Arbiter => "clock/arbiter",
        NodeName::RobotSim => "clock/robot-sim",
        NodeName::Recorder => "clock/recorder",
    }
}

fn message_header(channel_id: u16, times: Times) -> MessageHeader {
    MessageHeader {
        channel_id,
        sequence: times.sequence,
        log_time: times.log,
        publish_time: times.publish,
    }
}

pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
