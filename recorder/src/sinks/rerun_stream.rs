//! Drawings into a Rerun recording stream, and the `.rrd` file as a sink.

use std::fs::File;
use std::path::Path;
use std::time::Duration;

use rerun::log::{ChunkBatcherConfig, PendingRow};
use rerun::sink::{FileSink, FileSinkOptions};
use rerun::{RecordingStream, RecordingStreamBuilder, TimePoint};
use tandem_wire::Timing;

use super::feed::Sink;
use super::{Drops, Notice, OpenError};
use crate::heard::Heard;
use crate::session_file::Provenance;
use crate::view::{Drawing, View, layout};

/// What Rerun shows as the application.
const APPLICATION: &str = "tandem";
/// How long rows may wait to be sent together to a viewer. Every batch of an entity costs about a kilobyte of its own,
/// so at 50 Hz the SDK's eight milliseconds would send more envelope than letter; a tenth of a second nobody notices.
const LIVE_BATCH: Duration = Duration::from_millis(100);
/// The same for a file: larger batches make it and its index smaller, and a second is what a crash may cost.
pub(super) const FILE_BATCH: Duration = Duration::from_secs(1);
/// What may be on its way inside the SDK. Its default of 100 MiB would be most of our memory while a viewer is frozen.
const IN_FLIGHT_BYTES: u64 = 4 << 20;

/// A view that is drawn into a recording stream.
pub(super) struct StreamSink {
    view: View,
    drawings: Vec<Drawing>,
    stream: RecordingStream,
}

impl StreamSink {
    /// An `.rrd` file, replacing one that is there. Its index is kept in memory until the end.
    pub(super) fn save(
        path: &Path,
        has_index: bool,
        timing: Timing,
        provenance: &Provenance,
    ) -> Result<Self, OpenError> {
        // The SDK's own error does not tell a missing folder from a missing permission.
        File::create(path).map_err(|source| OpenError::Recording {
            path: path.to_owned(),
            source,
        })?;
        let options = FileSinkOptions {
            write_footer: has_index,
        };
        let sink = FileSink::with_options(path, options).map_err(|source| OpenError::View {
            source: Box::new(source.into()),
        })?;
        let stream = builder(provenance, FILE_BATCH).buffered().map_err(view_error)?;
        stream.set_sink(Box::new(sink));
        Ok(Self::new(stream, timing))
    }

    /// A viewer's address. Connecting goes on in the background, for ever.
    pub(super) fn connect(url: &str, timing: Timing, provenance: &Provenance) -> Result<Self, OpenError> {
        builder(provenance, LIVE_BATCH)
            .connect_grpc_opts(url)
            .map(|stream| Self::new(stream, timing))
            .map_err(view_error)
    }

    fn new(stream: RecordingStream, timing: Timing) -> Self {
        Self {
            view: View::new(timing),
            drawings: Vec::with_capacity(64),
            stream,
        }
    }

    pub(super) const fn stream(&self) -> &RecordingStream {
        &self.stream
    }

    fn record(&self, drawing: Drawing) {
        let time = drawing.moment.map_or_else(TimePoint::default, TimePoint::from);
        let row = PendingRow::from_iter(time, drawing.batches);
        self.stream.record_row(drawing.path.into(), row, false);
    }
}

impl Sink for StreamSink {
    fn begin(&mut self) -> Result<(), Notice> {
        layout::send(&self.stream).map_err(|error| failed(&error))?;
        for drawing in View::opening() {
            self.record(drawing);
        }
        Ok(())
    }

    fn take(&mut self, heard: &Heard, drops: Drops) -> Result<(), Notice> {
        let mut drawings = std::mem::take(&mut self.drawings);
        self.view.draw(heard, drops, &mut drawings);
        for drawing in drawings.drain(..) {
            self.record(drawing);
        }
        self.drawings = drawings;
        Ok(())
    }

    fn flush(&mut self) -> Result<(), Notice> {
        self.stream.flush_async().map_err(|error| failed(&error))
    }

    fn close(self) -> Result<(), Notice> {
        self.stream.flush_blocking().map_err(|error| failed(&error))
    }
}

fn builder(provenance: &Provenance, batch: Duration) -> RecordingStreamBuilder {
    let config = ChunkBatcherConfig {
        flush_tick: batch,
        max_bytes_in_flight: IN_FLIGHT_BYTES,
        ..ChunkBatcherConfig::DEFAULT
    };
    let Provenance {
        robot,
        epoch_unix_nanos,
        ..
    } = provenance;
    RecordingStreamBuilder::new(APPLICATION)
        // A file and a live view of one session are the same recording to Rerun.
        .recording_id(format!("{robot}-{epoch_unix_nanos}"))
        .recording_name(robot.as_str())
        .batcher_config(config)
}

fn view_error(source: rerun::RecordingStreamError) -> OpenError {
    OpenError::View {
        source: Box::new(source),
    }
}

fn failed(error: &dyn std::error::Error) -> Notice {
    Notice::Failed {
        sink: "the Rerun view".to_owned(),
        why: error.to_string(),
    }
}
