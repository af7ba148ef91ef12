//! Scripted timelines in, everything the robot says of itself out.

mod support;

use support::*;
use tandem_robot_sim::{Event, RobotSimSettings};
use tandem_wire::{
    Clearance, Envelope, Malformed, Motion, Node, Reason, Refusal, Session, Stamp, State, Timing, Topic, Unreadable,
    Used, Vec3,
};

const RIGHT: Vec3 = Vec3::new(0.0, 0.2, 0.0);

#[test]
fn a_press_moves_the_arm_and_a_release_stops_it() {
    let mut stage = Stage::real();
    stage.pass(at(50));
    stage.stream(at(100), RELEASED, Vec3::ZERO);
    stage.stream(at(600), pressed(1), RIGHT);
    stage.stream(at(900), RELEASED, Vec3::ZERO);
    insta::assert_snapshot!(stage.told(), @r"
      0 ms  tick  0  trial 1 held: no setpoint has arrived yet, at rest
     80 ms  tick  0  trial 1 held: the deadman is released, at rest
    140 ms  tick  1  trial 1 press 1
    640 ms  tick  6  trial 1 held: the deadman is released
    700 ms  tick  7  trial 1 held: the deadman is released, at rest
    ");
    insta::assert_snapshot!(stage.told_in_full(5), @r"
      0 ms  tick  0  (0.5000 -0.3000 0.1500)  0.000 m/s  nearest 0.2412  trial 1 held: no setpoint has arrived yet, at rest
    100 ms  tick  1  (0.5000 -0.3000 0.1500)  0.000 m/s  nearest 0.2412  trial 1 held: the deadman is released, at rest
    200 ms  tick  2  (0.5000 -0.2906 0.1500)  0.199 m/s  nearest 0.2370  trial 1 press 1
    300 ms  tick  3  (0.4999 -0.2707 0.1500)  0.200 m/s  nearest 0.2257  trial 1 press 1
    400 ms  tick  4  (0.4999 -0.2507 0.1500)  0.200 m/s  nearest 0.2057  trial 1 press 1
    500 ms  tick  5  (0.4999 -0.2307 0.1500)  0.200 m/s  nearest 0.1857  trial 1 press 1
    600 ms  tick  6  (0.4999 -0.2107 0.1500)  0.200 m/s  nearest 0.1657  trial 1 press 1
    700 ms  tick  7  (0.4999 -0.2001 0.1500)  0.000 m/s  nearest 0.1551  trial 1 held: the deadman is released, at rest
    800 ms  tick  8  (0.4999 -0.2001 0.1500)  0.000 m/s  nearest 0.1551  trial 1 held: the deadman is released, at rest
    900 ms  tick  9  (0.4999 -0.2001 0.1500)  0.000 m/s  nearest 0.1551  trial 1 held: the deadman is released, at rest
    ");
}

#[test]
fn a_silent_stream_stops_the_arm_and_the_same_press_does_not_move_it_again() {
    let mut stage = Stage::real();
    stage.stream(at(100), RELEASED, Vec3::ZERO);
    stage.stream(at(300), pressed(1), RIGHT);
    stage.pass(at(700));
    let stopped_at = stage.tool();
    stage.stream(at(1000), pressed(1), RIGHT);
    assert_eq!(stage.tool(), stopped_at);
    stage.stream(at(1300), pressed(2), RIGHT);
    assert!(stage.tool().y > stopped_at.y + 0.04);
    insta::assert_snapshot!(stage.told(), @r"
       0 ms  tick  0  trial 1 held: no setpoint has arrived yet, at rest
      40 ms  tick  0  trial 1 held: the deadman is released, at rest
     140 ms  tick  1  trial 1 press 1
     420 ms  tick  4  trial 1 held: the arbiter's setpoints stopped 101 ms ago
     500 ms  tick  5  trial 1 held: the arbiter's setpoints stopped 101 ms ago, at rest
     740 ms  tick  7  trial 1 held: waiting for a fresh press of the deadman, at rest
    1040 ms  tick 10  trial 1 press 2
    ");
}

#[test]
fn what_should_not_be_obeyed_is_counted_and_changes_nothing() {
    let mut stage = Stage::real();
    stage.stream(at(100), RELEASED, Vec3::ZERO);
    stage.stream(at(200), pressed(1), Vec3::ZERO);
    let newest = stage.state().header.id();
    let good = setpoint(40, 0, pressed(1), Vec3::ZERO, Some(newest));
    let mut foreign = setpoint(60, 0, pressed(1), RIGHT, Some(newest));
    foreign.header.session = Session(99);
    let events = [
        Event::Setpoint(good),
        Event::Setpoint(setpoint(40, 0, pressed(1), RIGHT, Some(newest))),
        Event::Setpoint(setpoint(39, 0, pressed(1), RIGHT, Some(newest))),
        Event::Setpoint(foreign),
        Event::Setpoint(setpoint(41, 0, pressed(1), RIGHT, None)),
        Event::Setpoint(setpoint(41, 0, pressed(1), RIGHT, seen(1_000_000))),
        Event::Unreadable(Unreadable {
            topic: Topic::Setpoint,
            why: Malformed::NotFinite,
        }),
        Event::Presence,
    ];
    let before = stage.tool();
    for event in events {
        stage.step(event);
    }
    stage.pass(at(240));
    assert_eq!(stage.state().body.refused.count, 6);
    assert_eq!(stage.state().body.refused.last, Some(Refusal::Unreadable));
    assert_eq!(stage.state().body.motion, pressed(1));
    assert!((stage.tool() - before).norm() < 1e-6);
}

#[test]
fn a_command_that_answers_an_old_state_moves_nothing_however_fresh_the_arbiter_is() {
    let mut stage = Stage::real();
    stage.stream(at(100), RELEASED, Vec3::ZERO);
    stage.stream(at(200), pressed(1), RIGHT);
    let old = stage.state().header.id();
    let used = Some(Used {
        id: old,
        sent: Stamp(0),
        age: 0,
        seen: Some(old),
    });
    // Setpoints come at the usual rate, from an arbiter that has just heard of the robot; the operator has not for long.
    for n in 1..=40 {
        stage.pass(at(222 + 20 * n));
        let newest = Some(stage.state().header.id());
        let mut fresh = setpoint(20 + n, 0, pressed(1), RIGHT, newest);
        fresh.body.command = used;
        stage.step(Event::Setpoint(fresh));
    }
    let moved = |state: &&Envelope<State>| state.body.motion.is_permitted();
    let last = stage.states.iter().rfind(moved).expect("it moved").header.sent;
    assert!(
        (at(700)..=at(800)).contains(&last),
        "half a second and the timeout: {last:?}"
    );
    assert_eq!(stage.state().body.motion, Motion::Held(Reason::LoopTooOld));
}

#[test]
fn a_backlog_that_arrives_in_order_is_too_old_and_stops_the_arm() {
    let mut stage = Stage::real();
    stage.stream(at(100), RELEASED, Vec3::ZERO);
    stage.stream(at(200), pressed(1), RIGHT);
    let old = Some(stage.state().header.id());
    // Half a second's worth of setpoints was held up somewhere, and comes now, in order and at the usual rate.
    for n in 1..=40 {
        stage.pass(at(222 + 20 * n));
        stage.step(Event::Setpoint(setpoint(20 + n, 0, pressed(1), RIGHT, old)));
    }
    insta::assert_snapshot!(stage.told(), @r"
       0 ms  tick  0  trial 1 held: no setpoint has arrived yet, at rest
      40 ms  tick  0  trial 1 held: the deadman is released, at rest
     140 ms  tick  1  trial 1 press 1
     720 ms  tick  7  trial 1 press 1, refused 1 (made from a state that is too old)
     740 ms  tick  7  trial 1 press 1, refused 2 (made from a state that is too old)
     760 ms  tick  7  trial 1 press 1, refused 3 (made from a state that is too old)
     780 ms  tick  7  trial 1 press 1, refused 4 (made from a state that is too old)
     800 ms  tick  8  trial 1 held: commands answer a state that is too old, refused 5 (made from a state that is too old)
     820 ms  tick  8  trial 1 held: commands answer a state that is too old, refused 6 (made from a state that is too old)
     840 ms  tick  8  trial 1 held: commands answer a state that is too old, refused 7 (made from a state that is too old)
     860 ms  tick  8  trial 1 held: commands answer a state that is too old, refused 8 (made from a state that is too old)
     880 ms  tick  8  trial 1 held: commands answer a state that is too old, at rest, refused 9 (made from a state that is too old)
     900 ms  tick  9  trial 1 held: commands answer a state that is too old, at rest, refused 10 (made from a state that is too old)
     920 ms  tick  9  trial 1 held: commands answer a state that is too old, at rest, refused 11 (made from a state that is too old)
     940 ms  tick  9  trial 1 held: commands answer a state that is too old, at rest, refused 12 (made from a state that is too old)
     960 ms  tick  9  trial 1 held: commands answer a state that is too old, at rest, refused 13 (made from a state that is too old)
     980 ms  tick  9  trial 1 held: commands answer a state that is too old, at rest, refused 14 (made from a state that is too old)
    1000 ms  tick 10  trial 1 held: commands answer a state that is too old, at rest, refused 15 (made from a state that is too old)
    1020 ms  tick 10  trial 1 held: commands answer a state that is too old, at rest, refused 16 (made from a state that is too old)
    ");
}

#[test]
fn a_restarted_robot_does_not_take_up_a_press_that_is_already_held() {
    let mut stage = Stage::real();
    stage.stream(at(300), pressed(5), RIGHT);
    assert_eq!(stage.state().body.motion, Motion::Held(Reason::AwaitingPress));
    assert!(stage.state().body.at_rest);
}

#[test]
fn contact_between_two_states_is_reported() {
    let obstacle = [0.5, -0.1];
    let settings = RobotSimSettings {
        obstacles_m: vec![[0.3, 0.3], obstacle],
        obstacle_radius_m: 0.001,
        tool_speed_m_s: 1.5,
        tool_acceleration_m_s2: 13.0,
        ..RobotSimSettings::default()
    };
    let mut stage = Stage::real_with(&settings);
    stage.stream(at(100), RELEASED, Vec3::ZERO);
    // The rod and the post are 12 mm across together; at 1 m/s the tool passes within 12 ms, states are 20 ms apart.
    stage.stream(at(600), pressed(1), Vec3::new(0.0, 1.0, 0.0));
    let nearest = |clearance: Option<Clearance>| clearance.unwrap().distance.0;
    let lowest = |of: &dyn Fn(&tandem_wire::State) -> f64| {
        stage
            .states
            .iter()
            .map(|state| of(&state.body))
            .fold(f64::INFINITY, f64::min)
    };
    assert!(
        lowest(&|state| nearest(state.closest)) < -0.003,
        "the tool went through the post"
    );
    assert!(
        lowest(&|state| nearest(state.clearance)) > 0.0,
        "and no state was taken while it did"
    );
    let touched = stage
        .states
        .iter()
        .find(|state| nearest(state.body.closest) <= 0.0)
        .unwrap();
    let Clearance { body, obstacle, .. } = touched.body.closest.unwrap();
    assert_eq!(
        (body, obstacle),
        (0, 1),
        "the tool is the first body, the post the second obstacle"
    );
    for state in &stage.states {
        assert!(nearest(state.body.closest) <= nearest(state.body.clearance));
    }
}

#[test]
fn in_lockstep_each_setpoint_moves_the_arm_by_one_period() {
    let mut stage = Stage::lockstep();
    assert_eq!(stage.robot.deadline(), None);
    stage.step(begin(1));
    stage.send(RELEASED, Vec3::ZERO);
    for _ in 0..3 {
        stage.send(pressed(1), RIGHT);
    }
    stage.step(end(1));
    stage.step(begin(1));
    stage.step(begin(2));
    stage.send(pressed(1), RIGHT);
    stage.send(pressed(2), RIGHT);
    stage.step(Event::Stop);
    stage.step(Event::Wake);
    assert_eq!(stage.scenes.len(), 2);
    insta::assert_snapshot!(stage.told_in_full(1), @r"
      0 ms  tick  0  (0.5000 -0.3000 0.1500)  0.000 m/s  nearest 0.2412  trial 1 held: no setpoint has arrived yet, at rest
    100 ms  tick  1  (0.5000 -0.3000 0.1500)  0.000 m/s  nearest 0.2412  trial 1 held: the deadman is released, at rest
    200 ms  tick  2  (0.5000 -0.2862 0.1500)  0.199 m/s  nearest 0.2351  trial 1 press 1
    300 ms  tick  3  (0.4999 -0.2663 0.1500)  0.200 m/s  nearest 0.2213  trial 1 press 1
    400 ms  tick  4  (0.4999 -0.2463 0.1500)  0.200 m/s  nearest 0.2013  trial 1 press 1
    500 ms  tick  5  (0.5000 -0.3000 0.1500)  0.000 m/s  nearest 0.2412  trial 2 held: the trial is over, at rest
    600 ms  tick  6  (0.5000 -0.3000 0.1500)  0.000 m/s  nearest 0.2412  trial 2 held: waiting for a fresh press of the deadman, at rest
    700 ms  tick  7  (0.5000 -0.2862 0.1500)  0.199 m/s  nearest 0.2351  trial 2 press 2
    700 ms  tick  7  (0.5000 -0.2862 0.1500)  0.199 m/s  nearest 0.2351  trial 2 held: the node is shutting down
    700 ms  tick  7  (0.5000 -0.2801 0.1500)  0.000 m/s  nearest 0.2325  trial 2 held: the node is shutting down, at rest
    ");
}

#[test]
fn in_lockstep_a_setpoint_of_another_tick_is_refused() {
    let mut stage = Stage::lockstep();
    let mut answer = |seq, tick| {
        stage.step(Event::Setpoint(setpoint(seq, tick, RELEASED, Vec3::ZERO, seen(1))));
        stage.states.len()
    };
    assert_eq!(answer(1, 0), 0, "no trial has begun");
    stage.step(begin(1));
    let mut answer = |seq, tick| {
        stage.step(Event::Setpoint(setpoint(seq, tick, RELEASED, Vec3::ZERO, seen(1))));
        stage.states.len()
    };
    assert_eq!(answer(2, 1), 1, "tick 1 is not there yet");
    assert_eq!(answer(3, 0), 2);
    assert_eq!(answer(4, 0), 2, "tick 0 is over");
    assert_eq!(stage.robot.deadline(), None);
}

#[test]
fn a_trial_that_begins_while_the_arm_moves_waits_until_it_stands() {
    let mut stage = Stage::real();
    stage.stream(at(100), RELEASED, Vec3::ZERO);
    stage.stream(at(600), pressed(1), RIGHT);
    stage.step(begin(2));
    stage.pass(at(1000));
    assert!((stage.tool() - Vec3::new(0.5, -0.3, 0.15)).norm() < 1e-7);
    // An answer to a state from before the jump would steer from a place where the arm no longer is.
    stage.step(Event::Setpoint(setpoint(500, 0, RELEASED, Vec3::ZERO, seen(20))));
    assert_eq!(stage.state().body.refused.last, None);
    stage.pass(at(1020));
    assert_eq!(stage.state().body.refused.last, Some(Refusal::LoopTooOld));
    insta::assert_snapshot!(stage.told(), @r"
       0 ms  tick  0  trial 1 held: no setpoint has arrived yet, at rest
      40 ms  tick  0  trial 1 held: the deadman is released, at rest
     140 ms  tick  1  trial 1 press 1
     620 ms  tick  6  trial 0 held: the trial is over
     680 ms  tick  6  trial 2 held: the trial is over, at rest
     720 ms  tick  7  trial 2 held: the arbiter's setpoints stopped 118 ms ago, at rest
    1020 ms  tick 10  trial 2 held: the arbiter's setpoints stopped 118 ms ago, at rest, refused 1 (made from a state that is too old)
    ");
}

#[test]
fn without_a_trial_nothing_moves_and_a_press_held_through_its_beginning_does_not_count() {
    let mut stage = Stage::new(Timing::default(), &RobotSimSettings::default());
    stage.stream(at(100), RELEASED, Vec3::ZERO);
    stage.stream(at(300), pressed(1), RIGHT);
    stage.step(begin(1));
    stage.stream(at(500), pressed(1), RIGHT);
    assert_eq!(stage.robot.arm().speeds(), &[0.0; 7]);
    stage.stream(at(700), pressed(2), RIGHT);
    stage.step(end(1));
    stage.stream(at(1000), pressed(3), RIGHT);
    insta::assert_snapshot!(stage.told(), @r"
      0 ms  tick  0  trial 0 held: no setpoint has arrived yet, at rest
     40 ms  tick  0  trial 0 held: the deadman is released, at rest
    140 ms  tick  1  trial 0 held: no trial is running, at rest
    320 ms  tick  3  trial 1 held: no trial is running, at rest
    340 ms  tick  3  trial 1 held: waiting for a fresh press of the deadman, at rest
    540 ms  tick  5  trial 1 press 2
    720 ms  tick  7  trial 0 held: the trial is over
    740 ms  tick  7  trial 0 held: no trial is running
    780 ms  tick  7  trial 0 held: no trial is running, at rest
    ");
}

#[test]
fn a_robot_that_shuts_down_brings_a_moving_arm_to_rest_within_its_limits_first() {
    let mut stage = Stage::real();
    stage.stream(at(100), RELEASED, Vec3::ZERO);
    stage.stream(at(500), pressed(1), RIGHT);
    let moving = stage.states.len();
    stage.step(Event::Stop);
    insta::assert_snapshot!(stage.told(), @r"
      0 ms  tick  0  trial 1 held: no setpoint has arrived yet, at rest
     40 ms  tick  0  trial 1 held: the deadman is released, at rest
    140 ms  tick  1  trial 1 press 1
    502 ms  tick  5  trial 1 held: the node is shutting down
    573 ms  tick  5  trial 1 held: the node is shutting down, at rest
    ");
    let states = &stage.states[moving - 1..];
    for pair in states.windows(2) {
        let passed = pair[1].header.sent.since(pair[0].header.sent) as f64 * 1e-9;
        let change = (pair[1].body.tool_velocity - pair[0].body.tool_velocity).norm();
        assert!(change <= 4.0 * passed + 1e-3, "{change} m/s in {passed} s");
    }
    assert!(stage.state().body.at_rest && stage.tool().y < -0.21);
}

#[test]
fn a_robot_that_shuts_down_at_the_end_of_all_time_ends() {
    let end = u64::MAX / tandem_wire::MILLISECOND;
    let mut stage = Stage::real();
    stage.now = at(end - 500);
    stage.step(Event::Wake);
    stage.stream(at(end - 400), RELEASED, Vec3::ZERO);
    stage.stream(at(end - 30), pressed(1), RIGHT);
    stage.now = tandem_wire::Stamp(u64::MAX);
    assert!(!stage.state().body.at_rest, "it moves");
    let before = stage.states.len();
    stage.step(Event::Stop);
    assert!(stage.states.len() - before < 10);
}

#[test]
fn a_stop_that_takes_twenty_seconds_is_not_cut_short_by_a_process_that_slept() {
    let settings = RobotSimSettings {
        tool_acceleration_m_s2: 0.1,
        tool_speed_m_s: 1.7,
        workspace_min_m: [-2.0, -2.0, -2.0],
        workspace_max_m: [2.0, 2.0, 2.0],
        ..RobotSimSettings::default()
    };
    let mut stage = Stage::real_with(&settings);
    stage.stream(at(100), RELEASED, Vec3::ZERO);
    stage.stream(at(6000), pressed(1), Vec3::new(0.0, 0.6, 0.0));
    let before = *stage.robot.arm().speeds();
    stage.now = at(86_400_000);
    stage.step(Event::Wake);
    assert!(before != [0.0; 7]);
    assert!(stage.state().body.at_rest, "{:?}", stage.robot.arm().speeds());
}

#[test]
fn the_scene_is_repeated_every_second() {
    let mut stage = Stage::real();
    stage.pass(at(3500));
    let times: Vec<f64> = stage.scenes.iter().map(|scene| scene.header.sent.seconds()).collect();
    assert_eq!(times, [0.0, 1.0, 2.0, 3.0]);
    assert_eq!(stage.states.len(), 176, "50 a second, and one at the very start");
}

#[test]
fn a_process_that_slept_finds_the_arm_stopped() {
    let mut stage = Stage::real();
    stage.stream(at(100), RELEASED, Vec3::ZERO);
    stage.stream(at(300), pressed(1), RIGHT);
    let asleep_from = stage.tool();
    stage.now = at(86_400_000);
    stage.step(Event::Wake);
    let state = &stage.state().body;
    assert_eq!(state.motion, Motion::Held(Reason::SetpointLost { silent: 101_000_000 }));
    assert!(state.at_rest && (stage.tool() - asleep_from).norm() < 0.05);
    stage.now = tandem_wire::Stamp(u64::MAX);
    stage.step(Event::Wake);
    assert!(stage.state().body.at_rest);
}
