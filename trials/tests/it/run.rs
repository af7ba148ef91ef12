//! A run's folder: what a crash leaves, what is refused, and that no trial is driven twice.

use std::fs;
use std::path::Path;

use tandem_trials::plan::{Participant, Plan};
use tandem_trials::run::{JudgedBy, RunError, RunFolder, RunLog, TrialEntry, TrialOutcome};
use tempfile::TempDir;

const PLAN: &str = "[plan]\nparticipants = ['P1']\n[conditions.fixed]\n[contexts]\na = {}\nb = {}\n";

fn plan() -> Plan {
    Plan::parse("plan.toml", PLAN).expect("a plan")
}

fn participant() -> Participant {
    "P1".parse().expect("a code")
}

fn entry(number: u32, slot: u32, outcome: TrialOutcome) -> TrialEntry {
    TrialEntry {
        number,
        participant: participant(),
        slot,
        practice: false,
        condition: "fixed".into(),
        context: "a".into(),
        group: "interpolated".into(),
        source: "simulated".into(),
        repetition: 1,
        seed: 7,
        outcome,
        judged_by: JudgedBy::Rule,
        reason: None,
        note: "a \"note\"\nwith ümläuts".into(),
        session: "session-1.mcap".into(),
        began_s: 0.1 + 0.2,
        lasted_s: 8.4,
        trace: None,
    }
}

fn open(path: &Path) -> RunLog {
    RunLog::open(path, &plan(), "test").expect("it opens")
}

fn open_slots(log: &RunLog) -> Vec<(u32, u32)> {
    let open = log.open_slots(&participant(), &plan().slots(&participant()));
    open.into_iter().map(|(slot, aborted)| (slot.number, aborted)).collect()
}

#[test]
fn finished_trials_stay_finished_and_aborted_ones_are_offered_again() {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("run");
    let mut log = open(&path);
    assert_eq!(open_slots(&log), [(1, 0), (2, 0)]);
    log.append(entry(1, 1, TrialOutcome::Aborted)).expect("written");
    log.append(entry(2, 1, TrialOutcome::Failure)).expect("written");
    log.append(entry(3, 2, TrialOutcome::Aborted)).expect("written");
    drop(log);
    let log = open(&path);
    assert_eq!(open_slots(&log), [(2, 1)]);
    assert_eq!(log.next_number(), 4);
    assert_eq!(
        RunFolder::open(&path).expect("a run").entries()[1],
        entry(2, 1, TrialOutcome::Failure)
    );
}

#[test]
fn a_line_that_a_crash_cut_off_is_no_trial() {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("run");
    open(&path).append(entry(1, 1, TrialOutcome::Success)).expect("written");
    let log_path = path.join("trials.jsonl");
    let whole = fs::read(&log_path).expect("a log");
    for cut in 0..whole.len() {
        fs::write(&log_path, [&whole[..], &whole[..cut]].concat()).expect("written");
        assert_eq!(RunFolder::open(&path).expect("a run").entries().len(), 1);
        let mut log = open(&path);
        log.append(entry(2, 2, TrialOutcome::Success)).expect("written");
        assert_eq!(
            RunFolder::open(&path).expect("a run").entries().len(),
            2,
            "cut at {cut}"
        );
    }
}

#[test]
fn a_line_that_makes_no_sense_is_named() {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("run");
    open(&path).append(entry(1, 1, TrialOutcome::Success)).expect("written");
    let log = path.join("trials.jsonl");
    let text = fs::read_to_string(&log).expect("a log");
    fs::write(&log, format!("{text}{{}}\n")).expect("written");
    let refused = RunFolder::open(&path).expect_err("broken").to_string();
    assert!(refused.ends_with("trials.jsonl:2: not a trial"), "{refused}");
}

#[test]
fn another_plans_run_is_refused_and_left_alone() {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("run");
    drop(open(&path));
    let other = Plan::parse("other.toml", &PLAN.replace("b = {}", "c = {}")).expect("a plan");
    let refused = RunLog::open(&path, &other, "test").expect_err("another plan's");
    assert!(matches!(refused, RunError::OtherPlan { .. }), "{refused}");
    assert_eq!(
        RunFolder::open(&path).expect("a run").plan().expect("its plan").text(),
        PLAN
    );
}

#[test]
fn a_plan_that_was_changed_in_the_folder_is_noticed() {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("run");
    drop(open(&path));
    fs::write(path.join("plan.toml"), PLAN.replace("b = {}", "c = {}")).expect("written");
    let refused = RunFolder::open(&path).expect("a run").plan().expect_err("changed");
    assert!(matches!(refused, RunError::PlanChanged { .. }), "{refused}");
}

#[test]
fn a_folder_with_something_else_in_it_is_not_touched() {
    let folder = TempDir::new().expect("a folder");
    fs::write(folder.path().join("thesis.tex"), "mine").expect("written");
    let refused = RunLog::open(folder.path(), &plan(), "test").expect_err("occupied");
    assert!(matches!(refused, RunError::Occupied { .. }), "{refused}");
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1);
    assert!(matches!(RunFolder::open(folder.path()), Err(RunError::NotARun { .. })));
}

#[test]
fn a_begin_that_was_cut_off_is_begun_anew() {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("run");
    drop(open(&path));
    fs::remove_file(path.join("run.json")).expect("removed");
    assert_eq!(open_slots(&open(&path)).len(), 2);
}

#[test]
fn two_runs_do_not_write_into_one_folder() {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("run");
    let first = open(&path);
    assert!(matches!(
        RunLog::open(&path, &plan(), "test"),
        Err(RunError::Busy { .. })
    ));
    drop(first);
    drop(open(&path));
}

#[test]
fn a_trace_comes_back_and_a_log_leads_nobody_out_of_the_folder() {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("run");
    let mut log = open(&path);
    let trace = log.write_trace(1, &vec![0.1, 0.2]).expect("written");
    let good = TrialEntry {
        trace: Some(trace),
        ..entry(1, 1, TrialOutcome::Success)
    };
    log.append(good.clone()).expect("written");
    let run = RunFolder::open(&path).expect("a run");
    assert_eq!(run.trace::<Vec<f64>>(&good).expect("a trace"), [0.1, 0.2]);
    for outside in ["../secret", "/etc/passwd", "", "trials/../../x"] {
        let bad = TrialEntry {
            trace: Some(outside.into()),
            session: outside.into(),
            ..good.clone()
        };
        assert!(
            matches!(run.trace::<Vec<f64>>(&bad), Err(RunError::Elsewhere { .. })),
            "{outside}"
        );
        assert!(run.session(&bad).is_err());
    }
}
