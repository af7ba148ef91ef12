//! The same measurement once, for a command that looks at a network and takes no part in it.

use std::time::{Duration, Instant};

use crossbeam_channel::{RecvTimeoutError, bounded};
use tandem_wire::{PeerClock, Pong, RobotName, decode};

use super::{Event, QUEUE, ping, unix_nanos};
use crate::Clock;
use crate::clocks::peers::Peers;
use crate::config::ClockSettings;
use crate::net::Link;

/// Pings every node of `robot` `times` times, `every` so often, and says what the answers tell of their clocks
/// against this process's. Takes `times · every`; who does not answer is not in the list.
#[must_use]
pub fn measure_clocks(
    link: &Link,
    robot: &RobotName,
    settings: &ClockSettings,
    times: u32,
    every: Duration,
) -> Vec<PeerClock> {
    let clock = Clock::of_process();
    let (sender, receiver) = bounded(QUEUE);
    let mut peers = Peers::new(settings.skew_alarm_ms, u64::MAX);
    for _ in 0..times {
        ping(&link.session, robot, &sender);
        let until = Instant::now() + every;
        loop {
            match receiver.recv_deadline(until) {
                Ok(Event::Pong(answer)) => {
                    if let Ok(pong) = decode::<Pong>(&answer.bytes) {
                        peers.hear(answer.node, answer.asked, &pong, answer.arrived);
                    }
                }
                Ok(Event::Ping(..) | Event::Stop) => {}
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => break,
            }
        }
    }
    peers.report(clock.now(), unix_nanos()).peers
}
