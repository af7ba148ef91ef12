//! A recorded demo, described, repaired, exported and replayed through the binary.

mod process;

use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use process::Process;
use process::recorded::{session, text};
use serde_json::Value;
use tandem_link::{Link, LinkSettings, Observer, Sighting};
use tandem_recorder::Recording;
use tandem_wire::{Pace, Topic, codec};

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

fn recording(path: &Path) -> Recording {
    Recording::read(&std::fs::read(path).expect("the file is there")).expect("a session")
}

/// The tool's positions on the channel `state`, by any tick: what another reader of the file must agree with.
fn states(recording: &Recording) -> usize {
    recording
        .messages
        .iter()
        .filter(|message| message.topic == Topic::State)
        .count()
}

#[test]
fn info_says_what_the_session_was() {
    let info = json(&Process::output(&["session", "info", text(&session()), "--json"]));
    assert_eq!(info["robot"], "panda");
    assert_eq!(info["seed"], "5");
    assert_eq!(info["model_sha256"].as_str().map(str::len), Some(64));
    assert_eq!(info["trials"][0]["outcome"], "goal reached");
    assert_eq!(info["damage"], serde_json::json!([]));
    assert_eq!(info["dropped_before_file"], 0);
    assert!(info["duration_s"].as_f64().is_some_and(|seconds| seconds > 5.0));
    let state = info["channels"]
        .as_array()
        .and_then(|all| all.iter().find(|one| one["topic"] == "tandem/panda/state"));
    let rate = state
        .and_then(|state| state["rate_hz"].as_f64())
        .expect("states have a rate");
    assert!((rate - 10.0).abs() < 0.5, "{rate} per second of the session's time");
    let released = |list: &str| {
        let list = info[list].as_array().expect("a list");
        list.iter().any(|stop| stop["reason"] == "the deadman is released")
    };
    assert!(released("holds") && !released("stops"), "letting go is no stop: {info}");
    let people = Process::output(&["session", "info", text(&session())]);
    assert!(String::from_utf8_lossy(&people.stdout).contains("goal reached"));
}

#[test]
fn a_file_that_a_crash_cut_short_is_repaired_beside_the_original() {
    let folder = tempfile::tempdir().expect("a folder");
    let cut = folder.path().join("cut.mcap");
    let whole = std::fs::read(session()).expect("the file is there");
    // The last tenth holds index and closing; the model lies near the beginning.
    std::fs::write(&cut, &whole[..whole.len() * 9 / 10]).expect("a file");
    let info = json(&Process::output(&["session", "info", text(&cut), "--json"]));
    assert_ne!(info["damage"], serde_json::json!([]));
    let repair = Process::output(&["session", "repair", text(&cut)]);
    assert!(repair.status.success(), "{}", String::from_utf8_lossy(&repair.stderr));
    let repaired = folder.path().join("cut.repaired.mcap");
    assert_eq!(states(&recording(&repaired)), states(&recording(&cut)));
    assert!(states(&recording(&repaired)) > 0);
    let again = Process::output(&["session", "repair", text(&cut)]);
    assert_eq!(again.status.code(), Some(1), "nothing is overwritten");
}

#[test]
fn every_table_has_a_row_for_every_message() {
    let folder = tempfile::tempdir().expect("a folder");
    let export = Process::output(&["session", "export", text(&session()), "--csv", text(folder.path())]);
    assert!(export.status.success(), "{}", String::from_utf8_lossy(&export.stderr));
    let recording = recording(&session());
    for topic in [Topic::State, Topic::Setpoint, Topic::Command, Topic::Proposal] {
        let table = std::fs::read_to_string(folder.path().join(format!("{topic}.csv"))).expect("a table");
        let columns = table.lines().next().expect("names").split(',').count();
        let rows = recording
            .messages
            .iter()
            .filter(|message| message.topic == topic)
            .count();
        assert_eq!(table.lines().count(), rows + 1, "{topic}");
        assert!(table.lines().all(|line| line.split(',').count() == columns), "{topic}");
    }
    let state = std::fs::read_to_string(folder.path().join("state.csv")).expect("a table");
    let names: Vec<_> = state.lines().next().expect("names").split(',').collect();
    let column = |name: &str| names.iter().position(|other| *other == name).expect("the column");
    let second: Vec<_> = state.lines().nth(2).expect("tick 1").split(',').collect();
    assert_eq!((second[column("tick")], second[column("captured_s")]), ("1", "0.1"));
    let session_time = ["captured_session_s", "captured_session_uncertainty_s"].map(|name| second[column(name)]);
    assert_eq!(
        session_time,
        ["0.1", "0"],
        "in lockstep every stamp is the session's time"
    );
    assert_eq!((second[column("trial")], second[column("trial_label")]), ("1", "demo"));
    assert!(
        second[column("tool_x_m")]
            .parse::<f64>()
            .is_ok_and(|x| (0.2..0.8).contains(&x))
    );
}

