//! A replay whose target is not there, or vanishes: a sentence and exit code 1, and never a wait without end.

#![expect(
    clippy::disallowed_methods,
    reason = "real programs are started, and waited for by the clock"
)]

use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use tandem_link::{Link, LinkSettings, Observer, Sighting};
use tandem_wire::Pace;

/// How long anything may take that happens at once on an idle machine.
const PATIENCE: Duration = Duration::from_secs(30);
/// How often we look.
const LOOK: Duration = Duration::from_millis(50);

/// Waits until `holds`, looking now and then; whether it ever did.
fn eventually(mut holds: impl FnMut() -> bool) -> bool {
    let limit = Instant::now() + PATIENCE;
    while Instant::now() < limit {
        if holds() {
            return true;
        }
        std::thread::sleep(LOOK);
    }
    false
}

/// One demo in lockstep for all tests of this file.
fn session() -> PathBuf {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a folder");
        let demo = Command::new(env!("CARGO_BIN_EXE_tandem"))
            .args(["demo", "--pace", "max", "--record"])
            .arg(folder.path().join("demo.mcap"))
            .output()
            .expect("tandem starts");
        assert!(demo.status.success(), "{}", String::from_utf8_lossy(&demo.stderr));
        folder
    });
    folder.path().join("demo.mcap")
}

/// A free port.
fn port() -> u16 {
    let socket = TcpListener::bind("127.0.0.1:0").expect("a port");
    socket.local_addr().expect("an address").port()
}

/// A replay that we started, and end if nothing else does.
struct Replay(Option<Child>);

impl Replay {
    fn start(arguments: &[&str]) -> Self {
        let child = Command::new(env!("CARGO_BIN_EXE_tandem"))
            .arg("replay")
            .arg(session())
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn();
        Self(Some(child.expect("tandem starts")))
    }

    /// Its exit code and what it said, once it has ended by itself.
    fn ended(mut self) -> (Option<i32>, String) {
        let mut child = self.0.take().expect("it is taken once");
        let has_ended = eventually(|| child.try_wait().expect("our own child").is_some());
        child.kill().ok();
        let Output { status, stderr, .. } = child.wait_with_output().expect("our own child");
        let said = String::from_utf8_lossy(&stderr).into_owned();
        assert!(has_ended, "it goes on without end: {said}");
        assert!(!said.contains("panicked"), "{said}");
        (status.code(), said)
    }
}

impl Drop for Replay {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            child.kill().ok();
            child.wait().ok();
        }
    }
}

#[test]
fn a_viewer_that_never_was_there_is_said_and_fails() {
    let view = format!("--view=rerun+http://127.0.0.1:{}/proxy", port());
    let (code, said) = Replay::start(&[&view, "--speed", "max"]).ended();
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("no viewer at rerun+http"), "{said}");
}

#[test]
fn a_network_that_vanishes_ends_the_replay_with_a_sentence() {
    let endpoint = format!("tcp/127.0.0.1:{}", port());
    let settings = LinkSettings {
        robot: "ghost".to_owned(),
        listen: vec![endpoint.clone()],
        ..LinkSettings::default()
    };
    let link = Link::open(&settings).expect("a link over loopback");
    let observer = Observer::new(&link, Pace::Real).expect("an observer");
    // It would go on for ever.
    let replay = Replay::start(&["--robot", "ghost", "--connect", &endpoint, "--loop"]);
    let is_heard = || matches!(observer.next(LOOK), Some(Sighting::Sample { .. }));
    assert!(eventually(is_heard), "the replay is heard");
    link.close();
    let (code, said) = replay.ended();
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("nobody is connected any more"), "{said}");
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

#[test]
fn a_viewer_is_shown_all_and_one_that_is_killed_ends_the_replay_with_a_sentence() {
    let Some(program) = rerun() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let (port, file) = (port(), folder.path().join("shown.rrd"));
    let view = format!("--view=rerun+http://127.0.0.1:{port}/proxy");
    let mut viewer = viewer(&program, &file, port);
    let (code, said) = Replay::start(&[&view, "--speed", "max"]).ended();
    assert_eq!(code, Some(0), "{said}");
    let length = || std::fs::metadata(&file).map_or(0, |file| file.len());
    let before = length();
    // It would go on for ever.
    let replay = Replay::start(&[&view, "--loop"]);
    assert!(eventually(|| length() > before), "the replay is shown");
    viewer.kill().expect("our own child");
    viewer.wait().expect("our own child");
    let (code, said) = replay.ended();
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("has gone; start it, and the replay again"), "{said}");
}
