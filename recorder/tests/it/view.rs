//! Which entities a session becomes.

use std::collections::BTreeMap;

use crate::script::{record, session};
use tandem_recorder::{Drawing, Drops, Entry, Heard, Level, Note, Output, Sample, View};
use tandem_wire::{Arrivals, NodeName, Stamp, Timing, Vec3};

fn drawn() -> Vec<Drawing> {
    drawn_with(|_| {})
}

/// With a change to everything that is shown.
fn drawn_with(change: impl Fn(&mut Heard)) -> Vec<Drawing> {
    let timing = Timing::default().lockstep();
    let mut view = View::new(timing);
    let mut drawings = View::opening();
    for output in record(&session(), timing) {
        if let Output::Show(heard) = output {
            let mut heard = Heard::clone(&heard);
            change(&mut heard);
            view.draw(&heard, Drops::default(), &mut drawings);
        }
    }
    drawings
}

#[test]
fn a_session_becomes_these_entities() {
    let mut times = BTreeMap::new();
    for drawing in drawn() {
        if drawing.moment.is_some() {
            *times.entry(drawing.path).or_insert(0) += 1;
        }
    }
    let lines: Vec<_> = times.iter().map(|(path, times)| format!("{path} {times}")).collect();
    assert_eq!(lines, GOLDEN);
}

#[test]
fn every_line_in_a_plot_has_a_name() {
    let drawings = drawn_with(|heard| {
        if let Entry::Sample(Sample::State(message)) = &mut heard.entry {
            message.body.arrivals = Some(Arrivals::default());
        }
    });
    let named: Vec<_> = drawings
        .iter()
        .filter(|d| d.moment.is_none())
        .map(|d| d.path.as_str())
        .collect();
    let plotted = drawings
        .iter()
        .filter(|d| d.moment.is_some() && d.path.starts_with("plots/"));
    for drawing in plotted {
        assert!(named.contains(&drawing.path.as_str()), "{}", drawing.path);
    }
}

#[test]
fn across_the_path_is_at_right_angles_to_the_way_to_the_goal() {
    let turned = drawn_with(|heard| {
        if let Entry::Sample(Sample::Scene(message)) = &mut heard.entry {
            message.body.start = Vec3::new(0.25, 0.0, 0.1);
            message.body.goal = Vec3::new(0.75, 0.0, 0.1);
        }
        if let Entry::Sample(Sample::State(message)) = &mut heard.entry {
            message.body.tool.position = Vec3::new(0.5, -0.25, 0.1);
        }
    });
    let across = turned
        .iter()
        .filter(|d| d.moment.is_some() && d.path == "plots/across/tool");
    let values: Vec<_> = across
        .map(|drawing| format!("{:?}", drawing.batches[0].array))
        .collect();
    assert!(
        values.len() > 40 && values.iter().all(|value| value.contains(" 0.25,")),
        "{values:?}"
    );
}

#[test]
fn a_warning_is_shown_between_trials_and_the_course_of_things_is_not() {
    let note = |is_routine, level| Heard {
        at: Stamp(0),
        session_time: Stamp(0),
        tick: 0,
        entry: Entry::Note(Note {
            level,
            about: NodeName::Operator,
            is_routine,
            text: "its wall clock is an hour behind the recorder's".into(),
        }),
    };
    let mut view = View::new(Timing::default());
    let mut lines = |heard: &Heard| {
        let mut drawings = Vec::new();
        view.draw(heard, Drops::default(), &mut drawings);
        drawings.iter().filter(|drawing| drawing.path == "log").count()
    };
    assert_eq!(lines(&note(false, Level::Warning)), 1);
    assert_eq!(lines(&note(true, Level::Warning)), 0);
    assert_eq!(lines(&note(true, Level::Error)), 1);
}