#[test]
fn a_replay_into_a_file_loses_nothing_and_takes_no_time() {
    let folder = tempfile::tempdir().expect("a folder");
    let rrd = folder.path().join("again.rrd");
    let summary = json(&Process::output(&[
        "replay",
        text(&session()),
        "--rrd",
        text(&rrd),
        "--json",
    ]));
    assert_eq!(summary["messages_lost"], 0);
    assert_eq!(summary["messages_played"], recording(&session()).messages.len());
    let (original, replayed) = (session().with_extension("rrd"), rrd);
    let length = |path: &Path| std::fs::metadata(path).expect("a file").len();
    let (original, replayed) = (length(&original), length(&replayed));
    // The same drawings in other batches: how many share a batch depends on how fast they come.
    assert!(
        replayed > original * 3 / 4 && replayed < original * 5 / 4,
        "{original} and {replayed} bytes"
    );
}

/// An observer of the robot "ghost", and where it listens.
fn listen() -> (Observer, Link, String) {
    let port = TcpListener::bind("127.0.0.1:0")
        .and_then(|socket| socket.local_addr())
        .expect("a port")
        .port();
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let settings = LinkSettings {
        robot: "ghost".into(),
        listen: vec![endpoint.clone()],
        ..LinkSettings::default()
    };
    let link = Link::open(&settings).expect("a session");
    (
        Observer::new(&link, Pace::Lockstep).expect("an observer"),
        link,
        endpoint,
    )
}

#[test]
fn on_the_network_a_replay_shows_what_was_and_commands_nobody() {
    let (observer, link, endpoint) = listen();
    let flags = ["--robot", "ghost", "--connect", &endpoint, "--speed", "max", "--json"];
    let summary = json(&Process::output(
        &[&["replay", text(&session())], flags.as_slice()].concat(),
    ));
    let mut heard = Vec::new();
    while let Some(sighting) = observer.next(Duration::from_millis(500)) {
        if let Sighting::Sample { topic, bytes, .. } = sighting {
            heard.push((topic, bytes));
        }
    }
    let recording = recording(&session());
    let shown = [
        Topic::State,
        Topic::Proposal,
        Topic::Forecast,
        Topic::Scene,
        Topic::Trial,
    ];
    let messages = recording
        .messages
        .into_iter()
        .filter(|message| shown.contains(&message.topic));
    let told: Vec<_> = messages.map(|message| (message.topic, message.bytes)).collect();
    assert_eq!(summary["messages_played"], told.len());
    assert_eq!(heard, told, "in order, and byte for byte");
    link.close();
}

#[test]
fn a_topic_is_left_out_or_has_another_name_as_asked() {
    let (observer, link, endpoint) = listen();
    let flags = ["--robot", "ghost", "--connect", &endpoint, "--speed", "max", "--json"];
    let names = ["--topics", "state,scene", "--rename", "state=pose"];
    let path = session();
    let arguments = [["replay", text(&path)].as_slice(), &flags, &names].concat();
    let summary = json(&Process::output(&arguments));
    let mut heard = Vec::new();
    while let Some(sighting) = observer.next(Duration::from_millis(500)) {
        if let Sighting::Sample { topic, .. } = sighting {
            heard.push(topic);
        }
    }
    assert!(heard.contains(&Topic::Scene));
    assert!(heard.iter().all(|topic| *topic == Topic::Scene), "{heard:?}");
    let played = states(&recording(&path)) + heard.len();
    assert_eq!(
        summary["messages_played"], played,
        "states went out, under a name that is no topic of ours"
    );
    link.close();
}

