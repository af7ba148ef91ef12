//! The recorder's own view as a target: a live viewer, or a Rerun recording.

use std::time::{Duration, Instant};

use anyhow::bail;
use tandem_recorder::{Notice, Provenance, Recorded, Recorder, RecorderConfig, Sinks};
use tandem_wire::{Input, Node, Outbox, Ports, Stamp, Timing};

use super::Closing;

/// How long a file may take to be written to its end.
const FILE_CLOSE_LIMIT: Duration = Duration::from_secs(30);
/// How long a live viewer may take for what is on its way; one that is absent never will.
const VIEWER_CLOSE_LIMIT: Duration = Duration::from_secs(2);
/// How long a target that takes nothing is waited for.
const STALL: Duration = Duration::from_secs(5);
/// A message becomes at most this many outputs.
const OUTPUTS: usize = 16;

/// The recorder's own view, fed by a recorder that hears the session once more.
pub(crate) struct Screen {
    config: RecorderConfig,
    timing: Timing,
    provenance: Provenance,
    recorder: Recorder,
    outbox: Outbox<tandem_recorder::Output>,
    sinks: Option<Sinks>,
    /// Whether the target is waited for: files are, a live viewer is not.
    waits: bool,
    is_file: bool,
    last: Stamp,
    closing: Closing,
}

impl Screen {
    pub(crate) fn open(
        config: RecorderConfig,
        timing: Timing,
        provenance: Provenance,
        waits: bool,
        is_file: bool,
    ) -> anyhow::Result<Self> {
        Ok(Self {
            sinks: Some(Sinks::open(&config, timing, &provenance)?),
            recorder: Recorder::new(timing),
            outbox: Outbox::default(),
            config,
            timing,
            provenance,
            waits,
            is_file,
            last: Stamp(0),
            closing: Closing {
                lost: 0,
                was_there: true,
            },
        })
    }

    pub(super) fn play(&mut self, message: Recorded) -> anyhow::Result<()> {
        let (topic, bytes) = (message.topic, message.bytes.as_slice());
        self.feed(message.at, Input::Sample { topic, bytes })
    }

    fn feed(&mut self, at: Stamp, input: Input<'_>) -> anyhow::Result<()> {
        self.wait_for_room()?;
        self.last = self.last.max(at);
        self.recorder.step(self.last, Recorder::event(input), &mut self.outbox);
        if let Some(sinks) = &mut self.sinks {
            for output in self.outbox.drain() {
                sinks.handle(output);
            }
        }
        self.hear()
    }

    /// Passes on what the sinks have to say. A viewer that was there and vanished ends the replay: nobody looks on.
    pub(super) fn hear(&mut self) -> anyhow::Result<()> {
        let notices = self.sinks.as_mut().map(Sinks::notices).unwrap_or_default();
        for notice in notices {
            if let Notice::ViewerGone { url } = notice {
                self.closing.was_there = false;
                bail!("the viewer at {url} has gone: start it, and replay again, with --from to go on");
            }
            eprintln!("replay: {notice}\r");
        }
        Ok(())
    }

    fn wait_for_room(&self) -> anyhow::Result<()> {
        let Some(sinks) = self.sinks.as_ref().filter(|_| self.waits) else {
            return Ok(());
        };
        let limit = Instant::now() + STALL;
        while sinks.room() < OUTPUTS {
            if Instant::now() > limit {
                bail!("the target has taken nothing for {} s", STALL.as_secs());
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(())
    }

    /// A new recording in the viewer: the old one keeps what was shown.
    pub(super) fn begin_again(&mut self) -> anyhow::Result<()> {
        self.finish();
        self.closing.was_there = true;
        self.provenance.epoch_unix_nanos += 1;
        self.sinks = Some(Sinks::open(&self.config, self.timing, &self.provenance)?);
        self.recorder = Recorder::new(self.timing);
        self.last = Stamp(0);
        Ok(())
    }

    fn finish(&mut self) {
        // The last counts; a target that no longer takes them is said below.
        let _ = self.feed(self.last, Input::Stop);
        if let Some(sinks) = self.sinks.take() {
            let closed = sinks.close(match self.is_file {
                true => FILE_CLOSE_LIMIT,
                // Said already, and nobody to wait for.
                false if !self.closing.was_there => Duration::ZERO,
                false => VIEWER_CLOSE_LIMIT,
            });
            if !self.closing.was_there {
                return;
            }
            for notice in &closed.notices {
                self.closing.was_there &= !matches!(notice, Notice::ViewerMissed { .. });
                eprintln!("replay: {notice}\r");
            }
            let unfinished = closed.sinks.iter().filter(|ended| ended.messages.is_none());
            for ended in unfinished.clone() {
                eprintln!("replay: {} did not take everything in time\r", ended.sink);
            }
            self.closing.lost += closed.drops.views.total() + unfinished.count() as u64;
        }
    }

    pub(super) fn close(mut self) -> Closing {
        self.finish();
        self.closing
    }
}
