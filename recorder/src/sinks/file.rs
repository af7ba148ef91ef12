//! The session file as a sink: in parts if it is to be, and with another part when the disk has failed.
//!
//! ```text
//!             limit of size or time: the next part
//!            ┌────────────┐
//!            ▼            │           a write fails
//!   begin ─▶ Writing ─────┴──────────────────────────▶ Waiting ──┐
//!            ▲                                           │  ▲    │ what comes is dropped
//!            └──── now and then: a new part can be begun ┘  └────┘ and counted
//! ```

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;

use tandem_wire::{Condition, Stamp};

use super::disk::{Disk, Measured, System};
use super::drops::Lost;
use super::feed::Sink;
use super::landmarks::Landmarks;
use super::shared::Shared;
use super::{Notice, OpenError};
use crate::config::{RecorderConfig, Split};
use crate::heard::{Entry, Heard};
use crate::session_file::{Provenance, SessionFile, WriteError};
use crate::tally::Counts;

/// After a failure every so many flushes it is tried again; at the usual half second that is every two seconds.
const RETRY_FLUSHES: u32 = 4;
/// What this sink is called.
const NAME: &str = "the session file";

pub(super) struct FileSink<D: Disk> {
    disk: D,
    path: PathBuf,
    chunk_bytes: u64,
    split: Split,
    provenance: Provenance,
    shared: Arc<Shared>,
    state: State<D::File>,
    /// How many parts were begun.
    parts: u32,
    counts: Counts,
    /// When the newest thing was heard.
    newest: Stamp,
    landmarks: Landmarks,
    /// Messages that seemed kept until their flush failed.
    lost_later: u64,
}

enum State<F: std::io::Write + std::io::Seek> {
    Writing(Box<Part<F>>),
    Waiting { flushes: u32 },
}

/// One file.
struct Part<F: std::io::Write + std::io::Seek> {
    file: SessionFile<Measured<F>>,
    length: Arc<AtomicU64>,
    began: Option<Stamp>,
    /// Taken since the last flush: what is lost if the next one fails.
    unflushed: Lost,
}

impl FileSink<System> {
    /// Creates the file.
    pub(super) fn create(
        path: &Path,
        config: &RecorderConfig,
        provenance: &Provenance,
        shared: Arc<Shared>,
    ) -> Result<Self, OpenError> {
        let disk = System {
            overwrites: config.overwrites,
        };
        Self::on(disk, path, config, provenance, shared)
    }
}

impl<D: Disk> FileSink<D> {
    pub(super) fn on(
        disk: D,
        path: &Path,
        config: &RecorderConfig,
        provenance: &Provenance,
        shared: Arc<Shared>,
    ) -> Result<Self, OpenError> {
        let mut sink = Self {
            disk,
            path: path.to_owned(),
            chunk_bytes: config.chunk_bytes,
            split: config.split,
            provenance: provenance.clone(),
            shared,
            state: State::Waiting { flushes: 0 },
            parts: 0,
            counts: Counts::default(),
            newest: Stamp(0),
            landmarks: Landmarks::default(),
            lost_later: 0,
        };
        sink.begin_part().map_err(|failure| failure.while_opening(path))?;
        Ok(sink)
    }

    /// Begins the next part with all it takes to read it alone. One that cannot be begun leaves nothing behind.
    fn begin_part(&mut self) -> Result<(), Failure> {
        let (number, path, file) = self.create_part().map_err(Failure::Create)?;
        let begun = self.write_beginning(file, number);
        if begun.is_err() {
            self.disk.remove(&path);
        }
        self.state = State::Writing(begun?);
        self.parts = number;
        Ok(())
    }

    /// A later part makes way for whatever has its name, which may be another session's, and takes the next number.
    fn create_part(&mut self) -> std::io::Result<(u32, PathBuf, D::File)> {
        let mut number = self.parts + 1;
        loop {
            let path = part_path(&self.path, number);
            match self.disk.create(&path) {
                Err(error) if number > 1 && error.kind() == std::io::ErrorKind::AlreadyExists => number += 1,
                created => return Ok((number, path, created?)),
            }
        }
    }

