//! What a whole trial costs under virtual time, nodes built anew, every message encoded and decoded.

use std::ops::ControlFlow;

use criterion::{Criterion, criterion_group, criterion_main};
use tandem_cesn::{Demonstration, Model, Settings};
use tandem_link::config::PaceName;
use tandem_trials::{Blueprint, Configuration, World};
use tandem_wire::{SECOND, Session, Trial};

/// As long as a trial of the shipped task takes.
const TRIAL: u64 = 9 * SECOND;

fn benches(criterion: &mut Criterion) {
    let demonstrations = [
        include_str!("../../examples/demonstrations/planar_a08.csv"),
        include_str!("../../examples/demonstrations/planar_a11.csv"),
        include_str!("../../examples/demonstrations/planar_a14.csv"),
    ]
    .map(|text| Demonstration::from_csv("shipped", text).expect("they ship"));
    let model = Model::train(&demonstrations, &Settings::default()).expect("they fit");
    let mut configuration = Configuration::default();
    configuration.rates.pace = PaceName::Max;
    let blueprint = Blueprint::new(configuration, Session(1), Some(model)).expect("the defaults fit");
    criterion.bench_function("world: a trial of 90 ticks", |bencher| {
        bencher.iter(|| {
            let mut world = World::new(&blueprint).expect("the defaults fit");
            world.mark(Trial::Begin {
                number: 1,
                label: String::new(),
            });
            world.run(TRIAL, |_, _, _| ControlFlow::Continue(()))
        });
    });
}

criterion_group!(world, benches);
criterion_main!(world);
