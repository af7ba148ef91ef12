//! What a recorder could not keep: it goes on, tells the others, writes down what is missing and ends with exit code 3.

#![cfg(target_os = "linux")]

mod process;

use std::net::TcpListener;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use process::Process;
use tandem_link::{Link, LinkSettings, Observer, Sighting};
use tandem_wire::{
    Condition, Delivery, Happening, JournalBatch, JournalEntry, NodeName, Numbering, Pace, Session, Stamp, Storage,
    Topic, decode, encode,
};

const TOPIC: Topic = Topic::Journal(NodeName::Arbiter);
const TANDEM: &str = env!("CARGO_BIN_EXE_tandem");

/// A network with a recorder in it, and a sender of journals.
struct Scene {
    link: Link,
    observer: Observer,
    numbering: Numbering,
}

fn free_endpoint() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    format!("tcp/{}", listener.local_addr().expect("an address"))
}

impl Scene {
    /// Joins, and waits until the recorder is there.
    fn at(endpoint: &str) -> Self {
        let settings = LinkSettings {
            robot: "lossy".into(),
            connect: vec![endpoint.to_owned()],
            ..LinkSettings::default()
        };
        let link = Link::open(&settings).expect("the recorder's process answers");
        let observer = Observer::new(&link, Pace::Real).expect("an observer");
        let limit = Instant::now() + Duration::from_secs(60);
        let is_there = |sighting| {
            let peer = NodeName::Recorder;
            matches!(sighting, Some(Sighting::Presence { peer: who, alive: true }) if who == peer)
        };
        while !is_there(observer.next(Duration::from_secs(1))) {
            assert!(Instant::now() < limit, "no recorder");
        }
        Self {
            link,
            observer,
            numbering: Numbering::new(Session(7)),
        }
    }

    /// A part of a journal of some kilobytes that do not compress.
    fn send(&mut self, number: u64) {
        let mut noise = number.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        let mut noisy = || {
            noise ^= noise << 13;
            noise ^= noise >> 7;
            noise ^= noise << 17;
            noise.to_le_bytes()[3]
        };
        let what = Happening::Output {
            topic: Topic::Setpoint,
            bytes: (0..4096).map(|_| noisy()).collect(),
        };
        let (at, wall) = (Stamp(number), Stamp(number));
        let body = JournalBatch {
            first: number,
            lost: 0,
            entries: vec![JournalEntry { at, wall, what }],
        };
        let mut bytes = Vec::new();
        encode(&self.numbering.envelope(Stamp(number), 0, body), &mut bytes);
        // Lockstep's manners: a sender that waits loses nothing by itself.
        let sent = self
            .link
            .publish_as(&TOPIC.suffix(), Delivery::Bulk, Pace::Lockstep, bytes);
        sent.expect("the session is open");
    }

    /// Sends until the recorder's word about its file is such.
    fn send_until(&mut self, from: u64, burst: u64, told: impl Fn(&Storage) -> bool) -> u64 {
        let limit = Instant::now() + Duration::from_secs(60);
        let mut number = from;
        loop {
            assert!(Instant::now() < limit, "the recorder never said so");
            for _ in 0..burst {
                self.send(number);
                number += 1;
            }
            // Our own journals come back too; what matters is the last word that is there.
            let mut wait = Duration::from_millis(5);
            while let Some(sighting) = self.observer.next(wait) {
                wait = Duration::ZERO;
                if let Sighting::Sample { topic, bytes, .. } = sighting
                    && topic == Topic::Storage
                    && told(&decode::<Storage>(&bytes).expect("a storage message").body)
                {
                    return number;
                }
            }
        }
    }
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a plain path")
}

fn info(session: &Path) -> String {
    let output = Command::new(TANDEM).args(["session", "info", text(session)]).output();
    String::from_utf8(output.expect("tandem starts").stdout).expect("text")
}

#[test]
fn a_disk_that_is_full_for_a_while_costs_samples_and_says_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = folder.path().join("full.mcap");
    // The second part meets a device that has no room. The recorder takes it away and tries again later: then there is.
    let second = folder.path().join("full_0002.mcap");
    std::os::unix::fs::symlink("/dev/full", &second).expect("a link");
    let endpoint = free_endpoint();
    let recorder = [
        "recorder",
        "--robot",
        "lossy",
        "--listen",
        &endpoint,
        "--record",
        text(&session),
        "--set",
        "recorder.split_s=1",
    ];
    let recorder = Process::start(&recorder);
    let mut scene = Scene::at(&endpoint);
    let sent = scene.send_until(0, 1, |storage| storage.condition == Condition::NoSpace);
    scene.send_until(sent, 1, |storage| {
        storage.condition == Condition::Kept && storage.dropped > 0
    });
    scene.link.close();
    assert_eq!(
        recorder.end(),
        Some(3),
        "samples are missing, and the exit code says so"
    );
    let told = info(&session);
    assert!(told.contains("missing                  journal/arbiter"), "{told}");
    assert!(second.is_file() && !second.is_symlink(), "recording went on");
}

#[test]
fn a_recorder_on_a_file_system_without_room_ends_with_3() {
    let folder = tempfile::tempdir().expect("a folder");
    let mounted = |program: &[&str]| {
        let mount = "mount -t tmpfs -o size=2m tmpfs \"$1\" && shift && exec \"$@\"";
        let mut command = Command::new("unshare");
        command.args([
            "--mount",
            "--map-root-user",
            "sh",
            "-c",
            mount,
            "sh",
            text(folder.path()),
        ]);
        command.args(program).stdin(Stdio::null()).stdout(Stdio::null());
        command
    };
    if !mounted(&["true"]).status().is_ok_and(|status| status.success()) {
        eprintln!("skipped: a small file system cannot be mounted here");
        return;
    }
    let session = folder.path().join("full.mcap");
    let endpoint = free_endpoint();
    let recorder = [
        TANDEM,
        "recorder",
        "--robot",
        "lossy",
        "--listen",
        &endpoint,
        "--record",
        text(&session),
    ];
    let recorder = Process::of(mounted(&recorder).spawn().expect("unshare starts"));
    let mut scene = Scene::at(&endpoint);
    scene.send_until(0, 10, |storage| storage.condition == Condition::NoSpace);
    scene.link.close();
    assert_eq!(recorder.end(), Some(3));
}

#[test]
fn what_the_recorder_has_no_time_to_take_up_is_a_loss_like_any_other() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = folder.path().join("late.mcap");
    let endpoint = free_endpoint();
    let recorder = [
        "recorder",
        "--robot",
        "lossy",
        "--listen",
        &endpoint,
        "--record",
        text(&session),
        "--set",
        "recorder.input_queue=16",
    ];
    let recorder = Process::start(&recorder);
    let mut scene = Scene::at(&endpoint);
    scene.send_until(0, 2000, |storage| storage.dropped > 0);
    scene.link.close();
    assert_eq!(
        recorder.end(),
        Some(3),
        "samples are missing, and the exit code says so"
    );
    let told = info(&session);
    let of_channel = told
        .lines()
        .find(|line| line.contains("journal/arbiter") && !line.contains("missing"));
    let dropped = of_channel.and_then(|line| line.split_whitespace().last()?.parse::<u64>().ok());
    assert!(dropped.is_some_and(|dropped| dropped > 0), "{told}");
}
