//! Many operators and robots through one router: each a session of its own, with one publisher at a fixed rate and one
//! subscriber, as a command and a state cross the router in each tick of Tandem's.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use zenoh::Wait;
use zenoh::pubsub::Subscriber;

use super::{Passed, head, open, payload};
use crate::Clock;
use crate::net::{LinkError, declare};

/// What one side of a fleet does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Sends commands and hears states.
    Operators,
    /// Hears commands and sends states.
    Robots,
}

impl Side {
    const fn says(self) -> &'static str {
        match self {
            Self::Operators => "command",
            Self::Robots => "state",
        }
    }

    const fn hears(self) -> &'static str {
        match self {
            Self::Operators => Self::Robots.says(),
            Self::Robots => Self::Operators.says(),
        }
    }
}

/// One side of a fleet at work. Dropping it ends its threads.
pub struct Fleet {
    stop: Arc<AtomicBool>,
    members: Vec<Member>,
}

struct Member {
    heard: Arc<Mutex<Vec<Passed>>>,
    thread: Option<JoinHandle<()>>,
    _subscriber: Subscriber<()>,
    session: zenoh::Session,
}

impl Fleet {
    /// Lets `robots` of a side dial the router at `endpoint`, each sending `bytes` bytes every `period`.
    ///
    /// # Errors
    /// If Zenoh refuses.
    pub fn start(side: Side, robots: u32, endpoint: &str, period: Duration, bytes: usize) -> Result<Self, LinkError> {
        let mut fleet = Self {
            stop: Arc::default(),
            members: Vec::new(),
        };
        for robot in 0..robots {
            let member = Member::start(side, robot, endpoint, period, bytes, &fleet.stop)?;
            fleet.members.push(member);
        }
        Ok(fleet)
    }

    /// What each robot has heard until now.
    #[must_use]
    pub fn heard(&self) -> Vec<Vec<Passed>> {
        let take = |member: &Member| std::mem::take(&mut *member.heard.lock().unwrap_or_else(PoisonError::into_inner));
        self.members.iter().map(take).collect()
    }
}

impl Drop for Fleet {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for member in &mut self.members {
            if let Some(thread) = member.thread.take() {
                // A thread that panicked sends nothing, which shows in what was heard.
                let _ = thread.join();
            }
            // What was sent before is on its way.
            let _ = member.session.close().wait();
        }
    }
}

impl Member {
    fn start(
        side: Side,
        robot: u32,
        endpoint: &str,
        period: Duration,
        bytes: usize,
        stop: &Arc<AtomicBool>,
    ) -> Result<Self, LinkError> {
        let session = open("connect", endpoint, Some("client"))?;
        let (heard, clock) = (Arc::new(Mutex::new(Vec::new())), Clock::of_process());
        let notes = Arc::clone(&heard);
        let key = format!("yardstick/{robot}/{}", side.hears());
        let subscriber = session.declare_subscriber(&key).callback(move |sample| {
            let arrived = clock.now();
            if let Some((number, sent)) = head(&sample.payload().to_bytes()) {
                let passed = Passed { number, sent, arrived };
                notes.lock().unwrap_or_else(PoisonError::into_inner).push(passed);
            }
        });
        let subscriber = subscriber.wait().map_err(|error| declare(&key, &error))?;
        let key = format!("yardstick/{robot}/{}", side.says());
        let publisher = session.declare_publisher(key.clone()).wait();
        let publisher = publisher.map_err(|error| declare(&key, &error))?;
        let stop = Arc::clone(stop);
        let thread = std::thread::spawn(move || {
            let mut due = Instant::now();
            for number in 1_u64.. {
                if stop.load(Ordering::Relaxed) {
                    return;
                }
                due += period;
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
                // Nobody may listen yet.
                let _ = publisher.put(payload(bytes, number, clock.now())).wait();
            }
        });
        Ok(Self {
            heard,
            thread: Some(thread),
            _subscriber: subscriber,
            session,
        })
    }
}
