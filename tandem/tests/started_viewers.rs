//! The viewer that a session starts by itself: a window of this machine, or a server for browsers.
//!
//! A script called `rerun`, first on the PATH, notes how it was called and becomes the program `rerun` as it ships
//! (TANDEM_RERUN names it, else the PATH), told to need no display. Where there is none, or where somebody listens at the
//! viewer's own address already, these tests say so and pass.

use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Where a viewer of this machine listens; one test at a time may.
static VIEWER: Mutex<&str> = Mutex::new("127.0.0.1:9876");
/// How long anything may take that happens at once on an idle machine.
const LIMIT: Duration = Duration::from_secs(30);
/// How often we look.
const LOOK: Duration = Duration::from_millis(50);

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

fn shipped() -> Option<PathBuf> {
    let named = std::env::var_os("TANDEM_RERUN").map(PathBuf::from);
    let paths = std::env::var_os("PATH").unwrap_or_default();
    let mut on_path = std::env::split_paths(&paths).map(|folder| folder.join("rerun"));
    named.or_else(|| on_path.find(|path| path.is_file()))
}

/// A folder with our `rerun` in it, which becomes the shipped one with `arguments`.
struct Viewer {
    folder: tempfile::TempDir,
    shipped: PathBuf,
}

impl Viewer {
    /// `None` where it cannot be tried.
    fn new(address: &str, arguments: &str) -> Option<Self> {
        let Some(shipped) = shipped() else {
            eprintln!("skipped: no program `rerun`; set TANDEM_RERUN to it (pip install rerun-sdk==0.36.3)");
            return None;
        };
        if TcpStream::connect(address).is_ok() {
            eprintln!("skipped: somebody listens on {address} already");
            return None;
        }
        let folder = tempfile::tempdir().expect("a folder");
        let here = folder.path().display();
        let program = shipped.display();
        let script =
            format!("#!/bin/sh\necho $$ > {here}/pid\necho \"$@\" > {here}/called\nexec {program} {arguments}\n")
                .replace("HERE", &here.to_string());
        let path = folder.path().join("rerun");
        std::fs::write(&path, script).expect("a script");
        let made = Command::new("chmod").arg("+x").arg(&path).status();
        assert!(made.expect("chmod runs").success());
        Some(Self { folder, shipped })
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A demo in lockstep, seen in the way that `view` says.
    fn demo(&self, view: &str) -> Output {
        let paths = std::env::var_os("PATH").unwrap_or_default();
        let paths = std::iter::once(self.folder.path().to_owned()).chain(std::env::split_paths(&paths));
        Command::new(env!("CARGO_BIN_EXE_tandem"))
            .args(["demo", "--pace", "max", "--view", view, "--record"])
            .arg(self.path("demo.mcap"))
            .env("PATH", std::env::join_paths(paths).expect("plain paths"))
            .stdin(Stdio::null())
            .output()
            .expect("tandem starts")
    }

    fn called(&self) -> String {
        std::fs::read_to_string(self.path("called")).unwrap_or_default()
    }

    /// What a Rerun recording holds, in rerun's own words.
    fn print(&self, file: &Path) -> String {
        let output = Command::new(&self.shipped)
            .args(["rrd", "print", "--continue-on-error", "true"])
            .arg(file)
            .output();
        String::from_utf8_lossy(&output.expect("rerun runs").stdout).into_owned()
    }
}

impl Drop for Viewer {
    /// It outlives the session on purpose: one still looks at what happened.
    fn drop(&mut self) {
        if let Ok(pid) = std::fs::read_to_string(self.path("pid")) {
            let _ = Command::new("kill").args(["-9", pid.trim()]).status();
        }
    }
}

#[test]
fn a_viewer_is_started_in_a_window_and_shown_the_session() {
    let address = VIEWER.lock().unwrap_or_else(PoisonError::into_inner);
    let arguments = "--bind 127.0.0.1 --port 9876 --save HERE/shown.rrd";
    let Some(viewer) = Viewer::new(&address, arguments) else {
        return;
    };
    let output = viewer.demo("spawn");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert!(
        viewer
            .called()
            .contains("--port 9876 --bind 127.0.0.1 --hide-welcome-screen"),
        "{}",
        viewer.called()
    );
    let shown = viewer.path("shown.rrd");
    assert!(eventually(|| viewer.print(&shown).contains("/world/path")), "{said}");
}

#[test]
fn a_server_is_started_and_gives_the_session_to_a_viewer_that_comes_later() {
    let address = VIEWER.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(viewer) = Viewer::new(&address, "\"$@\" --web-viewer-port 0") else {
        return;
    };
    let output = viewer.demo("serve");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert!(viewer.called().contains("--serve-web"), "{}", viewer.called());
    let fetched = viewer.path("fetched.rrd");
    let mut late = Command::new(&viewer.shipped)
        .arg(format!("rerun+http://{}/proxy", *address))
        // Or it would listen there itself.
        .args(["--port", "auto", "--save"])
        .arg(&fetched)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("rerun starts");
    let is_there = eventually(|| viewer.print(&fetched).contains("/world/path"));
    let _ = late.kill();
    let _ = late.wait();
    assert!(is_there, "{said}");
}
