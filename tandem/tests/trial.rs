//! `tandem trial`: plans checked, run in lockstep over real Zenoh, interrupted, taken up again, refused.

mod process;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use serde_json::Value;

use process::Process;

const SMALL: &str = "[plan]\nname = 'small'\nparticipants = ['S1']\n[order]\nblocks = 'contexts'\n\
    [conditions]\nfixed = { arbiter.law = 'fixed' }\nadaptive = { arbiter.law = 'adaptive' }\n\
    [contexts]\na = { amplitude_m = 0.1 }\nb = { amplitude_m = 0.165, group = 'extrapolated' }\n";

fn examples(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples").join(path)
}

fn tandem(arguments: &[&str]) -> Output {
    let run = Command::new(env!("CARGO_BIN_EXE_tandem")).args(arguments).output();
    run.expect("tandem starts")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a temporary folder has a plain name")
}

fn plan_file(folder: &Path, name: &str, plan: &str) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, plan).expect("the folder takes a file");
    path
}

fn run(plan: &Path, out: &Path) -> Value {
    let output = tandem(&["trial", "run", text(plan), "--out", text(out), "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("the summary is one JSON object")
}

fn entries(out: &Path) -> Vec<Value> {
    let log = fs::read_to_string(out.join("trials.jsonl")).unwrap_or_default();
    log.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
}

fn refusal(arguments: &[&str]) -> String {
    let output = tandem(arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    said
}

#[test]
fn the_plans_that_ship_pass_their_check() {
    let inside = "10 interpolated, 4 extrapolated";
    for (plan, trials, contexts) in [
        ("plans/paper.toml", "28", inside),
        ("plans/beyond.toml", "140", inside),
        ("plans/lossy.toml", "48", "5 interpolated, 3 extrapolated"),
    ] {
        let output = tandem(&["trial", "check", text(&examples(plan))]);
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(said.contains(&format!("{trials} for each participant")), "{said}");
        assert!(said.contains(contexts) && said.contains("order of S1"), "{said}");
        let late = "late-fixed: command 100 ms late; state-to-operator 100 ms late";
        assert_eq!(said.contains(late), plan.contains("lossy"), "{said}");
    }
}

#[test]
fn a_plan_is_run_once_and_every_condition_meets_the_same_human() {
    let folder = tempfile::tempdir().expect("a folder");
    let plan = plan_file(folder.path(), "small.toml", SMALL);
    let out = folder.path().join("run");
    let summary = run(&plan, &out);
    assert_eq!(
        (&summary["finished"], &summary["open"]),
        (&4.into(), &0.into()),
        "{summary}"
    );
    assert_eq!(summary["messages_lost"], 0);
    let log = fs::read(out.join("trials.jsonl")).expect("a log");
    let first_ticks: Vec<u64> = entries(&out)
        .iter()
        .map(|entry| {
            assert_eq!(entry["outcome"], "success", "{entry}");
            let trace = fs::read(out.join(entry["trace"].as_str().expect("a trace"))).expect("it is there");
            let trace: Value = serde_json::from_slice(&trace).expect("JSON");
            assert_eq!(trace["trial"], entry["number"]);
            assert!(trace["ticks"].as_array().expect("ticks").len() >= 84);
            assert_eq!(trace["forecasts"].as_array().expect("forecasts").len(), 1);
            trace["began_at"].as_u64().expect("a tick")
        })
        .collect();
    assert!(
        first_ticks.is_sorted_by(|one, next| one + 84 < *next),
        "time goes on: {first_ticks:?}"
    );
    let wishes = first_commands(&out);
    assert_eq!(wishes[0], wishes[1], "the same human under both laws");
    assert_ne!(wishes[0], wishes[2], "another context is another wish");
    let again = run(&plan, &out);
    assert_eq!(again["finished"], 4);
    assert_eq!(
        fs::read(out.join("trials.jsonl")).expect("a log"),
        log,
        "nothing runs twice"
    );
    let verified = tandem(&["replay", "--verify", text(&out.join("session-1.mcap"))]);
    assert!(
        verified.status.success(),
        "{}",
        String::from_utf8_lossy(&verified.stdout)
    );
}

/// What the human of each trial commanded before the checkpoint, where no law shows.
fn first_commands(out: &Path) -> Vec<Vec<Value>> {
    let of = |entry: &Value| {
        let trace = fs::read(out.join(entry["trace"].as_str().expect("a trace"))).expect("it is there");
        let trace: Value = serde_json::from_slice(&trace).expect("JSON");
        let ticks = trace["ticks"].as_array().expect("ticks").iter();
        ticks.take(30).map(|tick| tick["decision"]["human"].clone()).collect()
    };
    entries(out).iter().map(of).collect()
}

#[test]
fn two_checkpoints_forecast_twice_and_the_session_can_be_executed_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let demonstrations: Vec<String> = ["08", "11", "14"]
        .iter()
        .map(|a| format!("{:?}", text(&examples(&format!("demonstrations/planar_a{a}.csv")))))
        .collect();
    let model = |step: u32| {
        format!(
            "[models.at-{step}]\ndemonstrations = [{}]\ncheckpoint_step = {step}\n",
            demonstrations.join(", ")
        )
    };
    let plan = format!(
        "[plan]\nparticipants = ['S1']\n[conditions]\ntwo = {{ models = ['at-55', 'at-41'] }}\n\
         [contexts]\na = {{ amplitude_m = 0.12 }}\n{}{}",
        model(41),
        model(55)
    );
    let plan = plan_file(folder.path(), "two.toml", &plan);
    let out = folder.path().join("run");
    assert_eq!(run(&plan, &out)["successes"], 1);
    let trace: Value = serde_json::from_slice(&fs::read(out.join("trials/0001.json")).expect("a trace")).expect("JSON");
    let steps: Vec<u64> = trace["forecasts"]
        .as_array()
        .expect("forecasts")
        .iter()
        .filter_map(|forecast| forecast["first_step"].as_u64())
        .collect();
    assert_eq!(steps, [41, 55]);
    let verified = tandem(&["replay", "--verify", text(&out.join("session-1.mcap"))]);
    assert!(
        verified.status.success(),
        "{}",
        String::from_utf8_lossy(&verified.stdout)
    );
}

#[test]
fn an_interrupted_run_keeps_what_is_finished_and_goes_on_with_the_rest() {
    let folder = tempfile::tempdir().expect("a folder");
    let many: String = (0..20).map(|n| format!("c{n} = {{ amplitude_m = 0.1 }}\n")).collect();
    let plan = plan_file(folder.path(), "many.toml", &format!("{SMALL}{many}"));
    let out = folder.path().join("run");
    let process = Process::start(&["trial", "run", text(&plan), "--out", text(&out)]);
    let limit = Instant::now() + Duration::from_secs(60);
    while entries(&out).len() < 3 {
        assert!(Instant::now() < limit, "three trials take less than a minute");
        std::thread::sleep(Duration::from_millis(20));
    }
    let code = process.end();
    let kept = entries(&out);
    assert!(kept.len() < 44, "it was interrupted in time");
    assert_eq!(code, Some(3), "not everything was driven");
    let summary = run(&plan, &out);
    assert_eq!(summary["finished"], 44, "{summary}");
    let all = entries(&out);
    assert_eq!(all[..kept.len()], kept[..]);
    let mut finished: BTreeMap<u64, u32> = BTreeMap::new();
    for entry in all.iter().filter(|entry| entry["outcome"] != "aborted") {
        *finished.entry(entry["slot"].as_u64().expect("a slot")).or_default() += 1;
    }
    assert_eq!(finished.len(), 44);
    assert!(finished.values().all(|times| *times == 1), "{finished:?}");
    assert!(
        out.join("session-2.mcap").is_file(),
        "taken up again, it is another part"
    );
}

#[test]
fn what_cannot_be_run_is_refused_before_anybody_drives() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let refused = |plan: &str, more: &[&str]| {
        let plan = plan_file(folder.path(), "plan.toml", plan);
        let said = refusal(&[&["trial", "run", text(&plan), "--out", text(&out)], more].concat());
        assert!(!out.exists(), "nothing was made: {said}");
        said
    };
    let model = "[models.m]\nfile = 'nowhere.cesn'\n[conditions.x]\nmodels = ['m']\n";
    for (said, wanted) in [
        (refused(&SMALL.replace("'fixed'", "'fxed'"), &[]), "did you mean fixed?"),
        (refused(&format!("{SMALL}{model}"), &[]), "nowhere.cesn"),
        (refused(SMALL, &["--participant", "../S1"]), "no participant's code"),
        (refused(SMALL, &["--participant", ""]), "no participant's code"),
        (refused(SMALL, &["--participant", "S2"]), "known: S1"),
        (
            refused(&SMALL.replace("0.1 }", "0.1, task.origin_m = [1.5, 0.0, 0.1] }"), &[]),
            "cannot follow context a",
        ),
    ] {
        assert!(said.contains(wanted), "{said}");
    }
}

#[test]
fn a_folder_of_another_plan_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let one = SMALL.replace("b = { amplitude_m = 0.165, group = 'extrapolated' }\n", "");
    let plan = plan_file(
        folder.path(),
        "plan.toml",
        &one.replace("adaptive = { arbiter.law = 'adaptive' }\n", ""),
    );
    assert_eq!(run(&plan, &out)["finished"], 1);
    let other = plan_file(folder.path(), "other.toml", SMALL);
    let said = refusal(&["trial", "run", text(&other), "--out", text(&out)]);
    assert!(said.contains("belongs to another plan"), "{said}");
}

