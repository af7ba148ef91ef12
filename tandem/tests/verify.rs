//! `tandem replay --verify` on real recordings, whole and tampered with.

use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use mcap::records::Metadata;
use mcap::{Message, MessageStream, Summary, Writer};
use serde_json::Value;
use tandem_wire::{Happening, JournalBatch, decode};

/// Records a demo into `folder` and gives the file.
fn demo(folder: &Path, flags: &[&str]) -> PathBuf {
    let session = folder.join("demo.mcap");
    let output = Command::new(env!("CARGO_BIN_EXE_tandem"))
        .args(["demo", "--json", "--record"])
        .arg(&session)
        .args(flags)
        .output()
        .expect("the demo starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    session
}

fn verify(session: &Path, flags: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tandem"));
    command.args(["replay", "--verify"]).arg(session).args(flags);
    command.output().expect("tandem starts")
}

/// The exit code and what JSON says.
fn verdict(session: &Path) -> (Option<i32>, Value) {
    let output = verify(session, &["--json"]);
    let said = serde_json::from_slice(&output.stdout);
    (
        output.status.code(),
        said.unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&output.stderr))),
    )
}

/// What is said of a node that has one run.
fn of<'a>(said: &'a Value, node: &str) -> &'a Value {
    let runs = said["nodes"].as_array().expect("nodes");
    runs.iter()
        .find(|run| run["node"] == node)
        .unwrap_or_else(|| panic!("{node} is judged: {said}"))
}

/// What becomes of a message or a metadata record in a copy.
#[derive(Default)]
struct Tampering<'a> {
    drop_message: Option<&'a dyn Fn(&Message<'_>) -> bool>,
    change_metadata: Option<&'a dyn Fn(&mut Metadata)>,
    without_models: bool,
}

/// Writes a copy of a session file with something changed.
fn tamper(session: &Path, with: &Tampering<'_>) -> PathBuf {
    let bytes = std::fs::read(session).expect("the session file");
    let summary = Summary::read(&bytes).expect("an MCAP file").expect("a summary");
    let mut writer = Writer::new(Cursor::new(Vec::new())).expect("memory takes it");
    for index in &summary.metadata_indexes {
        let mut record = mcap::read::metadata(&bytes, index).expect("a record");
        if let Some(change) = with.change_metadata {
            change(&mut record);
        }
        writer.write_metadata(&record).expect("memory takes it");
    }
    for index in summary.attachment_indexes.iter().filter(|_| !with.without_models) {
        let attachment = mcap::read::attachment(&bytes, index).expect("an attachment");
        writer.attach(&attachment).expect("memory takes it");
    }
    for message in MessageStream::new(&bytes).expect("an MCAP file") {
        let message = message.expect("a whole message");
        if !with.drop_message.is_some_and(|dropped| dropped(&message)) {
            writer.write(&message).expect("memory takes it");
        }
    }
    writer.finish().expect("memory takes it");
    let copy = session.with_file_name("tampered.mcap");
    std::fs::write(&copy, writer.into_inner().into_inner()).expect("the folder takes it");
    copy
}

/// The parts of a node's journal in the file, as (first entry, entry behind the last).
fn parts(session: &Path, node: &str) -> Vec<(u64, u64)> {
    let bytes = std::fs::read(session).expect("the session file");
    let messages = MessageStream::new(&bytes).expect("an MCAP file").map(Result::unwrap);
    messages
        .filter(|message| message.channel.topic.ends_with(&format!("/journal/{node}")))
        .map(|message| decode::<JournalBatch>(&message.data).expect("a part").body)
        .map(|part| (part.first, part.first + part.entries.len() as u64))
        .collect()
}

/// How many messages of a topic a node says that it saw.
fn inputs(session: &Path, node: &str, topic: &str) -> usize {
    let bytes = std::fs::read(session).expect("the session file");
    let messages = MessageStream::new(&bytes).expect("an MCAP file").map(Result::unwrap);
    messages
        .filter(|message| message.channel.topic.ends_with(&format!("/journal/{node}")))
        .flat_map(|message| decode::<JournalBatch>(&message.data).expect("a part").body.entries)
        .filter(|entry| matches!(&entry.what, Happening::Sample { topic: seen, .. } if seen.suffix() == topic))
        .count()
}