    fn write_beginning(&self, file: D::File, number: u32) -> Result<Box<Part<D::File>>, Failure> {
        let (file, length) = Measured::new(file);
        let mut file = SessionFile::begin(file, self.chunk_bytes, self.provenance.clone())?;
        let beginning = if number > 1 {
            file.continue_session(number, self.newest, &self.landmarks.all())
        } else {
            Ok(())
        };
        if let Err(error) = beginning.and_then(|()| file.flush()) {
            D::abandon(file.abandon().into_inner());
            return Err(error.into());
        }
        Ok(Box::new(Part {
            file,
            length,
            began: None,
            unflushed: Lost::default(),
        }))
    }

    /// Ends a part that has become large or long enough, and begins the next one.
    fn split_if_due(&mut self) {
        let now = self.newest;
        let State::Writing(part) = &mut self.state else { return };
        let began = *part.began.get_or_insert(now);
        let is_long = self.split.nanos.is_some_and(|limit| now.since(began) >= limit);
        let length = part.length.load(Ordering::Relaxed);
        let is_large = self.split.bytes.is_some_and(|limit| length >= limit);
        if !is_long && !is_large {
            return;
        }
        if let State::Writing(part) = self.wait() {
            match end_part::<D>(*part, &self.counts, &self.shared) {
                Ok(file) => finish_aside::<D>(file, &self.shared),
                Err(unended) => return self.fail(&unended.unflushed, &unended.error.into()),
            }
        }
        if let Err(failure) = self.begin_part() {
            self.fail(&Lost::default(), &failure);
        }
    }

    fn wait(&mut self) -> State<D::File> {
        std::mem::replace(&mut self.state, State::Waiting { flushes: 0 })
    }

    /// The part is given up; what was not flushed is lost. What comes is dropped until a new part can be begun.
    fn fail(&mut self, unflushed: &Lost, failure: &Failure) {
        self.shared.lose(unflushed);
        self.lost_later += unflushed.total();
        if let State::Writing(part) = self.wait() {
            D::abandon(part.file.abandon().into_inner());
        }
        self.shared.set_condition(failure.condition());
        self.shared.say(Notice::Failed {
            sink: NAME.to_owned(),
            why: failure.to_string(),
        });
    }

    fn fail_part(&mut self, error: WriteError) {
        let unflushed = match &self.state {
            State::Writing(part) => part.unflushed,
            State::Waiting { .. } => Lost::default(),
        };
        self.fail(&unflushed, &error.into());
    }

    /// Now and then: is there room again?
    fn try_again(&mut self) {
        let State::Waiting { flushes } = &mut self.state else {
            return;
        };
        *flushes += 1;
        if *flushes < RETRY_FLUSHES {
            return;
        }
        match self.begin_part() {
            Ok(()) => {
                self.shared.set_condition(Condition::Kept);
                let path = part_path(&self.path, self.parts);
                self.shared.say(Notice::Resumed { path });
            }
            Err(_) => {
                self.wait();
            }
        }
    }
}

impl<D: Disk> Sink for FileSink<D> {
    fn take(&mut self, heard: &Arc<Heard>) -> Result<bool, Notice> {
        if let Entry::Counts(counts) = &heard.entry {
            self.counts.clone_from(counts);
        }
        self.newest = self.newest.max(heard.at);
        self.split_if_due();
        // After the split: what this very message changes belongs to the part that it is written to.
        self.landmarks.hear(heard);
        let State::Writing(part) = &mut self.state else {
            return Ok(false);
        };
        match part.file.write(heard, self.shared.drops_for(heard)) {
            Ok(()) => {
                part.unflushed.add(heard);
                Ok(true)
            }
            Err(error) => {
                self.fail_part(error);
                Ok(false)
            }
        }
    }

    fn flush(&mut self) -> Result<(), Notice> {
        let State::Writing(part) = &mut self.state else {
            self.try_again();
            return Ok(());
        };
        if part.unflushed.total() == 0 {
            return Ok(());
        }
        match part.file.flush() {
            Ok(()) => part.unflushed = Lost::default(),
            Err(error) => self.fail_part(error),
        }
        Ok(())
    }

