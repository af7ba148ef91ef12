//! A process around one node: connected, and listening for Ctrl-C.

use std::time::{Duration, Instant};

use anyhow::bail;
use crossbeam_channel::Receiver;
use tandem_link::{JournalReport, Link, Observer, Running, Sighting};
use tandem_site::Role;
use tandem_wire::{Motion, NodeName, Pace, Reason, Setpoint, State, Topic, decode};

use super::dialling::describe;
use crate::gate::{Gate, LOOK};
use crate::parts::Parts;
use crate::{Outcome, interrupt};

/// How often a process looks whether its node has ended.
pub(super) const POLL: Duration = Duration::from_millis(100);

/// A process around one node: connected, and listening for Ctrl-C.
pub(super) struct Process {
    pub(super) link: Link,
    pub(super) interrupted: Receiver<()>,
    gate: Gate,
}

impl Process {
    /// Connects, for as long as it takes; `None` if the user gave up first.
    pub(super) fn begin(parts: &Parts, name: NodeName) -> anyhow::Result<Option<Self>> {
        Self::begin_as(parts, Role::of(name), name)
    }

    /// The same with another role's certificate.
    pub(super) fn begin_as(parts: &Parts, role: Role, name: NodeName) -> anyhow::Result<Option<Self>> {
        let interrupted = interrupt::catch()?;
        let settings = parts.link_settings();
        let gate = Gate::new(settings, role)?;
        eprintln!("{name}: {}", describe(settings, gate.reach()));
        let Some(link) = gate.open(&interrupted)? else {
            return Ok(None);
        };
        eprintln!("{name}: ready, robot {:?}; Ctrl-C ends it", link.robot().as_str());
        Ok(Some(Self {
            link,
            interrupted,
            gate,
        }))
    }

    /// Runs until Ctrl-C, or until the node ends by itself.
    pub(super) fn wait(&self, running: &Running) {
        while !running.is_finished() && self.interrupted.recv_timeout(POLL).is_err() {}
    }

    /// Runs as [`Process::wait`] does, or until the roster has changed: then the node has to end and begin anew. A new run would
    /// not know of an emergency stop, so while one is in force, and nothing moves, the roster waits.
    pub(super) fn wait_for_roster(&mut self, running: &Running) -> anyhow::Result<bool> {
        let (mut next, mut word) = (Instant::now() + LOOK, None);
        while !running.is_finished() && self.interrupted.recv_timeout(POLL).is_err() {
            if Instant::now() < next {
                continue;
            }
            next = Instant::now() + LOOK;
            let heard = word.as_ref().map(is_stopped);
            if self.gate.look() && word.is_none() {
                word = Some(Observer::of_topics(
                    &self.link,
                    Pace::Real,
                    &[Topic::State, Topic::Setpoint],
                )?);
            }
            if heard == Some(false) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Opens the session again, by the roster of now; says whether it did, or the user gave up.
    pub(super) fn begin_anew(&mut self, name: NodeName) -> anyhow::Result<bool> {
        let Some(link) = self.gate.reopen(&self.interrupted)? else {
            return Ok(false);
        };
        self.link = link;
        eprintln!("{name}: ready again; {}; Ctrl-C ends it", self.gate.admits());
        Ok(true)
    }

    pub(super) fn end(&self, running: Running, name: NodeName) -> anyhow::Result<Outcome> {
        running.stop();
        let Some(report) = running.join() else {
            bail!("{name} panicked: please report this")
        };
        self.link.close();
        if let Some(awaited) = report.awaited {
            bail!("{name}: {awaited} did not answer for two seconds, so lockstep cannot go on");
        }
        tell_of_journal(name, &report.journal);
        let lost = report.dropped + report.journal.lost;
        eprintln!(
            "{name}: ended after {} steps, {lost} inputs or journal entries lost",
            report.steps
        );
        Ok(if lost > 0 { Outcome::SamplesLost } else { Outcome::Done })
    }
}

/// Whether an emergency stop is in force, by what robot and arbiter have said of motion since this was asked last.
fn is_stopped(word: &Observer) -> bool {
    let motion = |sighting: Sighting| match sighting {
        Sighting::Sample {
            topic: Topic::State,
            bytes,
            ..
        } => Some(decode::<State>(&bytes).ok()?.body.motion),
        Sighting::Sample { bytes, .. } => Some(decode::<Setpoint>(&bytes).ok()?.body.motion),
        Sighting::Presence { .. } => None,
    };
    let said = std::iter::from_fn(|| word.next(Duration::ZERO)).filter_map(motion);
    let stopped = said.map(|motion| matches!(motion, Motion::Held(Reason::EmergencyStop { .. })));
    stopped.last().unwrap_or(false)
}

/// Says what a person should know of a journal that no recorder took whole.
pub(crate) fn tell_of_journal(name: NodeName, journal: &JournalReport) {
    if journal.disk_failed {
        eprintln!("{name}: the disk failed, so its journal was sent and not kept; gaps in it stay");
    }
    if let Some(folder) = &journal.kept {
        eprintln!(
            "{name}: no recorder said that it has all of the journal, so it stays in {}",
            folder.display()
        );
    }
}
