//! A model that is conditioned anew on every tick: when it is asked, from where, and what comes of it.

mod support;

use support::*;
use tandem_predictor::{Event, Predictor, PredictorSettings};
use tandem_wire::{Node, Outbox, Session, Stamp, TaskFrame, Timing, Vec3, restore, snapshot};

/// The movement of amplitude 0.12 m, so far aside, over some ticks.
fn walk(stage: &mut Stage, aside: f64, ticks: std::ops::Range<u32>) {
    for tick in ticks {
        let [x, y] = path(0.12, f64::from(tick));
        stage.state(tick, [x, y + aside], MOVING);
    }
}

#[test]
fn every_tick_with_motion_is_a_new_condition_and_no_tick_without() {
    let mut stage = Stage::replanning();
    walk(&mut stage, 0.0, 0..46);
    let before = stage.forecasts();
    for tick in 46..49 {
        stage.state(tick, path(0.12, 45.0), HELD);
    }
    assert_eq!(stage.forecasts(), before, "nothing moves, nothing is new");
    for tick in 49..52 {
        stage.state(tick, path(0.12, f64::from(tick - 3)), MOVING);
    }
    let conditions: Vec<String> = stage
        .forecast_messages()
        .map(|forecast| {
            let [time, x, y] = [0, 1, 2].map(|i| forecast.context[i].0);
            format!(
                "{}: at {time:.2} s ({x:.2} {y:.2}), from {}",
                forecast.number, forecast.first_step
            )
        })
        .collect();
    insta::assert_snapshot!(conditions.join("\n"), @"
    1: at 4.10 s (0.29 0.12), from 41
    2: at 4.20 s (0.31 0.10), from 42
    3: at 4.30 s (0.32 0.09), from 43
    4: at 4.40 s (0.33 0.07), from 44
    5: at 4.50 s (0.35 0.04), from 45
    6: at 4.60 s (0.36 0.03), from 46
    7: at 4.70 s (0.37 0.01), from 47
    8: at 4.80 s (0.39 -0.01), from 48
    ");
}

#[test]
fn states_between_ticks_ask_for_nothing() {
    let mut stage = Stage::with(Timing::default(), replanning_model());
    for tick in 38..46 {
        let opening = stage.state(tick, path(0.12, f64::from(tick)), MOVING).guidance;
        for part in 1..5 {
            let at = path(0.12, f64::from(tick) + 0.2 * f64::from(part));
            assert_eq!(stage.state(tick, at, MOVING).guidance, opening);
        }
    }
    assert_eq!(stage.forecasts(), 5, "ticks 41 to 45");
}

#[test]
fn its_forecast_goes_with_a_human_who_goes_aside() {
    let aside = |stage: &mut Stage| {
        walk(stage, 0.0, 0..44);
        let mut off = Vec::new();
        for tick in 44..60 {
            let [x, y] = path(0.12, f64::from(tick));
            let at = [x, y + 0.02];
            let guidance = stage.state(tick, at, MOVING).guidance.expect("past the checkpoint");
            off.push((guidance.position - TaskFrame::default().to_base(at)).norm());
        }
        off.iter().sum::<f64>() / off.len() as f64
    };
    let (anew, once) = (aside(&mut Stage::replanning()), aside(&mut Stage::lockstep()));
    assert!(
        once > 0.015,
        "the forecast of the checkpoint stays where it was: {once} m"
    );
    assert!(anew < 0.5 * once, "{anew} m instead of {once} m");
}

#[test]
fn past_its_last_condition_the_last_forecast_serves_to_the_end() {
    let mut stage = Stage::replanning();
    walk(&mut stage, 0.0, 0..100);
    let last = stage.forecast_messages().last().expect("there are many");
    // It crossed a little past step 41, and so the last of its conditions would be a little past step 81.
    assert_eq!((last.number, last.first_step, last.points.len()), (40, 80, 4));
}

#[test]
fn whoever_follows_it_reaches_the_goal() {
    let mut stage = Stage::replanning();
    walk(&mut stage, 0.0, 0..42);
    let (frame, mut tool) = (TaskFrame::default(), TaskFrame::default().to_base(path(0.12, 41.0)));
    for tick in 42..100 {
        let guidance = stage
            .state(tick, frame.to_task(tool), MOVING)
            .guidance
            .expect("guidance");
        tool = tool + guidance.velocity * 0.1;
    }
    let [x, y] = frame.to_task(tool);
    assert!((x - 0.6).abs() < 5e-3 && y.abs() < 5e-3, "({x}, {y})");
}

#[test]
fn where_no_model_reaches_the_forecast_at_hand_stands() {
    let mut stage = Stage::replanning();
    walk(&mut stage, 0.0, 38..46);
    let before = stage.forecasts();
    let guidance = stage.state(46, [1e9, -1e9], MOVING).guidance.expect("the one before");
    assert_eq!((stage.forecasts(), guidance.forecast as usize), (before, before));
    assert!(guidance.phase.0 > 46.0 && guidance.velocity.norm() <= 0.5 + 1e-12);
    stage.state(47, path(0.12, 47.0), MOVING);
    assert_eq!(stage.forecasts(), before + 1);
}

#[test]
fn a_predictor_restored_between_two_conditions_goes_on_the_same() {
    let fresh = || {
        let (timing, settings) = (Timing::default().lockstep(), PredictorSettings::default());
        Predictor::new(Session(2), timing, TaskFrame::default(), replanning_model(), &settings).expect("it fits")
    };
    let said = |predictor: &mut Predictor, ticks: std::ops::Range<u32>| {
        let mut outbox = Outbox::default();
        for tick in ticks {
            let [x, y] = path(0.12, f64::from(tick));
            let state = state(u64::from(tick), tick, [x, y + 0.0005 * f64::from(tick)], MOVING);
            predictor.step(
                Stamp::of_tick(tick, Timing::default().period),
                Event::State(state),
                &mut outbox,
            );
        }
        outbox.drain().collect::<Vec<_>>()
    };
    for cut in [41, 42, 43, 60, 81, 82, 90] {
        let (mut one, mut other, mut bytes) = (fresh(), fresh(), Vec::new());
        said(&mut one, 0..cut);
        snapshot(&mut one, &mut bytes);
        restore(&mut other, &bytes).expect("its own");
        let (whole, restored) = (said(&mut one, cut..95), said(&mut other, cut..95));
        assert!(whole == restored && !whole.is_empty(), "restored before tick {cut}");
    }
}

#[test]
fn of_two_checkpoints_only_the_model_in_use_is_asked_again() {
    let settings = tandem_cesn::Settings {
        units: 120,
        checkpoint_step: 55,
        ..tandem_cesn::Settings::default()
    };
    let demonstrations: Vec<_> = [0.08, 0.11, 0.14].map(|a| demonstration_at(a, 55)).to_vec();
    let later = tandem_cesn::Model::train(&demonstrations, &settings).expect("it can be learnt");
    let models = vec![replanning_model(), std::sync::Arc::new(later)];
    let (timing, settings) = (Timing::default().lockstep(), PredictorSettings::default());
    let both = Predictor::with_models(Session(2), timing, TaskFrame::default(), models, &settings);
    let mut stage = Stage::of(both.expect("they fit"));
    walk(&mut stage, 0.0, 0..70);
    // A condition of the second model is a point, one of the first a time and a point.
    let numbers: Vec<usize> = stage
        .forecast_messages()
        .map(|forecast| forecast.context.len())
        .collect();
    let (last, before) = numbers.split_last().expect("there are forecasts");
    assert_eq!(*last, 2, "the second checkpoint's forecast is made once");
    assert!(
        before.len() > 12 && before.iter().all(|numbers| *numbers == 3),
        "{numbers:?}"
    );
    let velocity = stage
        .state(70, path(0.12, 70.0), MOVING)
        .guidance
        .expect("guidance")
        .velocity;
    assert!(velocity.norm() > 0.01 && velocity != Vec3::ZERO);
}
