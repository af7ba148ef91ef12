//! How recording ended, sink by sink.

use std::path::PathBuf;

use super::{Drops, Notice};

/// How one sink ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ended {
    /// Which sink, in words.
    pub sink: String,
    /// The file it wrote, if it wrote one.
    pub path: Option<PathBuf>,
    /// Messages that it took, or `None` if it had not ended when the time was up.
    pub messages: Option<u64>,
    /// Messages that it missed.
    pub dropped: u64,
}

/// How recording ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Closed {
    /// Every sink, the session file first.
    pub sinks: Vec<Ended>,
    /// What was dropped before them.
    pub drops: Drops,
    /// What was still to be said.
    pub notices: Vec<Notice>,
}
