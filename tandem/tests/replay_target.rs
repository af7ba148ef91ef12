//! A replay whose target is not there, vanishes, or is somebody else.

mod process;

use std::io::{BufRead as _, BufReader, Read as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use process::Process;
use process::recorded::session;
use tandem_link::net::free_port;
use tandem_link::{Link, LinkSettings, Observer, Sighting};
use tandem_wire::{NodeName, Pace};

/// How long anything may take that happens at once on an idle machine.
const LIMIT: Duration = Duration::from_secs(30);
/// How often we look.
const LOOK: Duration = Duration::from_millis(50);

fn replay(arguments: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_tandem"))
        .arg("replay")
        .arg(session())
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("tandem starts")
}

/// A replay under the name that all of these tests use.
fn ghost(endpoint: &str) -> Child {
    replay(&["--robot", "ghost", "--connect", endpoint])
}

/// Waits until `holds`, looking now and then; whether it ever did.
fn eventually(mut holds: impl FnMut() -> bool) -> bool {
    let limit = Instant::now() + LIMIT;
    while Instant::now() < limit {
        if holds() {
            return true;
        }
        std::thread::sleep(LOOK);
    }
    false
}

/// Its exit code and what it said, or `None` for the code if it does not end in time.
fn ended(mut child: Child) -> (Option<i32>, String) {
    let mut code = None;
    eventually(|| {
        let status = child.try_wait().expect("our own child");
        code = status.and_then(|status| status.code());
        status.is_some()
    });
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
    let child = ghost(&endpoint);
    assert!(observer.next(LIMIT).is_some(), "it plays");
    router.close();
    let (code, said) = ended(child);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("connected to has gone"), "{said}");
    assert!(!said.contains("panicked"), "{said}");
}

#[test]
fn nobody_at_the_other_end_does_not_hold_up_ctrl_c() {
    let mut child = ghost(&endpoint());
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
    let (code, said) = ended(ghost(&endpoint));
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("a robot-sim is alive as \"ghost\""), "{said}");
    watcher.close();
    robot.end();
}

#[test]
fn a_viewer_that_never_was_there_is_said_and_fails() {
    let view = format!("--view=rerun+http://127.0.0.1:{}/proxy", free_port().expect("a port"));
    let (code, said) = ended(replay(&[&view, "--speed", "max"]));
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("no viewer at rerun+http"), "{said}");
}

/// The program `rerun`, which keeps what it is sent in a file and needs no display.
fn rerun() -> Option<PathBuf> {
    let named = std::env::var_os("TANDEM_RERUN").map(PathBuf::from);
    let paths = std::env::var_os("PATH").unwrap_or_default();
    let mut on_path = std::env::split_paths(&paths).map(|folder| folder.join("rerun"));
    let found = named.or_else(|| on_path.find(|path| path.is_file()));
    if found.is_none() {
        eprintln!("skipped: no program `rerun`; set TANDEM_RERUN to it (pip install rerun-sdk==0.36.3)");
    }
    found
}

fn viewer(program: &Path, file: &Path, port: u16) -> Child {
    let viewer = Command::new(program)
        .args(["--bind", "127.0.0.1", "--port", &port.to_string(), "--save"])
        .arg(file)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    assert!(
        eventually(|| TcpStream::connect(("127.0.0.1", port)).is_ok()),
        "the viewer listens"
    );
    viewer.expect("rerun starts")
}

fn end(mut viewer: Child) {
    viewer.kill().expect("our own child");
    viewer.wait().expect("our own child");
}

#[test]
fn a_viewer_is_shown_all_and_one_that_is_killed_ends_the_replay_with_a_sentence() {
    let Some(program) = rerun() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let (port, file) = (free_port().expect("a port"), folder.path().join("shown.rrd"));
    let view = format!("--view=rerun+http://127.0.0.1:{port}/proxy");
    let viewer = viewer(&program, &file, port);
    let (code, said) = ended(replay(&[&view, "--speed", "max"]));
    assert_eq!(code, Some(0), "{said}");
    end(viewer);
    // Another one, with a file of its own: what it writes is of the replay that now comes, not the rest of the last.
    let file = folder.path().join("again.rrd");
    let viewer = self::viewer(&program, &file, port);
    let length = || std::fs::metadata(&file).map_or(0, |file| file.len());
    let before = length();
    // It would go on for ever.
    let child = replay(&[&view, "--loop"]);
    assert!(eventually(|| length() > before), "the replay is shown");
    end(viewer);
    let (code, said) = ended(child);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("has gone: start it, and replay again"), "{said}");
}

#[test]
fn a_name_is_spoken_for_by_one_replay_and_by_none_once_its_robot_comes_alive() {
    let endpoint = endpoint();
    let router = link(LinkSettings {
        listen: vec![endpoint.clone()],
        ..LinkSettings::default()
    });
    let observer = Observer::new(&router, Pace::Real).expect("an observer");
    // It would go on for ever.
    let first = replay(&["--robot", "ghost", "--connect", &endpoint, "--loop"]);
    assert!(observer.next(LIMIT).is_some(), "it plays");
    let (code, said) = ended(ghost(&endpoint));
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("another replay plays as \"ghost\""), "{said}");
    let robot = Process::start(&["robot-sim", "--robot", "ghost", "--connect", &endpoint]);
    let (code, said) = ended(first);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("a robot-sim has come alive as \"ghost\""), "{said}");
    robot.end();
    router.close();
}

#[test]
fn from_and_until_count_from_the_sessions_beginning_whatever_topics_are_played() {
    let folder = tempfile::tempdir().expect("a folder");
    let rrd = folder.path().join("x.rrd");
    let rrd = rrd.to_str().expect("a plain path");
    // The forecast is made at the checkpoint, more than four seconds into the demo.
    let forecast = ["--rrd", rrd, "--topics", "forecast"];
    let (code, said) = ended(replay(&[&forecast[..], &["--until", "2"]].concat()));
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("nothing to play"), "{said}");
    let (code, said) = ended(replay(&[&forecast[..], &["--from", "2"]].concat()));
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("1 messages played"), "{said}");
}

#[test]
fn what_would_not_be_published_is_refused_and_what_can_be_is_named() {
    let shown = "state, proposal, forecast, scene, trial";
    for (flags, wanted) in [
        (&["--rename", "command=x"][..], shown),
        (&["--topics", "setpoint"], shown),
        (&["--topics", "scene", "--rename", "state=x"], "--topics leaves it out"),
        (&["--paused"], "--paused needs a terminal"),
    ] {
        let (code, said) = ended(replay(&[&["--robot", "ghost"], flags].concat()));
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains(wanted), "{said}");
    }
    let (code, said) = ended(replay(&["--topics", "estop", "--rrd", "unwritten.rrd"]));
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("the session has no estop; it has command, "), "{said}");
}
