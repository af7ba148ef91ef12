//! The README's second recipe: five processes on loopback, started in an awkward order, ended by the termination signal.

mod process;

use std::collections::BTreeMap;
use std::net::TcpListener;
use std::path::Path;

use process::Process;
use process::goal::wait_for_the_goal;
use tandem_link::{Link, LinkSettings};

/// Messages per channel of a session file, read with the bare MCAP reader.
fn channels(session: &Path) -> BTreeMap<String, usize> {
    let bytes = std::fs::read(session).expect("the session file");
    let mut counts = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).expect("an MCAP file") {
        *counts
            .entry(message.expect("a whole message").channel.topic.clone())
            .or_default() += 1;
    }
    counts
}

#[test]
#[cfg(unix)]
fn five_processes_drive_to_the_goal_whoever_starts_first() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = folder.path().join("five.mcap");
    let port = TcpListener::bind("127.0.0.1:0")
        .and_then(|listener| listener.local_addr())
        .expect("a free port")
        .port();
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let connect = ["--robot", "five", "--connect", endpoint.as_str()];

    // Those who dial come first and must wait; the robot's process listens.
    let operator = Process::start(&[&["operator", "--source", "simulated"], &connect[..]].concat());
    let recorder = Process::start(
        &[
            &["recorder", "--record", session.to_str().expect("a plain path")],
            &connect[..],
        ]
        .concat(),
    );
    let arbiter = Process::start(&[&["arbiter"], &connect[..]].concat());
    let robot_sim = Process::start(&["robot-sim", "--robot", "five", "--listen", &endpoint]);
    let predictor = Process::start(&[&["predictor"], &connect[..]].concat());
    let settings = LinkSettings {
        robot: "five".into(),
        connect: vec![endpoint.clone()],
        ..LinkSettings::default()
    };
    let link = Link::open(&settings).expect("the listening process answers");
    wait_for_the_goal(&link, "five");
    link.close();

    for (name, process) in [
        ("operator", operator),
        ("predictor", predictor),
        ("arbiter", arbiter),
        ("recorder", recorder),
        ("robot-sim", robot_sim),
    ] {
        assert_eq!(process.end(), Some(0), "{name} ends cleanly");
    }
    let counts = channels(&session);
    for channel in ["command", "proposal", "setpoint", "state"] {
        assert!(
            counts
                .get(&format!("tandem/five/{channel}"))
                .is_some_and(|count| *count > 50),
            "{channel} is recorded: {counts:?}"
        );
    }
    assert!(
        counts.keys().any(|topic| topic.contains("journal")),
        "journals are recorded: {counts:?}"
    );
}
