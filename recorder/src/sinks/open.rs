//! How a session file and views are opened as the settings ask for, and why they cannot be.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::feed::{Feed, Limits};
use super::file::FileSink;
use super::rerun_stream::{FILE_BATCH, Show, StreamSink};
use super::shared::{Kind, Shared};
use super::viewer::ViewerSink;
use crate::config::{RecorderConfig, ViewTarget};
use crate::session_file::Provenance;
use crate::urdf::UrdfError;

/// Why recording cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// There is a file of that name.
    #[error(
        "{path:?} is there already, and recordings are not overwritten: name another file, or say --overwrite \
             (recorder.overwrite = true)"
    )]
    Exists {
        /// The path that was asked for.
        path: PathBuf,
    },
    /// The session file cannot be created.
    #[error("the session file {path:?} cannot be written")]
    SessionFile {
        /// The path that was asked for.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The session file was created, but its beginning could not be written.
    #[error("the session file {path:?} cannot be begun")]
    Begin {
        /// The path that was asked for.
        path: PathBuf,
        /// What is wrong.
        source: crate::WriteError,
    },
    /// The Rerun recording cannot be created.
    #[error("the Rerun recording {path:?} cannot be written")]
    Recording {
        /// The path that was asked for.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The Rerun SDK refuses to begin.
    #[error("the Rerun view cannot be begun")]
    View {
        /// What the SDK says.
        source: Box<rerun::RecordingStreamError>,
    },
    /// The arm cannot be shown by its URDF file.
    #[error("the arm cannot be shown as it looks (recorder.urdf)")]
    Urdf(#[from] UrdfError),
    /// No thread can be started.
    #[error("no thread can be started")]
    Thread {
        /// What the system says.
        source: std::io::Error,
    },
}

/// Whether every file that is asked for can be begun without another one being lost. Looked at before any is begun, so
/// that no empty one stays behind.
pub(super) fn keep_what_is_there(config: &RecorderConfig) -> Result<(), OpenError> {
    let saved = config.views.iter().filter_map(|view| match view {
        ViewTarget::Save(path) => Some(path),
        ViewTarget::Connect(_) | ViewTarget::Spawn | ViewTarget::Serve => None,
    });
    let mut wanted = config.session_file.iter().chain(saved);
    match wanted.find(|path| !config.overwrites && path.is_file()) {
        Some(path) => Err(OpenError::Exists { path: path.clone() }),
        None => Ok(()),
    }
}

pub(super) fn open_file(
    config: &RecorderConfig,
    path: &Path,
    provenance: &Provenance,
    shared: &Arc<Shared>,
) -> Result<Feed, OpenError> {
    let sink = FileSink::create(path, config, provenance, Arc::clone(shared))?;
    let limits = Limits {
        messages: config.file_queue,
        bytes: config.file_queue_bytes,
        flush: config.flush,
    };
    Feed::start(
        "the session file",
        Some(path.to_owned()),
        Kind::SessionFile,
        limits,
        shared,
        sink,
    )
}

pub(super) fn open_view(
    config: &RecorderConfig,
    target: &ViewTarget,
    show: &Show,
    shared: &Arc<Shared>,
) -> Result<Feed, OpenError> {
    let limits = Limits {
        messages: config.view_queue,
        bytes: config.file_queue_bytes,
        flush: config.flush,
    };
    let kind = Kind::View;
    match target {
        ViewTarget::Save(path) => {
            let flush = FILE_BATCH;
            let limits = Limits { flush, ..limits };
            let sink = StreamSink::save(path, config, show, Arc::clone(shared))?;
            Feed::start("the Rerun recording", Some(path.clone()), kind, limits, shared, sink)
        }
        ViewTarget::Connect(_) | ViewTarget::Spawn | ViewTarget::Serve => {
            let (show, history) = (show.clone(), config.view_history_bytes);
            let sink = ViewerSink::new(target.clone(), show, history, Arc::clone(shared));
            Feed::start("the live view", None, kind, limits, shared, sink)
        }
    }
}
