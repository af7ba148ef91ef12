//! What it costs to take a snapshot of each node in the middle of a trial, and to restore it; its size stands in the name.

use std::ops::ControlFlow;
use std::sync::{Arc, Mutex};

use criterion::{Criterion, criterion_group, criterion_main};
use tandem_cesn::{Demonstration, Model, Settings};
use tandem_trials::world::Said;
use tandem_trials::{Blueprint, Configuration, Player, Seat, World};
use tandem_wire::{Input, NodeName, Ports, SECOND, Session, Stamp, Topic, Trial, restore, snapshot};

/// A seat that several share: the world, and whoever looks at the node afterwards.
struct Shared<P>(Arc<Mutex<P>>);

impl<P: Player> Player for Shared<P> {
    fn name(&self) -> NodeName {
        self.0.lock().expect("one thread").name()
    }

    fn hears(&self, topic: Topic) -> bool {
        self.0.lock().expect("one thread").hears(topic)
    }

    fn deadline(&self) -> Option<Stamp> {
        self.0.lock().expect("one thread").deadline()
    }

    fn take(&mut self, now: Stamp, input: Input<'_>, said: &mut Said) {
        self.0.lock().expect("one thread").take(now, input, said);
    }
}

fn seat<N>(node: N) -> (Box<dyn Player>, Arc<Mutex<Seat<N>>>)
where
    N: Ports + Send + 'static,
    N::Output: Send,
{
    let seat = Arc::new(Mutex::new(Seat::new(node)));
    (Box::new(Shared(Arc::clone(&seat))), seat)
}

fn blueprint() -> Blueprint {
    let demonstrations = [
        include_str!("../../examples/demonstrations/planar_a08.csv"),
        include_str!("../../examples/demonstrations/planar_a11.csv"),
        include_str!("../../examples/demonstrations/planar_a14.csv"),
    ]
    .map(|text| Demonstration::from_csv("shipped", text).expect("they ship"));
    let model = Model::train(&demonstrations, &Settings::default()).expect("they fit");
    Blueprint::new(Configuration::default(), Session(1), Some(model)).expect("the defaults fit")
}

fn measure<N: Ports>(criterion: &mut Criterion, seat: &Mutex<Seat<N>>, mut fresh: N) {
    let mut seat = seat.lock().expect("one thread");
    let mut bytes = Vec::new();
    snapshot(seat.node_mut(), &mut bytes);
    let name = format!("{} ({} bytes)", N::NAME, bytes.len());
    criterion.bench_function(&format!("snapshot {name}"), |bencher| {
        bencher.iter(|| snapshot(seat.node_mut(), &mut bytes));
    });
    criterion.bench_function(&format!("restore {name}"), |bencher| {
        bencher.iter(|| restore(&mut fresh, &bytes).expect("its own snapshot"));
    });
}

fn snapshots(criterion: &mut Criterion) {
    let blueprint = blueprint();
    let predictor = || blueprint.predictor().expect("a model");
    let arbiter = || blueprint.arbiter().expect("a workspace");
    let robot = || blueprint.robot_sim().expect("a scene");
    let (at_operator, in_operator) = seat(blueprint.operator());
    let (at_predictor, in_predictor) = seat(predictor());
    let (at_arbiter, in_arbiter) = seat(arbiter());
    let (at_robot, in_robot) = seat(robot());
    let players = vec![at_operator, at_predictor, at_arbiter, at_robot];
    let mut world = World::of(players, blueprint.timing(), Session(1));
    let label = "snapshots".to_owned();
    world.mark(Trial::Begin { number: 1, label });
    // Behind the checkpoint, so that the predictor carries a forecast.
    world.run(6 * SECOND, |_, _, _| ControlFlow::Continue(()));
    measure(criterion, &in_operator, blueprint.operator());
    measure(criterion, &in_predictor, predictor());
    measure(criterion, &in_arbiter, arbiter());
    measure(criterion, &in_robot, robot());
}

criterion_group!(benches, snapshots);
criterion_main!(benches);
