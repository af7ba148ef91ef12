//! A robot's journal, written here entry by entry, whole and with everything that can be wrong with it.

use std::collections::BTreeMap;

use tandem_recorder::{Evidence, RecordedNode, Run};
use tandem_robot_sim::RobotSim;
use tandem_trials::{Blueprint, Configuration, Difference, Findings, Missing, Overall, Verdict, reexecute};
use tandem_wire::{
    Envelope, Happening, Input, JournalBatch, JournalEntry, MILLISECOND, Node, NodeName, Outbox, Ports, Session, Stamp,
    State, Topic, decode, encode, snapshot,
};

const RUN: Run = Run {
    node: NodeName::RobotSim,
    session: Session(7),
};

/// A robot that nobody commands, woken at each of its deadlines and then asked to end.
fn journal() -> Vec<JournalEntry> {
    let blueprint = Blueprint::new(Configuration::default(), RUN.session, None).expect("the defaults fit");
    let mut node = blueprint.robot_sim().expect("the defaults fit");
    let mut entries = Vec::new();
    let mut now = Stamp(0);
    for _ in 0..60 {
        feed(&mut node, now, Input::Wake, &mut entries);
        now = node.deadline().unwrap_or(now.after(MILLISECOND)).max(now);
    }
    feed(&mut node, now, Input::Stop, &mut entries);
    entries
}

fn feed(node: &mut RobotSim, at: Stamp, input: Input<'_>, entries: &mut Vec<JournalEntry>) {
    let mut write = |what| entries.push(JournalEntry { at, wall: at, what });
    write(Happening::from(input));
    let mut outbox = Outbox::default();
    node.step(at, RobotSim::event(input), &mut outbox);
    for output in outbox.drain() {
        let mut bytes = Vec::new();
        if let Some(topic) = RobotSim::sample(&output, &mut bytes) {
            write(Happening::Output { topic, bytes });
        }
    }
}

fn part(entries: &[JournalEntry], range: std::ops::Range<usize>) -> JournalBatch {
    JournalBatch {
        first: range.start as u64,
        lost: 0,
        entries: entries[range].to_vec(),
    }
}

fn found(parts: Vec<JournalBatch>) -> Findings {
    reexecute(&evidence(parts), |_, _| {})
}

fn evidence(parts: Vec<JournalBatch>) -> Evidence {
    let recorded = RecordedNode {
        config: Configuration::default().to_toml(),
        seed: 1,
        ..RecordedNode::default()
    };
    let mut evidence = Evidence::default();
    evidence.nodes.insert(RUN, recorded);
    evidence.journals = BTreeMap::from([(RUN, parts)]);
    evidence
}

fn verdict(parts: Vec<JournalBatch>) -> Verdict {
    found(parts).runs.remove(0).verdict
}

fn whole(entries: &[JournalEntry]) -> Vec<JournalBatch> {
    vec![part(entries, 0..entries.len())]
}

fn difference(entries: &[JournalEntry]) -> Difference {
    match verdict(whole(entries)) {
        Verdict::Diverged(divergence) => divergence.difference,
        other => panic!("{other:?}"),
    }
}

/// The last state in the journal.
fn last_state(entries: &[JournalEntry]) -> usize {
    let is_state = |entry: &JournalEntry| {
        matches!(
            entry.what,
            Happening::Output {
                topic: Topic::State,
                ..
            }
        )
    };
    entries.iter().rposition(is_state).expect("a state")
}

/// Changes a state that is in the journal.
fn edit(entry: &mut JournalEntry, change: impl FnOnce(&mut State)) {
    let Happening::Output { bytes, .. } = &mut entry.what else {
        panic!("{entry:?} is no output");
    };
    let mut message: Envelope<State> = decode(bytes).expect("a state");
    change(&mut message.body);
    encode(&message, bytes);
}

