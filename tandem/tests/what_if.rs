//! A recorded demo met again by another law, through the binary.

mod process;

use std::path::Path;

use process::Process;
use process::recorded::{session, text};
use serde_json::Value;

fn what_if(flags: &[&str]) -> (Value, tempfile::TempDir) {
    let folder = tempfile::tempdir().expect("a folder");
    let pictures = folder.path().join("pictures");
    let common = ["what-if", text(&session()), "--json", "--out", text(&pictures)].map(str::to_owned);
    let arguments: Vec<&str> = common.iter().map(String::as_str).chain(flags.iter().copied()).collect();
    let output = Process::output(&arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    (serde_json::from_slice(&output.stdout).expect("one JSON object"), folder)
}

#[test]
fn with_nothing_changed_a_lockstep_session_comes_out_byte_for_byte() {
    let (answer, folder) = what_if(&[]);
    assert_eq!(answer["is_the_original"], true, "{answer}");
    let states_and_setpoints = answer["states_and_setpoints"].as_u64().expect("a number");
    assert!(states_and_setpoints > 150, "{answer}");
    let trial = &answer["trials"][0];
    assert_eq!(trial["off_recorded_path_max_m"], 0.0);
    assert_eq!(trial["parts_at_tick"], Value::Null);
    for figure in [
        "human_effort_mean_m_s",
        "min_clearance_m",
        "tracking_forecast_mean_m",
        "stops",
        "ticks",
        "weight_mean",
    ] {
        assert_eq!(trial["original"][figure], trial["alternative"][figure], "{figure}");
    }
    assert!(folder.path().join("pictures/what-if-adaptive.rrd").is_file());
}

#[test]
fn the_human_alone_takes_another_path_with_the_same_commands() {
    let (answer, folder) = what_if(&["--law", "human"]);
    assert_eq!(
        (&answer["law"], &answer["law_then"]),
        (&"human".into(), &"adaptive".into())
    );
    assert_eq!(answer["is_the_original"], false);
    let trial = &answer["trials"][0];
    // The checkpoint is crossed some 41 ticks after motion began; until then the human drives alone under any law.
    assert!(trial["parts_at_tick"].as_u64().is_some_and(|tick| tick > 30), "{trial}");
    assert_eq!(
        trial["original"]["weight_mean_before"],
        trial["alternative"]["weight_mean_before"]
    );
    assert_eq!(trial["alternative"]["weight_mean_after"], 1.0);
    assert!(
        trial["off_recorded_path_max_m"]
            .as_f64()
            .is_some_and(|apart| apart > 0.005),
        "{trial}"
    );
    let not_known = answer["not_known"].to_string();
    assert!(not_known.contains("would have reacted differently"), "{not_known}");
    assert!(not_known.contains("what these commands alone give"), "{not_known}");
    assert!(folder.path().join("pictures/what-if-human.rrd").is_file());
}

#[test]
fn a_constant_weight_is_the_weight_that_is_used() {
    let (answer, _folder) = what_if(&["--law", "constant=0.3"]);
    let after = answer["trials"][0]["alternative"]["weight_mean_after"].as_f64();
    assert!(after.is_some_and(|weight| (weight - 0.3).abs() < 1e-9), "{after:?}");
}

#[test]
fn another_model_and_the_attentive_law_meet_the_same_commands() {
    let folder = tempfile::tempdir().expect("a folder");
    let model = folder.path().join("small.cesn");
    let demonstrations = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/demonstrations");
    let demonstrations = ["planar_a08.csv", "planar_a11.csv", "planar_a14.csv"].map(|name| demonstrations.join(name));
    let mut train = vec!["train", "-o", text(&model), "--set", "units=60", "--seed", "3"];
    train.extend(demonstrations.iter().map(|path| text(path)));
    let trained = Process::output(&train);
    assert!(trained.status.success(), "{}", String::from_utf8_lossy(&trained.stderr));
    let (answer, pictures) = what_if(&["--model", text(&model), "--law", "attentive"]);
    assert_eq!(answer["law"], "attentive");
    assert_eq!(answer["is_the_original"], false);
    let trial = &answer["trials"][0];
    // Another model says nothing before the checkpoint either.
    assert!(trial["parts_at_tick"].as_u64().is_some_and(|tick| tick > 30), "{trial}");
    assert!(pictures.path().join("pictures/what-if-attentive-small.rrd").is_file());
}

#[test]
fn what_cannot_be_asked_is_refused_in_words() {
    for law in ["constant=2", "constant=", "fuzzy"] {
        let output = Process::output(&["what-if", text(&session()), "--law", law]);
        assert_eq!(output.status.code(), Some(2), "{law}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("constant=W"), "{law}");
    }
    let missing = Process::output(&["what-if", text(&session()), "--model", "nowhere.cesn"]);
    assert_ne!(missing.status.code(), Some(0));
    assert!(String::from_utf8_lossy(&missing.stderr).contains("nowhere.cesn"));
}
