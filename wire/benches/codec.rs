//! What it costs to write and read the messages of one tick.

#[path = "../tests/samples/mod.rs"]
mod samples;

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use tandem_wire::{Envelope, Message, decode, encode};

fn round_trip<M: Message + Clone>(criterion: &mut Criterion, name: &str, body: M) {
    let envelope = Envelope {
        header: samples::header(),
        body,
    };
    let mut bytes = Vec::with_capacity(4096);
    criterion.bench_function(&format!("codec round trip: {name}"), |bencher| {
        bencher.iter(|| {
            encode(black_box(&envelope), &mut bytes);
            decode::<M>(black_box(&bytes)).is_ok()
        });
    });
}

fn benches(criterion: &mut Criterion) {
    round_trip(criterion, "command", samples::command());
    round_trip(criterion, "proposal", samples::proposal());
    round_trip(criterion, "setpoint", samples::setpoint());
    round_trip(criterion, "state", samples::state());
    round_trip(criterion, "forecast", samples::forecast());
    round_trip(criterion, "scene", samples::scene());
    round_trip(criterion, "trial", samples::trial());
    round_trip(criterion, "lease", samples::claim());
    round_trip(criterion, "estop", samples::emergency());
    round_trip(criterion, "journal", samples::journal());
    round_trip(criterion, "info", samples::info());
}

criterion_group!(codec, benches);
criterion_main!(codec);
