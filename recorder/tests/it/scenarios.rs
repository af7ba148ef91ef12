//! Scripted timelines in, the recorder's outputs in words out.

use crate::script::{PERIOD, a_state, record, session};
use tandem_recorder::{Entry, Event, Level, Output, Recorder, Sample};
use tandem_wire::{
    Condition, Input, Malformed, Node, NodeName, Outbox, Ports, Session, Stamp, Storage, Timing, Topic, Unreadable,
    codec, decode, encode,
};

/// Every output in one line: what is written, and whether it is shown too.
fn words(outputs: &[Output]) -> Vec<String> {
    let line = |output: &Output| match output {
        Output::Show(_) | Output::Ask(_) | Output::Say(_) => None,
        Output::Write(heard) => Some(match &heard.entry {
            Entry::Sample(sample) => format!("{} {}", heard.tick, sample.topic()),
            Entry::Note(note) => format!("{} {:?} {note}", heard.tick, note.level),
            Entry::Counts(counts) => {
                let received: u64 = counts.streams.iter().map(|stream| stream.received).sum();
                format!("{} counts {received}", heard.tick)
            }
        }),
    };
    outputs.iter().filter_map(line).collect()
}

fn notes(outputs: &[Output]) -> Vec<String> {
    words(outputs).into_iter().filter(|line| line.contains(": ")).collect()
}

#[test]
fn a_trial_is_told_in_eight_notes() {
    let outputs = record(&session(), Timing::default().lockstep());
    assert_eq!(
        notes(&outputs),
        [
            "0 Info robot-sim: stop: no setpoint has arrived yet",
            "0 Info arbiter: stop: the deadman is released",
            "0 Info robot-sim: trial 1 begins: planar task, A = 0.12, adaptive",
            "2 Info arbiter: motion is permitted by press 1",
            "41 Info predictor: forecast 1: 4.3 s ahead, at worst ±21.7 mm and 1.90 times as unsure as in training",
            "62 Warning arbiter: stop: the operator's commands stopped 250 ms ago",
            "68 Info arbiter: motion is permitted by press 1",
            "84 Info robot-sim: trial 1 ends: goal reached after 8.4 s",
        ]
    );
}

#[test]
fn everything_is_written_in_order_and_only_what_is_new_to_the_eye_is_shown() {
    let samples = session();
    let outputs = record(&samples, Timing::default().lockstep());
    let written = outputs.iter().filter_map(|output| match output {
        Output::Write(heard) => match &heard.entry {
            Entry::Sample(sample) => Some(sample.topic()),
            _ => None,
        },
        Output::Show(_) | Output::Ask(_) | Output::Say(_) => None,
    });
    assert!(written.eq(samples.iter().map(|sample| sample.topic)));
    let hidden =
        |heard: &tandem_recorder::Heard| matches!(heard.entry, Entry::Sample(Sample::Journal(_) | Sample::Info(..)));
    assert!(
        !outputs
            .iter()
            .any(|output| matches!(output, Output::Show(heard) if hidden(heard)))
    );
}

#[test]
fn in_lockstep_the_time_axis_is_the_tick() {
    for output in record(&session(), Timing::default().lockstep()) {
        let (Output::Write(heard) | Output::Show(heard)) = output else {
            continue;
        };
        assert_eq!(heard.session_time, Stamp::of_tick(heard.tick, PERIOD));
    }
}

#[test]
fn a_gap_and_a_repetition_are_counted_and_the_repetition_is_not_shown() {
    let mut recorder = Recorder::new(Timing::default());
    let mut outbox = Outbox::default();
    let mut hear = |seq| {
        let state = a_state(0, seq);
        recorder.step(Stamp(seq), Event::Sample(Sample::State(Box::new(state))), &mut outbox);
        outbox.drain().collect::<Vec<_>>()
    };
    hear(1);
    assert_eq!(
        words(&hear(4))[0],
        "0 Warning recorder: 2 messages on state were missed"
    );
    let repeated = hear(4);
    assert!(
        matches!(repeated.as_slice(), [Output::Write(_)]),
        "{:?}",
        words(&repeated)
    );
    recorder.step(Stamp(9), Event::Stop, &mut outbox);
    let outputs: Vec<_> = outbox.drain().collect();
    let Some(Output::Write(last)) = outputs.last() else {
        panic!("the counts are written last");
    };
    let Entry::Counts(counts) = &last.entry else {
        panic!("the counts are written last");
    };
    let state = counts.streams[0];
    assert_eq!(
        (state.topic, state.received, state.missed, state.repeated),
        (Topic::State, 3, 2, 1)
    );
}

