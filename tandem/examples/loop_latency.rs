//! Whether recording and viewing slow the loop: command to motion with the recorder and without, in turns.
//!
//! `loop_latency TANDEM [ROUNDS=5] [VIEWER]`, where TANDEM is the program whose recorder is measured and VIEWER the
//! address of a viewer that runs, such as `rerun+http://127.0.0.1:9876/proxy`; without it the recorder writes its files
//! only. Every round is a trial of the simulated human without the recorder and one with it, in real time. The four nodes
//! are in this process, the operator behind TCP on loopback, so that one clock measures; the recorder is another process.

use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use tandem_cesn::{Demonstration, Model, Settings};
use tandem_link::{
    Clock, ClockSettings, Faults, Impairments, Link, LinkSettings, Observer, Running, ShellOptions, Sighting,
    SpoolOptions, fresh_session, spawn,
};
use tandem_settings::Document;
use tandem_trials::{Blueprint, Configuration, Quantiles, Tracer};
use tandem_wire::{NodeInfo, Numbering, Pace, Ports, Topic, Trial, encode};

type Failure = Box<dyn std::error::Error>;

const ROBOT: &str = "latency";
/// The human needs about nine seconds.
const PATIENCE: Duration = Duration::from_secs(30);

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let program = arguments.next().ok_or("usage: loop_latency TANDEM [ROUNDS] [VIEWER]")?;
    let rounds: usize = arguments.next().map_or(Ok(5), |text| text.parse())?;
    let viewer = arguments.next();
    let folder = std::env::temp_dir().join(format!("loop-latency-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let measured = measure(&program, rounds, viewer.as_deref(), &folder);
    std::fs::remove_dir_all(&folder)?;
    measured
}

fn measure(program: &str, rounds: usize, viewer: Option<&str>, folder: &Path) -> Result<(), Failure> {
    let (mut off, mut on) = (Vec::new(), Vec::new());
    for round in 1..=rounds {
        // In turns, so that whatever else the machine does falls on both.
        off.push(trial(None)?);
        let file = folder.join("session.mcap").display().to_string();
        let mut recorder = Command::new(program);
        recorder.args(["recorder", "--robot", ROBOT, "--record", &file]);
        recorder.args(viewer.map(|url| format!("--view=connect={url}")));
        on.push(trial(Some(recorder))?);
        for (name, all) in [("off", &off), ("on", &on)] {
            if let Some(last) = all.last() {
                println!(
                    "round {round} {name:>4}  p50 {:.2} ms  p99 {:.2} ms",
                    last.p50_ms, last.p99_ms
                );
            }
        }
    }
    compare("p50", &off, &on, |quantiles| quantiles.p50_ms);
    compare("p99", &off, &on, |quantiles| quantiles.p99_ms);
    Ok(())
}

fn compare(name: &str, off: &[Quantiles], on: &[Quantiles], of: fn(&Quantiles) -> f64) {
    let (without, with): (Vec<f64>, Vec<f64>) = (off.iter().map(of).collect(), on.iter().map(of).collect());
    let changes = without.iter().zip(&with);
    let changes = changes.map(|(off, on)| 100.0 * (on / off - 1.0)).collect();
    let [least, middle, most] = spread(changes);
    let ([_, without, _], [_, with, _]) = (spread(without), spread(with));
    println!(
        "{name}  off {without:.2} ms, on {with:.2} ms (medians); change within a round {middle:+.1} % \
         (of all rounds {least:+.1} to {most:+.1})"
    );
}

/// The least, the middle and the most.
fn spread(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    let at = |index: usize| values.get(index).copied().unwrap_or(f64::NAN);
    [at(0), at(values.len() / 2), at(values.len().saturating_sub(1))]
}

/// A recorder's process, which ends with this value.
struct Recorder(Option<Child>);

impl Drop for Recorder {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            // It is over either way.
            let _ = Command::new("kill")
                .args(["-s", "INT", &child.id().to_string()])
                .status();
            let _ = child.wait();
        }
    }
}

