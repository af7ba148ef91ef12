//! The demo's figures under circumstances that the demo itself does not meet.

#![allow(
    dead_code,
    unreachable_pub,
    reason = "the program's own module, of which this tests a part"
)]

#[path = "../src/summary.rs"]
mod summary;

use summary::Summary;
use tandem_wire::{
    Aabb, Envelope, Finite, Guidance, Header, Law, Limited, Motion, Pose, Refusals, Scene, Setpoint, State, Vec3,
};

const DRIVING: Motion = Motion::Permitted { press: 1 };

fn header(tick: u32) -> Header {
    Header {
        tick,
        ..Header::default()
    }
}

fn setpoint(tick: u32, weight: f64, guided: bool) -> Envelope<Setpoint> {
    let human = Vec3::new(0.1, 0.0, 0.0);
    let body = Setpoint {
        velocity: human,
        motion: DRIVING,
        law: Law::Adaptive,
        weight: Finite(weight),
        human,
        guidance: guided.then(Guidance::default),
        blended: human,
        limited: Limited::default(),
        command: None,
        proposal: None,
        seen: None,
        refused: Refusals::default(),
    };
    Envelope {
        header: header(tick),
        body,
    }
}

fn state(tick: u32, tool: Vec3, at_rest: bool) -> Envelope<State> {
    let body = State {
        trial: 1,
        trial_start: 0,
        joints: Default::default(),
        joint_velocities: Default::default(),
        links: Default::default(),
        tool: Pose {
            position: tool,
            ..Pose::default()
        },
        tool_velocity: Vec3::ZERO,
        clearance: None,
        closest: None,
        motion: DRIVING,
        at_rest,
        obeys: None,
        refused: Refusals::default(),
    };
    Envelope {
        header: header(tick),
        body,
    }
}

fn scene() -> Scene {
    Scene {
        obstacles: vec![],
        bodies: vec![],
        start: Vec3::ZERO,
        goal: Vec3::new(0.5, 0.3, 0.15),
        goal_tolerance: Finite(0.01),
        workspace: Aabb {
            min: Vec3::ZERO,
            max: Vec3::ZERO,
        },
        period: 1,
    }
}

#[test]
fn ticks_after_the_loss_of_the_predictor_still_lie_after_the_checkpoint() {
    let mut summary = Summary::default();
    for tick in 0..31 {
        summary.see_state(&state(tick, Vec3::ZERO, false));
        let guided = (10..20).contains(&tick);
        let weight = if guided || tick < 10 { 0.5 } else { 1.0 };
        summary.see_setpoint(&setpoint(tick, weight, guided));
    }
    let figures = summary.figures();
    assert_eq!(figures.weight_mean_before, Some(0.5));
    assert_eq!(figures.weight_mean_after, Some(0.75));
    assert!((figures.human_effort_mean_m_s.expect("there was a human") - 0.1).abs() < 1e-12);
}

#[test]
fn a_tool_that_passes_the_goal_has_not_reached_it() {
    let mut summary = Summary::default();
    summary.see_scene(&scene());
    summary.see_state(&state(5, scene().goal, false));
    assert!(!summary.figures().reached_goal);
    summary.see_state(&state(6, scene().goal, true));
    assert!(summary.figures().reached_goal);
}

#[test]
fn ticks_at_the_end_of_all_numbers_are_counted_without_harm() {
    let mut summary = Summary::default();
    summary.see_state(&state(0, Vec3::ZERO, false));
    for tick in [u32::MAX, 0, u32::MAX] {
        summary.see_setpoint(&setpoint(tick, 1.0, false));
        let _ = summary.figures();
    }
    summary.see_setpoint(&setpoint(1, 1.0, false));
    assert_eq!(summary.figures().ticks, u32::MAX);
}
