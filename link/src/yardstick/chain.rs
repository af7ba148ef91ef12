//! One operator to one robot: a process publishes a command; another takes it up on a thread, publishes a setpoint, and takes
//! that up on a second thread. As many hops between threads and processes as operator, arbiter and robot have, with Zenoh's
//! own channels in between.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use zenoh::Wait;

use super::{HEAD, Passed, head, open, payload};
use crate::Clock;
use crate::net::{LinkError, declare};

const COMMAND: &str = "yardstick/command";
const SETPOINT: &str = "yardstick/setpoint";
/// How often a thread looks whether it shall end.
const LOOK: Duration = Duration::from_millis(50);

/// Publishes a command of `bytes` bytes every `period` to whoever listens at `endpoint`, until `stop`.
///
/// # Errors
/// If Zenoh refuses.
pub fn command(endpoint: &str, period: Duration, bytes: usize, stop: &AtomicBool) -> Result<(), LinkError> {
    let session = open("connect", endpoint, None)?;
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
        // Nobody may listen yet.
        let _ = publisher.put(payload(bytes, number, clock.now())).wait();
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
    let session = open("listen", endpoint, None)?;
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
            if let Some((number, sent)) = head(&setpoint.payload().to_bytes()) {
                passed.push(Passed { number, sent, arrived });
            }
        }
    }
    // A thread that panicked answers nothing, which shows in what passed.
    let _ = arbiter.join();
    let _ = session.close().wait();
    Ok(passed)
}
