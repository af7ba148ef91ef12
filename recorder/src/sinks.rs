//! Where outputs end up: the session file and the views, each behind a bounded queue and a thread of its own.
//!
//! ```text
//!             try_send            ┌ queue ─▶ thread: session file
//!   handle ─────────────▶ full? ──┼ queue ─▶ thread: .rrd file
//!      never waits        drop,   └ queue ─▶ thread: live viewer, which may be absent, frozen or gone
//!                         count it
//! ```
//!
//! A sink that fails or falls behind says so once, as a [`Notice`]; from then on what it misses is counted. Closing
//! waits for the threads up to a limit and then leaves them behind.

mod closed;
mod disk;
mod drops;
mod feed;
mod file;
mod history;
mod landmarks;
mod notice;
mod open;
mod program;
mod rerun_stream;
mod shared;
mod viewer;
mod what_if;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use crossbeam_channel::{Receiver, bounded};
use tandem_wire::{Condition, NodeName, Storage, Timing, Topic};

use crate::config::RecorderConfig;
use crate::heard::{Entry, Heard, Note};
use crate::node::Output;
use crate::session_file::Provenance;
use crate::urdf::Urdf;
use crate::view::Meshes;
pub use closed::{Closed, Ended};
pub use drops::{Drops, Lost};
use feed::Feed;
pub use file::part_path;
pub use notice::Notice;
pub use open::OpenError;
use open::{keep_what_is_there, open_file, open_view};
pub use program::{find_viewer, is_viewer_listening};
use rerun_stream::Show;
use shared::{Kind, Shared};
pub use what_if::{Heading, save_what_if};

/// Notices that may wait to be read; each sink makes one or two in its life.
const NOTICES: usize = 32;

/// The session file and the views.
pub struct Sinks {
    file: Option<Feed>,
    views: Vec<Feed>,
    shared: Arc<Shared>,
    told: Receiver<Notice>,
    notices: Vec<Notice>,
    /// What was missing from the session file when that was last asked.
    dropped_before: u64,
    /// The same when it was last told to people.
    dropped_said: u64,
    /// What was lost before the recorder took it up, when that was last told.
    never_heard: BTreeMap<Topic, u64>,
}

impl Sinks {
    /// Opens what the settings ask for.
    ///
    /// # Errors
    /// If a file cannot be created, or is there already and shall not be replaced, with its path and the reason. A viewer that is not there is no error: it becomes
    /// a [`Notice`].
    pub fn open(config: &RecorderConfig, timing: Timing, provenance: &Provenance) -> Result<Self, OpenError> {
        keep_what_is_there(config)?;
        // First: what cannot be shown is known before any file is begun.
        let urdf = config.urdf.as_deref().map(Urdf::load).transpose()?;
        let (tell, told) = bounded(NOTICES);
        let shared = Arc::new(Shared::new(tell));
        let file = match &config.session_file {
            Some(path) => Some(open_file(config, path, provenance, &shared)?),
            None => None,
        };
        let show = Show {
            timing,
            provenance: provenance.clone(),
            purpose: config.purpose,
            meshes: urdf.as_ref().map(Meshes::new),
        };
        let mut views = Vec::with_capacity(config.views.len());
        for target in &config.views {
            views.push(open_view(config, target, &show, &shared)?);
        }
        Ok(Self {
            file,
            views,
            shared,
            told,
            notices: Vec::new(),
            dropped_before: 0,
            dropped_said: 0,
            never_heard: BTreeMap::new(),
        })
    }

    /// Passes an output on, or drops and counts it. Never waits.
    pub fn handle(&mut self, output: Output) {
        match output {
            Output::Write(heard) => {
                self.listen(&heard);
                if let Some(file) = &mut self.file {
                    file.offer(heard);
                }
            }
            Output::Show(heard) => {
                for view in &mut self.views {
                    view.offer(Arc::clone(&heard));
                }
            }
            // The shell has put it.
            Output::Ask(_) => {}
            // For the network, not for a file.
            Output::Say(_) => {}
        }
    }

    /// Takes in what was lost before the recorder took it up, counted from the beginning: it is missing from the session
    /// file (without one, from the views) like anything else that is dropped.
    pub fn count_never_heard(&mut self, so_far: BTreeMap<Topic, u64>) {
        let kind = match self.file {
            Some(_) => Kind::SessionFile,
            None => Kind::View,
        };
        // What the shell itself says is for no file.
        for (topic, number) in so_far.iter().filter(|(topic, _)| **topic != Topic::Device) {
            let before = self.never_heard.get(topic).copied().unwrap_or(0);
            self.shared.lose_before(kind, *topic, number.saturating_sub(before));
        }
        self.never_heard = so_far;
    }

    /// How many outputs every sink can still take now: for whoever may wait, as a replay to a file does.
    #[must_use]
    pub fn room(&self) -> usize {
        let feeds = self.file.iter().chain(&self.views);
        feeds.map(Feed::room).min().unwrap_or(usize::MAX)
    }

    /// What was dropped so far.
    #[must_use]
    pub fn drops(&self) -> Drops {
        self.shared.drops()
    }

    /// How the session file is doing, for whoever wants to tell others: [`Condition::Behind`] if something was dropped
    /// since this was last asked.
    pub fn storage(&mut self) -> Storage {
        let dropped = self.shared.drops().session_file.total();
        let before = std::mem::replace(&mut self.dropped_before, dropped);
        // Said at the first loss and at every doubling: often enough to be seen, too seldom to flood a log.
        if dropped > 0 && dropped >= self.dropped_said.saturating_mul(2) {
            self.dropped_said = dropped;
            let channels = self.shared.drops().session_file.by_channel().collect();
            self.shared.say(Notice::Dropped { channels });
        }
        let condition = match self.shared.condition() {
            Condition::Kept if dropped > before => Condition::Behind,
            condition => condition,
        };
        Storage { condition, dropped }
    }

    /// What there is to be said since it was last asked.
    pub fn notices(&mut self) -> Vec<Notice> {
        self.notices.extend(self.told.try_iter());
        std::mem::take(&mut self.notices)
    }

    /// Ends every sink, waiting for all of them together at most `limit`. What has not ended by then is left behind.
    #[must_use]
    pub fn close(mut self, limit: Duration) -> Closed {
        let mut until = crossbeam_channel::after(limit);
        let feeds: Vec<_> = self.file.take().into_iter().chain(self.views.drain(..)).collect();
        // All are told to end before any is waited for.
        let ending: Vec<_> = feeds.into_iter().map(Feed::end).collect();
        let mut sinks = Vec::with_capacity(ending.len());
        for ending in ending {
            let (ended, is_time_up) = ending.wait(&until);
            sinks.push(ended);
            if is_time_up {
                // The moment comes once; for those behind it has come as well.
                until = crossbeam_channel::after(Duration::ZERO);
            }
        }
        Closed {
            sinks,
            drops: self.shared.drops(),
            notices: self.notices(),
        }
    }

    /// Keeps what the sinks say in the session file and the views too, where the losses are.
    fn listen(&mut self, heard: &Heard) {
        while let Ok(notice) = self.told.try_recv() {
            let note = Note {
                level: notice.level(),
                about: NodeName::Recorder,
                is_routine: false,
                text: notice.to_string(),
            };
            let entry = Entry::Note(note);
            let heard = Arc::new(Heard { entry, ..*heard });
            for feed in self.file.iter_mut().chain(&mut self.views) {
                feed.offer(Arc::clone(&heard));
            }
            self.notices.push(notice);
        }
    }
}
