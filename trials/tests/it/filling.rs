//! Sessions over real Zenoh whose recorder misses something: late, or on a network that loses messages.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;

use crate::support::model;
use tandem_link::{
    Clock, ClockSettings, Device, Faults, Link, Observer, Report, Running, ShellOptions, Sighting, SpoolOptions, spawn,
};
use tandem_recorder::{Entry, Evidence, Output, Provenance, Recorder, RecorderConfig, RecorderSettings, Sinks};
use tandem_trials::{Blueprint, Configuration, Findings, Missing, Overall, Verdict, reexecute};
use tandem_wire::{NodeInfo, NodeName, Numbering, Pace, Ports, Session, Stamp, Storage, Topic, Trial, codec, encode};

const LIMIT: Duration = Duration::from_secs(10);
/// More than a second of states.
const SOME: u32 = 60;

/// How a session goes.
struct Course {
    /// States that go by before the recorder comes.
    late: u32,
    spool_bytes: u64,
    faults: Faults,
    /// Messages that the session file is said to have lost.
    dropped: u64,
}

/// What became of it.
struct Outcome {
    findings: Findings,
    reports: Vec<Report>,
    spool: PathBuf,
    _folder: tempfile::TempDir,
}

struct Stage {
    blueprint: Blueprint,
    course: Course,
    spool: PathBuf,
}

impl Stage {
    fn options<N: Ports>(&self) -> ShellOptions {
        let configuration = self.blueprint.configuration();
        let model = match N::NAME {
            NodeName::Predictor => self.blueprint.model_bytes(),
            _ => Vec::new(),
        };
        let recorder = N::NAME == NodeName::Recorder;
        ShellOptions {
            timing: self.blueprint.timing(),
            info: NodeInfo {
                session: self.blueprint.session(),
                config: configuration.to_toml(),
                seed: configuration.rates.seed,
                build: "test".into(),
                model,
            },
            await_peers: vec![],
            impairment: configuration.impairment.clone(),
            queue: ShellOptions::QUEUE,
            spool: SpoolOptions {
                folder: self.spool.clone(),
                limit_bytes: self.course.spool_bytes,
            },
            clocks: ClockSettings::default(),
            faults: if recorder {
                Faults::default()
            } else {
                self.course.faults
            },
        }
    }

    fn start<N>(&self, link: &Link, node: N) -> Running
    where
        N: Ports + Send + 'static,
        N::Output: Send,
    {
        spawn(link, node, self.options::<N>(), |_, _| {}).expect("a node starts")
    }

    fn record(&self, link: &Link, path: &Path) -> (Running, Arc<Mutex<Sinks>>) {
        let settings = RecorderSettings {
            path: path.display().to_string(),
            ..RecorderSettings::default()
        };
        let provenance = Provenance {
            robot: link.robot().clone(),
            build: "test".into(),
            epoch_unix_nanos: Clock::of_process().origin_unix_nanos(),
        };
        let timing = self.blueprint.timing();
        let config = RecorderConfig::new(&settings).expect("settings that go together");
        let sinks = Sinks::open(&config, timing, &provenance).expect("a session file");
        let sinks = Arc::new(Mutex::new(sinks));
        let (shared, dropped) = (Arc::clone(&sinks), self.course.dropped);
        let entrance = Arc::new(OnceLock::<Device>::new());
        let back = Arc::clone(&entrance);
        let local = move |_, output| {
            let is_look_due = matches!(&output, Output::Write(heard) if matches!(heard.entry, Entry::Counts(_)));
            let mut sinks = shared.lock().expect("nobody panicked");
            sinks.handle(output);
            let storage = sinks.storage();
            let word = codec::to_bytes(&Storage { dropped, ..storage });
            // A word that is lost is followed by the next.
            let _ = is_look_due && back.get().is_some_and(|device| device.send(word));
        };
        let options = self.options::<Recorder>();
        let recorder = spawn(link, Recorder::new(timing), options, local).expect("a recorder starts");
        entrance.set(recorder.device()).expect("set once");
        (recorder, sinks)
    }
}

fn await_states(observer: &Observer, count: u32) {
    let mut seen = 0;
    while seen < count {
        let sighting = observer.next(LIMIT).expect("states keep coming");
        seen += u32::from(matches!(
            sighting,
            Sighting::Sample {
                topic: Topic::State,
                ..
            }
        ));
    }
}

fn mark(link: &Link, marks: &mut Numbering, number: u32) {
    let label = "filling".to_owned();
    let mut bytes = Vec::new();
    encode(&marks.envelope(Stamp(0), 0, Trial::Begin { number, label }), &mut bytes);
    link.publish(Topic::Trial, bytes).expect("published");
}

