//! A node is killed while the arm moves: what the robot does then, and what it says of it.

#![cfg(unix)]

mod process;

use process::loops::Loop;
use tandem_wire::{Envelope, Reason, Setpoint, Topic};

#[test]
fn without_the_operator_the_robot_stops_and_says_whose_commands_stopped() {
    let mut nodes = Loop::moving("no-operator");
    nodes.kill("operator");
    let state = nodes.watch.until_standing();
    let reason = state.motion.reason().expect("it holds");
    assert!(matches!(reason, Reason::CommandLost { .. }), "{reason}");
    assert!(
        reason.to_string().starts_with("the operator's commands stopped"),
        "{reason}"
    );
}

#[test]
fn without_the_arbiter_the_robot_stops_by_itself_and_moves_again_by_another_press_only() {
    let mut nodes = Loop::moving("no-arbiter");
    let before = nodes.watch.until_moving();
    nodes.kill("arbiter");
    let state = nodes.watch.until_standing();
    let reason = state.motion.reason().expect("it holds");
    assert!(matches!(reason, Reason::SetpointLost { .. }), "{reason}");
    assert!(
        reason.to_string().starts_with("the arbiter's setpoints stopped"),
        "{reason}"
    );
    nodes.start("arbiter");
    assert!(nodes.watch.until_moving() > before, "a press of before does not count");
}

#[test]
fn without_the_predictor_the_human_alone_goes_on_and_the_setpoints_say_so() {
    let mut nodes = Loop::moving("no-predictor");
    let shared = |setpoint: &Envelope<Setpoint>| setpoint.body.guidance.is_some() && setpoint.body.weight.0 < 1.0;
    let press = nodes.watch.until("sharing", Topic::Setpoint, shared).body.motion;
    nodes.kill("predictor");
    // From the last shared setpoint to the human's own there is none that holds motion.
    let mut held = None;
    let alone = nodes
        .watch
        .until("the human alone", Topic::Setpoint, |setpoint: &Envelope<Setpoint>| {
            held = held.or(setpoint.body.motion.reason());
            setpoint.body.guidance.is_none()
        });
    assert_eq!(held, None, "motion goes on");
    assert_eq!(alone.body.motion, press, "by the same press");
    assert_eq!((alone.body.weight.0, alone.body.proposal), (1.0, None));
    assert!(
        alone.body.human == alone.body.blended,
        "the human's velocity is all of it"
    );
}