#[test]
fn a_second_pass_is_another_run_of_its_senders() {
    let (observer, link, endpoint) = listen();
    let path = session();
    let arguments = [
        "replay",
        text(&path),
        "--robot",
        "ghost",
        "--connect",
        &endpoint,
        "--topics",
        "scene,trial",
    ];
    let mut replay = Command::new(env!("CARGO_BIN_EXE_tandem"))
        .args(arguments)
        .args(["--speed", "100", "--loop"])
        .stdin(Stdio::null())
        .spawn()
        .expect("tandem starts");
    let mut sessions = Vec::new();
    while sessions.len() < 2
        && let Some(sighting) = observer.next(Duration::from_secs(20))
    {
        if let Sighting::Sample {
            topic: Topic::Scene,
            bytes,
            ..
        } = sighting
        {
            let session = codec::peek(&bytes).expect("a header").1.session;
            sessions.extend((!sessions.contains(&session)).then_some(session));
        }
    }
    replay.kill().expect("our own child");
    replay.wait().expect("our own child");
    link.close();
    assert_eq!(sessions.len(), 2, "the scene comes again, from another run");
}

#[test]
fn a_replay_refuses_what_it_must_not_do() {
    let path = session();
    let folder = tempfile::tempdir().expect("a folder");
    let rrd = folder.path().join("x.rrd");
    let rrd = text(&rrd);
    let replay = |flags: &[&str]| {
        let output = Process::output(&[&["replay", text(&path)], flags].concat());
        (
            output.status.code(),
            String::from_utf8_lossy(&output.stderr).into_owned(),
        )
    };
    let (code, said) = replay(&["--robot", "panda", "--listen", "tcp/127.0.0.1:0"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("own name"), "{said}");
    for rename in ["state=command", "state=a/b", "state=", "nonsense=x"] {
        let (code, said) = replay(&["--robot", "ghost", "--rename", rename]);
        assert_eq!(code, Some(2), "{rename}: {said}");
    }
    for speed in ["0", "-1", "1000", "NaN", "fast"] {
        assert_eq!(replay(&["--rrd", rrd, "--speed", speed]).0, Some(2), "{speed}");
    }
    assert_eq!(replay(&["--rrd", rrd, "--loop"]).0, Some(2));
    let (code, said) = replay(&["--rrd", rrd, "--from", "1000"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("nothing to play"), "{said}");
    assert!(!Path::new(rrd).exists(), "and nothing is begun");
}

#[test]
fn what_is_no_session_is_named_in_words() {
    let folder = tempfile::tempdir().expect("a folder");
    for (bytes, words) in [
        (&b""[..], "empty"),
        (b"hello", "no MCAP file"),
        (b"\x89MCAP0\r\n", "no session"),
    ] {
        let path = folder.path().join("x.mcap");
        std::fs::write(&path, bytes).expect("a file");
        for command in [["session", "info"].as_slice(), &["replay"]] {
            let output = Process::output(&[command, &[text(&path)]].concat());
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(1), "{said}");
            assert!(said.contains(words), "{said}");
        }
    }
}

/// The repaired file must open where people will open it; skipped where Python lacks the readers.
#[test]
fn another_reader_agrees_about_a_repaired_file() {
    let python = std::env::var("TANDEM_PYTHON").unwrap_or_else(|_| "python3".into());
    let readers = Command::new(&python)
        .args(["-c", "import mcap, mcap_protobuf.decoder"])
        .output();
    if !readers.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: {python} has no mcap and mcap-protobuf-support; set TANDEM_PYTHON to one that has");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let cut = folder.path().join("cut.mcap");
    let whole = std::fs::read(session()).expect("the file is there");
    std::fs::write(&cut, &whole[..whole.len() * 9 / 10]).expect("a file");
    assert!(Process::output(&["session", "repair", text(&cut)]).status.success());
    let repaired = folder.path().join("cut.repaired.mcap");
    let script = "import sys; from mcap.reader import make_reader; from mcap_protobuf.decoder import DecoderFactory\n\
        reader = make_reader(open(sys.argv[1], 'rb'), decoder_factories=[DecoderFactory()])\n\
        ticks = [m.header.tick for _, c, _, m in reader.iter_decoded_messages(topics=['tandem/panda/state'])]\n\
        assert ticks == sorted(ticks); print(len(ticks))";
    let output = Command::new(&python)
        .args(["-c", script, text(&repaired)])
        .output()
        .expect("python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let counted: usize = String::from_utf8_lossy(&output.stdout)
        .trim()
        .parse()
        .expect("a number");
    let recording = recording(&repaired);
    let received = recording
        .counts
        .streams
        .iter()
        .find(|count| count.topic == Topic::State)
        .expect("states");
    assert_eq!(counted as u64, received.received);
}

/// A demo whose session is cut into parts of two seconds.
fn parts() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let config = folder.path().join("tandem.toml");
    std::fs::write(&config, "[recorder]\nsplit_s = 2\n").expect("a file");
    let path = folder.path().join("demo.mcap");
    let flags = [
        "demo",
        "--pace",
        "max",
        "--seed",
        "5",
        "--record",
        text(&path),
        "--config",
        text(&config),
    ];
    let demo = Process::output(&flags);
    assert!(demo.status.success(), "{}", String::from_utf8_lossy(&demo.stderr));
    (folder, path)
}

#[test]
fn the_parts_of_a_session_are_played_verified_and_described_together() {
    let (folder, path) = parts();
    let count = std::fs::read_dir(folder.path()).expect("the folder").filter(|entry| {
        let name = entry.as_ref().expect("an entry").file_name();
        name.to_string_lossy().ends_with(".mcap")
    });
    let count = count.count();
    assert!(count >= 4, "{count} parts");
    let info = json(&Process::output(&["session", "info", text(&path), "--json"]));
    assert_eq!(info["damage"], serde_json::json!([]));
    assert_eq!(info["trials"][0]["outcome"], "goal reached");
    assert_eq!(info["gaps"], serde_json::json!([]));
    let verified = json(&Process::output(&["replay", "--verify", text(&path), "--json"]));
    assert_eq!(verified["verdict"], "identical");
    let rrd = folder.path().join("again.rrd");
    let played = json(&Process::output(&[
        "replay",
        text(&path),
        "--rrd",
        text(&rrd),
        "--json",
    ]));
    let streams = info["streams"].as_array().expect("streams").iter();
    let received: u64 = streams.filter_map(|stream| stream["received"].as_u64()).sum();
    assert_eq!(
        played["messages_played"], received,
        "every message once, whatever is repeated for those who read one part"
    );
    // Named one by one, and one alone.
    let second = folder.path().join("demo_0002.mcap");
    let two = json(&Process::output(&[
        "session",
        "info",
        text(&path),
        text(&second),
        "--json",
    ]));
    assert!(two["duration_s"].as_f64() < info["duration_s"].as_f64());
    let alone = json(&Process::output(&["session", "info", text(&second), "--json"]));
    // In lockstep a journal's batch is many ticks, and the last ones of a part stand in the next part's.
    let damage = alone["damage"].as_array().expect("damage");
    let is_tail = |damage: &Value| damage.as_str().is_some_and(|text| text.contains("stand in no journal"));
    assert!(damage.iter().all(is_tail), "it can be read alone: {damage:?}");
    assert_eq!(alone["trials"][0]["label"], "demo", "and knows its trial");
    assert_eq!(alone["model_sha256"], info["model_sha256"]);
}

#[test]
fn the_parts_of_a_session_are_repaired_together_and_what_is_none_is_left_out() {
    let (folder, path) = parts();
    let second = folder.path().join("demo_0002.mcap");
    let whole = std::fs::read(&second).expect("a part");
    std::fs::write(&second, &whole[..whole.len() - 64]).expect("a part without its end");
    let before = json(&Process::output(&["session", "info", text(&path), "--json"]));
    assert_ne!(before["damage"], serde_json::json!([]));
    let third = folder.path().join("demo_0003.mcap");
    let repair = Process::output(&["session", "repair", text(&path)]);
    assert!(repair.status.success(), "{}", String::from_utf8_lossy(&repair.stderr));
    let repaired = folder.path().join("demo.repaired.mcap");
    let after = json(&Process::output(&["session", "info", text(&repaired), "--json"]));
    assert_eq!(after["channels"], before["channels"], "all of what could be read");
    // And with a part that is nothing.
    std::fs::write(&third, b"").expect("a file");
    let to = folder.path().join("again.mcap");
    let repair = Process::output(&["session", "repair", text(&path), "--output", text(&to)]);
    assert_eq!(repair.status.code(), Some(1), "something was left out");
    let said = String::from_utf8_lossy(&repair.stderr);
    assert!(said.contains("demo_0003.mcap is left out"), "{said}");
    assert!(to.exists() && folder.path().join("again_0002.mcap").exists());
    assert!(!folder.path().join("again_0003.mcap").exists());
}

#[test]
fn a_noted_verdict_is_shown_until_the_file_changes() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("noted.mcap");
    std::fs::copy(session(), &path).expect("a copy");
    let verdict = || json(&Process::output(&["session", "info", text(&path), "--json"]))["verdict"].clone();
    assert_eq!(verdict(), Value::Null);
    assert_eq!(
        Process::output(&["replay", "--verify", "--note", text(&path)])
            .status
            .code(),
        Some(0)
    );
    assert_eq!(verdict(), "identical");
    let mut bytes = std::fs::read(&path).expect("the file is there");
    bytes.push(0);
    std::fs::write(&path, bytes).expect("a file");
    assert_eq!(verdict(), "outdated");
}