fn run(name: &str, course: Course) -> Outcome {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, spool) = (folder.path().join("session.mcap"), folder.path().join("journals"));
    let session = Session(0xf111 + u64::from(course.late));
    let blueprint = Blueprint::new(Configuration::default(), session, Some(model())).expect("the defaults fit");
    let stage = Stage {
        blueprint,
        course,
        spool: spool.clone(),
    };
    let (edge, remote) = Link::open_pair(&name.parse().expect("a name")).expect("loopback");
    let observer = Observer::new(&edge, Pace::Real).expect("an observer");
    let early = (stage.course.late == 0).then(|| stage.record(&edge, &path));
    let blueprint = &stage.blueprint;
    let nodes = vec![
        stage.start(&remote, blueprint.operator()),
        stage.start(&edge, blueprint.predictor().expect("a model")),
        stage.start(&edge, blueprint.arbiter().expect("a workspace")),
        stage.start(&edge, blueprint.robot_sim().expect("a scene")),
    ];
    let mut marks = Numbering::new(Session(1));
    mark(&edge, &mut marks, 1);
    await_states(&observer, stage.course.late + SOME);
    let (recorder, sinks) = early.unwrap_or_else(|| stage.record(&edge, &path));
    await_states(&observer, SOME);
    // A recorder that can fetch nothing goes on from the snapshots that these cause; a bad network may lose some of them.
    for number in 2..7 {
        mark(&edge, &mut marks, number);
        await_states(&observer, SOME / 4);
    }
    let reports = nodes
        .into_iter()
        .map(|node| {
            node.stop();
            node.join().expect("no panic")
        })
        .collect();
    recorder.stop();
    recorder.join().expect("no panic");
    let sinks = Arc::into_inner(sinks).expect("the recorder has ended");
    let closed = sinks.into_inner().expect("nobody panicked").close(LIMIT);
    assert_eq!(closed.drops.session_file.total(), 0);
    remote.close();
    edge.close();
    let evidence = Evidence::read(File::open(&path).expect("the file")).expect("a session");
    Outcome {
        findings: reexecute(&evidence, |_, _| {}),
        reports,
        spool,
        _folder: folder,
    }
}

const KEPT: u64 = 16 << 20;

#[track_caller]
fn assert_whole(outcome: &Outcome) {
    let words: Vec<String> = outcome.findings.runs.iter().map(ToString::to_string).collect();
    assert_eq!(outcome.findings.overall(), Overall::Identical, "{words:?}");
    assert_eq!(outcome.findings.runs.len(), 4);
    for run in &outcome.findings.runs {
        assert!(
            run.resumed.is_empty() && run.stopped,
            "from its first entry to its last: {run}"
        );
        assert!(run.steps > 2 * u64::from(SOME) && run.snapshots > 1, "{run}");
    }
    for report in &outcome.reports {
        assert_eq!((report.journal.lost, &report.journal.kept), (0, &None));
    }
    assert!(!outcome.spool.exists(), "nobody needs what is kept any more");
}

#[test]
fn a_recorder_that_came_late_has_the_whole_journal_in_the_end() {
    assert_whole(&run(
        "late",
        Course {
            late: SOME,
            spool_bytes: KEPT,
            faults: Faults::default(),
            dropped: 0,
        },
    ));
}

#[test]
fn a_recorder_that_came_late_and_can_fetch_nothing_goes_on_from_a_snapshot() {
    let outcome = run(
        "snapshot",
        Course {
            late: SOME,
            spool_bytes: 0,
            faults: Faults::default(),
            dropped: 0,
        },
    );
    assert_eq!(outcome.findings.overall(), Overall::Incomplete);
    for run in &outcome.findings.runs {
        let late = matches!(run.verdict, Verdict::Incomplete(Missing::Beginning { first }) if first > 0);
        assert!(late && matches!(run.resumed[..], [entry] if entry > 0), "{run}");
        assert!(run.steps > u64::from(SOME) / 2 && run.stopped, "{run}");
    }
}

const BAD_NETWORK: Faults = Faults {
    batches_one_in: 3,
    samples_one_in: 20,
};

#[test]
fn on_a_network_that_loses_messages_and_parts_of_journals_nothing_is_missing_in_the_end() {
    assert_whole(&run(
        "lossy",
        Course {
            late: 0,
            spool_bytes: KEPT,
            faults: BAD_NETWORK,
            dropped: 0,
        },
    ));
}

#[test]
fn nodes_keep_their_journals_where_the_session_file_has_lost_something() {
    let outcome = run(
        "full",
        Course {
            late: 0,
            spool_bytes: KEPT,
            faults: Faults::default(),
            dropped: 1,
        },
    );
    for report in &outcome.reports {
        assert_eq!(report.journal.kept.as_ref(), Some(&outcome.spool));
    }
    let kept = std::fs::read_dir(&outcome.spool).expect("the folder is there").count();
    assert!(kept >= outcome.reports.len(), "{kept} files");
}

#[test]
fn without_anything_to_fetch_from_the_same_losses_are_named() {
    let outcome = run(
        "lost",
        Course {
            late: 0,
            spool_bytes: 0,
            faults: BAD_NETWORK,
            dropped: 0,
        },
    );
    assert_eq!(outcome.findings.overall(), Overall::Incomplete);
    for run in &outcome.findings.runs {
        let named = matches!(
            run.verdict,
            Verdict::Incomplete(Missing::Gap { .. } | Missing::Beginning { .. })
        );
        assert!(named && !run.resumed.is_empty(), "both sides of the gap: {run}");
    }
}
