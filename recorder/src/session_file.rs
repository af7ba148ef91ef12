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

mod channels;
mod cloud;
mod convert;
mod journal_schema;
mod losses;
mod nodes;
mod part;
mod samples;
mod schemas;
mod standard;
mod times;

use std::collections::BTreeMap;
use std::io::{Seek, Write};
use std::sync::Arc;

use mcap::McapError;
use tandem_wire::{Nanos, RobotName, SECOND, Scene, Seq, Stamp};

use crate::heard::{Entry, Heard};
use crate::sinks::Drops;
use crate::tally::Counts;
use channels::Channels;
pub(crate) use losses::COUNTS;
use losses::Losses;
use nodes::Nodes;
pub(crate) use part::PART;
use times::Times;

/// How the bytes on a journal channel are encoded.
pub const JOURNAL_ENCODING: &str = "x-tandem-wire-1";

/// What is lost is written down again at most this often: it ends a chunk.
const LOSSES_EVERY: Nanos = 10 * SECOND;

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

impl Provenance {
    fn fields(&self) -> BTreeMap<String, String> {
        BTreeMap::from([
            ("robot".to_owned(), self.robot.to_string()),
            ("recorder_build".to_owned(), self.build.clone()),
            ("epoch_unix_nanos".to_owned(), self.epoch_unix_nanos.to_string()),
            ("layout_version".to_owned(), tandem_wire::codec::VERSION.to_string()),
        ])
    }
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
    channels: Channels<W>,
    epoch_unix_nanos: u64,
    nodes: Nodes,
    /// The surroundings as last written: the arm's shape is part of them.
    scene: Option<Scene>,
    /// What was last written down as lost, and when.
    told: (Losses, Stamp),
    /// Messages of the recorder's own.
    sequence: u32,
}

impl<W: Write + Seek> SessionFile<W> {
    /// Begins a session file whose chunks are compressed and written once they reach `chunk_bytes`.
    ///
    /// # Errors
    /// If `to` cannot be written.
    pub fn begin(to: W, chunk_bytes: u64, provenance: Provenance) -> Result<Self, WriteError> {
        let mut channels = Channels::begin(to, chunk_bytes, provenance.robot.clone())?;
        channels.write_metadata("tandem.session".to_owned(), provenance.fields())?;
        Ok(Self {
            channels,
            epoch_unix_nanos: provenance.epoch_unix_nanos,
            nodes: Nodes::default(),
            scene: None,
            told: (Losses::default(), Stamp(0)),
            sequence: 0,
        })
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
        self.channels
            .write_metadata(PART.to_owned(), part::fields(number, at))?;
        for heard in part::renewed(at, lasting) {
            if let Entry::Sample(sample) = &heard.entry {
                self.write_sample(&heard, sample)?;
            }
        }
        let Some(part) = part::journal(at, lasting) else {
            return Ok(());
        };
        let times = Times::new(self.epoch_unix_nanos, at, at, at, Seq(number.into()));
        self.channels.put_journal(times, &part)
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
                let line = standard::log_line(note, times.session);
                self.channels.put("log", times, &line)
            }
            Entry::Counts(counts) => {
                let times = self.own_times(heard);
                let row = schemas::Counts::new(counts, drops);
                self.channels.put("counts", times, &row)?;
                self.tell_losses(heard.at, counts, drops)
            }
        }
    }

    /// Ends the chunk and hands everything so far to the operating system, so that a crash cannot take it back.
    ///
    /// # Errors
    /// If the file cannot take it.
    pub fn flush(&mut self) -> Result<(), WriteError> {
        self.channels.flush()
    }

    /// Ends the file with what was lost, and returns how many messages it holds and what it was written to.
    ///
    /// # Errors
    /// If the file cannot take it.
    pub fn close(mut self, counts: &Counts, drops: Drops) -> Result<(u64, W), WriteError> {
        let fields = losses::fields(counts, drops, true);
        self.channels.write_metadata(COUNTS.to_owned(), fields)?;
        Ok((self.channels.messages(), self.channels.finish()?))
    }

    /// Gives back what it was written to, as it is: after a failure, when no further byte may be written.
    #[must_use]
    pub fn abandon(self) -> W {
        self.channels.abandon()
    }

    /// How many messages it holds. What was not flushed since may not survive a crash.
    #[must_use]
    pub const fn messages(&self) -> u64 {
        self.channels.messages()
    }

    /// Writes down what is lost so far if there is news, for the file may never be closed.
    fn tell_losses(&mut self, at: Stamp, counts: &Counts, drops: Drops) -> Result<(), WriteError> {
        let (told, when) = &self.told;
        let losses = Losses::new(counts, drops);
        if losses == *told || at.since(*when) < LOSSES_EVERY {
            return Ok(());
        }
        self.told = (losses, at);
        let fields = losses::fields(counts, drops, false);
        self.channels.write_metadata(COUNTS.to_owned(), fields)
    }

    /// The times of what the recorder itself says.
    fn own_times(&mut self, heard: &Heard) -> Times {
        self.sequence = self.sequence.wrapping_add(1);
        self.times(heard, heard.at, Seq(self.sequence.into()))
    }

    fn times(&self, heard: &Heard, sent: Stamp, seq: Seq) -> Times {
        Times::new(self.epoch_unix_nanos, heard.at, heard.session_time, sent, seq)
    }
}

pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