#[test]
fn a_state_costs_a_few_entities_however_long_the_path_is() {
    let drawings = drawn();
    let bytes = |drawing: &Drawing| -> usize {
        drawing
            .batches
            .iter()
            .map(|batch| batch.array.get_array_memory_size())
            .sum()
    };
    let path: Vec<_> = drawings
        .iter()
        .filter(|drawing| drawing.path.starts_with("world/path"))
        .collect();
    assert!(path.len() > 50);
    assert!(path.iter().all(|drawing| bytes(drawing) < 8192));
}

#[test]
fn what_a_trial_came_to_stays_to_be_seen_after_its_end() {
    let timing = Timing::default().lockstep();
    let mut view = View::new(timing);
    let mut drawings = Vec::new();
    let outputs = record(&session(), timing);
    let mut last_state = None;
    for output in outputs {
        let Output::Show(heard) = output else { continue };
        view.draw(&heard, Drops::default(), &mut drawings);
        if matches!(heard.entry, Entry::Sample(Sample::State(_))) {
            last_state = Some(heard);
        }
    }
    let mut after = (*last_state.unwrap()).clone();
    after.tick += 1;
    if let Entry::Sample(Sample::State(message)) = &mut after.entry {
        message.body.trial = 0;
    }
    drawings.clear();
    view.draw(&after, Drops::default(), &mut drawings);
    let cleared: Vec<_> = drawings.iter().filter(|drawing| is_cleared(drawing)).collect();
    assert!(cleared.is_empty(), "{cleared:?}");
    if let Entry::Sample(Sample::State(message)) = &mut after.entry {
        message.body.trial = 2;
    }
    view.draw(&after, Drops::default(), &mut drawings);
    assert!(drawings.iter().any(is_cleared), "a new trial begins with a clean sheet");
}

fn is_cleared(drawing: &Drawing) -> bool {
    let is_clear =
        |batch: &rerun::SerializedComponentBatch| batch.descriptor.component.as_str() == "Clear:is_recursive";
    drawing.batches.iter().any(is_clear)
}

/// Entity, and how often it is drawn.
const GOLDEN: &[&str] = &[
    "lanes/driver 5",
    "lanes/held 4",
    "lanes/trial 2",
    "log 6",
    "now 79",
    "plan/forecast 1",
    "plan/forecast/edges 1",
    "plan/forecast/interval 1",
    "plan/forecast/line 1",
    "plan/goal 1",
    "plan/obstacles 1",
    "plan/path 1",
    "plan/path/0 64",
    "plan/path/1 9",
    "plan/start 1",
    "plan/tool 84",
    "plan/wish/human 84",
    "plan/wish/result 84",
    "plan/wish/robot 84",
    "plan/wished 33",
    "plan/workspace 1",
    "plots/across/forecast 43",
    "plots/across/high 43",
    "plots/across/low 43",
    "plots/across/tool 43",
    "plots/clearance 84",
    "plots/driver/held 8",
    "plots/driver/human 39",
    "plots/driver/shared 37",
    "plots/effort/human 84",
    "plots/effort/robot 43",
    "plots/effort/tool 84",
    "plots/interval/x 43",
    "plots/interval/y 43",
    "plots/latency 75",
    "plots/lost/dropped_file 9",
    "plots/lost/dropped_view 9",
    "plots/lost/missed 9",
    "plots/lost/unreadable 9",
    "plots/ratio/high 43",
    "plots/ratio/now 43",
    "plots/weight/human 168",
    "world/arm 83",
    "world/driver 84",
    "world/forecast 1",
    "world/forecast/interval 1",
    "world/forecast/line 1",
    "world/goal 1",
    "world/nearest 83",
    "world/obstacles 1",
    "world/path 1",
    "world/path/0 64",
    "world/path/1 9",
    "world/start 1",
    "world/tool 84",
    "world/wish/human 84",
    "world/wish/result 84",
    "world/wish/robot 84",
    "world/wished 33",
    "world/workspace 1",
];
