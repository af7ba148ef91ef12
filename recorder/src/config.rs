//! What can be set, and what the rest of the crate makes of it once checked.

use std::path::PathBuf;
use std::time::Duration;

use tandem_settings::{choices, settings};
use tandem_wire::{Nanos, SECOND};

choices! {
    /// Which live viewer is fed.
    pub enum Live {
        /// None.
        None = "none",
        /// The one that listens at `viewer`.
        Connect = "connect",
        /// The one that listens on this machine's usual port, or else a new one, if `rerun` is on the PATH.
        Spawn = "spawn",
        /// A server on this machine, started if none is there, which browsers and viewers come to.
        Serve = "serve",
    }
}

settings! {
    /// What the recorder keeps and shows.
    pub struct RecorderSettings("recorder") {
        /// The session file (MCAP); nothing is written if this is empty.
        pub path: String = "";
        /// The Rerun recording (.rrd); nothing is written if this is empty.
        pub rrd: String = "";
        /// Whether a recording that is there already is replaced; if not, recording does not begin.
        pub overwrite: bool = false;
        /// Whether the Rerun recording ends with an index, which makes it quick to jump in and is kept in memory until
        /// then: some 16 MiB a minute at 50 Hz. Sessions of hours go without; `rerun rrd optimize` adds it later.
        pub rrd_index: bool = false;
        /// The live Rerun viewer to feed.
        pub live: Live = Live::None;
        /// Where a viewer listens, for live = "connect".
        pub viewer: String = "rerun+http://127.0.0.1:9876/proxy";
        /// The longest that a message waits before it is on disk, in milliseconds: what a crash may cost.
        pub flush_ms: u64 = 500, in 20..=1000;
        /// The size at which a chunk of the session file is compressed and written, in KiB.
        pub chunk_kib: u64 = 256, in 16..=8192;
        /// Messages that may wait before the recorder takes them up: a second that it waits for the processor must not
        /// cost one. More cost the oldest ones, which are counted as dropped.
        pub input_queue: usize = 32768, in 16..=262144;
        /// Messages that may wait for the session file; more are dropped and counted.
        pub file_queue: usize = 32768, in 16..=65536;
        /// Memory that these may take, in MiB.
        pub file_queue_mib: usize = 32, in 8..=1024;
        /// Begin another session file when one has this many megabytes on disk; 0: never. The second is called
        /// NAME_0002.mcap, and every one can be read alone.
        pub split_mb: u64 = 0, in 0..=1000000;
        /// Begin another session file when one holds this many seconds; 0: never.
        pub split_s: u64 = 0, in 0..=86400;
        /// Messages that may wait for each view; more are dropped and counted.
        pub view_queue: usize = 1024, in 16..=65536;
        /// The arm's URDF file, whose meshes are then drawn instead of its collision shapes; none if this is empty.
        pub urdf: String = "";
        /// Memory for what a viewer that comes late or comes back is shown again, in MiB: at 50 Hz some seconds
        /// each.
        pub view_history_mib: usize = 16, in 1..=64;
    }
}

/// Why settings cannot work together.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BadSettings {
    /// The viewer's address is none.
    #[error("recorder.viewer = {url:?} is no viewer's address: use rerun+http://HOST:PORT/proxy")]
    Viewer {
        /// The text.
        url: String,
    },
    /// Two files with one name.
    #[error("recorder.path and recorder.rrd both name {path:?}")]
    SamePath {
        /// The name.
        path: PathBuf,
    },
}

/// Where the view goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ViewTarget {
    /// Into an `.rrd` file.
    Save(PathBuf),
    /// To the viewer at this address.
    Connect(String),
    /// To a viewer on this machine, started if none is there.
    Spawn,
    /// To a server on this machine, started if none is there.
    Serve,
}

/// When a part of a session file has become large or long enough.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Split {
    /// Bytes on disk.
    pub(crate) bytes: Option<u64>,
    /// From the first message of the part to the newest.
    pub(crate) nanos: Option<Nanos>,
}

