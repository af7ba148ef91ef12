//! A line that keeps two seconds of commands back and then delivers all of them, in order: each looks fresh when it comes,
//! and none of them may move the robot that has answered none of them.

#![cfg(unix)]

mod process;

use std::collections::BTreeMap;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use process::loops::Loop;
use tandem_wire::{Command, Envelope, Refusal, Seq, Setpoint, State, Topic, decode};

/// The backlog that builds up.
const BACKLOG: Duration = Duration::from_secs(2);
/// States in half a second, the limit on loop age, and some that may be under way.
const STATES_IN_LIMIT: u64 = 25 + 5;

/// A TCP line that can keep back what one side says; the other side's words pass all the time.
struct Door {
    endpoint: String,
    closed: Arc<AtomicBool>,
}

impl Door {
    fn to(endpoint: &str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let here = listener.local_addr().expect("an address");
        let there = endpoint.trim_start_matches("tcp/").to_owned();
        let closed = Arc::new(AtomicBool::new(false));
        let kept = Arc::clone(&closed);
        std::thread::spawn(move || {
            for caller in listener.incoming().flatten() {
                let Ok(callee) = TcpStream::connect(&there) else { return };
                join(&caller, &callee, &kept);
            }
        });
        Self {
            endpoint: format!("tcp/{here}"),
            closed,
        }
    }

    fn close(&self) {
        self.closed.store(true, Ordering::SeqCst);
    }

    fn open(&self) {
        self.closed.store(false, Ordering::SeqCst);
    }
}

/// Passes bytes both ways; what the caller says waits while the door is closed.
fn join(caller: &TcpStream, callee: &TcpStream, closed: &Arc<AtomicBool>) {
    let pair = || {
        (
            caller.try_clone().expect("a socket"),
            callee.try_clone().expect("a socket"),
        )
    };
    let ((mut from, mut to), (mut back_to, mut back_from)) = (pair(), pair());
    std::thread::spawn(move || std::io::copy(&mut back_from, &mut back_to));
    let (waiting, closed) = (Arc::new(Mutex::new(Some(Vec::new()))), Arc::clone(closed));
    let filling = Arc::clone(&waiting);
    std::thread::spawn(move || {
        let mut chunk = [0; 1 << 14];
        while let Ok(read @ 1..) = from.read(&mut chunk) {
            if let Some(waiting) = filling.lock().expect("nobody panicked").as_mut() {
                waiting.extend_from_slice(&chunk[..read]);
            }
        }
        *filling.lock().expect("nobody panicked") = None;
    });
    std::thread::spawn(move || {
        loop {
            let bytes = match waiting.lock().expect("nobody panicked").as_mut() {
                None => return,
                Some(_) if closed.load(Ordering::SeqCst) => Vec::new(),
                Some(waiting) => std::mem::take(waiting),
            };
            if bytes.is_empty() {
                std::thread::sleep(Duration::from_micros(200));
            } else if to.write_all(&bytes).is_err() {
                return;
            }
        }
    });
}

#[test]
fn a_backlog_of_two_seconds_moves_nothing_when_it_is_delivered() {
    let mut nodes = Loop::without_operator("backlog");
    let door = Door::to(&nodes.endpoint);
    nodes.start_through("operator", &door.endpoint);
    nodes.watch.until_moving();

    door.close();
    let stopped = nodes.watch.until_standing();
    assert!(stopped.motion.reason().is_some());
    // The backlog is as old as it is: this is no wait for something to be right.
    let until = Instant::now() + BACKLOG;
    let mut before = None;
    while Instant::now() < until {
        let state = nodes
            .watch
            .until("a state", Topic::State, |_: &Envelope<State>| true)
            .body;
        assert!(!state.motion.is_permitted(), "nobody is heard, so nothing moves");
        before = state.obeys.map(|obeyed| obeyed.setpoint.refused.count).or(before);
    }
    door.open();
    let refused = follow(&nodes, before.unwrap_or_default());
    assert!(
        refused > 50,
        "only {refused} commands of the backlog were refused for their age"
    );
}

/// Follows what comes of the backlog until a fresh press moves the tool; says how many commands were refused as too old.
fn follow(nodes: &Loop, before: u64) -> u64 {
    let (mut seen, mut newest) = (BTreeMap::<Seq, Seq>::new(), Seq(0));
    let (mut refused, mut moved) = (0, 0);
    while moved < 10 {
        let (topic, bytes) = nodes.watch.next();
        match topic {
            Topic::State => newest = decode::<State>(&bytes).expect("a state").header.seq,
            Topic::Command => {
                let command = decode::<Command>(&bytes).expect("a command");
                seen.extend(command.body.seen.map(|state| (command.header.seq, state.seq)));
            }
            Topic::Setpoint => {
                let setpoint = decode::<Setpoint>(&bytes).expect("a setpoint").body;
                if setpoint.refused.last == Some(Refusal::LoopTooOld) {
                    refused = setpoint.refused.count.saturating_sub(before);
                }
                if setpoint.motion.is_permitted() {
                    moved += 1;
                    let used = setpoint.command.expect("somebody steers").id.seq;
                    let age = seen.get(&used).map(|state| newest.0.saturating_sub(state.0));
                    assert!(
                        age.is_none_or(|age| age <= STATES_IN_LIMIT),
                        "moved by a command made {age:?} states ago"
                    );
                }
            }
            _ => {}
        }
    }
    refused
}
