//! The network as a target, under another robot's name.

use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use tandem_link::{Link, Observer, Player, Sighting};
use tandem_recorder::Recorded;
use tandem_wire::{NodeName, Pace, Topic};

use super::{Closing, SHOWN};

/// How long a robot of that name has to show itself.
const PRESENCE: Duration = Duration::from_millis(300);

/// Who plays a part on this robot; a recorder only listens.
pub(crate) fn present(link: &Link) -> anyhow::Result<Vec<NodeName>> {
    Ok(seen(&Observer::of_presence(link)?, PRESENCE))
}

/// Whoever has come alive, as far as that shows within `limit`.
fn seen(presence: &Observer, limit: Duration) -> Vec<NodeName> {
    let limit = Instant::now() + limit;
    let mut seen = Vec::new();
    while let Some(sighting) = presence.next(limit.saturating_duration_since(Instant::now())) {
        if let Sighting::Presence { peer, alive: true } = sighting
            && peer != NodeName::Recorder
        {
            seen.push(peer);
        }
    }
    seen
}

/// The network, under another robot's name.
pub(crate) struct Network {
    link: Link,
    pace: Pace,
    /// What a topic is called instead.
    names: Vec<(Topic, String)>,
    pass: u64,
    /// Says that this name is spoken for, for other replays.
    _player: Player,
    /// Who comes and goes under this name.
    presence: Observer,
    /// Whether it depends on whom it has dialled: nobody can dial it.
    only_dials: bool,
    /// Whether somebody was at the other end.
    was_heard: bool,
}

impl Network {
    /// Refuses a name under which a robot is alive or another replay plays: two would speak as one.
    pub(crate) fn open(link: Link, pace: Pace, names: Vec<(Topic, String)>, only_dials: bool) -> anyhow::Result<Self> {
        let name = link.robot().clone();
        let player = Player::announce(&link)?;
        let presence = Observer::of_presence(&link)?;
        if let Some(peer) = seen(&presence, PRESENCE).first() {
            bail!("a {peer} is alive as \"{name}\": choose another --robot name");
        }
        if player.others()? > 0 {
            bail!("another replay plays as \"{name}\": choose another --robot name, or end that one first");
        }
        Ok(Self {
            was_heard: link.is_connected(),
            link,
            pace,
            names,
            pass: 0,
            _player: player,
            presence,
            only_dials,
        })
    }

    /// What follows is another run of its senders.
    pub(super) const fn begin_again(&mut self) {
        self.pass += 1;
    }

    /// Ends the replay where a robot of this name came alive, or nobody is left to hear it: Zenoh would say neither.
    pub(super) fn look(&mut self) -> anyhow::Result<()> {
        if let Some(peer) = seen(&self.presence, Duration::ZERO).first() {
            let name = self.link.robot();
            bail!("a {peer} has come alive as \"{name}\", and two would speak as one: choose another --robot name");
        }
        let is_heard = self.link.is_connected();
        if self.only_dials && self.was_heard && !is_heard {
            bail!("whom this replay was connected to has gone: start it, and replay again, with --from to go on");
        }
        self.was_heard |= is_heard;
        Ok(())
    }

    pub(super) fn play(&self, message: Recorded) -> anyhow::Result<()> {
        if !SHOWN.contains(&message.topic) {
            return Ok(());
        }
        let mut bytes = message.bytes;
        self.renew_session(&mut bytes);
        let name = self.names.iter().find(|(topic, _)| *topic == message.topic);
        let name = name.map_or_else(|| message.topic.suffix(), |(_, name)| name.clone());
        self.link
            .publish_as(&name, message.topic.delivery(), self.pace, bytes)
            .with_context(|| format!("cannot replay {}", message.topic))
    }

    /// It was looked at when the last message was played.
    pub(super) fn close(self) -> Closing {
        self.link.close();
        Closing {
            lost: 0,
            was_there: true,
        }
    }

    /// A second pass is another run of its sender, or every receiver would drop it as late. The first travels as it was.
    fn renew_session(&self, bytes: &mut [u8]) {
        for (byte, salt) in bytes.iter_mut().skip(8).take(8).zip(self.pass.to_le_bytes()) {
            *byte ^= salt;
        }
    }
}
