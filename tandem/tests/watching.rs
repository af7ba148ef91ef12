//! `tandem recorder` as a person starts it: where it records to, what it does not overwrite, and watching only.

#![cfg(unix)]

mod process;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use process::Process;
use tandem_link::net::free_port;
use tandem_link::{Link, LinkSettings, Observer, Sighting};
use tandem_wire::NodeName;

const LIMIT: Duration = Duration::from_secs(60);

/// A folder, and what is said in it.
struct Desk(tempfile::TempDir);

impl Desk {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn path(&self, name: &str) -> String {
        self.at(name).to_str().expect("a plain path").to_owned()
    }

    /// Exit code and standard error of a command that ends by itself.
    fn refused(&self, arguments: &[&str]) -> (Option<i32>, String) {
        let output = Command::new(env!("CARGO_BIN_EXE_tandem"))
            .args(arguments)
            .current_dir(self.0.path())
            .output()
            .expect("tandem starts");
        (
            output.status.code(),
            String::from_utf8_lossy(&output.stderr).into_owned(),
        )
    }

    /// Starts a command whose standard error goes into the file `said`.
    fn start(&self, arguments: &[&str]) -> Process {
        let said = std::fs::File::create(self.at("said")).expect("a file");
        let child = Command::new(env!("CARGO_BIN_EXE_tandem"))
            .args(arguments)
            .current_dir(self.0.path())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(said)
            .spawn();
        Process::of(child.expect("tandem starts"))
    }

    fn said(&self) -> String {
        std::fs::read_to_string(self.at("said")).unwrap_or_default()
    }

    /// Waits until `holds`, and fails with what was said if it never does.
    fn wait(&self, what: &str, mut holds: impl FnMut() -> bool) {
        let limit = Instant::now() + LIMIT;
        while !holds() {
            assert!(Instant::now() < limit, "{what}: {}", self.said());
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

fn endpoint() -> String {
    format!("tcp/127.0.0.1:{}", free_port().expect("a port"))
}

fn length(path: &Path) -> u64 {
    path.metadata().map_or(0, |found| found.len())
}

#[test]
fn the_configuration_says_where_to_record_and_nothing_recorded_is_overwritten() {
    let desk = Desk::new();
    let config = desk.path("recorder.toml");
    let text = format!(
        "[link]\nlisten = [{:?}]\n[recorder]\npath = \"hour.mcap\"\nrrd = \"hour.rrd\"\n",
        endpoint()
    );
    std::fs::write(&config, text).expect("written");
    let arguments = ["recorder", "--config", &config];
    let recorder = desk.start(&arguments);
    desk.wait("it records", || desk.said().contains("ready"));
    assert_eq!(recorder.end(), Some(0), "{}", desk.said());
    let before = std::fs::read(desk.at("hour.mcap")).expect("the configured session file");
    assert!(desk.at("hour.rrd").is_file());

    let (code, why) = desk.refused(&arguments);
    assert_eq!(code, Some(1), "{why}");
    assert!(why.contains("hour.mcap") && why.contains("--overwrite"), "{why}");
    assert_eq!(std::fs::read(desk.at("hour.mcap")).expect("still there"), before);

    let recorder = desk.start(&[&arguments[..], &["--record", "other.mcap"]].concat());
    desk.wait("a flag names another", || desk.said().contains("ready"));
    assert_eq!(recorder.end(), Some(0));
    assert!(desk.at("other.mcap").is_file() && desk.at("other.rrd").is_file());

    let recorder = desk.start(&[&arguments[..], &["--overwrite"]].concat());
    desk.wait("it is asked to", || desk.said().contains("ready"));
    assert_eq!(recorder.end(), Some(0));
}

#[test]
fn a_recorder_with_nowhere_to_record_says_what_to_give_and_one_that_never_began_leaves_nothing() {
    let desk = Desk::new();
    let (code, why) = desk.refused(&["recorder"]);
    assert_eq!(code, Some(2), "{why}");
    assert!(why.contains("--record session.mcap") && why.contains("--view"), "{why}");

    // Nobody listens there.
    let recorder = desk.start(&["recorder", "--connect", &endpoint(), "--record", "never.mcap"]);
    desk.wait("it dials", || desk.said().contains("connecting"));
    assert_eq!(recorder.end(), Some(0));
    assert!(!desk.at("never.mcap").exists() && !desk.at("never.rrd").exists());
}

/// Whether a recorder is seen on the robot's network, once the robot is.
fn sees_recorder(endpoint: &str, site: &str) -> bool {
    let link = Link::open(&LinkSettings {
        site: site.into(),
        connect: vec![endpoint.into()],
        ..LinkSettings::default()
    });
    let link = link.expect("the robot answers");
    let presence = Observer::of_presence(&link).expect("presence");
    let (mut robot, mut recorder) = (false, false);
    let limit = Instant::now() + LIMIT;
    while Instant::now() < limit {
        match presence.next(Duration::from_millis(500)) {
            Some(Sighting::Presence { peer, alive: true }) => {
                robot |= peer == NodeName::RobotSim;
                recorder |= peer == NodeName::Recorder;
            }
            None if robot => break,
            _ => {}
        }
    }
    link.close();
    assert!(robot, "the robot is there");
    recorder
}

#[test]
fn a_viewers_certificate_is_enough_to_watch_and_a_watcher_is_no_recorder() {
    let desk = Desk::new();
    for arguments in [
        ["keys", "new", "--site", "lab", "--out", "lab"],
        ["keys", "copy", "viewer", "--site=lab", "--out", "guest"],
    ] {
        let (code, why) = desk.refused(&arguments);
        assert_eq!(code, Some(0), "{why}");
    }
    let endpoint = endpoint();
    let robot = Process::start(&["robot-sim", "--site", &desk.path("lab"), "--listen", &endpoint]);
    let guest = desk.path("guest");
    let reach = ["--site", &guest, "--connect", &endpoint];
    let (code, why) = desk.refused(&[&["recorder", "--record", "no.mcap"], &reach[..]].concat());
    assert!(code != Some(0) && why.contains("no key of a recorder"), "{why}");
    assert!(!desk.at("no.mcap").exists());

    let watcher = desk.start(&[&["recorder", "--view", "save=seen.rrd"], &reach[..]].concat());
    // Some seconds of states: names and colours alone are smaller.
    desk.wait("states arrive", || length(&desk.at("seen.rrd")) > 400_000);
    assert!(!sees_recorder(&endpoint, &desk.path("lab")));
    assert_eq!(watcher.end(), Some(0), "{}", desk.said());
    let said = desk.said();
    assert!(said.contains("recorder: as ") && said.contains("viewer"), "{said}");
    let messages = said.split("ended after ").nth(1).and_then(|rest| {
        let number = rest.split(' ').next()?;
        number.parse::<u64>().ok()
    });
    assert!(messages > Some(50), "{said}");
    assert_eq!(robot.end(), Some(0));
}
