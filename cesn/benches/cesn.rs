//! What training, one update, one forecast and one interval cost, with five hundred units on one core.

#[path = "../tests/support/planar.rs"]
mod planar;

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use tandem_cesn::{Demonstration, Forecaster, Jitter, Model, Reservoir, Ridge, Settings, Shape};

const FIXED: Ridge = Ridge::Fixed { lambda: 1e-6 };

fn bells() -> Vec<Demonstration> {
    [0.4, 0.6, 0.8, 1.0].map(|a| planar::bell(a, 200)).to_vec()
}

fn reservoir(inputs: usize, steps: usize) -> Reservoir {
    let shape = Shape {
        inputs,
        leak: Settings::default().leak_for(steps),
        ..Shape::default()
    };
    Reservoir::from_seed(&shape, 1).expect("legal")
}

/// Harvest, regression, leaving demonstrations out, and everything an interval needs.
fn training(c: &mut Criterion) {
    let plain = Settings {
        jitter: None,
        ..Settings::default()
    };
    let jittered = Settings {
        jitter: Some(Jitter::default()),
        ..Settings::default()
    };
    let (bells, planar) = (bells(), planar::demonstrations());
    let mut group = c.benchmark_group("training");
    let mut bench = |name: &str, demonstrations: &[Demonstration], settings: Settings| {
        let first = &demonstrations[0];
        let reservoir = reservoir(first.context().len(), first.steps());
        group.bench_function(name, |b| {
            b.iter(|| Model::train_with(reservoir.clone(), black_box(demonstrations), &settings).expect("trainable"));
        });
    };
    bench(
        "n = 800, fixed ridge",
        &bells,
        Settings {
            ridge: FIXED,
            ..plain.clone()
        },
    );
    bench("n = 800, evidence", &bells, plain.clone());
    bench(
        "n = 252, fixed ridge",
        &planar,
        Settings {
            ridge: FIXED,
            ..plain.clone()
        },
    );
    bench("n = 252, evidence", &planar, plain);
    bench("n = 252, four jittered copies, evidence", &planar, jittered);
    group.finish();
}

fn making(c: &mut Criterion) {
    let mut group = c.benchmark_group("making");
    group.sample_size(10);
    group.bench_function("a reservoir from a seed", |b| b.iter(|| reservoir(2, 84)));
    let model = Model::train(&planar::demonstrations(), &Settings::default()).expect("trainable");
    group.bench_function("a model file", |b| b.iter(|| black_box(&model).to_bytes()));
    let bytes = model.to_bytes();
    group.bench_function("a model from its file", |b| {
        b.iter(|| Model::from_bytes(black_box(&bytes)).expect("whole"))
    });
    group.finish();
}

fn forecasting(c: &mut Criterion) {
    let model = Model::train(&planar::demonstrations(), &Settings::default()).expect("trainable");
    let context = planar::checkpoint(0.12);
    let mut state = model.reservoir().rest();
    c.bench_function("one state update", |b| {
        b.iter(|| model.reservoir().update(&mut state, black_box(&[0.1, 0.3])))
    });
    let mut forecaster = Forecaster::new(&model);
    c.bench_function("forecast of 42 steps with intervals, from rest", |b| {
        b.iter(|| {
            forecaster
                .forecast(&model, black_box(&context), 42)
                .expect("legal")
                .mean_ratio()
        });
    });
    let mut interval = model.interval(&state, 42);
    c.bench_function("interval of one state", |b| {
        b.iter(|| model.interval_into(black_box(&state), 42, &mut interval));
    });
    let mut y = [0.0; 2];
    c.bench_function("readout of one state", |b| {
        b.iter(|| model.read(black_box(&state), &mut y))
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(30);
    targets = training, making, forecasting
}
criterion_main!(benches);
