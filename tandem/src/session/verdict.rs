//! The verdict of an execution, kept beside the session file it is about: `session.verdict.json`.
//!
//! It names every part with its SHA-256, so that a file that was changed since has no verdict.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use super::family;
use crate::{BUILD, table};

/// What is known of a session's verdict.
pub(crate) enum Known {
    /// Nobody noted one.
    None,
    /// One was noted of files that are no longer the same.
    Outdated,
    /// This.
    Noted {
        /// In a word.
        verdict: String,
        /// Which program executed it.
        by: String,
    },
}

/// Where the verdict stands.
pub(crate) fn path(session: &Path) -> PathBuf {
    session.with_extension("verdict.json")
}

/// Notes a verdict beside the session file.
pub(crate) fn note(session: &Path, more: &[PathBuf], verdict: &Value) -> anyhow::Result<PathBuf> {
    let files = hashes(&family::parts(session, more)).context("cannot read the session file again")?;
    let noted = json!({"files": files, "by": BUILD, "verdict": verdict["verdict"], "nodes": verdict["nodes"]});
    let path = path(session);
    let text = serde_json::to_string_pretty(&noted)?;
    std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(path)
}

/// Looks for a verdict, and whether it is about these files.
pub(crate) fn find(session: &Path, more: &[PathBuf]) -> Known {
    let Ok(text) = std::fs::read_to_string(path(session)) else {
        return Known::None;
    };
    let noted: Value = serde_json::from_str(&text).unwrap_or_default();
    match (noted["verdict"].as_str(), hashes(&family::parts(session, more))) {
        (Some(verdict), Ok(files)) if noted["files"] == Value::from(files.clone()) => Known::Noted {
            verdict: verdict.to_owned(),
            by: noted["by"].as_str().unwrap_or("unknown").to_owned(),
        },
        _ => Known::Outdated,
    }
}

fn hashes(paths: &[PathBuf]) -> io::Result<Vec<Value>> {
    let one = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(json!({"name": name, "sha256": hash(path)?}))
    };
    paths.iter().map(one).collect()
}

/// In pieces: a session file may be larger than the memory.
fn hash(path: &Path) -> io::Result<String> {
    let (mut file, mut hasher) = (File::open(path)?, Sha256::new());
    let mut piece = vec![0; 1 << 18];
    loop {
        let read = file.read(&mut piece)?;
        if read == 0 {
            return Ok(table::hex(&hasher.finalize()));
        }
        hasher.update(piece.get(..read).unwrap_or_default());
    }
}
