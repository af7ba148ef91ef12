//! What a person is told, once, while recording goes on.

use std::fmt;
use std::path::PathBuf;

use crate::heard::Level;

/// Something that a person should know once, while recording goes on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Notice {
    /// There is no viewer to start.
    NoViewer,
    /// A viewer could not be started, or ended at once.
    ViewerFailed {
        /// What happened.
        why: String,
    },
    /// Nobody answers at the viewer's address so far.
    ViewerSilent {
        /// The address.
        url: String,
    },
    /// The viewer was there and is no longer.
    ViewerGone {
        /// The address.
        url: String,
    },
    /// When it ended, no viewer had been shown all of it.
    ViewerMissed {
        /// The address.
        url: String,
    },
    /// A sink falls behind, so that messages to it are dropped.
    Behind {
        /// Which sink.
        sink: String,
    },
    /// Messages never reached the session file.
    Dropped {
        /// How many so far, by channel.
        channels: Vec<(String, u64)>,
    },
    /// There is room again: the session goes on in another file.
    Resumed {
        /// Which one.
        path: PathBuf,
    },
    /// A sink cannot go on.
    Failed {
        /// Which sink.
        sink: String,
        /// What happened.
        why: String,
    },
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoViewer => f.write_str(
                "no Rerun viewer is running and none is on the PATH, so nothing is shown; to get it: pip install \
                 rerun-sdk==0.36.3, or cargo install rerun-cli --version 0.36.3 --locked",
            ),
            Self::ViewerFailed { why } => write!(f, "the Rerun viewer could not be started ({why}); recording goes on"),
            Self::ViewerSilent { url } => write!(f, "no viewer answers at {url} yet; recording goes on"),
            Self::ViewerGone { url } => write!(
                f,
                "the viewer at {url} has gone; recording goes on, and it is shown the session again when it is back"
            ),
            Self::ViewerMissed { url } => write!(
                f,
                "no viewer at {url} was shown the end: none was there, or it took too long to begin"
            ),
            Self::Behind { sink } => write!(f, "{sink} falls behind; what it misses is counted"),
            Self::Dropped { channels } => {
                f.write_str("missing from the session file so far:")?;
                let mut channels = channels.iter();
                channels.try_for_each(|(channel, number)| write!(f, " {number} on {channel};"))
            }
            Self::Resumed { path } => write!(f, "recording goes on in {}", path.display()),
            Self::Failed { sink, why } => write!(f, "{sink} cannot go on ({why}); what it misses is counted"),
        }
    }
}

impl Notice {
    /// How much it matters to whoever reads the log: that nothing is kept any more is as bad as it gets.
    #[must_use]
    pub const fn level(&self) -> Level {
        match self {
            Self::Failed { .. } => Level::Error,
            Self::Resumed { .. } => Level::Info,
            _ => Level::Warning,
        }
    }
}
