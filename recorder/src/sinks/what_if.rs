//! Two runs of one session into one `.rrd` file.

use std::fs::File;
use std::path::Path;

use rerun::log::PendingRow;
use rerun::sink::{FileSink, FileSinkOptions};
use rerun::{RecordingStream, RecordingStreamBuilder, TimePoint};
use tandem_wire::{Input, Ports, Stamp, Timing, Topic};

use super::OpenError;
use crate::heard::{Entry, Heard};
use crate::node::{Event, Recorder};
use crate::session_file::Provenance;
use crate::view::Drawing;
use crate::view::layout;
use crate::view::what_if::{Comparison, Side};

/// What stands over the picture.
#[derive(Clone, Copy, Debug)]
pub struct Heading<'a> {
    /// What the recording is called, in a word or two.
    pub name: &'a str,
    /// What was changed and what cannot be known, as markdown.
    pub words: &'a str,
}

/// Writes an `.rrd` file, replacing one that is there, that shows the messages of two runs on one time axis, the one of
/// their stamps. Messages come in order of time; equal stamps keep their order.
///
/// # Errors
/// If the file cannot be written.
pub fn save_what_if<'a>(
    path: &Path,
    timing: Timing,
    provenance: &Provenance,
    heading: Heading<'_>,
    messages: impl IntoIterator<Item = (Side, Stamp, Topic, &'a [u8])>,
) -> Result<(), OpenError> {
    // The SDK's own error does not tell a missing folder from a missing permission.
    File::create(path).map_err(|source| OpenError::Recording {
        path: path.to_owned(),
        source,
    })?;
    let stream = open(path, provenance, heading.name).map_err(|source| OpenError::View {
        source: Box::new(source),
    })?;
    let mut comparison = Comparison::new();
    let mut drawings = Comparison::opening(heading.words);
    for (side, at, topic, bytes) in messages {
        if let Some(heard) = heard(timing, at, topic, bytes) {
            comparison.draw(side, &heard, &mut drawings);
        }
        drawings.drain(..).for_each(|drawing| record(&stream, drawing));
    }
    let failed = |why: &dyn std::fmt::Display| OpenError::Recording {
        path: path.to_owned(),
        source: std::io::Error::other(why.to_string()),
    };
    stream.flush_blocking().map_err(|why| failed(&why))
}

fn open(path: &Path, provenance: &Provenance, name: &str) -> rerun::RecordingStreamResult<RecordingStream> {
    let Provenance {
        robot,
        epoch_unix_nanos,
        ..
    } = provenance;
    let stream = RecordingStreamBuilder::new("tandem-what-if")
        .recording_id(format!("{robot}-{epoch_unix_nanos}-what-if-{name}"))
        .recording_name(format!("{robot}, what if: {name}"))
        .buffered()?;
    let options = FileSinkOptions { write_footer: true };
    stream.set_sink(Box::new(FileSink::with_options(path, options)?));
    let fit = layout::Fit::default();
    layout::send(&stream, layout::Layout::Comparing, fit, layout::Arrives::AtOnce)?;
    Ok(stream)
}

fn heard(timing: Timing, at: Stamp, topic: Topic, bytes: &[u8]) -> Option<Heard> {
    let Event::Sample(sample) = Recorder::event(Input::Sample { topic, bytes }) else {
        return None;
    };
    let tick = sample.header().tick;
    Some(Heard {
        at,
        session_time: timing.session_time(at, tick),
        tick,
        entry: Entry::Sample(sample),
    })
}

fn record(stream: &RecordingStream, drawing: Drawing) {
    let time = drawing.moment.map_or_else(TimePoint::default, TimePoint::from);
    let row = PendingRow::from_iter(time, drawing.batches);
    stream.record_row(drawing.path.into(), row, false);
}
