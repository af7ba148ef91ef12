//! What a message costs: the step, handing it on, its rows, its drawing.

#[path = "../tests/it/script/mod.rs"]
mod script;

use std::hint::black_box;
use std::io::Cursor;
use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use script::{record, session};
use tandem_recorder::{
    Drops, Entry, Heard, Output, Provenance, Recorder, RecorderConfig, RecorderSettings, Sample, SessionFile, Sinks,
    View,
};
use tandem_wire::{Input, Node, Outbox, Ports, Timing};

fn provenance() -> Provenance {
    Provenance {
        robot: "panda".parse().expect("a valid name"),
        build: String::new(),
        epoch_unix_nanos: 0,
    }
}

fn states(timing: Timing) -> Vec<Arc<Heard>> {
    let state = |output| match output {
        Output::Show(heard) if matches!(heard.entry, Entry::Sample(Sample::State(_))) => Some(heard),
        _ => None,
    };
    record(&session(), timing).into_iter().filter_map(state).collect()
}

fn step(c: &mut Criterion) {
    let timing = Timing::default().lockstep();
    let samples = session();
    let count = samples.len() as u64;
    let mut group = c.benchmark_group("recorder");
    group.throughput(criterion::Throughput::Elements(count));
    group.bench_function("decode and step, a session of messages", |b| {
        b.iter(|| black_box(record(&samples, timing)));
    });
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("bench.mcap");
    let settings = RecorderSettings {
        path: path.to_string_lossy().into_owned(),
        ..RecorderSettings::default()
    };
    let config = RecorderConfig::new(&settings).expect("valid settings");
    let mut sinks = Sinks::open(&config, timing, &provenance()).expect("the temporary folder is writable");
    let mut outbox = Outbox::default();
    group.bench_function("decode, step and handle, a session of messages", |b| {
        b.iter(|| {
            let mut recorder = Recorder::new(timing);
            for script::Sample { at, topic, bytes } in &samples {
                recorder.step(
                    *at,
                    Recorder::event(Input::Sample { topic: *topic, bytes }),
                    &mut outbox,
                );
                for output in outbox.drain() {
                    sinks.handle(output);
                }
            }
        });
    });
    group.finish();
}

fn translations(c: &mut Criterion) {
    let timing = Timing::default().lockstep();
    let states = states(timing);
    let mut group = c.benchmark_group("one state");
    group.throughput(criterion::Throughput::Elements(states.len() as u64));
    group.bench_function("to session file rows, 84 times", |b| {
        b.iter(|| {
            let to = Cursor::new(Vec::with_capacity(1 << 20));
            let mut file = SessionFile::begin(to, 1 << 18, provenance()).expect("memory takes it");
            for state in &states {
                file.write(state, Drops::default()).expect("memory takes it");
            }
            black_box(file)
        });
    });
    group.bench_function("to entities, 84 times", |b| {
        let mut drawings = Vec::new();
        b.iter(|| {
            let mut view = View::new(timing);
            for state in &states {
                view.draw(state, Drops::default(), &mut drawings);
            }
            black_box(&drawings);
            drawings.clear();
        });
    });
    group.finish();
}

criterion_group!(benches, step, translations);
criterion_main!(benches);
