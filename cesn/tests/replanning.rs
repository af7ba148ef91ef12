//! Models that are conditioned anew while the movement goes on.

#[path = "support/planar.rs"]
mod planar;

use std::sync::OnceLock;

use tandem_cesn::{Fed, Forecaster, Model, Settings, Stepper};

fn model() -> &'static Model {
    static MODEL: OnceLock<Model> = OnceLock::new();
    MODEL.get_or_init(|| {
        Model::train_replanning(&planar::demonstrations(), &Settings::replanning()).expect("the planar task trains")
    })
}

fn distance(a: &[f64], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Mean distance from the next step of a wish to the forecast made one step before, and to the one of the checkpoint.
fn misses(wish: impl Fn(u32) -> [f64; 2]) -> [f64; 2] {
    let mut forecaster = Forecaster::new(model());
    let mut next = |at: u32, step: u32| {
        let context = model().context_at(f64::from(at), &wish(at));
        let forecast = forecaster
            .forecast(model(), &context, at as usize)
            .expect("it can take it");
        distance(forecast.mean(step as usize + 1).expect("forecast"), wish(step + 1))
    };
    let steps = 44..80;
    let anew = steps.clone().map(|step| next(step, step)).sum::<f64>();
    let once = steps.clone().map(|step| next(41, step)).sum::<f64>();
    [anew, once].map(|total| total / steps.len() as f64)
}

#[test]
fn a_wish_that_turns_into_another_of_the_family_is_followed() {
    let amplitude = |step: u32| 0.08 + 0.06 * ((f64::from(step) - 44.0) / 16.0).clamp(0.0, 1.0);
    let [anew, once] = misses(|step| planar::position(amplitude(step), step));
    assert!(anew < 0.5 * once, "{anew} m instead of {once} m");
}

#[test]
fn a_wish_that_leaves_the_family_is_followed_too() {
    for largest in [0.02, 0.06] {
        let bump = |step: u32| libm::sin(std::f64::consts::PI * f64::from(step.saturating_sub(41)) / 42.0);
        let [anew, once] = misses(|step| {
            let [x, y] = planar::position(0.12, step);
            [x, y + largest * bump(step) * bump(step)]
        });
        assert!(anew < 0.5 * once, "{largest}: {anew} m instead of {once} m");
    }
}

#[test]
fn every_forecast_ends_at_the_goal_and_starts_where_the_movement_is() {
    let mut forecaster = Forecaster::new(model());
    for at in [41_u32, 50, 60, 70, 80] {
        for shift in [[0.0, 0.0], [0.0, 0.01], [-0.01, 0.0]] {
            let [x, y] = planar::position(0.11, at);
            let here = [x + shift[0], y + shift[1]];
            let context = model().context_at(f64::from(at), &here);
            let forecast = forecaster.forecast(model(), &context, at as usize).expect("legal");
            let (start, end) = (forecast.mean(at as usize), forecast.mean(83));
            let start = distance(start.expect("forecast"), here);
            assert!(start < 0.012, "{at} {shift:?}: {start} m");
            assert!(distance(end.expect("forecast"), planar::position(0.11, 83)) < 0.01);
        }
    }
    assert!(model().calibration().rho_hi > 1.06, "{}", model().calibration().rho_hi);
}

#[test]
fn the_file_says_so_and_gives_the_same_forecasts() {
    let bytes = model().to_bytes();
    assert_eq!(bytes[8], 2);
    let read = Model::from_bytes(&bytes).expect("our own");
    let context = model().context_at(50.5, &[0.4, 0.02]);
    assert_eq!(model().forecast(&context, 50), read.forecast(&context, 50));
    assert_eq!(read.last_condition_step(), Some(81));
    for (at, first) in [(43.0, 43), (50.5, 50), (0.0, 41), (1e9, 81), (f64::NAN, 41)] {
        assert_eq!(read.first_step(&read.context_at(at, &[0.4, 0.02])), first);
    }
    assert_eq!(read.context_columns(), ["context_time_s", "context_x_m", "context_y_m"]);
    for wrong in [f64::NAN, f64::INFINITY, 1e300] {
        assert!(read.forecast(&[wrong, 0.4, 0.0], 50).is_err());
    }
}

#[test]
fn at_every_time_the_demonstrations_look_known_and_what_is_far_off_new() {
    let mut forecaster = Forecaster::new(model());
    let mut ratio = |at: u32, amplitude: f64, aside: f64| {
        let [x, y] = planar::position(amplitude, at);
        let context = model().context_at(f64::from(at), &[x, y + aside]);
        let forecast = forecaster.forecast(model(), &context, at as usize).expect("legal");
        forecast.ratio(at as usize).expect("the first step")
    };
    for at in (41..=81).step_by(4) {
        let largest = planar::TRAINED.map(|amplitude| ratio(at, amplitude, 0.0));
        let largest = largest.into_iter().fold(0.0, f64::max);
        assert!(
            (largest - 1.0).abs() < 1e-4,
            "{at}: the demonstrations' own ratio is {largest}"
        );
        // Copies 15 mm off have taught departures of that size.
        assert!(ratio(at, 0.12, 0.01) < 1.03, "{at}: {}", ratio(at, 0.12, 0.01));
        assert!(ratio(at, 0.12, 0.06) > 1.05, "{at}: {}", ratio(at, 0.12, 0.06));
    }
}

#[test]
fn a_stepper_says_the_same_as_a_forecaster() {
    let context = model().context_at(60.5, &[0.5, 0.0]);
    let forecast = model().forecast(&context, 60).expect("legal");
    let mut stepper = Stepper::new(model(), &context).expect("legal");
    for step in 0..70 {
        let one = stepper.advance(model(), Fed::Own).expect("within the movement");
        if let Some(ratio) = forecast.ratio(step) {
            assert!((one.interval.ratio - ratio).abs() < 1e-12, "{step}");
        }
    }
}

#[test]
fn whoever_follows_it_blindly_comes_home_from_anywhere() {
    let mut forecaster = Forecaster::new(model());
    for from in [41_u32, 50, 58] {
        for (amplitude, aside) in [
            (0.12, [0.0, -0.03]),
            (0.12, [-0.03, 0.0]),
            (0.05, [0.0, -0.06]),
            (0.18, [0.03, 0.06]),
        ] {
            let [x, y] = planar::position(amplitude, from);
            let mut here = [x + aside[0], y + aside[1]];
            for step in from..83 {
                let at = step.min(81);
                let context = model().context_at(f64::from(at), &here);
                let forecast = forecaster.forecast(model(), &context, at as usize).expect("legal");
                let next = forecast.mean(step as usize + 1).expect("within the movement");
                here = [next[0], next[1]];
                let off = distance(&here, planar::position(amplitude, step + 1));
                assert!(
                    off < 0.16,
                    "from {from}, {amplitude} {aside:?}: {off} m off at step {step}"
                );
            }
            let off = distance(&here, planar::position(0.11, 83));
            assert!(off < 0.01, "from {from}, {amplitude} {aside:?}: {off} m from the goal");
        }
    }
}

#[test]
fn what_lies_too_far_to_be_heard_is_added_and_comes_back() {
    let forecast = |aside: f64| {
        let [x, y] = planar::position(0.11, 60);
        model()
            .forecast(&model().context_at(60.0, &[x, y + aside]), 60)
            .expect("legal")
    };
    let (near, far) = (forecast(0.1), forecast(1.1));
    let apart = |step: usize| far.mean(step).expect("forecast")[1] - near.mean(step).expect("forecast")[1];
    assert!(
        (apart(60) - 1.0).abs() < 1e-9 && apart(83).abs() < 1e-9,
        "{} {}",
        apart(60),
        apart(83)
    );
    assert!((apart(70) - 0.6).abs() < 0.1, "{}", apart(70));
    let leverages = [&near, &far].map(|forecast| forecast.leverage(60).expect("forecast"));
    assert!((leverages[1] / leverages[0] - 121.0).abs() < 5.0, "{leverages:?}");
}
