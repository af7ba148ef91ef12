//! A live view over a real stream: viewers that come late, are killed and come back, or never read.
//!
//! The viewer is the program `rerun` as it ships (TANDEM_RERUN names it, else the PATH), told to keep what it is sent in
//! a file, which needs no display. Where it is not there, these tests say so and pass.

#![expect(
    clippy::disallowed_methods,
    reason = "a real program is started, and waited for by the clock"
)]

use std::io::Read as _;
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::script::{Sample, record, session};
use tandem_recorder::{Live, Notice, Output, Provenance, RecorderConfig, RecorderSettings, Sinks};
use tandem_wire::{Envelope, Header, SECOND, Seq, Session, Stamp, Timing, Topic, Trial, encode};

/// How long anything may take that happens at once on an idle machine.
const PATIENCE: Duration = Duration::from_secs(30);
/// How often we look.
const LOOK: Duration = Duration::from_millis(50);

fn program() -> Option<PathBuf> {
    let named = std::env::var_os("TANDEM_RERUN").map(PathBuf::from);
    let paths = std::env::var_os("PATH").unwrap_or_default();
    let mut on_path = std::env::split_paths(&paths).map(|folder| folder.join("rerun"));
    let found = named.or_else(|| on_path.find(|path| path.is_file()));
    if found.is_none() {
        eprintln!("skipped: no program `rerun`; set TANDEM_RERUN to it (pip install rerun-sdk==0.36.3)");
    }
    found
}

/// A port that was free a moment ago.
fn port() -> u16 {
    let socket = TcpListener::bind("127.0.0.1:0").expect("a port");
    socket.local_addr().expect("an address").port()
}

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

/// A viewer that keeps what it is sent in a file.
struct Viewer {
    program: PathBuf,
    child: Child,
    file: PathBuf,
}

impl Viewer {
    fn start(program: &Path, file: PathBuf, port: u16) -> Self {
        let child = Command::new(program)
            .args(["--bind", "127.0.0.1", "--port", &port.to_string(), "--save"])
            .arg(&file)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("rerun starts");
        let viewer = Self {
            program: program.to_owned(),
            child,
            file,
        };
        assert!(
            eventually(|| TcpStream::connect(("127.0.0.1", port)).is_ok()),
            "the viewer listens"
        );
        viewer
    }

    /// What it was sent, in rerun's own words: recordings and entities.
    fn shown(&self) -> String {
        let output = Command::new(&self.program)
            .args(["rrd", "print", "--continue-on-error", "true"])
            .arg(&self.file)
            .output();
        String::from_utf8_lossy(&output.expect("rerun runs").stdout).into_owned()
    }

    fn shows(&self, all: &[&str]) -> bool {
        let shown = self.shown();
        all.iter().all(|what| shown.contains(what))
    }

