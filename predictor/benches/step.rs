//! What one state costs: before the checkpoint, at it (target: 2 ms), after it, and after it where every tick is a new
//! condition (the control period is 100 ms). N = 500.

use std::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use tandem_cesn::{Model, Settings};
use tandem_predictor::{Event, Output, Predictor, PredictorSettings};
use tandem_wire::{Node, Outbox, Session, Stamp, TaskFrame, Timing};

#[path = "../tests/support/mod.rs"]
mod support;

use support::{MOVING, demonstrations, path, state};

/// A predictor that has seen the movement up to `tick`.
fn predictor_at(model: &std::sync::Arc<Model>, tick: u32) -> (Predictor, Outbox<Output>) {
    let (timing, frame) = (Timing::default().lockstep(), TaskFrame::default());
    let settings = PredictorSettings::default();
    let mut predictor = Predictor::new(Session(2), timing, frame, model.clone(), &settings).expect("the model fits");
    let mut outbox = Outbox::default();
    for tick in 0..=tick {
        predictor.step(stamp(tick), event(tick), &mut outbox);
        outbox.drain().for_each(drop);
    }
    (predictor, outbox)
}

fn stamp(tick: u32) -> Stamp {
    Stamp::of_tick(tick, Timing::default().period)
}

fn event(tick: u32) -> Event {
    Event::State(state(u64::from(tick) + 1, tick, path(0.12, f64::from(tick)), MOVING))
}

fn steps(c: &mut Criterion) {
    let trained = Model::train(&demonstrations(), &Settings::default()).expect("the planar task can be learnt");
    let once = std::sync::Arc::new(trained);
    let trained = Model::train_replanning(&demonstrations(), &Settings::replanning()).expect("it can be learnt, too");
    let anew = std::sync::Arc::new(trained);
    let cases = [
        ("before the checkpoint", &once, 20, 0),
        ("the step with the forecast", &once, 41, 1),
        ("after the checkpoint", &once, 60, 0),
        ("conditioned anew, first", &anew, 42, 1),
        ("conditioned anew, half-way", &anew, 60, 1),
    ];
    for (name, model, tick, forecasts) in cases {
        let name = format!("predictor: {name}");
        c.bench_function(&name, |b| {
            let once = || (predictor_at(model, tick - 1), event(tick));
            b.iter_batched(
                once,
                |((mut predictor, mut outbox), event)| {
                    predictor.step(stamp(tick), black_box(event), &mut outbox);
                    assert_eq!(outbox.as_slice().len(), 1 + forecasts);
                    (predictor, outbox)
                },
                BatchSize::LargeInput,
            );
        });
    }
}

criterion_group!(benches, steps);
criterion_main!(benches);
