//! A replay whose target is not there, vanishes, or is somebody else.

mod process;

use std::io::{BufRead as _, BufReader, Read as _};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use process::Process;
use tandem_link::net::free_port;
use tandem_link::{Link, LinkSettings, Observer, Sighting};
use tandem_wire::{NodeName, Pace};

const LIMIT: Duration = Duration::from_secs(20);

/// One demo in lockstep, recorded once for all tests of this file.
fn session() -> PathBuf {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a folder");
        let demo = Command::new(env!("CARGO_BIN_EXE_tandem"))
            .args(["demo", "--pace", "max", "--seed", "5", "--record"])
            .arg(folder.path().join("demo.mcap"))
            .stdin(Stdio::null())
            .output()
            .expect("tandem starts");
        assert!(demo.status.success(), "{}", String::from_utf8_lossy(&demo.stderr));
        folder
    });
    folder.path().join("demo.mcap")
}

fn replay(endpoint: &str) -> Child {
    Command::new(env!("CARGO_BIN_EXE_tandem"))
        .arg("replay")
        .arg(session())
        .args(["--robot", "ghost", "--connect", endpoint])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("tandem starts")
}

/// Its exit code and what it said, or `None` for the code if it does not end in time.
fn ended(mut child: Child) -> (Option<i32>, String) {
    let limit = Instant::now() + LIMIT;
    let mut code = None;
    while code.is_none() && Instant::now() < limit {
        code = child
            .try_wait()
            .expect("our own child")
            .and_then(|status| status.code());
        std::thread::sleep(Duration::from_millis(20));
    }
    let _ = child.kill();
    let mut said = String::new();
    let stderr = child.stderr.as_mut().expect("it is piped");
    stderr.read_to_string(&mut said).expect("text");
    (code, said)
}

fn link(settings: LinkSettings) -> Link {
    Link::open(&LinkSettings {
        robot: "ghost".into(),
        ..settings
    })
    .expect("a session")
}

fn endpoint() -> String {
    format!("tcp/127.0.0.1:{}", free_port().expect("a port"))
}

#[test]
fn a_network_that_vanishes_ends_the_replay_in_words() {
    let endpoint = endpoint();
    let router = link(LinkSettings {
        listen: vec![endpoint.clone()],
        ..LinkSettings::default()
    });
    let observer = Observer::new(&router, Pace::Real).expect("an observer");
    let child = replay(&endpoint);
    assert!(observer.next(LIMIT).is_some(), "it plays");
    router.close();
    let (code, said) = ended(child);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("connected to has gone"), "{said}");
}

#[test]
fn nobody_at_the_other_end_does_not_hold_up_ctrl_c() {
    let mut child = replay(&endpoint());
    let mut line = String::new();
    let stderr = child.stderr.as_mut().expect("it is piped");
    BufReader::new(stderr).read_line(&mut line).expect("text");
    assert!(line.contains("connecting to"), "{line}");
    let asked = Command::new("kill")
        .args(["-s", "INT", &child.id().to_string()])
        .status()
        .expect("kill runs");
    assert!(asked.success());
    assert_eq!(ended(child).0, Some(1));
}

#[test]
fn a_robot_that_is_alive_is_not_spoken_for() {
    let endpoint = endpoint();
    let robot = Process::start(&["robot-sim", "--robot", "ghost", "--listen", &endpoint]);
    let watcher = link(LinkSettings {
        connect: vec![endpoint.clone()],
        ..LinkSettings::default()
    });
    let presence = Observer::of_presence(&watcher).expect("an observer");
    let alive = presence.next(LIMIT);
    let expected = NodeName::RobotSim;
    assert!(
        matches!(alive, Some(Sighting::Presence { peer, alive: true }) if peer == expected),
        "{alive:?}"
    );
    let (code, said) = ended(replay(&endpoint));
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("a robot-sim is alive as \"ghost\""), "{said}");
    watcher.close();
    robot.end();
}
