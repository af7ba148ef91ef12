//! Watching a robot without taking part: the demo's table, trials and tests look through this.

use crossbeam_channel::{Receiver, Sender, bounded};
use std::time::Duration;
use tandem_wire::{NodeName, Pace, Stamp, Topic, keys};
use zenoh::Wait;
use zenoh::pubsub::Subscriber;
use zenoh::sample::SampleKind;

use crate::Clock;
use crate::entrance::at_most;
use crate::net::{Link, LinkError, declare};

/// Sightings that may wait to be looked at.
const QUEUE: usize = 1 << 16;

/// Something seen on the network.
#[derive(Clone, Debug)]
pub enum Sighting {
    /// A sample.
    Sample {
        /// When it arrived, by this process's clock.
        at: Stamp,
        /// On which topic.
        topic: Topic,
        /// Its bytes, untrusted.
        bytes: Vec<u8>,
    },
    /// A node came or went.
    Presence {
        /// Which node.
        peer: NodeName,
        /// Whether it is there.
        alive: bool,
    },
}

/// Sees what happens around a robot.
pub struct Observer {
    receiver: Receiver<Sighting>,
    _subscribers: Vec<Subscriber<()>>,
}

impl Observer {
    /// Sees every message and who is there. In lockstep a slow watcher slows the loop; in real time it misses sightings.
    ///
    /// # Errors
    /// If Zenoh refuses.
    pub fn new(link: &Link, pace: Pace) -> Result<Self, LinkError> {
        let (sender, receiver) = bounded(QUEUE);
        let subscribers = vec![
            watch(link, pace, &link.robot.everything(), sender.clone())?,
            watch_presence(link, sender)?,
        ];
        Ok(Self {
            receiver,
            _subscribers: subscribers,
        })
    }

    /// Sees some topics: all that somebody may hear who is neither recorder nor viewer.
    ///
    /// # Errors
    /// If Zenoh refuses.
    pub fn of_topics(link: &Link, pace: Pace, topics: &[Topic]) -> Result<Self, LinkError> {
        let (sender, receiver) = bounded(QUEUE);
        let subscribers = topics
            .iter()
            .map(|topic| watch(link, pace, &topic.key(&link.robot), sender.clone()));
        Ok(Self {
            receiver,
            _subscribers: subscribers.collect::<Result<_, _>>()?,
        })
    }

    /// Sees who is there and nothing else.
    ///
    /// # Errors
    /// If Zenoh refuses.
    pub fn of_presence(link: &Link) -> Result<Self, LinkError> {
        let (sender, receiver) = bounded(QUEUE);
        Ok(Self {
            receiver,
            _subscribers: vec![watch_presence(link, sender)?],
        })
    }

    /// The next sighting, or `None` after `limit` without one.
    #[must_use]
    pub fn next(&self, limit: Duration) -> Option<Sighting> {
        self.receiver.recv_timeout(limit).ok()
    }
}

fn watch(link: &Link, pace: Pace, key: &str, sender: Sender<Sighting>) -> Result<Subscriber<()>, LinkError> {
    let clock = Clock::of_process();
    let subscriber = link.session.declare_subscriber(key).callback(move |sample| {
        let Some((_, topic)) = keys::parse(sample.key_expr().as_str()) else {
            return;
        };
        let sighting = Sighting::Sample {
            at: clock.now(),
            topic,
            bytes: at_most(topic.max_bytes(), sample.payload()),
        };
        // Gone or, in real time, too slow: an observer owes nobody anything.
        let _ = match pace {
            Pace::Lockstep => sender.send(sighting).is_ok(),
            Pace::Real => sender.try_send(sighting).is_ok(),
        };
    });
    subscriber.wait().map_err(|error| declare(key, &error))
}

fn watch_presence(link: &Link, sender: Sender<Sighting>) -> Result<Subscriber<()>, LinkError> {
    let key = format!("{}/{}/alive/*", keys::ROOT, link.robot);
    let subscriber = link
        .session
        .liveliness()
        .declare_subscriber(&key)
        .history(true)
        .callback(move |sample| {
            if let Some((_, Topic::Alive(peer))) = keys::parse(sample.key_expr().as_str()) {
                // An observer that is gone needs no news.
                let _ = sender.try_send(Sighting::Presence {
                    peer,
                    alive: sample.kind() == SampleKind::Put,
                });
            }
        });
    subscriber.wait().map_err(|error| declare(&key, &error))
}