/// How many messages of a topic the recorder heard.
fn said(session: &Path, topic: &str) -> usize {
    let bytes = std::fs::read(session).expect("the session file");
    let messages = MessageStream::new(&bytes).expect("an MCAP file").map(Result::unwrap);
    messages
        .filter(|message| message.channel.topic.ends_with(&format!("/{topic}")))
        .count()
}

/// A copy that lacks the part of a node's journal that begins with the entry `first`.
fn without_part(session: &Path, node: &str, first: u64) -> PathBuf {
    let key = format!("/journal/{node}");
    let dropped = |message: &Message<'_>| {
        message.channel.topic.ends_with(&key)
            && decode::<JournalBatch>(&message.data).is_ok_and(|part| part.body.first == first)
    };
    tamper(
        session,
        &Tampering {
            drop_message: Some(&dropped),
            ..Tampering::default()
        },
    )
}

const NODES: [&str; 4] = ["operator", "predictor", "arbiter", "robot-sim"];

fn assert_identical(session: &Path) {
    let (code, said) = verdict(session);
    assert_eq!(said["verdict"], "identical", "{said}");
    assert_eq!(code, Some(0));
    for node in NODES {
        let run = of(&said, node);
        assert_eq!(run["verdict"], "identical", "{run}");
        assert!(run["outputs"].as_u64() > Some(80), "{run}");
    }
}

#[test]
fn a_demo_in_lockstep_comes_out_the_same() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = demo(folder.path(), &["--pace", "max", "--seed", "5"]);
    assert_identical(&session);
    // What tampering copies without changing anything is still the same session.
    assert_identical(&tamper(&session, &Tampering::default()));
}

#[test]
fn a_demo_over_a_bad_line_in_lockstep_comes_out_the_same() {
    let folder = tempfile::tempdir().expect("a folder");
    let bad = [
        "impairment.command.delay_ms=30",
        "impairment.command.loss=0.05",
        "impairment.setpoint.jitter_ms=40",
        "impairment.setpoint.loss=0.05",
        "impairment.state-to-operator.loss=0.05",
        "impairment.proposal.reorder=0.1",
    ];
    let set = bad.iter().flat_map(|one| ["--set", *one]);
    let flags: Vec<&str> = ["--pace", "max", "--seed", "5"].into_iter().chain(set).collect();
    assert_identical(&demo(folder.path(), &flags));
}

#[test]
fn a_demo_in_real_time_comes_out_the_same() {
    let folder = tempfile::tempdir().expect("a folder");
    assert_identical(&demo(folder.path(), &["--pace", "real"]));
}

#[test]
fn a_session_forecast_anew_on_every_tick_comes_out_the_same() {
    let folder = tempfile::tempdir().expect("a folder");
    let model = folder.path().join("anew.cesn");
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/demonstrations");
    let trained = Command::new(env!("CARGO_BIN_EXE_tandem"))
        .args(["train", "--replan", "--set", "units=200", "--output"])
        .arg(&model)
        .args(["planar_a08.csv", "planar_a11.csv", "planar_a14.csv"].map(|name| examples.join(name)))
        .output()
        .expect("tandem starts");
    assert!(trained.status.success(), "{}", String::from_utf8_lossy(&trained.stderr));
    let model = format!("predictor.model={}", model.display());
    for pace in ["max", "real"] {
        let session = demo(folder.path(), &["--pace", pace, "--set", &model]);
        assert_identical(&session);
        let (_, said) = verdict(&session);
        assert!(
            of(&said, "predictor")["outputs"].as_u64() > Some(84 + 35),
            "a forecast for every tick: {said}"
        );
    }
}

#[test]
fn a_demo_on_a_line_that_loses_messages_comes_out_the_same() {
    let folder = tempfile::tempdir().expect("a folder");
    let streams = "impairment.streams=[\"command\", \"setpoint\", \"state-to-operator\"]";
    let line = ["--set", streams, "--set", "impairment.loss=0.05"];
    let session = demo(folder.path(), &[&["--pace", "real"], &line[..]].concat());
    // That messages were lost shows in what a node saw, which is fewer than were sent.
    let seen = inputs(&session, "robot-sim", "setpoint");
    let sent = said(&session, "setpoint");
    assert!(0 < seen && seen + 5 < sent, "{seen} of {sent} came through");
    assert_identical(&session);
}

