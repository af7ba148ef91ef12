//! The README's first command, in lockstep: real Zenoh, real files.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// Runs the demo in lockstep and gives its summary.
fn demo(folder: &Path, name: &str, flags: &[&str]) -> Value {
    let session = folder.join(name);
    let output = Command::new(env!("CARGO_BIN_EXE_tandem"))
        .args(["demo", "--pace", "max", "--json", "--record"])
        .arg(&session)
        .args(flags)
        .output()
        .expect("the demo starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("the summary is one JSON object")
}

/// The summary without what may differ from run to run.
fn repeatable(mut summary: Value) -> Value {
    let object = summary.as_object_mut().expect("an object");
    for key in [
        "latency_p50_ms",
        "latency_p99_ms",
        "train_ms",
        "wall_s",
        "session_path",
        "rrd_path",
    ] {
        assert!(object.remove(key).is_some(), "the summary has {key}");
    }
    summary
}

#[test]
fn the_demo_reaches_the_goal_and_says_the_same_twice() {
    let folder = tempfile::tempdir().expect("a folder");
    let first = demo(folder.path(), "first.mcap", &["--seed", "7"]);
    assert_eq!(first["reached_goal"], true);
    assert_eq!(first["stops"], Value::Array(vec![]));
    assert_eq!(first["messages_lost"], 0);
    assert!(
        first["min_clearance_m"].as_f64().expect("a clearance") > 0.0,
        "the arm touched nothing: {first}"
    );
    assert!(first["human_effort_mean_m_s"].as_f64().expect("an effort") > 0.0);
    let (before, after) = (
        first["weight_mean_before"].as_f64(),
        first["weight_mean_after"].as_f64(),
    );
    assert_eq!(before, Some(1.0), "the human drives alone before the checkpoint");
    assert!(after.expect("a weight") < 1.0, "the robot takes a share after it");
    for path in ["session_path", "rrd_path"] {
        let length = std::fs::metadata(first[path].as_str().expect("a path"))
            .expect("the file is there")
            .len();
        assert!(length > 10_000, "{path} holds {length} bytes");
    }
    let second = demo(folder.path(), "second.mcap", &["--seed", "7"]);
    let other = demo(folder.path(), "other.mcap", &["--seed", "8"]);
    assert_ne!(
        repeatable(other),
        repeatable(first.clone()),
        "another seed is another human"
    );
    assert_eq!(repeatable(second), repeatable(first));
}

#[test]
fn every_law_drives_to_the_goal() {
    let folder = tempfile::tempdir().expect("a folder");
    let after = |law: &str| {
        let summary = demo(folder.path(), &format!("{law}.mcap"), &["--law", law]);
        assert_eq!(summary["reached_goal"], true, "{law}");
        assert_eq!(summary["law"], law);
        summary["weight_mean_after"].as_f64().expect("a weight")
    };
    assert_eq!((after("human"), after("fixed"), after("robot")), (1.0, 0.5, 0.0));
    assert!((after("constant=0.7") - 0.7).abs() < 1e-9);
}

#[test]
fn a_recording_that_cannot_be_written_is_refused_at_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = folder.path().join("taken.mcap");
    std::fs::create_dir(&session).expect("a folder in the way");
    let demo = Command::new(env!("CARGO_BIN_EXE_tandem"))
        .args(["demo", "--pace", "max", "--record"])
        .arg(&session)
        .output();
    let demo = demo.expect("the demo starts");
    let said = String::from_utf8_lossy(&demo.stderr);
    assert_eq!(demo.status.code(), Some(1), "{said}");
    assert!(said.contains("taken.mcap"), "{said}");
}
