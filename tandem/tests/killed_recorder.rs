//! The recorder is killed while five processes run: at most a second is lost, and the file opens by itself.

mod process;

use std::net::TcpListener;
use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use process::Process;
use tandem_link::{Link, LinkSettings, Observer, Sighting};
use tandem_recorder::{Damage, Recording};
use tandem_wire::{NodeName, Pace, SECOND, Stamp, Topic, codec};

fn tandem(arguments: &[&str]) -> Output {
    let output = Command::new(env!("CARGO_BIN_EXE_tandem")).args(arguments).output();
    output.expect("tandem starts")
}

fn read(path: &Path) -> Recording {
    Recording::read(&std::fs::read(path).expect("the file is there")).expect("a session")
}

/// The newest state's stamp, by the robot's own clock.
fn newest(recording: &Recording) -> Stamp {
    let states = recording
        .messages
        .iter()
        .filter(|message| message.topic == Topic::State);
    states.map(|message| message.header.sent).max().expect("states")
}

/// Watches until so many states came with the recorder there, and gives the newest one's stamp.
fn watch_states(observer: &Observer, wanted: usize) -> Stamp {
    let limit = Instant::now() + Duration::from_secs(60);
    let (mut recorder, mut seen, mut newest) = (false, 0, Stamp(0));
    while seen < wanted {
        assert!(Instant::now() < limit, "recorder there: {recorder}, {seen} states");
        match observer.next(Duration::from_secs(1)) {
            Some(Sighting::Presence {
                peer: NodeName::Recorder,
                alive: true,
            }) => recorder = true,
            Some(Sighting::Sample {
                topic: Topic::State,
                bytes,
                ..
            }) if recorder => {
                newest = codec::peek(&bytes).expect("a header").1.sent;
                seen += 1;
            }
            _ => {}
        }
    }
    newest
}

#[test]
#[cfg(unix)]
fn a_killed_recorder_loses_at_most_a_second_and_its_file_opens() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = folder.path().join("cut.mcap");
    let path = session.to_str().expect("a plain path");
    let port = TcpListener::bind("127.0.0.1:0")
        .and_then(|listener| listener.local_addr())
        .expect("a free port")
        .port();
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let connect = ["--robot", "cut", "--connect", endpoint.as_str()];
    let start = |arguments: &[&str]| Process::start(&[arguments, &connect[..]].concat());
    let robot_sim = Process::start(&["robot-sim", "--robot", "cut", "--listen", &endpoint]);
    let recorder = start(&["recorder", "--record", path]);
    let others = [
        ["arbiter"].as_slice(),
        &["predictor"],
        &["operator", "--source", "simulated"],
    ]
    .map(start);
    let link = Link::open(&LinkSettings {
        robot: "cut".into(),
        connect: vec![endpoint.clone()],
        ..LinkSettings::default()
    })
    .expect("the robot's process answers");
    let observer = Observer::new(&link, Pace::Real).expect("an observer");
    let last = watch_states(&observer, 200);
    recorder.kill();
    link.close();
    for process in others.into_iter().chain([robot_sim]) {
        assert_eq!(process.end(), Some(0), "the loop does not need a recorder");
    }

    let cut = read(&session);
    let lost = last.since(newest(&cut));
    assert!(lost <= SECOND, "{lost} ns are missing");
    assert!(cut.damage.contains(&Damage::NotClosed), "{:?}", cut.damage);
    let rrd = folder.path().join("again.rrd");
    let rrd = rrd.to_str().expect("a plain path");
    assert!(
        tandem(&["replay", path, "--rrd", rrd]).status.success(),
        "it opens by itself"
    );

    assert!(tandem(&["session", "repair", path]).status.success());
    let repaired = folder.path().join("cut.repaired.mcap");
    assert_eq!(newest(&read(&repaired)), newest(&cut));
    let bytes = std::fs::read(&repaired).expect("the repaired file");
    let summary = mcap::Summary::read(&bytes).expect("an MCAP file").expect("an index");
    assert!(!summary.chunk_indexes.is_empty());
}
