//! A capture of a real drive, played again over the same network without certificates, does not move the robot.

#![cfg(unix)]

mod process;

use std::time::{Duration, Instant};

use process::Process;
use tandem_link::net::free_port;
use tandem_link::{Link, LinkSettings, Observer, Sighting};
use tandem_wire::{Pace, Setpoint, State, Topic, decode};

const LIMIT: Duration = Duration::from_secs(60);

/// The network, tapped.
struct Tap {
    link: Link,
    observer: Observer,
}

impl Tap {
    fn next(&self) -> (Topic, Vec<u8>) {
        let limit = Instant::now() + LIMIT;
        while Instant::now() < limit {
            if let Some(Sighting::Sample { topic, bytes, .. }) = self.observer.next(LIMIT) {
                return (topic, bytes);
            }
        }
        panic!("nothing was said for a minute")
    }

    /// Copies commands and setpoints until the robot has moved for `states` states.
    fn capture(&self, states: usize) -> Vec<(Topic, Vec<u8>)> {
        let (mut captured, mut moved) = (Vec::new(), 0);
        while moved < states {
            let (topic, bytes) = self.next();
            match topic {
                Topic::State => moved += usize::from(state(&bytes).is_some_and(|state| !state.at_rest)),
                Topic::Command | Topic::Setpoint => captured.push((topic, bytes)),
                _ => {}
            }
        }
        captured
    }

    fn wait_for_rest(&self) {
        let limit = Instant::now() + LIMIT;
        while Instant::now() < limit {
            let (topic, bytes) = self.next();
            if topic == Topic::State && state(&bytes).is_some_and(|state| state.at_rest && !state.motion.is_permitted())
            {
                return;
            }
        }
        panic!("the robot does not come to rest");
    }

    /// Plays one stream of a capture, a message for every state as in the original, and looks at each state meanwhile.
    fn replay(&self, captured: &[(Topic, Vec<u8>)], stream: Topic) -> usize {
        let messages: Vec<&Vec<u8>> = captured
            .iter()
            .filter(|(topic, _)| *topic == stream)
            .map(|(_, bytes)| bytes)
            .collect();
        let mut played = 0;
        while played < messages.len() {
            let (topic, bytes) = self.next();
            if topic != Topic::State {
                continue;
            }
            let state = state(&bytes).expect("a state");
            assert!(
                state.at_rest && !state.motion.is_permitted(),
                "it moves: {:?}",
                state.motion
            );
            assert!(state.trial > 0, "it is not for want of a trial");
            self.link.publish(stream, messages[played].clone()).expect("published");
            played += 1;
        }
        played
    }
}

fn state(bytes: &[u8]) -> Option<State> {
    decode::<State>(bytes).ok().map(|state| state.body)
}

#[test]
fn what_was_captured_and_is_played_again_moves_nothing() {
    let endpoint = format!("tcp/127.0.0.1:{}", free_port().expect("a port"));
    let connect = ["--robot", "capture", "--connect", endpoint.as_str()];
    let robot = Process::start(&["robot-sim", "--robot", "capture", "--listen", &endpoint]);
    let node = |name: &[&str]| Process::start(&[name, &connect[..]].concat());
    let (arbiter, predictor) = (node(&["arbiter"]), node(&["predictor"]));
    let operator = node(&["operator", "--source", "simulated"]);
    let link = Link::open(&LinkSettings {
        robot: "capture".into(),
        connect: vec![endpoint.clone()],
        ..LinkSettings::default()
    });
    let link = link.expect("the robot's process answers");
    let observer = Observer::new(&link, Pace::Real).expect("an observer");
    let tap = Tap { link, observer };

    let captured = tap.capture(100);
    assert_eq!(operator.end(), Some(0));
    tap.wait_for_rest();
    // Arbiter and trial are still there: commands that moved the robot a moment ago are refused.
    let before = arbiter_refusals(&tap);
    let commands = tap.replay(&captured, Topic::Command);
    let refused = arbiter_refusals(&tap) - before;
    assert!(
        refused * 2 > commands as u64,
        "the arbiter refused {refused} of {commands} commands"
    );

    assert_eq!(arbiter.end(), Some(0));
    tap.wait_for_rest();
    let before = robot_refusals(&tap);
    let setpoints = tap.replay(&captured, Topic::Setpoint);
    assert!(
        commands > 50 && setpoints > 50,
        "{commands} commands and {setpoints} setpoints were captured"
    );
    let refused = robot_refusals(&tap) - before;
    assert!(
        refused * 2 > setpoints as u64,
        "the robot refused {refused} of {setpoints} setpoints"
    );
    for process in [predictor, robot] {
        assert_eq!(process.end(), Some(0));
    }
    tap.link.close();
}

/// What the arbiter has refused so far, by its own word.
fn arbiter_refusals(tap: &Tap) -> u64 {
    loop {
        if let (Topic::Setpoint, bytes) = tap.next()
            && let Ok(setpoint) = decode::<Setpoint>(&bytes)
        {
            return setpoint.body.refused.count;
        }
    }
}

/// What the robot has refused so far, by its own word.
fn robot_refusals(tap: &Tap) -> u64 {
    loop {
        if let (Topic::State, bytes) = tap.next()
            && let Some(state) = state(&bytes)
        {
            return state.refused.count;
        }
    }
}