    fn kill(mut self) {
        self.child.kill().expect("our own child");
        self.child.wait().expect("our own child");
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn sinks(port: u16, session_file: &Path) -> Sinks {
    let settings = RecorderSettings {
        path: session_file.display().to_string(),
        live: Live::Connect,
        viewer: format!("rerun+http://127.0.0.1:{port}/proxy"),
        flush_ms: 20,
        view_history_mib: 1,
        ..RecorderSettings::default()
    };
    let provenance = Provenance {
        robot: "panda".parse().expect("a valid name"),
        build: "test".into(),
        epoch_unix_nanos: 7,
    };
    let config = RecorderConfig::new(&settings).expect("settings that fit together");
    Sinks::open(&config, Timing::default().lockstep(), &provenance).expect("the folder is there")
}

fn outputs(samples: &[Sample]) -> Vec<Output> {
    record(samples, Timing::default().lockstep())
}

/// What every picture of the scripted session has in it.
const SESSION: [&str; 5] = [
    "/world/obstacles",
    "/world/path/0",
    "/world/forecast/line",
    "/plots/weight/human",
    "\"panda-7-1-0\"",
];

#[test]
fn a_viewer_that_comes_late_is_shown_everything() {
    let Some(program) = program() else { return };
    let folder = tempfile::tempdir().unwrap();
    let port = port();
    let mut sinks = sinks(port, &folder.path().join("a.mcap"));
    outputs(&session()).into_iter().for_each(|output| sinks.handle(output));
    let viewer = Viewer::start(&program, folder.path().join("late.rrd"), port);
    assert!(eventually(|| viewer.shows(&SESSION)), "{}", viewer.shown());
    let closed = sinks.close(PATIENCE);
    assert_eq!(closed.drops.session_file.total(), 0);
    assert_eq!(closed.drops.views.total(), 0, "{closed:?}");
}

#[test]
fn a_viewer_that_was_killed_is_shown_the_session_again_when_it_is_back() {
    let Some(program) = program() else { return };
    let folder = tempfile::tempdir().unwrap();
    let port = port();
    let mut sinks = sinks(port, &folder.path().join("a.mcap"));
    let outputs = outputs(&session());
    let (before, after) = outputs.split_at(outputs.len() / 2);
    let viewer = Viewer::start(&program, folder.path().join("first.rrd"), port);
    before.iter().cloned().for_each(|output| sinks.handle(output));
    assert!(eventually(|| viewer.shows(&["/world/obstacles"])), "{}", viewer.shown());
    viewer.kill();
    // A connection is known to be lost when something was to be sent, so the session goes on meanwhile.
    let mut notices = Vec::new();
    let mut rest = after.iter().cloned();
    assert!(
        eventually(|| {
            rest.by_ref().take(5).for_each(|output| sinks.handle(output));
            notices.extend(sinks.notices());
            notices.iter().any(|notice| matches!(notice, Notice::ViewerGone { .. }))
        }),
        "{notices:?}"
    );
    let viewer = Viewer::start(&program, folder.path().join("second.rrd"), port);
    rest.for_each(|output| sinks.handle(output));
    assert!(eventually(|| viewer.shows(&SESSION)), "{}", viewer.shown());
    let closed = sinks.close(PATIENCE);
    assert_eq!(closed.drops.session_file.total(), 0, "{closed:?}");
}

#[test]
fn every_trial_is_a_recording_of_its_own() {
    let Some(program) = program() else { return };
    let folder = tempfile::tempdir().unwrap();
    let port = port();
    let mut samples = session();
    let last = samples.last().expect("a session").at;
    let mut bytes = Vec::new();
    let header = Header {
        tick: 95,
        session: Session(106),
        seq: Seq(90),
        sent: last,
    };
    let label = "once more".to_owned();
    let body = Trial::Begin { number: 2, label };
    encode(&Envelope { header, body }, &mut bytes);
    samples.push(Sample {
        at: Stamp(last.0 + SECOND),
        topic: Topic::Trial,
        bytes,
    });
    let viewer = Viewer::start(&program, folder.path().join("two.rrd"), port);
    let mut sinks = sinks(port, &folder.path().join("a.mcap"));
    outputs(&samples).into_iter().for_each(|output| sinks.handle(output));
    let recordings = ["\"panda-7-1-0\"", "\"panda-7-2-95\""];
    assert!(eventually(|| viewer.shows(&recordings)), "{}", viewer.shown());
    // The new recording shows the surroundings, though the scene came before it.
    assert!(
        eventually(|| viewer.shown().matches("/world/obstacles ").count() >= 2),
        "{}",
        viewer.shown()
    );
    assert_eq!(sinks.close(PATIENCE).drops.session_file.total(), 0);
}

/// Memory that this process holds, in MiB; `None` where the system does not say.
fn resident_mib() -> Option<u64> {
    let mut status = String::new();
    std::fs::File::open("/proc/self/status")
        .ok()?
        .read_to_string(&mut status)
        .ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    Some(line.trim().trim_end_matches(" kB").parse::<u64>().ok()? / 1024)
}

#[test]
fn a_viewer_that_accepts_and_never_reads_costs_no_message_and_little_memory() {
    let socket = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = socket.local_addr().unwrap().port();
    let (keep, kept) = crossbeam_channel::unbounded();
    std::thread::spawn(move || {
        for stream in socket.incoming() {
            // Held open, never read.
            keep.send(stream).ok();
        }
    });
    let folder = tempfile::tempdir().unwrap();
    let mut sinks = sinks(port, &folder.path().join("a.mcap"));
    let outputs = outputs(&session());
    let before = resident_mib();
    for _ in 0..40 {
        for output in outputs.iter().cloned() {
            while sinks.room() < 8 {
                std::thread::yield_now();
            }
            sinks.handle(output);
        }
    }
    let grown = resident_mib()
        .zip(before)
        .map(|(now, before)| now.saturating_sub(before));
    // History, queue, what is on its way inside the SDK; the rest is what an allocator keeps.
    assert!(grown.is_none_or(|grown| grown < 80), "{grown:?} MiB more");
    let closed = sinks.close(Duration::from_secs(5));
    assert_eq!(closed.drops.session_file.total(), 0, "{closed:?}");
    assert!(
        closed.sinks[0].messages.is_some(),
        "the session file ended in good order"
    );
    assert!(kept.try_recv().is_ok(), "somebody had connected");
}