/// Plays a trial's mark from `from` on, as the report's page says, in the run's folder.
fn marks_between(out: &Path, from: f64, until: f64) -> Option<u64> {
    let (from, until) = (format!("{from:.1}"), format!("{until:.1}"));
    let play = [
        "replay",
        "session-1.mcap",
        "--topics",
        "trial",
        "--from",
        &from,
        "--until",
        &until,
    ];
    let mut command = Command::new(env!("CARGO_BIN_EXE_tandem"));
    let output = command
        .args(play)
        .args(["--rrd", "seen.rrd", "--json"])
        .current_dir(out)
        .output();
    let output = output.expect("tandem starts");
    let played: Value = serde_json::from_slice(&output.stdout).ok()?;
    played["messages_played"].as_u64()
}

#[test]
fn a_run_is_reported_and_a_trials_line_opens_the_session_where_it_begins() {
    let folder = tempfile::tempdir().expect("a folder");
    let plan = plan_file(folder.path(), "small.toml", SMALL);
    let out = folder.path().join("run");
    run(&plan, &out);
    let output = tandem(&["trial", "report", text(&out)]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let page = fs::read_to_string(out.join("report.html")).expect("a page");
    assert!(page.contains("class=\"wish\""), "where the human wished to be is drawn");
    for entry in entries(&out).iter().skip(1) {
        let began = entry["began_s"].as_f64().expect("a time");
        let line = format!("tandem replay session-1.mcap --from {began:.1}<");
        assert!(page.contains(&line), "{line}");
        assert_eq!(marks_between(&out, began, began), Some(1), "its mark is there: {entry}");
        assert_eq!(marks_between(&out, began + 0.1, began + 5.0), None, "and not later");
    }
}
