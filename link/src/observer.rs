//! Watching a robot without taking part: the demo's table, trials and tests look through this.

use crossbeam_channel::{Receiver, RecvTimeoutError, bounded};
use std::time::Duration;
use tandem_wire::{NodeName, Pace, Stamp, Topic, keys};
use zenoh::Wait;
use zenoh::pubsub::Subscriber;
use zenoh::sample::SampleKind;

use crate::Clock;
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

/// Sees every message of a robot.
pub struct Observer {
    receiver: Receiver<Sighting>,
    _subscribers: [Subscriber<()>; 2],
}

impl Observer {
    /// Starts to watch. In lockstep a slow watcher slows the loop; in real time it misses sightings.
    ///
    /// # Errors
    /// If Zenoh refuses.
    pub fn new(link: &Link, pace: Pace) -> Result<Self, LinkError> {
        let (sender, receiver) = bounded(QUEUE);
        let clock = Clock::of_process();
        let put = move |sighting| {
            // Gone or, in real time, too slow: an observer owes nobody anything.
            let _ = match pace {
                Pace::Lockstep => sender.send(sighting).is_ok(),
                Pace::Real => sender.try_send(sighting).is_ok(),
            };
        };
        let put_presence = put.clone();
        let key = link.robot.everything();
        let samples = link.session.declare_subscriber(&key).callback(move |sample| {
            if let Some((_, topic)) = keys::parse(sample.key_expr().as_str()) {
                put(Sighting::Sample {
                    at: clock.now(),
                    topic,
                    bytes: sample.payload().to_bytes().into_owned(),
                });
            }
        });
        let samples = samples.wait().map_err(|error| declare(&key, &error))?;
        let key = format!("{}/{}/alive/*", keys::ROOT, link.robot);
        let presence = link
            .session
            .liveliness()
            .declare_subscriber(&key)
            .history(true)
            .callback(move |sample| {
                if let Some((_, Topic::Alive(peer))) = keys::parse(sample.key_expr().as_str()) {
                    put_presence(Sighting::Presence {
                        peer,
                        alive: sample.kind() == SampleKind::Put,
                    });
                }
            });
        let presence = presence.wait().map_err(|error| declare(&key, &error))?;
        Ok(Self {
            receiver,
            _subscribers: [samples, presence],
        })
    }

    /// The next sighting, or `None` after `limit` without one.
    #[must_use]
    pub fn next(&self, limit: Duration) -> Option<Sighting> {
        match self.receiver.recv_timeout(limit) {
            Ok(sighting) => Some(sighting),
            Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => None,
        }
    }
}
