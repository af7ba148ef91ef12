//! The recorder of a run: one file goes on from trial to trial for as long as the control period stays the same.

use tandem_trials::Blueprint;
use tandem_wire::{NodeName, Stamp};

use super::Stage;
use crate::parts::{Parts, RunningRecorder, lost};

/// A recorder at work.
pub(super) struct Recording {
    recorder: RunningRecorder,
    pub(super) file: String,
    /// In lockstep the recorder counts time in this period, so another one needs another file.
    period: u64,
    /// When the file's first message came: in real time a session's seconds count from there.
    pub(super) first: Option<Stamp>,
}

impl Stage {
    /// Has a recorder at work that can record the task; a new file is called `next`.
    pub(crate) fn record(&mut self, blueprint: &Blueprint, next: impl FnOnce() -> String) -> anyhow::Result<()> {
        let period = blueprint.timing().period;
        if self
            .recording
            .as_ref()
            .is_some_and(|recording| recording.period == period)
        {
            return Ok(());
        }
        self.close_recording()?;
        let file = next();
        let mut configuration = blueprint.configuration().clone();
        configuration.recorder.path = self.folder.join(&file).display().to_string();
        let parts = Parts::new(configuration, None)?;
        let sinks = parts.sinks()?;
        let recorder = parts.recorder(&self.edge, sinks)?;
        self.sessions.push(file.clone());
        self.recording = Some(Recording {
            recorder,
            file,
            period,
            first: None,
        });
        Ok(())
    }

    pub(super) fn close_recording(&mut self) -> anyhow::Result<()> {
        if let Some(recording) = self.recording.take() {
            let closed = recording.recorder.stop()?;
            self.messages_lost += lost(&closed);
            // In lockstep time begins anew in a new file.
            self.next_tick = 0;
            self.settle(&[NodeName::Recorder])?;
        }
        Ok(())
    }

    /// When the session's file began, by its first message.
    pub(super) fn first_message(&self) -> Stamp {
        let first = self.recording.as_ref().and_then(|recording| recording.first);
        first.unwrap_or(Stamp(0))
    }
}
