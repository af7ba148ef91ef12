//! Files of a site: secrets that nobody else may read, and nothing that is overwritten.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::path::Path;

/// What others may do with a file or folder that must be its owner's alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exposed {
    /// Its permissions, as chmod takes them.
    pub mode: u32,
}

/// Creates a file that only its owner may read.
///
/// # Errors
/// If it is there already, or cannot be written.
pub fn write_secret(path: &Path, text: &str) -> io::Result<()> {
    create(path, 0o600, text)
}

/// Creates a file that everybody may read.
///
/// # Errors
/// If it is there already, or cannot be written.
pub fn write_public(path: &Path, text: &str) -> io::Result<()> {
    create(path, 0o644, text)
}

fn create(path: &Path, mode: u32, text: &str) -> io::Result<()> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    with_mode(&mut options, mode);
    fill(&options.open(path)?, text)
}

fn fill(mut file: &File, text: &str) -> io::Result<()> {
    file.write_all(text.as_bytes())?;
    file.sync_all()
}

/// Replaces a file in one step: whoever reads it sees the old text or the new one.
pub(crate) fn replace(path: &Path, text: &str) -> io::Result<()> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(format!(".{}.new", std::process::id()));
    let written = write_public(Path::new(&beside), text).and_then(|()| fs::rename(&beside, path));
    written.inspect_err(|_| drop(fs::remove_file(&beside)))
}

/// Creates a folder that only its owner may enter; one that is there and empty will do.
pub(crate) fn create_folder(path: &Path) -> io::Result<()> {
    let mut builder = fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::{DirBuilderExt as _, PermissionsExt as _};
        builder.mode(0o700).create(path)?;
        fs::set_permissions(path, fs::Permissions::from_mode(0o700))
    }
    #[cfg(not(unix))]
    builder.create(path)
}

#[cfg(unix)]
fn with_mode(options: &mut OpenOptions, mode: u32) {
    use std::os::unix::fs::OpenOptionsExt as _;
    options.mode(mode);
}

#[cfg(not(unix))]
fn with_mode(_: &mut OpenOptions, _: u32) {}

/// What others than the owner may do with a secret, if anything.
pub(crate) fn exposed_secret(path: &Path) -> io::Result<Option<Exposed>> {
    exposed(path, 0o077)
}

/// Whether others than the owner may put files into a folder.
pub(crate) fn exposed_folder(path: &Path) -> io::Result<Option<Exposed>> {
    exposed(path, 0o022)
}

#[cfg(unix)]
fn exposed(path: &Path, forbidden: u32) -> io::Result<Option<Exposed>> {
    use std::os::unix::fs::PermissionsExt as _;
    let mode = fs::metadata(path)?.permissions().mode() & 0o777;
    Ok((mode & forbidden != 0).then_some(Exposed { mode }))
}

#[cfg(not(unix))]
fn exposed(path: &Path, _: u32) -> io::Result<Option<Exposed>> {
    fs::metadata(path).map(|_| None)
}
