//! A recorder without a session file: sees what happens around a robot, shows it, and takes no part.
//!
//! It asks for no journals, because a node that has been asked to the end of its journal throws it away, and it is not seen
//! as a recorder, because nodes that end wait for one. So it needs no more rights than a viewer's.

use tandem_link::{LinkError, LinkSettings, Network, Noticed, Reach};
use tandem_recorder::{Closed, Event, Recorder, Sinks};
use tandem_site::{Role, SiteError};
use tandem_wire::{Input, Node as _, NodeName, Outbox, Ports as _, Stamp, Topic};

use super::process::{POLL, Process};
use crate::parts::{CLOSE_LIMIT, Parts};

/// What a recorder hears from others that is drawn, noted or measured. Proposals, journals and configurations are not.
fn seen() -> Vec<Topic> {
    let is_shown = |topic: &Topic| {
        !matches!(
            topic,
            Topic::Proposal | Topic::Journal(_) | Topic::Info(_) | Topic::Device
        )
    };
    Recorder::INPUTS.iter().copied().filter(is_shown).collect()
}

/// Connects as whoever may do least and still see all; `None` if the user gave up first.
pub(super) fn begin(parts: &Parts) -> anyhow::Result<Option<Process>> {
    Process::begin_as(parts, role(parts.link_settings()), NodeName::Recorder)
}

/// A viewer, or a recorder where there is only a recorder's certificate.
fn role(settings: &LinkSettings) -> Role {
    let is_missing = |why: &SiteError| matches!(why, SiteError::NoKey { .. } | SiteError::WrongRole { .. });
    let has_none = |role| matches!(Reach::new(settings, Some(role)), Err(LinkError::Site(why)) if is_missing(&why));
    match has_none(Role::Viewer) && !has_none(Role::Recorder) {
        true => Role::Recorder,
        false => Role::Viewer,
    }
}

/// Shows what is seen until Ctrl-C.
pub(super) fn watch(parts: &Parts, process: &Process, sinks: Sinks) -> anyhow::Result<Closed> {
    let robots = [parts.link_settings().robot.clone()];
    let network = Network::watch(&process.link, &robots, &seen())?;
    let mut watcher = Watcher {
        node: parts.watcher(),
        outbox: Outbox::default(),
        now: Stamp(0),
        sinks,
    };
    while process.interrupted.try_recv().is_err() {
        match network.next(POLL) {
            Some(noticed) => watcher.see(&noticed),
            None => watcher.step(watcher.now, Event::Wake),
        }
    }
    watcher.step(watcher.now, Event::Stop);
    Ok(watcher.sinks.close(CLOSE_LIMIT))
}

/// The recorder's node and its views, outside the shell that would make them known.
struct Watcher {
    node: Recorder,
    outbox: Outbox<tandem_recorder::Output>,
    now: Stamp,
    sinks: Sinks,
}

impl Watcher {
    fn see(&mut self, noticed: &Noticed) {
        let input = match noticed.topic {
            Topic::Alive(peer) => Input::Presence {
                peer,
                alive: noticed.alive,
            },
            topic => Input::Sample {
                topic,
                bytes: &noticed.bytes,
            },
        };
        self.step(noticed.at, Recorder::event(input));
    }

    fn step(&mut self, at: Stamp, event: Event) {
        // Messages may overtake each other on their way from Zenoh's threads; time does not.
        self.now = self.now.max(at);
        self.node.step(self.now, event, &mut self.outbox);
        self.outbox.drain().for_each(|output| self.sinks.handle(output));
        for notice in self.sinks.notices() {
            eprintln!("recorder: {notice}");
        }
    }
}
