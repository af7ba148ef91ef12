//! A node is killed and started again while five processes run; the recording still proves what each of them did.

mod process;

use std::net::TcpListener;
use std::process::Command;
use std::time::{Duration, Instant};

use process::Process;
use serde_json::Value;
use tandem_link::{Link, LinkSettings, Observer, Sighting};
use tandem_wire::{NodeName, Pace, Session, Topic, codec};

/// What is seen on the network, with an end to patience.
struct Watch {
    observer: Observer,
    limit: Instant,
}

impl Watch {
    fn until(&self, what: &str, mut found: impl FnMut(&Sighting) -> bool) {
        while Instant::now() < self.limit {
            if self
                .observer
                .next(Duration::from_secs(1))
                .is_some_and(|sighting| found(&sighting))
            {
                return;
            }
        }
        panic!("{what} does not come");
    }

    fn until_alive(&self, node: NodeName) {
        self.until(
            node.as_str(),
            |sighting| matches!(sighting, Sighting::Presence { peer, alive: true } if *peer == node),
        );
    }

    /// Waits for so many messages of a topic, of any run but `not`, and says whose run the last one was.
    fn until_said(&self, topic: Topic, count: usize, not: Option<Session>) -> Session {
        let (mut seen, mut session) = (0, Session(0));
        self.until(&topic.suffix(), |sighting| {
            if let Sighting::Sample {
                topic: heard, bytes, ..
            } = sighting
                && *heard == topic
                && let Ok((_, header)) = codec::peek(bytes)
                && Some(header.session) != not
            {
                seen += 1;
                session = header.session;
            }
            seen >= count
        });
        session
    }
}

#[test]
#[cfg(unix)]
fn a_killed_and_restarted_predictor_is_identical_up_to_its_last_entry() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = folder.path().join("killed.mcap");
    let port = TcpListener::bind("127.0.0.1:0")
        .and_then(|listener| listener.local_addr())
        .expect("a free port")
        .port();
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let connect = ["--robot", "killed", "--connect", endpoint.as_str()];

    // The recorder is there before anybody has something to say, so that every journal is whole.
    let path = session.to_str().expect("a plain path");
    let recorder = Process::start(&["recorder", "--record", path, "--robot", "killed", "--listen", &endpoint]);
    let link = Link::open(&LinkSettings {
        robot: "killed".into(),
        connect: vec![endpoint.clone()],
        ..LinkSettings::default()
    })
    .expect("the recorder answers");
    let watch = Watch {
        observer: Observer::new(&link, Pace::Real).expect("an observer"),
        limit: Instant::now() + Duration::from_secs(120),
    };
    watch.until_alive(NodeName::Recorder);
    let start = |command: &str| Process::start(&[&[command], &connect[..]].concat());
    let predictor = start("predictor");
    // One that comes when the human is past the checkpoint forecasts nothing.
    watch.until_alive(NodeName::Predictor);
    let others = ["robot-sim", "arbiter", "operator"].map(|name| (name, start(name)));

    watch.until_said(Topic::Forecast, 1, None);
    let first = watch.until_said(Topic::Proposal, 10, None);
    predictor.kill();
    let again = start("predictor");
    watch.until_said(Topic::Proposal, 50, Some(first));
    link.close();
    for (name, process) in [("predictor", again)]
        .into_iter()
        .chain(others)
        .chain([("recorder", recorder)])
    {
        assert_eq!(process.end(), Some(0), "{name} ends cleanly");
    }

    let verified = Command::new(env!("CARGO_BIN_EXE_tandem"))
        .args(["replay", "--verify", "--json", path])
        .output()
        .expect("tandem starts");
    let errors = String::from_utf8_lossy(&verified.stderr);
    let said: Value =
        serde_json::from_slice(&verified.stdout).unwrap_or_else(|error| panic!("no JSON ({error}): {errors}"));
    assert_eq!(verified.status.code(), Some(0), "{said}");
    let runs = said["nodes"].as_array().expect("runs");
    assert!(runs.iter().all(|run| run["verdict"] == "identical"), "{said}");
    let of = |node: &str| runs.iter().filter(|run| run["node"] == node).collect::<Vec<_>>();
    let (killed, stopped): (Vec<_>, Vec<_>) = of("predictor").into_iter().partition(|run| run["stopped"] == false);
    assert_eq!(
        (killed.len(), stopped.len()),
        (1, 1),
        "one was killed, one ended: {said}"
    );
    assert!(killed[0]["outputs"].as_u64() > Some(50), "{said}");
    for node in ["operator", "arbiter", "robot-sim"] {
        assert_eq!(of(node).len(), 1, "{node} ran once: {said}");
    }
}
