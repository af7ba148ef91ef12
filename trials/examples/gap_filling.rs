//! How long a recorder that comes late takes to fetch what it missed of four nodes' journals, over real Zenoh:
//!
//! ```text
//! cargo run --release -p tandem-trials --example gap_filling -- [ROUNDS=3] [SECONDS…=1 10 60]
//! ```
//!
//! Each measurement is a session of its own, in real time at 100 Hz, with a new trial every ten seconds. The four nodes,
//! which keep their journals on disk, and the recorder, which writes a session file, are in this process; all that passes
//! between them goes through TCP on loopback. The clock runs from the recorder's first question until the session file has
//! been handed the last entry that was missed, while both go on with what is new.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use tandem_cesn::{Demonstration, Model, Settings};
use tandem_link::{
    Clock, ClockSettings, Faults, Impairments, Link, LinkSettings, Observer, Running, ShellOptions, Sighting,
    SpoolOptions, fresh_session, spawn,
};
use tandem_recorder::{
    Entry, JournalPart, Output, Provenance, Recorder, RecorderConfig, RecorderSettings, Sample, Sinks,
};
use tandem_trials::{Blueprint, Configuration};
use tandem_wire::{
    Nanos, NodeInfo, NodeName, Numbering, Pace, Ports, SECOND, Seq, Stamp, Topic, Trial, encode, seconds,
};

type Failure = Box<dyn std::error::Error>;

const ROBOT: &str = "filling";
/// The rate of commands, setpoints and states.
const STREAM_HZ: f64 = 100.0;
const NODES: usize = 4;
const TRIAL_EVERY: Nanos = 10 * SECOND;
/// What does not come within this does not come.
const PATIENCE: Duration = Duration::from_secs(30);

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let rounds: usize = arguments.next().map_or(Ok(3), |text| text.parse())?;
    let gaps: Vec<u64> = arguments.map(|text| text.parse()).collect::<Result<_, _>>()?;
    let gaps = if gaps.is_empty() { vec![1, 10, 60] } else { gaps };
    for gap in gaps {
        let mut fillings = Vec::new();
        for _ in 0..rounds {
            let filling = measure(gap * SECOND)?;
            println!("{gap:>4} s missed: {filling}");
            fillings.push(filling);
        }
        if let Some(summary) = summary(fillings) {
            println!("{gap:>4} s missed, {summary}");
        }
    }
    Ok(())
}

/// What was missed, and how long it took to come.
#[derive(Clone, Copy, Debug, Default)]
struct Filling {
    took: Nanos,
    entries: u64,
    bytes: u64,
    answers: u64,
}

impl Filling {
    fn megabytes(&self) -> f64 {
        self.bytes as f64 / 1e6
    }

    fn megabytes_per_second(&self) -> f64 {
        self.megabytes() / seconds(self.took)
    }
}

impl std::fmt::Display for Filling {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} entries, {:.2} MB in {} answers, in {:.3} s ({:.1} MB/s)",
            self.entries,
            self.megabytes(),
            self.answers,
            seconds(self.took),
            self.megabytes_per_second()
        )
    }
}

fn summary(mut fillings: Vec<Filling>) -> Option<String> {
    fillings.sort_by_key(|filling| filling.took);
    let (least, most) = (fillings.first()?, fillings.last()?);
    let middle = fillings.get(fillings.len() / 2)?;
    Some(format!(
        "of {}: {:.3} s at least, {:.3} s in the middle, {:.3} s at most",
        fillings.len(),
        seconds(least.took),
        seconds(middle.took),
        seconds(most.took)
    ))
}

fn measure(gap: Nanos) -> Result<Filling, Failure> {
    let folder = tempfile::tempdir()?;
    let blueprint = blueprint()?;
    let (edge, remote) = Link::open_pair(&ROBOT.parse()?)?;
    let observer = Observer::of_topics(&edge, Pace::Real, &[Topic::State])?;
    let spool = folder.path().join("journals");
    let nodes = [
        start(&edge, &blueprint, &spool, blueprint.robot_sim()?)?,
        start(&edge, &blueprint, &spool, blueprint.arbiter()?)?,
        start(&edge, &blueprint, &spool, blueprint.predictor()?)?,
        start(&edge, &blueprint, &spool, blueprint.operator())?,
    ];
    run_trials(&edge, &observer, gap)?;
    let (tell, tidings) = channel();
    let (recorder, sinks) = record(&remote, &blueprint, folder.path(), tell)?;
    let filling = await_filling(&tidings)?;
    for node in nodes {
        node.stop();
        node.join().ok_or("a node panicked")?;
    }
    recorder.stop();
    recorder.join().ok_or("the recorder panicked")?;
    let sinks = Arc::into_inner(sinks).ok_or("the recorder has not ended")?;
    let closed = sinks.into_inner()?.close(PATIENCE);
    if closed.drops.session_file.total() > 0 {
        return Err("the session file dropped some".into());
    }
    remote.close();
    edge.close();
    Ok(filling)
}

fn blueprint() -> Result<Blueprint, Failure> {
    let demonstrations = [
        include_str!("../../examples/demonstrations/planar_a08.csv"),
        include_str!("../../examples/demonstrations/planar_a11.csv"),
        include_str!("../../examples/demonstrations/planar_a14.csv"),
    ]
    .map(|text| Demonstration::from_csv("shipped", text));
    let demonstrations: Vec<_> = demonstrations.into_iter().collect::<Result<_, _>>()?;
    let model = Model::train(&demonstrations, &Settings::default())?;
    let mut configuration = Configuration::default();
    configuration.rates.stream_hz = STREAM_HZ;
    Ok(Blueprint::new(configuration, fresh_session(), Some(model))?)
}