#[test]
fn a_constant_that_changed_is_caught_at_its_first_effect() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = demo(folder.path(), &["--pace", "max"]);
    let change = |record: &mut Metadata| {
        if record.name == "tandem.node.arbiter" {
            let config = record.metadata.get_mut("config").expect("a configuration");
            assert!(config.contains("\nweight_floor = 0.1\n"), "{config}");
            *config = config.replace("\nweight_floor = 0.1\n", "\nweight_floor = 0.101\n");
        }
    };
    let tampered = tamper(
        &session,
        &Tampering {
            change_metadata: Some(&change),
            ..Tampering::default()
        },
    );
    let (code, said) = verdict(&tampered);
    assert_eq!((code, &said["verdict"]), (Some(1), &Value::from("diverged")), "{said}");
    let divergence = &of(&said, "arbiter")["divergence"];
    assert_eq!(divergence["topic"], "setpoint");
    assert!(
        divergence["step"].as_u64() > Some(100),
        "the floor is reached after the checkpoint"
    );
    let fields = divergence["fields"].as_array().expect("fields");
    let weight = fields
        .iter()
        .find(|field| field["path"] == "weight")
        .expect("the weight");
    let number = |which: &str| {
        weight[which]
            .as_str()
            .expect("a number")
            .parse::<f64>()
            .expect("a number")
    };
    assert!(number("recorded") < number("now"), "{weight}");
    for node in ["operator", "predictor", "robot-sim"] {
        assert_eq!(
            of(&said, node)["verdict"],
            "identical",
            "{node} is fed from its own journal"
        );
    }
    let table = String::from_utf8(verify(&tampered, &[]).stdout).expect("text");
    assert!(table.contains("arbiter    diverged at step"), "{table}");
    let both = format!("weight: recorded {}, now {}", number("recorded"), number("now"));
    assert!(table.contains(&both), "{table}");
}

#[test]
fn a_journal_with_a_hole_is_incomplete_and_the_hole_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = demo(folder.path(), &["--pace", "max"]);
    let journal = parts(&session, "arbiter");
    assert!(journal.len() > 2, "{journal:?}");
    for (at, says) in [
        (
            1,
            format!(
                "entries {} to {} of its journal are missing",
                journal[1].0,
                journal[1].1 - 1
            ),
        ),
        (0, format!("begins with entry {}", journal[0].1)),
    ] {
        let (code, said) = verdict(&without_part(&session, "arbiter", journal[at].0));
        assert_eq!(
            (code, &said["verdict"]),
            (Some(3), &Value::from("incomplete")),
            "{said}"
        );
        let missing = of(&said, "arbiter")["missing"].as_str().expect("what is missing");
        assert!(missing.contains(&says), "{missing}");
        assert_eq!(of(&said, "operator")["verdict"], "identical");
    }
}

#[test]
fn what_it_takes_to_build_a_node_is_missed_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = demo(folder.path(), &["--pace", "max"]);
    let rename = |record: &mut Metadata| {
        if record.name == "tandem.node.robot-sim" {
            record.name = "elsewhere".into();
        }
    };
    let tampered = tamper(
        &session,
        &Tampering {
            change_metadata: Some(&rename),
            without_models: true,
            ..Tampering::default()
        },
    );
    let (code, said) = verdict(&tampered);
    assert_eq!(code, Some(3), "{said}");
    let missing = |node| of(&said, node)["missing"].as_str().unwrap_or("nothing").to_owned();
    assert!(missing("predictor").contains("its model"), "{said}");
    assert!(missing("robot-sim").contains("its configuration"), "{said}");
    assert_eq!(missing("arbiter"), "nothing");
}

#[test]
fn a_file_that_is_no_session_is_bad_usage() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("session.mcap");
    for bytes in [&b""[..], b"not a session at all, but long enough to look into"] {
        std::fs::write(&path, bytes).expect("the folder takes it");
        let output = verify(&path, &[]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(
            said.contains("session.mcap") && said.contains("not an MCAP file"),
            "{said}"
        );
    }
}