#[test]
fn a_whole_journal_is_identical_in_one_part_or_many_even_twice() {
    let entries = journal();
    let count = entries.len();
    let mut parts: Vec<_> = (0..count)
        .step_by(7)
        .map(|at| part(&entries, at..count.min(at + 10)))
        .collect();
    parts.insert(1, part(&entries, 0..7));
    for parts in [whole(&entries), parts] {
        let found = found(parts);
        assert_eq!(found.overall(), Overall::Identical);
        let run = &found.runs[0];
        assert_eq!((run.steps, run.stopped), (61, true));
        assert_eq!(run.outputs + run.steps, count as u64);
    }
}

#[test]
fn a_journal_cut_anywhere_is_identical_up_to_its_last_entry() {
    let entries = journal();
    let stop = entries
        .iter()
        .position(|entry| entry.what == Happening::Stop)
        .expect("a stop");
    for end in 1..=stop {
        let found = found(vec![part(&entries, 0..end)]);
        assert_eq!(found.runs[0].verdict, Verdict::Identical, "cut before entry {end}");
        assert!(!found.runs[0].stopped);
    }
    let answers = entries.len() - 1 - stop;
    assert!(answers > 0, "the robot answers the stop");
    let from = stop as u64 + 1;
    let cut = verdict(vec![part(&entries, 0..stop + 1)]);
    assert_eq!(cut, Verdict::Incomplete(Missing::End { from }));
}

#[test]
fn an_end_that_the_recorder_knew_of_and_does_not_have_is_missing() {
    let entries = journal();
    let count = entries.len();
    let end = part(&entries, count..count);
    let mut whole = whole(&entries);
    whole.push(end.clone());
    assert_eq!(verdict(whole), Verdict::Identical);
    let from = count as u64 - 5;
    let cut = vec![part(&entries, 0..count - 5), end.clone()];
    assert_eq!(verdict(cut), Verdict::Incomplete(Missing::End { from }));
    assert_eq!(verdict(vec![end]), Verdict::Incomplete(Missing::Journal));
}

#[test]
fn a_hole_is_named_with_what_the_node_lost_itself() {
    let entries = journal();
    let mut behind = part(&entries, 30..50);
    behind.lost = 4;
    let found = verdict(vec![part(&entries, 0..20), behind]);
    let (from, to, lost) = (20, 29, 4);
    assert_eq!(found, Verdict::Incomplete(Missing::Gap { from, to, lost }));
    let late = verdict(vec![part(&entries, 5..40)]);
    assert_eq!(late, Verdict::Incomplete(Missing::Beginning { first: 5 }));
}

#[test]
fn a_difference_before_a_hole_outweighs_the_hole() {
    let mut entries = journal();
    let at = entries.iter().position(|entry| {
        matches!(
            entry.what,
            Happening::Output {
                topic: Topic::State,
                ..
            }
        )
    });
    edit(&mut entries[at.expect("a state")], |state| state.trial = 9);
    assert!(matches!(
        verdict(vec![part(&entries, 0..20), part(&entries, 30..50)]),
        Verdict::Diverged(_)
    ));
}

