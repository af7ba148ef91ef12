//! `tandem trial report` on folders that are whole, half-written, of another version, or none.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use tandem_trials::Trace;
use tandem_trials::plan::Plan;
use tandem_trials::run::{JudgedBy, RunLog, TrialEntry, TrialOutcome};

const PLAN: &str = include_str!("../../examples/plans/paper.toml");

fn report(run: &Path, flags: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tandem"));
    command.args(["trial", "report"]).arg(run).args(flags);
    command.output().expect("the program starts")
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout)
}

/// A run of four trials that saw nothing but their beginning.
fn make_run(folder: &Path) {
    let plan = Plan::parse("paper.toml", PLAN).expect("the shipped plan is one");
    let mut log = RunLog::open(folder, &plan, "a test").expect("the folder is empty");
    let participant = plan.participants()[0].clone();
    for slot in plan.slots(&participant).iter().take(4) {
        let number = log.next_number();
        let name = log.write_trace(number, &Trace::default()).expect("it can be written");
        let entry = TrialEntry {
            number,
            participant: participant.clone(),
            slot: slot.number,
            practice: false,
            condition: plan.conditions[slot.condition].name.clone(),
            context: plan.contexts[slot.context].name.clone(),
            group: "interpolated".into(),
            source: "simulated".into(),
            repetition: 1,
            seed: slot.seed,
            outcome: TrialOutcome::Failure,
            judged_by: JudgedBy::Rule,
            reason: None,
            note: String::new(),
            session: "session-1.mcap".into(),
            began_s: 0.0,
            lasted_s: 0.0,
            trace: Some(name),
        };
        log.append(entry).expect("it can be written");
    }
}

#[test]
fn a_whole_run_gives_a_page_tables_and_json() {
    let folder = tempfile::tempdir().expect("a folder");
    make_run(folder.path());
    let tables = folder.path().join("tables");
    let output = report(
        folder.path(),
        &["--json", "--csv", tables.to_str().expect("a plain name")],
    );
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let object: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(object["report"]["trials"].as_array().map(Vec::len), Some(4));
    let page = fs::read_to_string(folder.path().join("report.html")).expect("the page is there");
    assert!(page.ends_with("</html>\n") && page.contains("id=\"trial-4\""));
    for name in ["trials.csv", "steps.csv", "conditions.csv", "comparisons.csv"] {
        assert!(tables.join(name).is_file(), "{name}");
    }
}

#[test]
fn a_folder_that_is_no_run_is_bad_usage() {
    let folder = tempfile::tempdir().expect("a folder");
    for path in [folder.path().to_owned(), folder.path().join("nowhere")] {
        let output = report(&path, &[]);
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        assert!(said(&output).contains("no run's folder"), "{}", said(&output));
    }
}

#[test]
fn a_run_of_another_version_is_refused_with_both_numbers() {
    let folder = tempfile::tempdir().expect("a folder");
    make_run(folder.path());
    let info = folder.path().join("run.json");
    let text = fs::read_to_string(&info).expect("it is there");
    let mut object: serde_json::Value = serde_json::from_str(&text).expect("it is JSON");
    object["format"] = 99.into();
    fs::write(&info, object.to_string()).expect("it can be written");
    let output = report(folder.path(), &[]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains("99"), "{}", said(&output));
}

#[test]
fn what_is_half_written_is_left_out_and_said() {
    let folder = tempfile::tempdir().expect("a folder");
    make_run(folder.path());
    let log = folder.path().join("trials.jsonl");
    let mut text = fs::read_to_string(&log).expect("it is there");
    text.push_str("{\"number\":5,\"partic");
    fs::write(&log, text).expect("it can be written");
    fs::remove_file(folder.path().join("trials/0001.json")).expect("it is there");
    let whole = fs::read(folder.path().join("trials/0002.json")).expect("it is there");
    fs::write(folder.path().join("trials/0002.json"), &whole[..whole.len() / 2]).expect("it can be written");
    let output = report(folder.path(), &[]);
    assert_eq!(output.status.code(), Some(3), "{}", said(&output));
    assert!(
        said(&output).contains("not read: trial 1") && said(&output).contains("not read: trial 2"),
        "{}",
        said(&output)
    );
    assert!(said(&output).contains("2 trials of 1 participant"), "{}", said(&output));
}

#[test]
fn an_unknown_reference_is_bad_usage_and_names_the_known_ones() {
    let folder = tempfile::tempdir().expect("a folder");
    make_run(folder.path());
    let output = report(folder.path(), &["--reference", "adaptif"]);
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(
        said(&output).contains("choose from fixed, adaptive"),
        "{}",
        said(&output)
    );
    assert!(report(folder.path(), &["--reference", "fixed"]).status.success());
}

/// Runs the program with its output going into a pipe that nobody reads.
fn unread(arguments: &[&str]) -> Output {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let mut command = Command::new(env!("CARGO_BIN_EXE_tandem"));
    command.args(arguments).stdout(writer);
    command.output().expect("the program starts")
}

#[test]
fn a_report_whose_reader_has_left_is_still_written_and_nothing_panics() {
    let folder = tempfile::tempdir().expect("a folder");
    make_run(folder.path());
    let run = folder.path().to_str().expect("its name is text");
    let output = unread(&["trial", "report", run]);
    assert_eq!((output.status.code(), said(&output).as_str()), (Some(0), ""));
    assert!(folder.path().join("report.html").exists());
}

#[test]
fn other_commands_do_not_panic_either_when_nobody_reads() {
    for arguments in [&["config", "show"][..], &["forecast", "0.1"], &["--help"]] {
        let output = unread(arguments);
        assert!(!said(&output).contains("panicked"), "{arguments:?}: {}", said(&output));
        assert_ne!(output.status.code(), Some(101), "{arguments:?}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_report_that_does_not_fit_on_the_disk_is_a_failure() {
    let folder = tempfile::tempdir().expect("a folder");
    make_run(folder.path());
    let full = fs::OpenOptions::new()
        .write(true)
        .open("/dev/full")
        .expect("a full device");
    let mut command = Command::new(env!("CARGO_BIN_EXE_tandem"));
    command.args(["trial", "report"]).arg(folder.path()).stdout(full);
    let output = command.output().expect("the program starts");
    assert_eq!(output.status.code(), Some(1));
    assert!(
        said(&output).contains("could not be written whole"),
        "{}",
        said(&output)
    );
}
