//! Drawings into Rerun recordings, one for each trial, through one outlet; and the `.rrd` file as a sink.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use rerun::log::{ChunkBatcherConfig, LogMsg, PendingRow};
use rerun::sink::{FileSink, FileSinkOptions, GrpcSink, GrpcSinkConnectionState, LogSink, SinkFlushError};
use rerun::{RecordingStream, RecordingStreamBuilder, TimePoint};
use tandem_wire::Timing;

use super::disk;
use super::feed::Sink;
use super::shared::Shared;
use super::{Notice, OpenError};
use crate::config::{Purpose, RecorderConfig};
use crate::heard::Heard;
use crate::session_file::Provenance;
use crate::view::layout::{self, Arrives, Fit, Layout};
use crate::view::{Drawing, Meshes, Trials, View};

/// What Rerun shows as the application.
const APPLICATION: &str = "tandem";
/// How long rows may wait to be sent together to a viewer. Every batch of an entity costs about a kilobyte of its own,
/// so at 50 Hz the SDK's eight milliseconds would send more envelope than letter; a tenth of a second nobody notices.
const LIVE_BATCH: Duration = Duration::from_millis(100);
/// The same for a file: larger batches make it and its index smaller, and a second is what a crash may cost.
pub(super) const FILE_BATCH: Duration = Duration::from_secs(1);
/// What may be on its way inside the SDK. Its default of 100 MiB would be most of our memory while a viewer is frozen.
const IN_FLIGHT_BYTES: u64 = 4 << 20;

/// What it takes to begin to show.
#[derive(Clone)]
pub(super) struct Show {
    pub(super) timing: Timing,
    pub(super) provenance: Provenance,
    pub(super) purpose: Purpose,
    pub(super) meshes: Option<Meshes>,
}

/// A view that is drawn into recordings.
pub(super) struct StreamSink {
    outlet: Outlet,
    batch: Duration,
    provenance: Provenance,
    purpose: Purpose,
    shared: Arc<Shared>,
    trials: Trials,
    view: View,
    drawings: Vec<Drawing>,
    /// The running trial's; before the first, what comes before it.
    stream: Option<RecordingStream>,
    layout: Laid,
}

/// Which layout was sent.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Laid {
    Nothing,
    /// The usual one, until the robot has told what is around it.
    Guessed,
    Fitted(Fit),
}

/// A stream to a viewer.
pub(super) struct Connected {
    pub(super) sink: StreamSink,
    pub(super) connection: Connection,
}

/// The connection behind it.
pub(super) struct Connection(Arc<GrpcSink>);

impl Connection {
    pub(super) fn is_lost(&self) -> bool {
        matches!(self.0.status(), GrpcSinkConnectionState::Disconnected(_))
    }
}

/// What several recordings share. The SDK wants a sink for each; this one passes on.
#[derive(Clone)]
struct Outlet(Arc<dyn LogSink>);

impl LogSink for Outlet {
    fn send(&self, msg: LogMsg) {
        self.0.send(msg);
    }

    fn send_all(&self, messages: Vec<LogMsg>) {
        self.0.send_all(messages);
    }

    fn flush_blocking(&self, timeout: Duration) -> Result<(), SinkFlushError> {
        self.0.flush_blocking(timeout)
    }
}

impl StreamSink {
    /// An `.rrd` file. Its index, if any, is kept in memory until the end.
    pub(super) fn save(
        path: &Path,
        config: &RecorderConfig,
        show: &Show,
        shared: Arc<Shared>,
    ) -> Result<Self, OpenError> {
        // The SDK's own error does not tell a missing folder from a missing permission.
        disk::create(path, config.overwrites).map_err(|source| OpenError::Recording {
            path: path.to_owned(),
            source,
        })?;
        let options = FileSinkOptions {
            write_footer: config.rrd_index,
        };
        let file = FileSink::with_options(path, options).map_err(|source| OpenError::View {
            source: Box::new(source.into()),
        })?;
        Ok(Self::new(Arc::new(file), FILE_BATCH, show, shared))
    }

    /// A viewer's address.
    pub(super) fn connect(url: &str, show: &Show, shared: Arc<Shared>) -> Result<Connected, Notice> {
        let uri = url.parse().map_err(|error| failed(&error))?;
        let grpc = Arc::new(GrpcSink::new(uri));
        let connection = Connection(Arc::clone(&grpc));
        let sink = Self::new(grpc, LIVE_BATCH, show, shared);
        Ok(Connected { sink, connection })
    }

