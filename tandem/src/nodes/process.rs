//! A process around one node: connected, and listening for Ctrl-C.

use std::time::Duration;

use anyhow::bail;
use crossbeam_channel::Receiver;
use tandem_link::{JournalReport, Link, LinkSettings, Reach, Running};
use tandem_site::Role;
use tandem_wire::NodeName;

use super::dialling::{connect, describe};
use crate::parts::Parts;
use crate::{Outcome, interrupt};

/// How often a process looks whether its node has ended.
pub(super) const POLL: Duration = Duration::from_millis(100);

/// A process around one node: connected, and listening for Ctrl-C.
pub(super) struct Process {
    pub(super) link: Link,
    pub(super) interrupted: Receiver<()>,
}

impl Process {
    /// Connects, for as long as it takes; `None` if the user gave up first.
    pub(super) fn begin(parts: &Parts, name: NodeName) -> anyhow::Result<Option<Self>> {
        let settings = parts.link_settings();
        Self::begin_at(settings, &Reach::new(settings, Some(Role::of(name)))?, name)
    }

    /// The same as whoever `reach` says.
    pub(super) fn begin_at(settings: &LinkSettings, reach: &Reach, name: NodeName) -> anyhow::Result<Option<Self>> {
        let interrupted = interrupt::catch()?;
        eprintln!("{name}: {}", describe(settings, reach));
        let Some(link) = connect(settings, reach, || interrupted.try_recv().is_ok())? else {
            return Ok(None);
        };
        eprintln!("{name}: ready, robot {:?}; Ctrl-C ends it", link.robot().as_str());
        Ok(Some(Self { link, interrupted }))
    }

    /// Runs until Ctrl-C, or until the node ends by itself.
    pub(super) fn wait(&self, running: &Running) {
        while !running.is_finished() && self.interrupted.recv_timeout(POLL).is_err() {}
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
