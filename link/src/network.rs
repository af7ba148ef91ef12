//! Watching every robot of a network at once, and asking nodes who they are.

use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, bounded};
use tandem_wire::{Envelope, NodeInfo, NodeName, RobotName, Stamp, Topic, decode, keys};
use zenoh::Wait;
use zenoh::pubsub::Subscriber;
use zenoh::sample::SampleKind;

use crate::Clock;
use crate::entrance::at_most;
use crate::net::{Link, LinkError, declare};

/// What may wait to be looked at.
const QUEUE: usize = 1 << 16;

/// Something seen of some robot.
#[derive(Clone, Debug)]
pub struct Noticed {
    /// When, by this process's clock.
    pub at: Stamp,
    /// Of which robot.
    pub robot: RobotName,
    /// On which topic; [`Topic::Alive`] is presence.
    pub topic: Topic,
    /// The bytes of a sample, untrusted. Of presence: none, and whether there is somebody now stands in `alive`.
    pub bytes: Vec<u8>,
    /// Whether a node is there; always true of a sample.
    pub alive: bool,
}

/// Sees some topics of some robots, and who is there. What it is too slow for it misses.
pub struct Network {
    receiver: Receiver<Noticed>,
    _subscribers: Vec<Subscriber<()>>,
}

impl Network {
    /// Watches `robots`, each a name or `*` for all.
    ///
    /// # Errors
    /// If Zenoh refuses.
    pub fn watch(link: &Link, robots: &[String], topics: &[Topic]) -> Result<Self, LinkError> {
        let (sender, receiver) = bounded(QUEUE);
        let mut subscribers = Vec::new();
        for robot in robots {
            for topic in topics {
                let key = format!("{}/{robot}/{}", keys::ROOT, topic.suffix());
                let subscriber = link.session.declare_subscriber(&key).callback(notice(sender.clone()));
                subscribers.push(subscriber.wait().map_err(|error| declare(&key, &error))?);
            }
        }
        // Presence is for all to see, but of the robots that are watched.
        for robot in robots {
            let key = format!("{}/{robot}/alive/*", keys::ROOT);
            let presence = link.session.liveliness().declare_subscriber(&key).history(true);
            let subscriber = presence.callback(notice(sender.clone()));
            subscribers.push(subscriber.wait().map_err(|error| declare(&key, &error))?);
        }
        Ok(Self {
            receiver,
            _subscribers: subscribers,
        })
    }

    /// The next thing noticed, or `None` after `limit` without one.
    #[must_use]
    pub fn next(&self, limit: Duration) -> Option<Noticed> {
        self.receiver.recv_timeout(limit).ok()
    }
}

fn notice(sender: Sender<Noticed>) -> impl Fn(zenoh::sample::Sample) + Send + Sync + 'static {
    let clock = Clock::of_process();
    move |sample| {
        let Some((robot, topic)) = keys::parse(sample.key_expr().as_str()) else {
            return;
        };
        let noticed = Noticed {
            at: clock.now(),
            robot,
            topic,
            bytes: at_most(topic.max_bytes(), sample.payload()),
            alive: sample.kind() == SampleKind::Put,
        };
        // Gone or too slow: a watcher owes nobody anything.
        let _ = sender.try_send(noticed);
    }
}

impl Link {
    /// Asks a node who it is; `None` if it does not answer within `limit`, or not in words that can be read.
    #[must_use]
    pub fn ask(&self, robot: &RobotName, node: NodeName, limit: Duration) -> Option<Envelope<NodeInfo>> {
        let replies = self
            .session
            .get(Topic::Info(node).key(robot))
            .timeout(limit)
            .wait()
            .ok()?;
        let samples = replies.into_iter().filter_map(|reply| reply.into_result().ok());
        let mut read = samples.filter_map(|sample| decode::<NodeInfo>(&sample.payload().to_bytes()).ok());
        read.next()
    }
}