    fn close(&mut self) -> Result<(), Notice> {
        let State::Writing(part) = self.wait() else {
            return Ok(());
        };
        let ended = match end_part::<D>(*part, &self.counts, &self.shared) {
            Ok(file) => D::finish(file).map_err(Failure::from),
            Err(unended) => {
                self.shared.lose(&unended.unflushed);
                self.lost_later += unended.unflushed.total();
                Err(unended.error.into())
            }
        };
        ended.map_err(|failure| Notice::Failed {
            sink: NAME.to_owned(),
            why: failure.to_string(),
        })
    }

    fn lost_later(&self) -> u64 {
        self.lost_later
    }
}

/// What could not be ended.
struct Unended {
    unflushed: Lost,
    error: WriteError,
}

/// Writes a part's end. If that fails, what was not flushed before is lost with it.
fn end_part<D: Disk>(part: Part<D::File>, counts: &Counts, shared: &Shared) -> Result<D::File, Box<Unended>> {
    let Part {
        mut file, unflushed, ..
    } = part;
    // Flushed by itself first, so that a disk without room for the index still has all messages.
    if let Err(error) = file.flush() {
        D::abandon(file.abandon().into_inner());
        return Err(Box::new(Unended { unflushed, error }));
    }
    let unflushed = Lost::default();
    let closed = file.close(counts, shared.drops());
    let (_, measured) = closed.map_err(|error| Box::new(Unended { unflushed, error }))?;
    Ok(measured.into_inner())
}

/// The end of a part goes to the disk on a thread of its own: meanwhile the next one is written.
fn finish_aside<D: Disk>(file: D::File, shared: &Arc<Shared>) {
    let shared = Arc::clone(shared);
    let named = thread::Builder::new().name("recorder: ends a part".to_owned());
    // Without a thread the file is closed all the same, and the system writes it when it likes.
    let _ = named.spawn(move || {
        if let Err(error) = D::finish(file) {
            shared.say(Notice::Failed {
                sink: NAME.to_owned(),
                why: error.to_string(),
            });
        }
    });
}

/// What a part of a session file is called: the first has the name that was asked for, `session.mcap`, the second is
/// `session_0002.mcap` beside it.
#[must_use]
pub fn part_path(first: &Path, number: u32) -> PathBuf {
    if number <= 1 {
        return first.to_owned();
    }
    let stem = first.file_stem().unwrap_or_default().to_string_lossy();
    let name = match first.extension() {
        Some(extension) => format!("{stem}_{number:04}.{}", extension.to_string_lossy()),
        None => format!("{stem}_{number:04}"),
    };
    first.with_file_name(name)
}

/// Why there is no file to write to.
#[derive(Debug)]
enum Failure {
    Create(std::io::Error),
    Write(WriteError),
}

impl From<WriteError> for Failure {
    fn from(error: WriteError) -> Self {
        Self::Write(error)
    }
}

impl From<std::io::Error> for Failure {
    fn from(error: std::io::Error) -> Self {
        Self::Create(error)
    }
}

impl Failure {
    fn while_opening(self, path: &Path) -> OpenError {
        let path = path.to_owned();
        match self {
            Self::Create(source) => OpenError::SessionFile { path, source },
            Self::Write(source) => OpenError::Begin { path, source },
        }
    }

    fn condition(&self) -> Condition {
        let error = match self {
            Self::Create(error) => Some(error),
            Self::Write(WriteError::File(mcap::McapError::Io(error))) => Some(error),
            Self::Write(_) => None,
        };
        match error.map(std::io::Error::kind) {
            Some(std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded) => Condition::NoSpace,
            _ => Condition::Failing,
        }
    }
}

impl std::fmt::Display for Failure {
    /// The error with its causes, on one line.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let error: &dyn std::error::Error = match self {
            Self::Create(error) => error,
            Self::Write(error) => error,
        };
        write!(f, "{error}")?;
        let causes = std::iter::successors(error.source(), |cause| cause.source());
        causes.into_iter().try_for_each(|cause| write!(f, ": {cause}"))
    }
}

#[cfg(test)]
mod tests;