/// Checked settings: nothing is left to validate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecorderConfig {
    pub(crate) session_file: Option<PathBuf>,
    pub(crate) views: Vec<ViewTarget>,
    pub(crate) overwrites: bool,
    pub(crate) rrd_index: bool,
    pub(crate) flush: Duration,
    pub(crate) chunk_bytes: u64,
    pub(crate) file_queue: usize,
    pub(crate) file_queue_bytes: usize,
    pub(crate) split: Split,
    pub(crate) view_queue: usize,
    pub(crate) view_history_bytes: usize,
    pub(crate) urdf: Option<PathBuf>,
    pub(crate) purpose: Purpose,
}

impl RecorderConfig {
    /// Checks what the ranges of single settings cannot say.
    ///
    /// # Errors
    /// If the viewer's address is none, or both files have one name.
    pub fn new(settings: &RecorderSettings) -> Result<Self, BadSettings> {
        let (session_file, rrd) = (path(&settings.path), path(&settings.rrd));
        if let Some(path) = &session_file
            && session_file == rrd
        {
            return Err(BadSettings::SamePath { path: path.clone() });
        }
        let live = match settings.live {
            Live::None => None,
            Live::Connect if is_viewer(&settings.viewer) => Some(ViewTarget::Connect(settings.viewer.clone())),
            Live::Connect => {
                let url = settings.viewer.clone();
                return Err(BadSettings::Viewer { url });
            }
            Live::Spawn => Some(ViewTarget::Spawn),
            Live::Serve => Some(ViewTarget::Serve),
        };
        Ok(Self {
            session_file,
            views: rrd.map(ViewTarget::Save).into_iter().chain(live).collect(),
            overwrites: settings.overwrite,
            rrd_index: settings.rrd_index,
            flush: Duration::from_millis(settings.flush_ms),
            chunk_bytes: settings.chunk_kib << 10,
            file_queue: settings.file_queue,
            file_queue_bytes: settings.file_queue_mib << 20,
            split: Split {
                bytes: limit(settings.split_mb, 1_000_000),
                nanos: limit(settings.split_s, SECOND),
            },
            view_queue: settings.view_queue,
            view_history_bytes: settings.view_history_mib << 20,
            urdf: path(&settings.urdf),
            purpose: Purpose::Live,
        })
    }
}

/// What the view is for, and so how it is laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// Something that goes on: the newest is what counts.
    Live,
    /// Something that is over: who drove when, and why it stopped, is seen at once.
    Replay,
}

impl RecorderConfig {
    /// The same for a session that is over: its layout has the lanes of driver, reason and trial in front, and what it
    /// writes replaces what is there, for it can be made again.
    #[must_use]
    pub fn for_replay(self) -> Self {
        Self {
            purpose: Purpose::Replay,
            overwrites: true,
            ..self
        }
    }
}

/// So many units; `None` for zero, which means never.
fn limit(count: u64, unit: u64) -> Option<u64> {
    (count > 0).then(|| count.saturating_mul(unit))
}

fn path(text: &str) -> Option<PathBuf> {
    (!text.is_empty()).then(|| text.into())
}

fn is_viewer(url: &str) -> bool {
    url.parse::<rerun::external::re_uri::ProxyUri>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_settings::{Document, show};

    #[test]
    fn what_is_shown_reads_back() {
        let defaults = RecorderSettings::default();
        let read: RecorderSettings = Document::parse("x", &show(&defaults)).unwrap().section().unwrap();
        assert_eq!(read, defaults);
    }

    #[test]
    fn a_recording_and_a_live_view_go_together() {
        let settings = RecorderSettings {
            path: "a.mcap".into(),
            rrd: "a.rrd".into(),
            live: Live::Connect,
            ..RecorderSettings::default()
        };
        let config = RecorderConfig::new(&settings).unwrap();
        assert_eq!(
            config.views,
            [
                ViewTarget::Save("a.rrd".into()),
                ViewTarget::Connect(settings.viewer.clone())
            ]
        );
    }

    #[test]
    fn a_wrong_address_and_a_shared_path_are_refused() {
        let wrong = RecorderSettings {
            live: Live::Connect,
            viewer: "localhost".into(),
            ..RecorderSettings::default()
        };
        assert!(matches!(RecorderConfig::new(&wrong), Err(BadSettings::Viewer { .. })));
        let shared = RecorderSettings {
            path: "a".into(),
            rrd: "a".into(),
            ..RecorderSettings::default()
        };
        assert!(matches!(
            RecorderConfig::new(&shared),
            Err(BadSettings::SamePath { .. })
        ));
    }
}
