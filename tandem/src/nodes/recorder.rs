//! `tandem recorder`: its flags, and the process around it.

use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;
use tandem_link::stand_back;
use tandem_recorder::Notice;
use tandem_wire::NodeName;

use super::NodeFlags;
use super::process::Process;
use crate::Outcome;
use crate::parts::{CLOSE_LIMIT, Parts, lost};

#[derive(Args)]
pub(crate) struct RecorderFlags {
    /// The session file; the Rerun recording goes beside it.
    #[arg(long, value_name = "PATH")]
    record: PathBuf,
    /// Shows the session live in Rerun: in a viewer of this machine (spawn), in one that listens elsewhere
    /// (connect=URL), through a server that browsers come to (serve), or writes the recording there (save=PATH.rrd).
    #[arg(long, value_name = "spawn|serve|connect=URL|save=PATH", num_args = 0..=1, default_missing_value = "spawn")]
    view: Option<ViewFlag>,
    /// Draws the arm as this URDF file describes it, with its meshes, instead of its collision shapes.
    #[arg(long, value_name = "PATH")]
    urdf: Option<PathBuf>,
    #[command(flatten)]
    node: NodeFlags,
}

/// Where a session is shown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum ViewFlag {
    Spawn,
    Serve,
    Connect(String),
    Save(String),
}

impl FromStr for ViewFlag {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            None if text == "spawn" => Ok(Self::Spawn),
            None if text == "serve" => Ok(Self::Serve),
            Some(("connect", url)) if !url.is_empty() => Ok(Self::Connect(url.to_owned())),
            Some(("save", path)) if !path.is_empty() => Ok(Self::Save(path.to_owned())),
            _ => Err("use spawn, serve, connect=URL or save=PATH".to_owned()),
        }
    }
}

impl ViewFlag {
    /// The settings that mean the same.
    pub(crate) fn overrides(&self) -> Vec<(&'static str, String)> {
        match self {
            Self::Spawn => vec![("recorder.live", "spawn".to_owned())],
            Self::Serve => vec![("recorder.live", "serve".to_owned())],
            Self::Connect(url) => vec![
                ("recorder.live", "connect".to_owned()),
                ("recorder.viewer", url.clone()),
            ],
            Self::Save(path) => vec![("recorder.rrd", path.clone())],
        }
    }
}

/// `tandem recorder`.
pub(crate) fn recorder(flags: &RecorderFlags) -> anyhow::Result<Outcome> {
    // Before anything is started: Zenoh's threads, the files' and a viewer that is spawned stand back, too.
    stand_back();
    let mut overrides = vec![
        ("recorder.path", flags.record.display().to_string()),
        ("recorder.rrd", flags.record.with_extension("rrd").display().to_string()),
    ];
    overrides.extend(flags.view.iter().flat_map(ViewFlag::overrides));
    overrides.extend(
        flags
            .urdf
            .iter()
            .map(|path| ("recorder.urdf", path.display().to_string())),
    );
    let parts = Parts::new(flags.node.configuration(&overrides)?, None)?;
    let sinks = parts.sinks()?;
    let process = match Process::begin(&parts, NodeName::Recorder) {
        Ok(Some(process)) => process,
        // An empty session file is a whole one, too.
        gave_up => {
            // Nothing was heard, so nothing can have been lost.
            let _ = sinks.close(CLOSE_LIMIT);
            return gave_up.map(|_| Outcome::Done);
        }
    };
    let recorder = parts.recorder(&process.link, sinks)?;
    process.wait(recorder.node());
    let closed = recorder.stop()?;
    process.link.close();
    for ended in &closed.sinks {
        let taken = ended
            .messages
            .map_or("an unknown number of".into(), |messages| messages.to_string());
        eprintln!(
            "recorder: {} ended after {taken} messages, {} missed",
            ended.sink, ended.dropped
        );
    }
    for notice in &closed.notices {
        eprintln!("recorder: {notice}");
    }
    let channels: Vec<_> = closed.drops.session_file.by_channel().collect();
    if !channels.is_empty() {
        eprintln!("recorder: {}", Notice::Dropped { channels });
    }
    Ok(if lost(&closed) > 0 {
        Outcome::SamplesLost
    } else {
        Outcome::Done
    })
}