    fn new(outlet: Arc<dyn LogSink>, batch: Duration, show: &Show, shared: Arc<Shared>) -> Self {
        Self {
            outlet: Outlet(outlet),
            batch,
            provenance: show.provenance.clone(),
            purpose: show.purpose,
            shared,
            trials: Trials::default(),
            view: View::new(show.timing).with_meshes(show.meshes.clone()),
            drawings: Vec::with_capacity(64),
            stream: None,
            layout: Laid::Nothing,
        }
    }

    /// Begins the recording of a trial, or of what comes before the first.
    fn begin_recording(&mut self, number: Option<u32>, heard: &Heard) -> Result<(), Notice> {
        let Provenance {
            robot,
            epoch_unix_nanos,
            ..
        } = &self.provenance;
        // Whoever is shown the same trial again knows it by the same name: the file, the viewer that came back.
        let (id, name) = match number {
            Some(number) => {
                let id = format!("{robot}-{epoch_unix_nanos}-{number}-{}", heard.tick);
                (id, format!("{robot}, trial {number}"))
            }
            None => (
                format!("{robot}-{epoch_unix_nanos}"),
                format!("{robot}, before the trial"),
            ),
        };
        let config = ChunkBatcherConfig {
            flush_tick: self.batch,
            max_bytes_in_flight: IN_FLIGHT_BYTES,
            ..ChunkBatcherConfig::DEFAULT
        };
        let stream = RecordingStreamBuilder::new(APPLICATION)
            .recording_id(id)
            .recording_name(name)
            .batcher_config(config)
            .buffered()
            .map_err(|error| failed(&error))?;
        stream.set_sink(Box::new(self.outlet.clone()));
        if self.layout == Laid::Nothing {
            self.layout = Laid::Guessed;
            self.send_layout(&stream, Fit::default(), Arrives::AtOnce)?;
        }
        if let Some(before) = self.stream.replace(stream) {
            before.flush_async().map_err(|error| failed(&error))?;
        }
        for drawing in View::opening() {
            self.record(drawing);
        }
        Ok(())
    }

    /// Once the surroundings are known, the layout fits them. That comes within a second, before anybody has moved
    /// anything; when they change later, the layout that fits is kept for whoever resets theirs.
    fn fit_layout(&mut self) -> Result<(), Notice> {
        let (Some(fit), Some(stream)) = (self.view.fit(), self.stream.clone()) else {
            return Ok(());
        };
        let arrives = match self.layout {
            Laid::Fitted(before) if before == fit => return Ok(()),
            Laid::Fitted(_) => Arrives::OnReset,
            Laid::Nothing | Laid::Guessed => Arrives::AtOnce,
        };
        self.layout = Laid::Fitted(fit);
        self.send_layout(&stream, fit, arrives)
    }

    fn send_layout(&self, stream: &RecordingStream, fit: Fit, arrives: Arrives) -> Result<(), Notice> {
        let layout = Layout::Watching(self.purpose);
        layout::send(stream, layout, fit, arrives).map_err(|error| failed(&error))
    }

    fn record(&self, drawing: Drawing) {
        if let Some(stream) = &self.stream {
            let time = drawing.moment.map_or_else(TimePoint::default, TimePoint::from);
            let row = PendingRow::from_iter(time, drawing.batches);
            stream.record_row(drawing.path.into(), row, false);
        }
    }

    fn record_all(&mut self) {
        let mut drawings = std::mem::take(&mut self.drawings);
        for drawing in drawings.drain(..) {
            self.record(drawing);
        }
        self.drawings = drawings;
    }
}

impl Sink for StreamSink {
    fn take(&mut self, heard: &Arc<Heard>) -> Result<bool, Notice> {
        let begins = self.trials.hear(heard);
        if begins.is_some() || self.stream.is_none() {
            self.begin_recording(begins, heard)?;
            self.view.begin_recording(heard, &mut self.drawings);
        }
        self.view.draw(heard, self.shared.drops_for(heard), &mut self.drawings);
        self.record_all();
        self.fit_layout()?;
        Ok(true)
    }

    fn flush(&mut self) -> Result<(), Notice> {
        match &self.stream {
            Some(stream) => stream.flush_async().map_err(|error| failed(&error)),
            None => Ok(()),
        }
    }

    fn close(&mut self) -> Result<(), Notice> {
        match &self.stream {
            Some(stream) => stream.flush_blocking().map_err(|error| failed(&error)),
            None => Ok(()),
        }
    }
}

fn failed(error: &dyn std::error::Error) -> Notice {
    Notice::Failed {
        sink: "the Rerun view".to_owned(),
        why: error.to_string(),
    }
}

#[cfg(test)]
mod tests;