fn trial(recorder: Option<Command>) -> Result<Quantiles, Failure> {
    let endpoint = format!("tcp/{}", TcpListener::bind("127.0.0.1:0")?.local_addr()?);
    let settings = |listen: &[&str], connect: &[&str]| LinkSettings {
        robot: ROBOT.into(),
        listen: listen.iter().map(|text| (*text).to_owned()).collect(),
        connect: connect.iter().map(|text| (*text).to_owned()).collect(),
        ..LinkSettings::default()
    };
    let edge = Link::open(&settings(&[endpoint.as_str()], &[]))?;
    let remote = Link::open(&settings(&[], &[endpoint.as_str()]))?;
    let observer = Observer::new(&edge, Pace::Real)?;
    let is_recorded = recorder.is_some();
    let child = recorder.map(|mut recorder| {
        let quiet = recorder
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        quiet.args(["--connect", &endpoint]).spawn()
    });
    let recorder = Recorder(child.transpose()?);
    let blueprint = blueprint()?;
    let nodes = [
        start(&edge, &blueprint, blueprint.robot_sim()?)?,
        start(&edge, &blueprint, blueprint.arbiter()?)?,
        start(&edge, &blueprint, blueprint.predictor()?)?,
        start(&remote, &blueprint, blueprint.operator())?,
    ];
    gather(&observer, nodes.len() + usize::from(is_recorded))?;
    begin(&edge)?;
    let mut tracer = Tracer::default();
    let until = Instant::now() + PATIENCE;
    while !tracer.is_over() && Instant::now() < until {
        look(&observer, &mut tracer, Duration::from_secs(1));
    }
    for node in nodes {
        node.stop();
        node.join().ok_or("a node panicked")?;
    }
    // The ends of the journals, which tell the latency.
    while look(&observer, &mut tracer, Duration::from_millis(300)) {}
    drop(recorder);
    remote.close();
    edge.close();
    Ok(tracer
        .trace()
        .latency
        .ok_or("no command could be followed to the robot")?)
}

fn blueprint() -> Result<Blueprint, Failure> {
    let demonstrations = [
        (
            "planar_a08.csv",
            include_str!("../../examples/demonstrations/planar_a08.csv"),
        ),
        (
            "planar_a11.csv",
            include_str!("../../examples/demonstrations/planar_a11.csv"),
        ),
        (
            "planar_a14.csv",
            include_str!("../../examples/demonstrations/planar_a14.csv"),
        ),
    ];
    let demonstrations: Result<Vec<_>, _> = demonstrations
        .into_iter()
        .map(|(name, text)| Demonstration::from_csv(name, text))
        .collect();
    let model = Model::train(&demonstrations?, &Settings::default())?;
    let document = Document::parse("the example", "[operator]\nsource = \"simulated\"\n")?;
    let configuration = Configuration::from_document(&document)?;
    Ok(Blueprint::new(configuration, fresh_session(), Some(model))?)
}

fn start<N: Ports + Send + 'static>(link: &Link, blueprint: &Blueprint, node: N) -> Result<Running, Failure>
where
    N::Output: Send,
{
    let options = ShellOptions {
        timing: blueprint.timing(),
        info: NodeInfo {
            session: blueprint.session(),
            ..NodeInfo::default()
        },
        await_peers: vec![],
        impairment: Impairments::default(),
        clocks: ClockSettings::default(),
        spool: SpoolOptions::default(),
        faults: Faults::default(),
        queue: ShellOptions::QUEUE,
    };
    Ok(spawn(link, node, options, |_, _| {})?)
}

/// Waits until so many nodes are there.
fn gather(observer: &Observer, wanted: usize) -> Result<(), Failure> {
    let mut there = std::collections::BTreeSet::new();
    let until = Instant::now() + PATIENCE;
    while there.len() < wanted {
        if Instant::now() > until {
            return Err(format!("only {there:?} are there").into());
        }
        if let Some(Sighting::Presence { peer, alive: true }) = observer.next(Duration::from_secs(1)) {
            there.insert(peer);
        }
    }
    Ok(())
}

fn begin(link: &Link) -> Result<(), Failure> {
    let begin = Trial::Begin {
        number: 1,
        label: "latency".into(),
    };
    let mut bytes = Vec::new();
    let mut numbering = Numbering::new(fresh_session());
    encode(&numbering.envelope(Clock::of_process().now(), 0, begin), &mut bytes);
    Ok(link.publish(Topic::Trial, bytes)?)
}

/// Says whether there was something to see.
fn look(observer: &Observer, tracer: &mut Tracer, limit: Duration) -> bool {
    let sighting = observer.next(limit);
    if let Some(Sighting::Sample { topic, bytes, .. }) = &sighting {
        tracer.see(*topic, bytes);
    }
    sighting.is_some()
}
