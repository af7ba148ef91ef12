//! A live viewer as a sink: it may be absent, late, slow, frozen, killed and started again.
//!
//! What was heard goes into a [`History`], which never waits. Showing is the work of an attempt: a disposable thread
//! that waits until somebody listens, connects, shows the history from its beginning and then follows it. An attempt
//! ends with its connection, and the next one begins; one that hangs with a frozen viewer hurts nobody.

use std::process::Child;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::thread;
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, after, bounded};

use super::Notice;
use super::feed::Sink;
use super::history::History;
use super::program;
use super::rerun_stream::{Connected, Show, StreamSink};
use super::shared::Shared;
use crate::config::ViewTarget;
use crate::heard::Heard;

/// How many flushes nobody may answer before we say so; trying goes on.
const PATIENCE: u32 = 4;
/// How often an attempt looks for somebody who listens.
const LOOK_EVERY: Duration = Duration::from_millis(250);
/// How long an attempt waits for news before it looks at its connection.
const NEWS_WITHIN: Duration = Duration::from_millis(100);

/// ```text
///          begin              somebody listens            connection lost
///   Begun ───────▶ Looking ───────────────────▶ Showing ──────────────────▶ Gone: a Notice
///                   ▲ └ nobody: a Notice                                      │
///                   └─────────────────────── the next attempt ────────────────┘
/// ```
pub(super) struct ViewerSink {
    target: ViewTarget,
    show: Show,
    shared: Arc<Shared>,
    history: Arc<History>,
    attempt: Option<Attempt>,
    /// The viewer that we started, until it has answered.
    child: Option<Child>,
    unanswered: u32,
}

/// The supervising side of an attempt.
struct Attempt {
    phase: Arc<AtomicU8>,
    is_abandoned: Arc<AtomicBool>,
    /// Whether everything was shown, once it has ended.
    done: Receiver<bool>,
}

const LOOKING: u8 = 0;
const SHOWING: u8 = 1;
const GONE: u8 = 2;

impl ViewerSink {
    pub(super) fn new(target: ViewTarget, show: Show, history_bytes: usize, shared: Arc<Shared>) -> Self {
        let history = Arc::new(History::new(history_bytes));
        Self {
            target,
            show,
            shared,
            history,
            attempt: None,
            child: None,
            unanswered: 0,
        }
    }

    fn url(&self) -> String {
        match &self.target {
            ViewTarget::Connect(url) => url.clone(),
            _ => program::local_url(),
        }
    }

    fn try_anew(&mut self) -> Result<(), Notice> {
        self.unanswered = 0;
        let (history, shared) = (Arc::clone(&self.history), Arc::clone(&self.shared));
        self.attempt = Some(Attempt::start(self.url(), self.show.clone(), history, shared)?);
        Ok(())
    }

    /// Whether there will be somebody to show it to: one who listens, or whom we started and who has not failed.
    fn is_coming(&mut self) -> bool {
        let started = self.child.as_mut().map(Child::try_wait);
        matches!(started, Some(Ok(None))) || program::is_viewer_listening(&self.url())
    }

    fn wait_for_answer(&mut self) {
        self.unanswered += 1;
        if self.unanswered == PATIENCE && self.child.is_none() {
            self.shared.say(Notice::ViewerSilent { url: self.url() });
        }
        let ended = self.child.as_mut().and_then(|child| child.try_wait().ok().flatten());
        // The `rerun` command may hand over to another process and end well.
        if let Some(status) = ended.filter(|status| !status.success()) {
            self.child = None;
            self.shared.say(Notice::ViewerFailed {
                why: status.to_string(),
            });
        }
    }
}

impl Sink for ViewerSink {
    fn begin(&mut self) -> Result<(), Notice> {
        self.child = match self.target {
            ViewTarget::Spawn => program::find_or_start(program::WINDOW)?,
            ViewTarget::Serve => program::find_or_start(program::SERVER)?,
            ViewTarget::Connect(_) | ViewTarget::Save(_) => None,
        };
        self.try_anew()
    }

