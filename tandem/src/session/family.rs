//! The files of one session: a long one, or one whose disk was full for a while, has several parts.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use tandem_recorder::{Keep, PartsReader, Place, Recording, Reel, part_path};

/// The files to be read for the one that was named: those that were named with it, or else the later parts that lie
/// beside it, `NAME_0002.mcap` and so on. A later part named alone is read alone.
pub(crate) fn parts(first: &Path, more: &[PathBuf]) -> Vec<PathBuf> {
    let named = std::iter::once(first.to_owned()).chain(more.iter().cloned());
    let beside = (2..).map(|number| part_path(first, number));
    let beside = beside.take_while(|path| more.is_empty() && path.is_file());
    named.chain(beside).collect()
}

/// Reads a session file, damaged or not, with its later parts.
pub(crate) fn load(first: &Path, more: &[PathBuf]) -> anyhow::Result<Recording> {
    Ok(read(first, more)?.0)
}

/// The same, but of each message only where it stands, and what to fetch it with: for sessions of any length.
pub(crate) fn open(first: &Path, more: &[PathBuf]) -> anyhow::Result<(Recording<Place>, Reel<Part>)> {
    let (recording, files) = read(first, more)?;
    Ok((recording, Reel::new(files)))
}

/// A file of a session.
pub(crate) type Part = BufReader<File>;

fn read<B: Keep + Default>(first: &Path, more: &[PathBuf]) -> anyhow::Result<(Recording<B>, Vec<Part>)> {
    let mut reader = PartsReader::default();
    let mut files = Vec::new();
    for (index, path) in parts(first, more).iter().enumerate() {
        let file = File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
        let mut file = BufReader::new(file);
        match reader.add(&mut file) {
            Ok(()) => files.push(file),
            // What the first part has is no less there because a later one is nothing.
            Err(error) if index > 0 => eprintln!("session: {} is left out: {error}", path.display()),
            Err(error) => return Err(error).with_context(|| format!("cannot use {}", path.display())),
        }
    }
    let recording = reader
        .finish()
        .with_context(|| format!("cannot use {}", first.display()))?;
    Ok((recording, files))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn later_parts_are_found_beside_the_first_up_to_the_first_that_is_missing() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        for name in ["a.mcap", "a_0002.mcap", "a_0003.mcap", "a_0005.mcap", "b.mcap"] {
            std::fs::write(path(name), b"").expect("a file");
        }
        assert_eq!(
            parts(&path("a.mcap"), &[]),
            [path("a.mcap"), path("a_0002.mcap"), path("a_0003.mcap")]
        );
        assert_eq!(parts(&path("a_0003.mcap"), &[]), [path("a_0003.mcap")]);
        assert_eq!(
            parts(&path("a.mcap"), &[path("b.mcap")]),
            [path("a.mcap"), path("b.mcap")],
            "who names several means these"
        );
    }
}
