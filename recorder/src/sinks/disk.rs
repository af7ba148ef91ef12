//! Where session files come from: the file system, or in tests one that stalls, fills up and recovers.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Makes files.
pub(super) trait Disk: Send + 'static {
    /// An open one.
    type File: Write + Seek + Send + 'static;

    /// Creates a file, or fails with [`io::ErrorKind::AlreadyExists`] where one is there that shall stay.
    fn create(&mut self, path: &Path) -> io::Result<Self::File>;

    /// Puts everything beyond the reach of a power cut, and closes it.
    fn finish(file: Self::File) -> io::Result<()>;

    /// Closes it as it is, without another byte: after a failure, when what is buffered may be half written.
    fn abandon(file: Self::File);

    /// Takes away a file that came to nothing.
    fn remove(&mut self, path: &Path);
}

/// The file system.
#[derive(Clone, Copy, Debug)]
pub(super) struct System {
    /// Whether a file that is there already is replaced.
    pub(super) overwrites: bool,
}

/// Creates a file. One that is there already, even since a moment ago, is replaced only if that is wanted; a device or a
/// pipe keeps nothing that could be lost.
pub(super) fn create(path: &Path, overwrites: bool) -> io::Result<File> {
    let is_device = path.metadata().is_ok_and(|found| !found.is_file());
    match overwrites || is_device {
        true => File::create(path),
        false => File::create_new(path),
    }
}

impl Disk for System {
    type File = BufWriter<File>;

    fn create(&mut self, path: &Path) -> io::Result<Self::File> {
        // A chunk is some hundred kilobytes, written in one piece; the buffer is for the records between.
        Ok(BufWriter::new(create(path, self.overwrites)?))
    }

    fn finish(file: Self::File) -> io::Result<()> {
        let file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.sync_all()
    }

    fn abandon(file: Self::File) {
        drop(file.into_parts());
    }

    fn remove(&mut self, path: &Path) {
        // If even this fails, an empty file stays.
        std::fs::remove_file(path).ok();
    }
}

/// A file that says how long it has become.
pub(super) struct Measured<F> {
    file: F,
    length: Arc<AtomicU64>,
}

impl<F> Measured<F> {
    pub(super) fn new(file: F) -> (Self, Arc<AtomicU64>) {
        let length = Arc::new(AtomicU64::new(0));
        let shared = Arc::clone(&length);
        (Self { file, length }, shared)
    }

    pub(super) fn into_inner(self) -> F {
        self.file
    }
}

impl<F: Write> Write for Measured<F> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.length.fetch_add(written as u64, Ordering::Relaxed);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl<F: Seek> Seek for Measured<F> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }

    /// Known without asking the system: what is written stays where it is.
    fn stream_position(&mut self) -> io::Result<u64> {
        Ok(self.length.load(Ordering::Relaxed))
    }
}