#[test]
fn unreadable_bytes_are_said_once_and_counted() {
    let mut recorder = Recorder::new(Timing::default());
    let mut outbox = Outbox::default();
    for _ in 0..3 {
        let event = Recorder::event(Input::Sample {
            topic: Topic::Setpoint,
            bytes: &[1, 4, 0],
        });
        let why = Malformed::Truncated(3);
        let topic = Topic::Setpoint;
        assert_eq!(event, Event::Unreadable(Unreadable { topic, why }));
        recorder.step(Stamp(1), event, &mut outbox);
    }
    let outputs: Vec<_> = outbox.drain().collect();
    assert_eq!(
        words(&outputs),
        ["0 Warning recorder: a sample on setpoint cannot be read: truncated after 3 bytes"]
    );
}

#[test]
fn the_counts_come_a_second_after_the_first_message_and_only_if_there_was_one() {
    let mut recorder = Recorder::new(Timing::default());
    let mut outbox = Outbox::default();
    assert_eq!(recorder.deadline(), None);
    let start = Stamp(5);
    recorder.step(
        start,
        Event::Sample(Sample::State(Box::new(a_state(0, 1)))),
        &mut outbox,
    );
    let due = recorder.deadline().unwrap();
    assert_eq!(due.since(start), 1_000_000_000);
    outbox.drain().for_each(drop);
    recorder.step(due, Event::Wake, &mut outbox);
    assert_eq!(words(&outbox.drain().collect::<Vec<_>>()), ["0 counts 1"]);
    assert_eq!(recorder.deadline(), None);
}

#[test]
fn a_node_that_vanishes_is_a_warning() {
    let mut recorder = Recorder::new(Timing::default());
    let mut outbox = Outbox::default();
    let peer = NodeName::Predictor;
    recorder.step(Stamp(0), Event::Presence { peer, alive: false }, &mut outbox);
    let Some(Output::Write(heard)) = outbox.drain().nth(1) else {
        panic!("a note is shown and written");
    };
    assert!(
        matches!(&heard.entry, Entry::Note(note) if note.level == Level::Warning && note.about == peer && note.is_routine)
    );
}

#[test]
fn a_second_robot_session_starts_new_numbers() {
    let mut recorder = Recorder::new(Timing::default());
    let mut outbox = Outbox::default();
    for session in [1, 2] {
        let mut state = a_state(0, 1);
        state.header.session = Session(session);
        let mut bytes = Vec::new();
        encode(&state, &mut bytes);
        let topic = Topic::State;
        recorder.step(
            Stamp(0),
            Recorder::event(Input::Sample { topic, bytes: &bytes }),
            &mut outbox,
        );
    }
    let shown = outbox
        .drain()
        .filter(|output| matches!(output, Output::Show(heard) if matches!(heard.entry, Entry::Sample(_))));
    assert_eq!(shown.count(), 2);
}

#[test]
fn what_is_wrong_with_the_session_file_is_told_again_and_again_and_once_that_it_is_over() {
    let mut recorder = Recorder::new(Timing::default()).in_session(Session(5));
    let mut outbox = Outbox::default();
    let mut look = |condition, dropped| {
        let found = codec::to_bytes(&Storage { condition, dropped });
        let input = Input::Sample {
            topic: Topic::Device,
            bytes: &found,
        };
        recorder.step(Stamp(1), Recorder::event(input), &mut outbox);
        let mut bytes = Vec::new();
        let said = outbox.drain().map(|output| {
            assert_eq!(Recorder::sample(&output, &mut bytes), Some(Topic::Storage));
            decode::<Storage>(&bytes).unwrap()
        });
        said.collect::<Vec<_>>()
    };
    assert_eq!(look(Condition::Kept, 0), [], "all is well");
    assert_eq!(look(Condition::Behind, 3)[0].body.dropped, 3);
    let full = look(Condition::NoSpace, 9);
    assert_eq!(full[0].header.session, Session(5));
    assert_eq!(look(Condition::NoSpace, 9).len(), 1, "for whoever came late");
    assert_eq!(look(Condition::Kept, 9).len(), 1);
    assert_eq!(look(Condition::Kept, 9), []);
}