#[test]
fn there_is_one_row_for_every_tick() {
    let folder = tempfile::tempdir().expect("a folder");
    let export = Process::output(&["session", "export", text(&session()), "--csv", text(folder.path())]);
    assert!(export.status.success(), "{}", String::from_utf8_lossy(&export.stderr));
    let table = std::fs::read_to_string(folder.path().join("ticks.csv")).expect("a table");
    let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let names = lines.next().expect("names");
    let column = |name: &str| names.iter().position(|other| *other == name).expect("the column");
    let columns = [
        "tick",
        "state_captured_s",
        "setpoint_captured_s",
        "command_human_velocity_x_m_s",
    ]
    .map(column);
    let rows: Vec<_> = lines.collect();
    for (tick, row) in rows.iter().enumerate() {
        assert_eq!(row[columns[0]], tick.to_string());
    }
    assert_eq!(rows[40][columns[1]], "4");
    assert_eq!(rows[40][columns[2]], "4");
    assert!(rows[41][columns[3]].parse::<f64>().is_ok());
}

/// Tables as Parquet must read where people read them, and say the same as CSV; skipped where Python lacks the reader.
#[test]
fn another_reader_finds_the_same_numbers_in_parquet_and_csv() {
    let folder = tempfile::tempdir().expect("a folder");
    let flags = ["--csv", text(folder.path()), "--parquet", text(folder.path())];
    let export = Process::output(&[&["session", "export", text(&session())], flags.as_slice()].concat());
    assert!(export.status.success(), "{}", String::from_utf8_lossy(&export.stderr));
    let state = std::fs::read(folder.path().join("state.parquet")).expect("a table");
    assert!(state.starts_with(b"PAR1") && state.ends_with(b"PAR1"));
    let python = std::env::var("TANDEM_PYTHON").unwrap_or_else(|_| "python3".into());
    let reader = Command::new(&python).args(["-c", "import pyarrow.parquet"]).output();
    if !reader.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: {python} has no pyarrow; set TANDEM_PYTHON to one that has");
        return;
    }
    let script = include_str!("parquet_equals_csv.py");
    let output = Command::new(&python).args(["-c", script, text(folder.path())]).output();
    let output = output.expect("python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