    fn take(&mut self, heard: &Arc<Heard>) -> Result<bool, Notice> {
        self.history.push(Arc::clone(heard));
        Ok(true)
    }

    fn flush(&mut self) -> Result<(), Notice> {
        let phase = self
            .attempt
            .as_ref()
            .map(|attempt| attempt.phase.load(Ordering::Relaxed));
        match phase {
            Some(LOOKING) => self.wait_for_answer(),
            Some(SHOWING) => self.child = None,
            _ => {
                self.shared.say(Notice::ViewerGone { url: self.url() });
                self.try_anew()?;
            }
        }
        Ok(())
    }

    fn close(&mut self) -> Result<(), Notice> {
        self.history.end();
        let Some(attempt) = self.attempt.take() else {
            return Ok(());
        };
        let is_shown = attempt.phase.load(Ordering::Relaxed) == SHOWING;
        // Whoever closes us has set a limit, and leaves this thread behind when it is reached.
        if (is_shown || self.is_coming()) && attempt.done.recv().unwrap_or(false) {
            return Ok(());
        }
        Err(Notice::ViewerMissed { url: self.url() })
    }
}

impl Attempt {
    fn start(url: String, show: Show, history: Arc<History>, shared: Arc<Shared>) -> Result<Self, Notice> {
        let (end, done) = bounded(1);
        let attempt = Self {
            phase: Arc::new(AtomicU8::new(LOOKING)),
            is_abandoned: Arc::new(AtomicBool::new(false)),
            done,
        };
        let worker = Worker {
            url,
            show,
            history,
            phase: Arc::clone(&attempt.phase),
            shared,
            is_abandoned: Arc::clone(&attempt.is_abandoned),
        };
        let named = thread::Builder::new().name("recorder: shows a viewer".to_owned());
        let started = named.spawn(move || worker.run(&end));
        started.map_err(|error| Notice::Failed {
            sink: "the live view".to_owned(),
            why: error.to_string(),
        })?;
        Ok(attempt)
    }
}

impl Drop for Attempt {
    fn drop(&mut self) {
        self.is_abandoned.store(true, Ordering::Relaxed);
    }
}

/// The attempt's own thread.
struct Worker {
    url: String,
    show: Show,
    history: Arc<History>,
    shared: Arc<Shared>,
    phase: Arc<AtomicU8>,
    is_abandoned: Arc<AtomicBool>,
}

impl Worker {
    fn run(self, end: &Sender<bool>) {
        while !program::is_viewer_listening(&self.url) {
            if self.is_abandoned.load(Ordering::Relaxed) {
                return;
            }
            after(LOOK_EVERY).recv().ok();
        }
        let mut is_complete = false;
        if let Ok(connected) = StreamSink::connect(&self.url, &self.show, Arc::clone(&self.shared)) {
            self.phase.store(SHOWING, Ordering::Relaxed);
            is_complete = self.follow(connected).unwrap_or(false);
        }
        self.phase.store(GONE, Ordering::Relaxed);
        end.try_send(is_complete).ok();
    }

    /// Shows the history to its end, or until the connection or the wish for it is lost; whether to its end.
    fn follow(&self, connected: Connected) -> Result<bool, Notice> {
        let Connected { mut sink, connection } = connected;
        sink.begin()?;
        let mut place = 0;
        while !connection.is_lost() && !self.is_abandoned.load(Ordering::Relaxed) {
            let page = self.history.read(place, NEWS_WITHIN);
            // What was gone before it came is no loss; what fell out while it was there is.
            if place > 0 {
                self.shared.miss(page.missed);
            }
            for heard in &page.entries {
                sink.take(heard)?;
            }
            place = page.next;
            if page.is_last {
                sink.close()?;
                return Ok(!connection.is_lost());
            }
        }
        Ok(false)
    }
}
