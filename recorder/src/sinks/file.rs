//! The session file as a sink.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::sync::Arc;

use super::feed::{Shared, Sink};
use super::{Drops, Notice, OpenError};
use crate::heard::{Entry, Heard};
use crate::session_file::{Provenance, SessionFile, WriteError};
use crate::tally::Counts;

pub(super) struct FileSink {
    file: SessionFile<BufWriter<File>>,
    counts: Counts,
    is_dirty: bool,
    shared: Arc<Shared>,
}

impl FileSink {
    /// Creates the file, replacing one that is there.
    pub(super) fn create(
        path: &Path,
        chunk_bytes: u64,
        provenance: &Provenance,
        shared: Arc<Shared>,
    ) -> Result<Self, OpenError> {
        let file = File::create(path).map_err(|source| OpenError::SessionFile {
            path: path.to_owned(),
            source,
        })?;
        let begun = SessionFile::begin(BufWriter::new(file), chunk_bytes, provenance.clone());
        let mut file = begun.map_err(|source| begin_error(path, source))?;
        file.flush().map_err(|source| begin_error(path, source))?;
        Ok(Self {
            file,
            counts: Counts::default(),
            is_dirty: false,
            shared,
        })
    }
}

impl Sink for FileSink {
    fn take(&mut self, heard: &Arc<Heard>, drops: Drops) -> Result<(), Notice> {
        if let Entry::Counts(counts) = &heard.entry {
            self.counts.clone_from(counts);
        }
        self.is_dirty = true;
        self.file.write(heard, drops).map_err(|error| failed(&error))
    }

    fn flush(&mut self) -> Result<(), Notice> {
        if std::mem::take(&mut self.is_dirty) {
            self.file.flush().map_err(|error| failed(&error))?;
        }
        Ok(())
    }

    fn close(self) -> Result<(), Notice> {
        let drops = self.shared.drops();
        let (_, file) = self.file.close(&self.counts, drops).map_err(|error| failed(&error))?;
        let file = file.into_inner().map_err(|error| failed(error.error()))?;
        file.sync_all().map_err(|error| failed(&error))
    }
}

fn begin_error(path: &Path, source: WriteError) -> OpenError {
    OpenError::Begin {
        path: path.to_owned(),
        source,
    }
}

/// The error with its causes, on one line.
fn failed(error: &dyn std::error::Error) -> Notice {
    let causes = std::iter::successors(error.source(), |cause| cause.source());
    let why = causes.fold(error.to_string(), |why, cause| format!("{why}: {cause}"));
    Notice::Failed {
        sink: "the session file".to_owned(),
        why,
    }
}
