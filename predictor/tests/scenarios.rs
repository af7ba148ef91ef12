//! Scripted movements in, every proposal and forecast out.

mod support;

use support::*;
use tandem_cesn::{Demonstration, Model, Settings};
use tandem_predictor::{Event, Output, Predictor, PredictorSettings, UnfitModel};
use tandem_wire::{MILLISECOND, Session, TaskFrame, Timing};

/// The movement of amplitude `a`, so many demonstration steps per tick, up to a tick.
fn walk(stage: &mut Stage, a: f64, steps_per_tick: f64, ticks: std::ops::Range<u32>) {
    for tick in ticks {
        stage.state(tick, path(a, steps_per_tick * f64::from(tick)), MOVING);
    }
}

#[test]
fn the_phase_stands_still_for_as_long_as_the_robot_is_held() {
    let mut stage = Stage::lockstep();
    walk(&mut stage, 0.12, 1.0, 0..46);
    for tick in 46..49 {
        stage.state(tick, path(0.12, 45.0), HELD);
    }
    for tick in 49..52 {
        stage.state(tick, path(0.12, f64::from(tick - 3)), MOVING);
    }
    insta::assert_snapshot!(stage.told(), @r"
    proposal without guidance  ×41
    forecast 1 from (0.293 0.116): 43 steps from 41
    proposal on forecast 1: phase 41.01, at (0.39 -0.01 0.15), velocity (0.13 0.14 0.00)
    proposal on forecast 1: phase 42.01, at (0.40 0.01 0.15), velocity (0.14 0.14 0.00)
    proposal on forecast 1: phase 43.01, at (0.41 0.02 0.15), velocity (0.13 0.14 0.00)
    proposal on forecast 1: phase 44.01, at (0.43 0.03 0.15), velocity (0.13 0.13 0.00)
    proposal on forecast 1: phase 45.01, at (0.45 0.05 0.15), velocity (0.16 0.13 0.00)  ×4
    proposal on forecast 1: phase 46.01, at (0.47 0.06 0.15), velocity (0.20 0.13 0.00)
    proposal on forecast 1: phase 47.01, at (0.49 0.07 0.15), velocity (0.25 0.13 0.00)
    proposal on forecast 1: phase 48.01, at (0.52 0.09 0.15), velocity (0.28 0.13 0.00)
    ");
}

#[test]
fn whoever_follows_the_proposals_reaches_the_goal_and_stays_there() {
    let mut stage = Stage::lockstep();
    walk(&mut stage, 0.12, 1.0, 0..42);
    let (frame, mut tool) = (TaskFrame::default(), TaskFrame::default().to_base(path(0.12, 41.0)));
    for tick in 42..100 {
        let guidance = stage.state(tick, frame.to_task(tool), MOVING).guidance.unwrap();
        assert!(guidance.half_width.x > 0.0 && guidance.half_width.y > 0.0);
        assert_eq!(guidance.last_step, 83);
        tool = tool + guidance.velocity * 0.1;
    }
    let [x, y] = frame.to_task(tool);
    assert!((x - 0.6).abs() < 2e-3 && y.abs() < 3e-3, "({x}, {y})");
    assert_eq!(stage.forecasts(), 1);
}

#[test]
fn the_phase_counts_from_the_plane_at_every_speed() {
    for (steps_per_tick, share) in [(0.3, 0.2), (0.7, 0.9), (1.0, 0.5), (1.6, 0.1)] {
        let mut stage = Stage::lockstep();
        let plane = model().checkpoint_plane();
        let mut phases = Vec::new();
        for tick in 0..6_u32 {
            // A straight way through the plane, `share` of a tick past it at tick 3.
            let x = plane + 0.01 * steps_per_tick * (f64::from(tick) - 3.0 + share);
            let guidance = stage.state(tick, [x, 0.11], MOVING).guidance;
            phases.extend(guidance.map(|guidance| guidance.phase.0));
        }
        let expected = [0.0, 1.0, 2.0].map(|ticks| 41.0 + share + ticks);
        assert_eq!(phases.len(), 3);
        for (phase, expected) in phases.iter().zip(expected) {
            assert!((phase - expected).abs() < 1e-9, "{phase} instead of {expected}");
        }
    }
}

#[test]
fn states_between_ticks_repeat_the_velocity_of_their_tick() {
    let mut stage = Stage::new(Timing::default());
    let at = |tick: u32, part: u32| path(0.1, f64::from(tick) + 0.2 * f64::from(part));
    for tick in 38..44 {
        let opening = stage.state(tick, at(tick, 0), MOVING).guidance;
        for part in 1..5 {
            assert_eq!(stage.state(tick, at(tick, part), MOVING).guidance, opening);
        }
        assert_eq!(opening.is_some(), tick >= 42);
    }
    assert_eq!((stage.forecasts(), stage.said.len()), (1, 31));
}

#[test]
fn a_forged_state_of_the_last_tick_there_is_does_not_freeze_the_guidance() {
    for mut stage in [Stage::lockstep(), Stage::new(Timing::default())] {
        walk(&mut stage, 0.12, 1.0, 38..44);
        stage.event(
            4_350,
            Event::State(state(1_000_000, u32::MAX, path(0.12, 44.0), MOVING)),
        );
        stage.event(4_351, Event::State(state(7, u32::MAX, path(0.12, 44.0), MOVING)));
        assert_eq!(stage.predictor.refused().count, 2);
        let phase = |stage: &mut Stage, tick: u32| {
            let guidance = stage.state(tick, path(0.12, f64::from(tick)), MOVING).guidance;
            guidance.map(|guidance| guidance.phase.0)
        };
        let (one, next) = (phase(&mut stage, 44), phase(&mut stage, 45));
        assert!(
            one.zip(next).is_some_and(|(one, next)| next - one > 0.99),
            "{one:?} {next:?}"
        );
    }
}

#[test]
fn never_crossed_is_never_guided() {
    let mut stage = Stage::lockstep();
    for tick in 0..300 {
        let x = 0.2 + 0.05 * libm::sin(f64::from(tick));
        assert_eq!(stage.state(tick, [x, 0.1], MOVING).guidance, None);
    }
}

#[test]
fn a_new_trial_starts_anew_and_its_forecast_has_the_next_number() {
    let mut stage = Stage::lockstep();
    walk(&mut stage, 0.08, 1.0, 40..44);
    for (seq, tick) in (44..48).zip(44_u32..) {
        let mut next = state(seq, tick, path(0.14, f64::from(tick) - 4.5), MOVING);
        (next.body.trial, next.body.trial_start) = (2, 44);
        stage.event(u64::from(tick) * 100, Event::State(next));
    }
    insta::assert_snapshot!(stage.told(), @r"
    proposal without guidance  ×2
    forecast 1 from (0.293 0.077): 43 steps from 41
    proposal on forecast 1: phase 41.98, at (0.43 0.01 0.15), velocity (0.04 0.14 0.00)
    proposal on forecast 1: phase 42.98, at (0.44 0.02 0.15), velocity (0.04 0.14 0.00)
    proposal without guidance  ×2
    forecast 2 from (0.293 0.134): 43 steps from 41
    proposal on forecast 2: phase 41.52, at (0.38 0.00 0.15), velocity (0.21 0.13 0.00)
    proposal on forecast 2: phase 42.52, at (0.39 0.01 0.15), velocity (0.21 0.13 0.00)
    ");
}

#[test]
fn a_state_that_comes_twice_is_answered_once() {
    let mut stage = Stage::lockstep();
    let once = state(1, 0, [0.0, 0.0], MOVING);
    stage.event(0, Event::State(once));
    stage.event(0, Event::State(once));
    assert_eq!((stage.said.len(), stage.predictor.refused().count), (1, 1));
}

#[test]
fn a_forecast_names_its_model_and_starts_at_the_checkpoint() {
    let mut stage = Stage::lockstep();
    walk(&mut stage, 0.11, 1.0, 38..43);
    let forecast = stage.said.iter().find_map(|output| match output {
        Output::Forecast(forecast) => Some(forecast),
        Output::Proposal(_) => None,
    });
    let forecast = forecast.unwrap();
    assert_eq!(forecast.body.model, model().hash());
    assert_eq!((forecast.body.first_step, forecast.body.points.len()), (41, 43));
    assert_eq!(forecast.body.period, 100 * MILLISECOND);
    let [x, y] = TaskFrame::default().to_task(forecast.body.points[20].position);
    let expected = path(0.11, 61.0);
    assert!(
        (x - expected[0]).abs() < 1e-3 && (y - expected[1]).abs() < 5e-3,
        "({x}, {y})"
    );
}

fn refusal(contexts: &[&str], outputs: &[&str], settings: Settings) -> UnfitModel {
    let demonstration = |a: f64| {
        let values = (0..60).flat_map(|t| vec![a * f64::from(t); outputs.len()]).collect();
        let context: Vec<(&str, f64)> = contexts.iter().map(|name| (*name, a)).collect();
        Demonstration::new("line", &context, outputs, values, None).expect("numbers are finite")
    };
    let settings = Settings {
        units: 30,
        checkpoint_step: 20,
        ..settings
    };
    let model = Model::train(&[demonstration(0.8), demonstration(1.0), demonstration(1.2)], &settings)
        .expect("lines can be learnt");
    let (timing, frame) = (Timing::default(), TaskFrame::default());
    match Predictor::new(Session(2), timing, frame, model, &PredictorSettings::default()) {
        Err(why) => why,
        Ok(_) => panic!("the model should not fit"),
    }
}

#[test]
fn a_model_for_something_else_is_refused_with_the_reason() {
    let (context, outputs) = (["context_x_m", "context_y_m"], ["x_m", "y_m"]);
    let frame = Settings {
        frame: "world".to_owned(),
        ..Settings::default()
    };
    let period = Settings {
        period_s: 0.05,
        ..Settings::default()
    };
    let reasons = [
        refusal(&context, &["height_m"], Settings::default()),
        refusal(&["context_height_m"], &outputs, Settings::default()),
        refusal(&context, &outputs, frame),
        refusal(&context, &outputs, period),
    ];
    let told: Vec<String> = reasons.iter().map(ToString::to_string).collect();
    insta::assert_snapshot!(told.join("\n"), @r#"
    the model predicts 1 numbers a step (height_m); guiding the tool in the plane needs x and y
    the model's context has 1 numbers (context_height_m); a checkpoint gives one point, x and y
    the model's positions are in the frame "world"; only "task" has a known place before the robot
    the model's steps last 0.05 s, the control period 0.1 s; train it at the control period
    "#);
}
