//! What Tandem's own latency is measured against: the same hops and payloads over bare Zenoh with its default settings.
//!
//! One process publishes a command; another takes it up on a thread, publishes a setpoint, and takes that up on a second
//! thread: as many hops between threads and processes as operator, arbiter and robot have, with Zenoh's own channels in
//! between. Used by `tandem bench`, and by nothing that runs a robot.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use tandem_wire::{Stamp, keys};
use zenoh::Wait;
use zenoh::pubsub::Subscriber;

use crate::Clock;
use crate::net::{Link, LinkError, declare};

const COMMAND: &str = "yardstick/command";
const SETPOINT: &str = "yardstick/setpoint";
/// How often a thread looks whether it shall end.
const LOOK: Duration = Duration::from_millis(50);
/// Number and stamp.
const HEAD: usize = 16;

/// A command that went all the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Passed {
    /// Which one, from 1.
    pub number: u64,
    /// When it was sent, by its sender's clock.
    pub sent: Stamp,
    /// When the setpoint made of it was taken up, by this process's clock.
    pub arrived: Stamp,
}

/// Publishes a command of `bytes` bytes every `period` to whoever listens at `endpoint`, until `stop`.
///
/// # Errors
/// If Zenoh refuses.
pub fn command(endpoint: &str, period: Duration, bytes: usize, stop: &AtomicBool) -> Result<(), LinkError> {
    let session = open("connect", endpoint)?;
    let publisher = session.declare_publisher(COMMAND).wait();
    let publisher = publisher.map_err(|error| declare(COMMAND, &error))?;
    let clock = Clock::of_process();
    let mut due = Instant::now();
    for number in 1_u64.. {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        due += period;
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let sent = clock.now();
        let mut payload = vec![0; bytes.max(HEAD)];
        payload[..8].copy_from_slice(&number.to_le_bytes());
        payload[8..HEAD].copy_from_slice(&sent.0.to_le_bytes());
        // Nobody may listen yet.
        let _ = publisher.put(payload).wait();
    }
    // What was published before is on its way.
    let _ = session.close().wait();
    Ok(())
}

/// Listens at `endpoint`, answers each command with a setpoint of `bytes` bytes, and tells when each was taken up, until
/// `stop`. Calls `ready` once it listens.
///
/// # Errors
/// If Zenoh refuses.
pub fn obey(
    endpoint: &str,
    bytes: usize,
    stop: &Arc<AtomicBool>,
    ready: impl FnOnce(),
) -> Result<Vec<Passed>, LinkError> {
    let session = open("listen", endpoint)?;
    let setpoints = session.declare_subscriber(SETPOINT).wait();
    let setpoints = setpoints.map_err(|error| declare(SETPOINT, &error))?;
    let commands = session.declare_subscriber(COMMAND).wait();
    let commands = commands.map_err(|error| declare(COMMAND, &error))?;
    let publisher = session.declare_publisher(SETPOINT).wait();
    let publisher = publisher.map_err(|error| declare(SETPOINT, &error))?;
    let stopped = Arc::clone(stop);
    let arbiter = std::thread::spawn(move || {
        while !stopped.load(Ordering::Relaxed) {
            if let Ok(Some(command)) = commands.recv_timeout(LOOK) {
                let mut payload = vec![0; bytes.max(HEAD)];
                let head = command.payload().to_bytes();
                let length = head.len().min(HEAD);
                payload[..length].copy_from_slice(&head[..length]);
                // Its own process listens.
                let _ = publisher.put(payload).wait();
            }
        }
    });
    ready();
    let clock = Clock::of_process();
    let mut passed = Vec::new();
    while !stop.load(Ordering::Relaxed) {
        if let Ok(Some(setpoint)) = setpoints.recv_timeout(LOOK) {
            let arrived = clock.now();
            let head = setpoint.payload().to_bytes();
            if let (Some(number), Some(sent)) = (word(&head, 0), word(&head, 8)) {
                let sent = Stamp(sent);
                passed.push(Passed { number, sent, arrived });
            }
        }
    }
    // A thread that panicked answers nothing, which shows in what passed.
    let _ = arbiter.join();
    let _ = session.close().wait();
    Ok(passed)
}

fn word(bytes: &[u8], at: usize) -> Option<u64> {
    let word = bytes.get(at..)?.first_chunk()?;
    Some(u64::from_le_bytes(*word))
}

/// As Zenoh comes, but for looking around on the network.
fn open(side: &str, endpoint: &str) -> Result<zenoh::Session, LinkError> {
    let open = || {
        let mut config = zenoh::Config::default();
        config.insert_json5("scouting/multicast/enabled", "false")?;
        config.insert_json5(&format!("{side}/endpoints"), &format!("[{endpoint:?}]"))?;
        if side == "connect" {
            config.insert_json5("listen/endpoints", "[]")?;
        }
        zenoh::open(config).wait()
    };
    open().map_err(|error| declare(endpoint, &error))
}

/// Counts what arrives about a robot, whatever it is: as a viewer that takes everything would.
pub struct Everything {
    bytes: Arc<AtomicU64>,
    _subscriber: Subscriber<()>,
}

impl Everything {
    /// Begins to count.
    ///
    /// # Errors
    /// If Zenoh refuses.
    pub fn about(link: &Link) -> Result<Self, LinkError> {
        let bytes = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&bytes);
        let key = format!("{}/{}/**", keys::ROOT, link.robot);
        let subscriber = link.session.declare_subscriber(&key).callback(move |sample| {
            counted.fetch_add(sample.payload().len() as u64, Ordering::Relaxed);
        });
        Ok(Self {
            bytes,
            _subscriber: subscriber.wait().map_err(|error| declare(&key, &error))?,
        })
    }

    /// Bytes so far.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }
}
