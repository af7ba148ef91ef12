//! Where a session that is recorded is shown, for every command that records one.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::Args;

/// How a session is shown while it is recorded.
#[derive(Args, Clone, Debug)]
pub(crate) struct ShowFlags {
    /// Shows the session live in Rerun: in a viewer of this machine (spawn), in one that listens elsewhere
    /// (connect=URL), through a server that browsers come to (serve), or writes the recording there (save=PATH.rrd).
    #[arg(long, value_name = "spawn|serve|connect=URL|save=PATH", num_args = 0..=1, default_missing_value = "spawn")]
    view: Option<ViewFlag>,
    /// Draws the arm as this URDF file describes it, with its meshes, instead of its collision shapes.
    #[arg(long, value_name = "PATH")]
    urdf: Option<PathBuf>,
}

impl ShowFlags {
    /// The settings that mean the same. Where a session file is named, the Rerun recording goes beside it; where none is,
    /// the configuration says where both go.
    pub(crate) fn overrides(&self, record: Option<&Path>) -> Vec<(&'static str, String)> {
        let mut overrides = Vec::new();
        if let Some(record) = record {
            overrides.push(("recorder.path", record.display().to_string()));
            overrides.push(("recorder.rrd", record.with_extension("rrd").display().to_string()));
        }
        overrides.extend(self.view.iter().flat_map(ViewFlag::overrides));
        let urdf = self.urdf.iter().map(|path| path.display().to_string());
        overrides.extend(urdf.map(|path| ("recorder.urdf", path)));
        overrides
    }
}

/// Where a session is shown.
#[derive(Clone, Debug, PartialEq, Eq)]
enum ViewFlag {
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
    fn overrides(&self) -> Vec<(&'static str, String)> {
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