#[test]
fn a_changed_number_is_close_or_diverged_by_how_much_it_changed() {
    let mut entries = journal();
    let at = last_state(&entries);
    edit(&mut entries[at], |state| state.tool.position.x += 1e-12);
    match verdict(whole(&entries)) {
        Verdict::Close { largest, field } => {
            assert_eq!(field, "state.tool.position.x");
            assert!((0.5e-12..2e-12).contains(&largest), "{largest:e}");
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(found(whole(&entries)).overall(), Overall::Close, "not identical");
    edit(&mut entries[at], |state| state.tool.position.x += 1e-3);
    let Verdict::Diverged(divergence) = verdict(whole(&entries)) else {
        panic!("a millimetre is a difference");
    };
    assert_eq!((divergence.entry, divergence.at), (at as u64, entries[at].at));
    let Difference::Fields(fields) = divergence.difference else {
        panic!("{:?}", divergence.difference);
    };
    assert_eq!(fields.len(), 1);
    assert_eq!(fields[0].path, "tool.position.x");
    assert_ne!(fields[0].recorded, fields[0].again);
}

#[test]
fn outputs_that_are_too_many_too_few_or_nonsense_are_told_apart() {
    let entries = journal();
    let at = last_state(&entries[..entries.len() - 2]);
    let mut more = entries.clone();
    more.insert(at, entries[at].clone());
    assert!(matches!(difference(&more), Difference::Fields(_) | Difference::Absent));
    let mut less = entries.clone();
    less.remove(at);
    assert_eq!(difference(&less), Difference::Additional);
    let mut nonsense = entries.clone();
    nonsense[at].what = Happening::Output {
        topic: Topic::State,
        bytes: vec![1, 2, 3],
    };
    assert_eq!(difference(&nonsense), Difference::Bytes);
    let mut moved = entries;
    moved[at].what = Happening::Output {
        topic: Topic::Command,
        bytes: vec![],
    };
    assert_eq!(difference(&moved), Difference::Topic(Topic::State));
}

#[test]
fn a_configuration_that_cannot_be_read_is_missing_and_said_so() {
    let mut evidence = Evidence::default();
    let config = "[robot-sim]\nfeet = 2\n".to_owned();
    evidence.nodes.insert(
        RUN,
        RecordedNode {
            config,
            ..RecordedNode::default()
        },
    );
    evidence.journals.insert(RUN, whole(&journal()));
    let found = reexecute(&evidence, |_, _| {});
    assert_eq!(found.overall(), Overall::Incomplete);
    assert!(found.runs[0].to_string().contains("feet"), "{}", found.runs[0]);
}

#[test]
fn messages_of_a_node_without_journal_and_configuration_are_not_passed_over() {
    let mut evidence = Evidence::default();
    evidence.heard.insert((Topic::Setpoint, Session(9)));
    let found = reexecute(&evidence, |_, _| {});
    assert_eq!(
        (found.runs[0].run.node, found.runs[0].run.session),
        (NodeName::Arbiter, Session(9))
    );
    assert_eq!(found.overall(), Overall::Incomplete);
    assert_eq!(
        reexecute(&Evidence::default(), |_, _| {}).overall(),
        Overall::Incomplete
    );
}

#[test]
fn another_run_of_a_node_that_was_heard_and_left_no_journal_is_not_passed_over() {
    let mut evidence = evidence(whole(&journal()));
    evidence.heard.insert((Topic::State, RUN.session));
    assert_eq!(reexecute(&evidence, |_, _| {}).overall(), Overall::Identical);
    evidence.heard.insert((Topic::State, Session(8)));
    let found = reexecute(&evidence, |_, _| {});
    assert_eq!(found.overall(), Overall::Incomplete);
    let verdicts: Vec<_> = found.runs.iter().map(|run| (run.run.session, &run.verdict)).collect();
    let missing = Verdict::Incomplete(Missing::Journal);
    assert_eq!(verdicts, [(RUN.session, &Verdict::Identical), (Session(8), &missing)]);
}

#[test]
fn a_stamp_at_the_end_of_time_neither_hangs_nor_panics() {
    let mut entries = journal();
    let stop = entries.iter().position(|entry| entry.what == Happening::Stop);
    entries.truncate(stop.expect("a stop"));
    let at = Stamp(u64::MAX);
    let what = Happening::Wake;
    entries.push(JournalEntry { at, wall: at, what });
    assert_eq!(verdict(whole(&entries)), Verdict::Identical);
}

/// The same journal with a snapshot in front of every tenth step.
fn with_snapshots() -> Vec<JournalEntry> {
    let blueprint = Blueprint::new(Configuration::default(), RUN.session, None).expect("the defaults fit");
    let mut node = blueprint.robot_sim().expect("the defaults fit");
    let mut entries = Vec::new();
    let mut now = Stamp(0);
    for step in 0..60 {
        if step % 10 == 0 {
            let mut bytes = Vec::new();
            snapshot(&mut node, &mut bytes);
            let what = Happening::Snapshot { bytes };
            entries.push(JournalEntry {
                at: now,
                wall: now,
                what,
            });
        }
        feed(&mut node, now, Input::Wake, &mut entries);
        now = node.deadline().unwrap_or(now.after(MILLISECOND)).max(now);
    }
    feed(&mut node, now, Input::Stop, &mut entries);
    entries
}

fn snapshots_in(entries: &[JournalEntry]) -> Vec<usize> {
    let is_snapshot = |at: &usize| matches!(entries[*at].what, Happening::Snapshot { .. });
    (0..entries.len()).filter(is_snapshot).collect()
}

#[test]
fn snapshots_on_the_way_are_compared() {
    let entries = with_snapshots();
    let run = found(whole(&entries)).runs.remove(0);
    assert_eq!((run.verdict, run.snapshots, run.steps), (Verdict::Identical, 6, 61));
    assert!(run.resumed.is_empty());
}

#[test]
fn a_recording_that_begins_late_is_executed_from_its_first_snapshot() {
    let entries = with_snapshots();
    let at = snapshots_in(&entries)[2];
    let run = found(vec![part(&entries, at - 3..entries.len())]).runs.remove(0);
    let first = at as u64 - 3;
    assert_eq!(run.verdict, Verdict::Incomplete(Missing::Beginning { first }));
    assert_eq!(run.resumed, [at as u64]);
    assert_eq!((run.steps, run.stopped), (41, true));
    let words = run.to_string();
    assert!(
        words.contains(&format!("the same from the snapshot at entry {at} on")),
        "{words}"
    );
}

#[test]
fn behind_a_hole_a_snapshot_lets_execution_go_on_and_the_hole_is_still_named() {
    let entries = with_snapshots();
    let at = snapshots_in(&entries)[3];
    let parts = |entries: &[JournalEntry]| vec![part(entries, 0..20), part(entries, at - 5..entries.len())];
    let run = found(parts(&entries)).runs.remove(0);
    let (from, to, lost) = (20, at as u64 - 6, 0);
    assert_eq!(run.verdict, Verdict::Incomplete(Missing::Gap { from, to, lost }));
    assert_eq!((run.resumed, run.stopped), (vec![at as u64], true));

    let mut changed = entries.clone();
    let last = last_state(&changed);
    edit(&mut changed[last], |state| state.trial = 9);
    assert!(matches!(verdict(parts(&changed)), Verdict::Diverged(_)));
}

#[test]
fn another_state_is_a_divergence_before_any_output_shows_it() {
    let mut entries = with_snapshots();
    let at = snapshots_in(&entries)[1];
    let Happening::Snapshot { bytes } = &mut entries[at].what else {
        panic!("a snapshot");
    };
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    match difference(&entries) {
        Difference::State { from, recorded, again } => assert_eq!((from, recorded, again), (last, last + 1, last + 1)),
        other => panic!("{other:?}"),
    }
    let words = found(whole(&entries)).runs[0].to_string();
    assert!(words.contains("the node's state differs"), "{words}");
}

#[test]
fn a_snapshot_that_cannot_be_read_is_passed_over_for_the_next() {
    let mut entries = with_snapshots();
    let at = snapshots_in(&entries);
    entries[at[2]].what = Happening::Snapshot { bytes: vec![1, 2, 3] };
    let run = found(vec![part(&entries, at[2]..entries.len())]).runs.remove(0);
    assert_eq!(run.resumed, [at[3] as u64]);
    assert!(matches!(run.verdict, Verdict::Incomplete(Missing::Beginning { .. })));
}
