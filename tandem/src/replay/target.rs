//! Where a replay goes: the Rerun view, or the network under another robot's name.

use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use tandem_link::{Link, Observer, Sighting};
use tandem_recorder::{Notice, Provenance, Recorded, Recorder, RecorderConfig, Sinks};
use tandem_wire::{Input, Node, NodeName, Outbox, Pace, Ports, Stamp, Timing, Topic};

/// How long a file may take to be written to its end.
const FILE_CLOSE_LIMIT: Duration = Duration::from_secs(30);
/// How long a live viewer may take for what is on its way; one that is absent never will.
const VIEWER_CLOSE_LIMIT: Duration = Duration::from_secs(2);
/// How long a target that takes nothing is waited for.
const STALL: Duration = Duration::from_secs(5);
/// A message becomes at most this many outputs.
const OUTPUTS: usize = 16;
/// How long a robot of that name has to show itself.
const PRESENCE: Duration = Duration::from_millis(300);

/// What may be published: nothing that a robot obeys.
pub(super) const SHOWN: [Topic; 5] = [
    Topic::State,
    Topic::Proposal,
    Topic::Forecast,
    Topic::Scene,
    Topic::Trial,
];

pub(super) enum Target {
    View(Box<Screen>),
    Network(Network),
}

impl Target {
    pub(super) fn play(&mut self, message: &Recorded) -> anyhow::Result<()> {
        match self {
            Self::View(screen) => screen.play(message),
            Self::Network(network) => network.play(message),
        }
    }

    /// Whether it is still there.
    pub(super) fn look(&mut self) -> anyhow::Result<()> {
        match self {
            Self::View(screen) => screen.hear(),
            Self::Network(network) => network.look(),
        }
    }

    /// What follows does not continue what was played.
    pub(super) fn begin_again(&mut self) -> anyhow::Result<()> {
        match self {
            Self::View(screen) => screen.begin_again(),
            Self::Network(network) => {
                network.pass += 1;
                Ok(())
            }
        }
    }

    /// Ends it, and says what became of it.
    pub(super) fn close(self) -> Closing {
        match self {
            Self::View(screen) => screen.close(),
            Self::Network(network) => network.close(),
        }
    }
}

/// How a target ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Closing {
    /// Messages that were lost on the way.
    pub(super) lost: u64,
    /// Whether the target was there to the end.
    pub(super) was_there: bool,
}

/// The recorder's own view, fed by a recorder that hears the session once more.
pub(super) struct Screen {
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
    pub(super) fn open(
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

    fn play(&mut self, message: &Recorded) -> anyhow::Result<()> {
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
    fn hear(&mut self) -> anyhow::Result<()> {
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
    fn begin_again(&mut self) -> anyhow::Result<()> {
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

    fn close(mut self) -> Closing {
        self.finish();
        self.closing
    }
}

/// Who plays a part on this robot; a recorder only listens.
pub(super) fn present(link: &Link) -> anyhow::Result<Vec<NodeName>> {
    let presence = Observer::of_presence(link)?;
    let limit = Instant::now() + PRESENCE;
    let mut present = Vec::new();
    while let Some(sighting) = presence.next(limit.saturating_duration_since(Instant::now())) {
        if let Sighting::Presence { peer, alive: true } = sighting
            && peer != NodeName::Recorder
        {
            present.push(peer);
        }
    }
    Ok(present)
}

/// The network, under another robot's name.
pub(super) struct Network {
    link: Link,
    pace: Pace,
    /// What a topic is called instead.
    names: Vec<(Topic, String)>,
    pass: u64,
    /// Whether it depends on whom it has dialled: nobody can dial it.
    only_dials: bool,
    /// Whether somebody was at the other end.
    was_heard: bool,
}

impl Network {
    /// Refuses a name under which a robot is alive: two would speak as one.
    pub(super) fn open(link: Link, pace: Pace, names: Vec<(Topic, String)>, only_dials: bool) -> anyhow::Result<Self> {
        if let Some(peer) = present(&link)?.first() {
            bail!(
                "a {peer} is alive as {:?}: choose another --robot name",
                link.robot().as_str()
            );
        }
        Ok(Self {
            was_heard: link.is_connected(),
            link,
            pace,
            names,
            pass: 0,
            only_dials,
        })
    }

    /// A session that only dials speaks to nobody once the other end is gone; Zenoh would not say so.
    fn look(&mut self) -> anyhow::Result<()> {
        let is_heard = self.link.is_connected();
        if self.only_dials && self.was_heard && !is_heard {
            bail!("whom this replay was connected to has gone: start it, and replay again, with --from to go on");
        }
        self.was_heard |= is_heard;
        Ok(())
    }

    fn play(&self, message: &Recorded) -> anyhow::Result<()> {
        if !SHOWN.contains(&message.topic) {
            return Ok(());
        }
        let mut bytes = message.bytes.clone();
        self.renew_session(&mut bytes);
        let name = self.names.iter().find(|(topic, _)| *topic == message.topic);
        let name = name.map_or_else(|| message.topic.suffix(), |(_, name)| name.clone());
        self.link
            .publish_as(&name, message.topic.delivery(), self.pace, bytes)
            .with_context(|| format!("cannot replay {}", message.topic))
    }

    /// It was looked at when the last message was played.
    fn close(self) -> Closing {
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
