//! The link on which a setpoint is expected every millisecond.

mod support;

use support::*;
use tandem_robot_sim::{LinkName, RobotSimSettings};
use tandem_wire::{Arrivals, Finite, Motion, Reason, Vec3};

const RIGHT: Vec3 = Vec3::new(0.0, 0.2, 0.0);

fn franka() -> Stage {
    Stage::real_with(&RobotSimSettings {
        link: LinkName::Franka,
        ..RobotSimSettings::default()
    })
}

/// A setpoint in each of these milliseconds for which `comes`.
fn pulses(stage: &mut Stage, millis: std::ops::Range<u64>, motion: Motion, comes: impl Fn(u64) -> bool) {
    for milli in millis {
        stage.pass(tandem_wire::Stamp(at(milli).0 + 300_000));
        if comes(milli) {
            stage.send(motion, RIGHT);
        }
    }
}

fn arrivals(stage: &mut Stage) -> Arrivals {
    let next = stage.now.0 / 20_000_000 + 1;
    stage.pass(at(next * 20));
    stage
        .state()
        .body
        .arrivals
        .expect("a pulsed link tells how setpoints arrive")
}

#[test]
fn single_misses_are_bridged_and_counted() {
    let mut stage = franka();
    pulses(&mut stage, 40..60, RELEASED, |_| true);
    pulses(&mut stage, 60..460, pressed(1), |milli| milli % 4 != 0);
    assert_eq!(stage.state().body.motion, pressed(1));
    let told = stage
        .state()
        .body
        .arrivals
        .expect("a pulsed link tells how setpoints arrive");
    assert_eq!((told.success_rate, told.longest), (Finite(0.75), 1));
    assert!(
        (stage.state().body.tool_velocity.y - 0.2).abs() < 2e-3,
        "as if none had been missed"
    );
}

#[test]
fn twenty_misses_in_a_row_stop_the_arm_and_motion_needs_a_fresh_press() {
    let mut stage = franka();
    pulses(&mut stage, 40..60, RELEASED, |_| true);
    pulses(&mut stage, 60..300, pressed(1), |_| true);
    pulses(&mut stage, 300..319, pressed(1), |_| false);
    assert_eq!(stage.robot.motion(), pressed(1));
    pulses(&mut stage, 319..323, pressed(1), |_| false);
    assert_eq!(
        stage.robot.motion(),
        Motion::Held(Reason::SetpointsMissed { in_a_row: 20 })
    );
    assert_eq!(arrivals(&mut stage).success_rate, Finite(0.0), "no motion, no rate");
    pulses(&mut stage, 341..500, pressed(1), |_| true);
    assert_eq!(stage.robot.motion(), Motion::Held(Reason::AwaitingPress));
    assert!(stage.state().body.at_rest);
    pulses(&mut stage, 500..520, pressed(2), |_| true);
    assert_eq!(stage.robot.motion(), pressed(2));
}

#[test]
fn a_stop_is_told_although_setpoints_come_again_before_the_next_state() {
    let mut stage = franka();
    pulses(&mut stage, 40..60, RELEASED, |_| true);
    pulses(&mut stage, 60..301, pressed(1), |_| true);
    // The last state was that of 320 ms when the stop comes, and setpoints are back before that of 340 ms.
    pulses(&mut stage, 301..322, pressed(1), |_| false);
    pulses(&mut stage, 322..341, pressed(1), |_| true);
    let missed = Reason::SetpointsMissed { in_a_row: 20 };
    assert_eq!(stage.state().body.motion, Motion::Held(missed));
    pulses(&mut stage, 341..361, pressed(1), |_| true);
    assert_eq!(stage.state().body.motion, Motion::Held(Reason::AwaitingPress));
}

#[test]
fn a_stream_at_the_usual_rate_is_just_borne_and_a_slower_one_is_not() {
    let mut stage = franka();
    pulses(&mut stage, 40..60, RELEASED, |_| true);
    pulses(&mut stage, 60..300, pressed(1), |milli| milli % 20 == 0);
    assert_eq!(stage.robot.motion(), pressed(1));
    let told = arrivals(&mut stage);
    assert_eq!((told.success_rate, told.longest), (Finite(0.05), 19));
    pulses(&mut stage, 301..400, pressed(1), |milli| milli % 25 == 0);
    assert!(!stage.robot.motion().is_permitted());
    assert!(
        Stage::real().state().body.arrivals.is_none(),
        "elsewhere nothing is counted"
    );
}