fn options(blueprint: &Blueprint, spool: SpoolOptions) -> ShellOptions {
    ShellOptions {
        timing: blueprint.timing(),
        info: NodeInfo {
            session: blueprint.session(),
            ..NodeInfo::default()
        },
        await_peers: vec![],
        impairment: Impairments::default(),
        clocks: ClockSettings::default(),
        spool,
        faults: Faults::default(),
        queue: ShellOptions::QUEUE,
    }
}

fn start<N>(link: &Link, blueprint: &Blueprint, spool: &Path, node: N) -> Result<Running, Failure>
where
    N: Ports + Send + 'static,
    N::Output: Send,
{
    let spool = SpoolOptions {
        folder: spool.to_owned(),
        limit_bytes: LinkSettings::default().spool_mib << 20,
    };
    Ok(spawn(link, node, options(blueprint, spool), |_, _| {})?)
}

/// Lets the nodes drive trials for so long, counted from the first state.
fn run_trials(link: &Link, observer: &Observer, time: Nanos) -> Result<(), Failure> {
    let mut marks = Numbering::new(fresh_session());
    let (mut began, mut number) = (None, 0);
    loop {
        let Some(Sighting::Sample { at, .. }) = observer.next(PATIENCE) else {
            return Err("the robot says nothing".into());
        };
        let passed = at.since(*began.get_or_insert(at));
        if passed >= time {
            return Ok(());
        }
        if passed >= u64::from(number) * TRIAL_EVERY {
            number += 1;
            let label = "filling".to_owned();
            let mut bytes = Vec::new();
            encode(&marks.envelope(at, 0, Trial::Begin { number, label }), &mut bytes);
            link.publish(Topic::Trial, bytes)?;
        }
    }
}

/// What the recorder did, and when.
enum Tidings {
    Asked(Stamp),
    Kept(Stamp, Part),
}

/// What counts of a part of a journal.
struct Part {
    node: NodeName,
    is_answer: bool,
    first: u64,
    entries: u64,
    bytes: u64,
}

impl From<&JournalPart> for Part {
    fn from(part: &JournalPart) -> Self {
        Self {
            node: part.node,
            is_answer: part.header.seq == Seq(0),
            first: part.first,
            entries: part.entries,
            bytes: part.bytes.len() as u64,
        }
    }
}

/// Starts a recorder that tells what it does.
fn record(
    link: &Link,
    blueprint: &Blueprint,
    folder: &Path,
    tell: Sender<Tidings>,
) -> Result<(Running, Arc<Mutex<Sinks>>), Failure> {
    let settings = RecorderSettings {
        path: folder.join("session.mcap").display().to_string(),
        ..RecorderSettings::default()
    };
    let provenance = Provenance {
        robot: link.robot().clone(),
        build: "gap_filling".into(),
        epoch_unix_nanos: Clock::of_process().origin_unix_nanos(),
    };
    let timing = blueprint.timing();
    let sinks = Sinks::open(&RecorderConfig::new(&settings)?, timing, &provenance)?;
    let sinks = Arc::new(Mutex::new(sinks));
    let shared = Arc::clone(&sinks);
    let local = move |_, output: Output| {
        let now = Clock::of_process().now();
        let tidings = match &output {
            Output::Ask(_) => Some(Tidings::Asked(now)),
            Output::Write(heard) => match &heard.entry {
                Entry::Sample(Sample::Journal(part)) => Some(Tidings::Kept(now, part.into())),
                _ => None,
            },
            _ => None,
        };
        if let Ok(mut sinks) = shared.lock() {
            sinks.handle(output);
        }
        // Whoever has heard enough listens no more.
        tidings.and_then(|tidings| tell.send(tidings).err());
    };
    let options = options(blueprint, SpoolOptions::default());
    Ok((spawn(link, Recorder::new(timing), options, local)?, sinks))
}

/// What is known of a node's journal: the index behind its newest entry, and how many before that are missing.
#[derive(Default)]
struct Known {
    next: u64,
    missing: u64,
}

/// Follows the recorder until it has everything that came before, or fell out between, the parts that the nodes sent by
/// themselves.
fn await_filling(tidings: &Receiver<Tidings>) -> Result<Filling, Failure> {
    let mut filling = Filling::default();
    let mut journals = BTreeMap::<NodeName, Known>::new();
    let mut began = None;
    while journals.len() < NODES || journals.values().any(|known| known.missing > 0) {
        let (at, part) = match tidings.recv_timeout(PATIENCE)? {
            Tidings::Asked(at) => {
                began.get_or_insert(at);
                continue;
            }
            Tidings::Kept(at, part) => (at, part),
        };
        let known = journals.entry(part.node).or_default();
        if !part.is_answer {
            known.missing += part.first.saturating_sub(known.next);
            known.next = known.next.max(part.first + part.entries);
            continue;
        }
        known.missing = known
            .missing
            .checked_sub(part.entries)
            .ok_or("more came than was missed")?;
        filling.entries += part.entries;
        filling.bytes += part.bytes;
        filling.answers += 1;
        filling.took = at.since(began.ok_or("an answer to no question")?);
    }
    Ok(filling)
}
