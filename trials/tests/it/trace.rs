//! Trials and their figures under circumstances that a demo does not meet.

use tandem_trials::trace::Stopper;
use tandem_trials::{Measures, Trace, Tracer, sparc};
use tandem_wire::{
    Aabb, Clearance, Envelope, Finite, Guidance, Header, Law, Limited, Motion, Pose, Reason, Refusals, SECOND, Scene,
    Seq, Session, Setpoint, State, Topic, Trial, Vec3, encode,
};

const DRIVING: Motion = Motion::Permitted { press: 1 };
const RELEASED: Motion = Motion::Held(Reason::DeadmanReleased);

fn header(tick: u32) -> Header {
    Header {
        tick,
        seq: Seq(u64::from(tick)),
        ..Header::default()
    }
}

fn setpoint(tick: u32, motion: Motion, weight: f64, guidance: Option<Guidance>) -> Envelope<Setpoint> {
    let human = Vec3::new(0.1, 0.0, 0.0);
    let body = Setpoint {
        velocity: human,
        motion,
        lease: None,
        asks: None,
        law: Law::Adaptive,
        weight: Finite(weight),
        human,
        guidance,
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

fn clearance(metres: f64) -> Option<Clearance> {
    Some(Clearance {
        distance: Finite(metres),
        ..Clearance::default()
    })
}

fn state(tick: u32, tool: Vec3) -> Envelope<State> {
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
        at_rest: false,
        obeys: None,
        arrivals: None,
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
        period: SECOND / 10,
    }
}

/// Guidance at a phase of ten steps, along x at 0.2 m/s, 3 mm above the tool.
fn guidance(phase: f64) -> Option<Guidance> {
    Some(Guidance {
        phase: Finite(phase),
        last_step: 10,
        velocity: Vec3::new(0.2, 0.0, 0.0),
        position: Vec3::new(0.0, 0.0, 0.003),
        ..Guidance::default()
    })
}

fn figures(tracer: &Tracer) -> Measures {
    Measures::of(&tracer.trace())
}

#[test]
fn ticks_after_the_loss_of_the_predictor_still_lie_after_the_checkpoint() {
    let mut tracer = Tracer::default();
    for tick in 0..30 {
        tracer.see_state(&state(tick, Vec3::ZERO));
        let guided = (10..20).contains(&tick);
        let weight = if guided || tick < 10 { 0.5 } else { 1.0 };
        let guidance = guided.then(Guidance::default);
        tracer.see_setpoint(&setpoint(tick, DRIVING, weight, guidance));
    }
    let figures = figures(&tracer);
    assert_eq!(figures.weight_mean_before, Some(0.5));
    assert_eq!(figures.weight_mean_after, Some(0.75));
    assert!((figures.human_effort_mean_m_s.expect("there was a human") - 0.1).abs() < 1e-12);
}

#[test]
fn a_tool_that_passes_the_goal_has_not_reached_it() {
    let mut tracer = Tracer::default();
    tracer.see_scene(&scene());
    tracer.see_state(&state(5, scene().goal));
    assert!(!figures(&tracer).reached_goal);
    let mut resting = state(6, scene().goal);
    resting.body.at_rest = true;
    tracer.see_state(&resting);
    assert!(figures(&tracer).reached_goal);
}

#[test]
fn ticks_at_the_end_of_all_numbers_are_counted_without_harm() {
    let mut tracer = Tracer::default();
    tracer.see_scene(&scene());
    tracer.see_state(&state(0, Vec3::ZERO));
    for tick in [u32::MAX, 0, u32::MAX] {
        tracer.see_setpoint(&setpoint(tick, DRIVING, 1.0, None));
        let _ = figures(&tracer);
    }
    tracer.see_setpoint(&setpoint(1, DRIVING, 1.0, None));
    assert_eq!(figures(&tracer).ticks, u32::MAX);
}

#[test]
fn a_trace_that_heard_nothing_has_no_figures() {
    let tracer = Tracer::default();
    assert!(!tracer.is_over());
    assert_eq!(figures(&tracer), Measures::default());
}

/// Ten ticks of driving, a release that is answered after three ticks, five more, and silence.
fn interrupted_trial() -> Tracer {
    let mut tracer = Tracer::default();
    tracer.see_scene(&scene());
    for tick in 0..40 {
        let mut seen = state(tick, Vec3::new(0.01 * f64::from(tick.min(17)), 0.0, 0.0));
        // The nearest moment is the first period of motion; before it, at tick 0, another trial's end was nearer.
        let distance = match tick {
            0 => 0.001,
            2 => 0.005,
            9 | 10 | 15 => -0.002,
            _ => 0.05,
        };
        seen.body.closest = clearance(distance);
        tracer.see_state(&seen);
        let motion = if (1..10).contains(&tick) || (13..18).contains(&tick) {
            DRIVING
        } else {
            RELEASED
        };
        let guidance = (tick >= 5).then(|| guidance(f64::from(tick) - 4.0)).flatten();
        tracer.see_setpoint(&setpoint(tick, motion, 0.5, guidance));
    }
    tracer
}

#[test]
fn a_stop_that_the_human_answers_is_counted_and_the_last_release_is_not() {
    let tracer = interrupted_trial();
    let trace = tracer.trace();
    assert!(tracer.is_over() && trace.over);
    assert_eq!(trace.motion(), Some((1, 17)));
    let stops = Measures::of(&trace).stops;
    assert_eq!(stops.len(), 1);
    assert_eq!((stops[0].tick, stops[0].by), (10, Stopper::Arbiter));
    assert_eq!(stops[0].reason, "the deadman is released");
}

#[test]
fn the_smallest_clearance_counts_from_the_first_tick_with_motion() {
    let mut trace = interrupted_trial().trace();
    trace.ticks.retain(|tick| tick.tick < 9);
    assert_eq!(Measures::of(&trace).min_clearance_m, Some(0.005));
}

#[test]
fn a_touch_that_lasts_counts_once() {
    let figures = figures(&interrupted_trial());
    assert_eq!((figures.contacts, figures.min_clearance_m), (2, Some(-0.002)));
}

#[test]
fn the_figures_are_what_a_hand_computes() {
    let figures = figures(&interrupted_trial());
    let near = |value: Option<f64>, expected: f64| {
        assert!(
            (value.expect("a figure") - expected).abs() < 1e-12,
            "{value:?} is not {expected}"
        );
    };
    assert_eq!(figures.ticks, 18);
    near(figures.duration_s, 1.7);
    near(figures.path_length_m, 0.16);
    // Ticks 5 to 9 and 13 to 17 lie after the checkpoint; the phase reaches the last step at tick 14.
    near(figures.human_effort_mean_m_s, 0.1);
    near(figures.human_effort_integral_m, 0.1);
    assert_eq!(figures.human_effort_steps_m_s, vec![0.1; 6]);
    near(figures.disagreement_mean_m_s, 0.1);
    near(figures.agreement_cosine_mean, 1.0);
    let ticks = [5, 6, 7, 8, 9, 13, 14, 15, 16, 17];
    let away = ticks.map(|tick| libm::hypot(0.01 * f64::from(tick), 0.003));
    near(figures.tracking_forecast_mean_m, away.iter().sum::<f64>() / 10.0);
    near(figures.tracking_forecast_max_m, away[9]);
    assert_eq!(figures.tracking_wish_mean_m, None);
}

#[test]
fn a_wish_is_measured_when_it_is_given() {
    let mut tracer = interrupted_trial();
    tracer.see_wish(6, Vec3::new(0.06, 0.004, 0.0));
    let figures = figures(&tracer);
    assert!((figures.tracking_wish_mean_m.expect("a wish") - 0.004).abs() < 1e-12);
}

#[test]
fn only_the_last_setpoint_of_a_tick_counts() {
    let mut tracer = Tracer::default();
    tracer.see_state(&state(0, Vec3::ZERO));
    tracer.see_setpoint(&setpoint(0, DRIVING, 0.25, None));
    tracer.see_setpoint(&setpoint(1, DRIVING, 1.0, None));
    tracer.see_setpoint(&setpoint(1, RELEASED, 1.0, None));
    assert_eq!(tracer.trace().motion(), Some((0, 0)));
    assert_eq!(figures(&tracer).weight_mean, Some(0.25));
}

#[test]
fn a_trial_is_followed_by_its_number_and_ends_with_the_next_one() {
    let mut tracer = Tracer::of_trial(2);
    tracer.see_state(&state(3, Vec3::ZERO));
    assert_eq!(tracer.trace().trial, 0, "that was trial 1");
    let of_trial = |trial: u32, tick: u32| {
        let mut state = state(tick, Vec3::ZERO);
        (state.body.trial, state.body.trial_start) = (trial, 4);
        state
    };
    tracer.see_state(&of_trial(2, 4));
    tracer.see_state(&of_trial(2, 5));
    assert!(tracer.trace().trial == 2 && !tracer.is_over());
    tracer.see_state(&of_trial(3, 6));
    assert!(tracer.is_over());
    let trace = tracer.trace();
    assert_eq!((trace.trial, trace.began_at, trace.ticks.len()), (2, 4, 2));
    assert_eq!(trace.ticks[1].tick, 1);
}

#[test]
fn a_robot_that_starts_anew_ends_the_trial() {
    let mut tracer = Tracer::default();
    tracer.see_state(&state(7, Vec3::ZERO));
    let mut restarted = state(0, Vec3::ZERO);
    restarted.header.session = Session(9);
    tracer.see_state(&restarted);
    assert!(tracer.is_over());
}

#[test]
fn bytes_are_read_and_what_is_none_of_ours_is_counted() {
    let mut tracer = Tracer::default();
    let mut bytes = Vec::new();
    let begin = Trial::Begin {
        number: 1,
        label: "practice".into(),
    };
    encode(
        &Envelope {
            header: header(0),
            body: begin,
        },
        &mut bytes,
    );
    tracer.see(Topic::Trial, &bytes);
    bytes.clear();
    encode(&state(4, Vec3::ZERO), &mut bytes);
    tracer.see(Topic::State, &bytes);
    for length in 0..bytes.len() {
        tracer.see(Topic::State, &bytes[..length]);
    }
    tracer.see(Topic::Command, b"not looked at");
    let trace = tracer.trace();
    assert_eq!((trace.label.as_str(), trace.ticks.len()), ("practice", 1));
    assert_eq!(trace.drops.unreadable, bytes.len() as u64);
}

#[test]
fn missing_numbers_and_refusals_are_drops() {
    let mut tracer = Tracer::default();
    for (tick, refused) in [(3, 7), (4, 7), (7, 9)] {
        let mut seen = state(tick, Vec3::ZERO);
        seen.body.refused.count = refused;
        tracer.see_state(&seen);
    }
    let drops = tracer.trace().drops;
    assert_eq!((drops.unheard, drops.by_robot, drops.total()), (2, 2, 4));
}

#[test]
fn a_stored_trace_has_the_same_figures() {
    let trace = interrupted_trial().trace();
    let text = serde_json::to_string(&trace).expect("a trace is plain data");
    let read: Trace = serde_json::from_str(&text).expect("what was written can be read");
    assert_eq!(read, trace);
    assert_eq!(Measures::of(&read), Measures::of(&trace));
    let figures = serde_json::to_string(&Measures::of(&trace)).expect("figures are plain data");
    let read: Measures = serde_json::from_str(&figures).expect("what was written can be read");
    assert_eq!(read, Measures::of(&trace));
}

#[test]
fn smoothness_agrees_with_the_authors_program() {
    // Reference: the authors' `sparc.py` (padlevel 4, threshold 0.05) in numpy, with the cut-off at 10 Hz, and at 5 Hz
    // for profiles sampled at 10 Hz, beyond which their spectrum repeats itself.
    let bell = |t: f64| 30.0 * t * t * (1.0 - t) * (1.0 - t);
    let wavy = |t: f64| bell(t) * (1.0 + 0.3 * libm::cos(std::f64::consts::TAU * 6.0 * t));
    let profile = |shape: &dyn Fn(f64) -> f64, count: u32| -> Vec<f64> {
        (0..count).map(|k| shape(f64::from(k) / f64::from(count - 1))).collect()
    };
    for (speeds, period_s, expected) in [
        (profile(&bell, 84), 0.1, -1.406_262_003_517_026_1),
        (profile(&wavy, 84), 0.1, -1.893_574_378_489_396_1),
        (profile(&bell, 200), 0.01, -1.403_567_007_452_145_8),
        (profile(&wavy, 200), 0.01, -1.888_950_830_305_906_4),
    ] {
        let found = sparc(&speeds, period_s).expect("it moves");
        assert!((found - expected).abs() < 1e-10, "{found} is not {expected}");
    }
}

#[test]
fn what_does_not_move_has_no_smoothness() {
    assert_eq!(sparc(&[], 0.1), None);
    assert_eq!(sparc(&[1.0, 1.0], 0.1), None);
    assert_eq!(sparc(&[0.0; 50], 0.1), None);
    assert_eq!(sparc(&[1.0, f64::NAN, 1.0], 0.1), None);
    assert_eq!(sparc(&[1.0, 2.0, 1.0], 0.0), None);
}
