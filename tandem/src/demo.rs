//! `tandem demo`: five nodes in this process, talking over real Zenoh sessions; the operator on its own side of a TCP
//! connection, as if it were remote.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use tandem_link::{Clock, Link, Observer, PaceName, Running, Sighting};
use tandem_operator::SourceKind;
use tandem_recorder::{Closed, Sinks};
use tandem_settings::Choice as _;
use tandem_trials::what_if::LawChoice;
use tandem_trials::{Configuration, Measures, Tracer};
use tandem_wire::{JournalBatch, NodeName, Pace, Topic, Trial, decode};

use crate::configuration::{self, CommonFlags};
use crate::nodes::{ShowFlags, tell_of_journal};
use crate::parts::{LOOP, Parts, RunningRecorder, lost};
use crate::summary::progress;
use crate::trial::TrialMarks;
use crate::{Outcome, interrupt, shipped, table};

/// A trial that has not ended by now is stopped.
const TICKS_MAX: u32 = 200;
/// This long without a state means that somebody does not answer. In real time the others talk on without the robot.
const STALL: Duration = Duration::from_secs(2);
/// How long the last words may be on their way.
const DRAINING: Duration = Duration::from_secs(1);
/// How long the nodes may take to find each other.
const GATHERING: Duration = Duration::from_secs(10);

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PaceFlag {
    /// 10 Hz control, by the clock.
    Real,
    /// As fast as messages travel.
    Max,
}

impl From<PaceFlag> for PaceName {
    fn from(flag: PaceFlag) -> Self {
        match flag {
            PaceFlag::Real => Self::Real,
            PaceFlag::Max => Self::Max,
        }
    }
}

#[derive(Args)]
pub(crate) struct DemoFlags {
    /// What drives time.
    #[arg(long, value_enum, default_value = "real")]
    pace: PaceFlag,
    /// How human and robot share the command: adaptive, attentive, fixed, human, robot, or constant=W with the human's
    /// weight W [default: the configuration's].
    #[arg(long, value_name = "LAW")]
    law: Option<LawChoice>,
    /// Seed of the simulated human.
    #[arg(long)]
    seed: Option<u64>,
    /// The session file; the Rerun recording goes beside it [default: sessions/demo-SECONDS.mcap].
    #[arg(long, value_name = "PATH")]
    record: Option<PathBuf>,
    #[command(flatten)]
    show: ShowFlags,
    /// Prints the summary as one JSON object.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: CommonFlags,
}

pub(crate) fn run(flags: &DemoFlags) -> anyhow::Result<Outcome> {
    let began = Instant::now();
    let configuration = configuration(flags)?;
    let interrupted = interrupt::catch()?;
    let model = shipped::model_or(&configuration.predictor.model)?;
    let trained = began.elapsed();
    let pace = configuration.rates.timing().pace;
    let robot = configuration.link.robot.parse()?;
    let parts = Parts::new(configuration.clone(), Some(model))?.recorded_from_the_start();
    let sinks = parts.sinks()?;
    let (edge, remote) = Link::open_pair(&robot)?;
    let observer = Observer::new(&edge, pace)?;
    let team = Team::start(&parts, sinks, &edge, &remote)?;

    let mut watch = Watch::new(observer, pace, ProgressBar::new(84));
    let mut trial = TrialMarks::new(edge.clone());
    let begin = Trial::Begin {
        number: 1,
        label: "demo".into(),
    };
    // However it ends, the recorder is closed before anybody hears of it: that is when the file is wanted.
    let ended = watch
        .gather()
        .and_then(|()| trial.mark(begin))
        .and_then(|()| watch.until_over(&interrupted));
    let outcome = if watch.figures().reached_goal {
        "goal reached"
    } else {
        "goal not reached"
    };
    let marked = trial.mark(Trial::End {
        number: 1,
        outcome: outcome.into(),
    });
    let closed = team.stop(&mut watch)?;
    remote.close();
    edge.close();
    ended?;
    marked?;

    let report = Report {
        figures: watch.figures(),
        closed,
        trained,
        wall: began.elapsed(),
        configuration,
    };
    report.print(flags.json)?;
    Ok(report.outcome())
}

fn configuration(flags: &DemoFlags) -> anyhow::Result<Configuration> {
    let session = flags.record.clone().unwrap_or_else(default_path);
    if let Some(folder) = session.parent() {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    let mut overrides = flags.show.overrides(Some(&session));
    overrides.extend([
        ("loop.pace", PaceName::from(flags.pace).name().to_owned()),
        ("operator.source", SourceKind::Simulated.name().to_owned()),
        // A demo is short enough for its index to be kept in memory until the end.
        ("recorder.rrd_index", "true".to_owned()),
        // The same demo can be run again.
        ("recorder.overwrite", "true".to_owned()),
    ]);
    overrides.extend(flags.law.map(|choice| ("arbiter.law", choice.law.name().to_owned())));
    let weight = flags.law.and_then(|choice| choice.weight);
    overrides.extend(weight.map(|weight| ("arbiter.constant_weight", weight.to_string())));
    overrides.extend(flags.seed.map(|seed| ("loop.seed", seed.to_string())));
    Ok(configuration::load(&flags.common, &overrides)?)
}

fn default_path() -> PathBuf {
    let second = Clock::of_process().origin_unix_nanos() / 1_000_000_000;
    PathBuf::from("sessions").join(format!("demo-{second}.mcap"))
}

/// The five nodes at work. The recorder ends last, so that it hears everybody's last words.
struct Team {
    players: Vec<Running>,
    recorder: RunningRecorder,
}

impl Team {
    fn start(parts: &Parts, sinks: Sinks, edge: &Link, remote: &Link) -> anyhow::Result<Self> {
        let recorder = parts.recorder(edge, sinks)?;
        let players = vec![
            parts.operator(remote, |_| {})?,
            parts.predictor(edge)?,
            parts.arbiter(edge)?,
            parts.robot_sim(edge)?,
        ];
        Ok(Self { players, recorder })
    }

    /// Ends the players, waits for the ends of their journals, and ends the recorder.
    fn stop(self, watch: &mut Watch) -> anyhow::Result<Closed> {
        let mut panicked = false;
        let mut entries = 0;
        for (name, node) in LOOP.into_iter().zip(self.players) {
            node.stop();
            match node.join() {
                Some(report) => {
                    tell_of_journal(name, &report.journal);
                    entries += report.journal.entries - report.journal.lost;
                }
                None => panicked = true,
            }
        }
        watch.drain(entries);
        let closed = self.recorder.stop()?;
        if panicked {
            bail!("a node panicked: please report this with the session file");
        }
        Ok(closed)
    }
}

/// Follows the trial from outside, as any listener could.
struct Watch {
    observer: Observer,
    pace: Pace,
    bar: ProgressBar,
    tracer: Tracer,
    /// Journal entries seen, of all nodes.
    journalled: u64,
    newest: [u32; 4],
    /// When the last state came.
    progressed: Instant,
}

/// Whose message of a tick is awaited, in the order in which they follow each other.
const RELAY: [(Topic, NodeName); 4] = [
    (Topic::State, NodeName::RobotSim),
    (Topic::Command, NodeName::Operator),
    (Topic::Proposal, NodeName::Predictor),
    (Topic::Setpoint, NodeName::Arbiter),
];

impl Watch {
    fn new(observer: Observer, pace: Pace, bar: ProgressBar) -> Self {
        let style = ProgressStyle::with_template("{elapsed:>4} {bar:40} tick {pos:>3}  {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        Self {
            observer,
            pace,
            bar,
            tracer: Tracer::default(),
            journalled: 0,
            newest: [0; 4],
            progressed: Instant::now(),
        }
    }

    /// Waits until all five nodes are there.
    fn gather(&mut self) -> anyhow::Result<()> {
        let mut missing: Vec<NodeName> = NodeName::ALL.to_vec();
        let limit = Instant::now() + GATHERING;
        while !missing.is_empty() {
            match self.observer.next(limit.saturating_duration_since(Instant::now())) {
                Some(Sighting::Presence { peer, alive: true }) => missing.retain(|name| *name != peer),
                Some(_) => {}
                None => bail!("{} did not come up within {} s", missing[0], GATHERING.as_secs()),
            }
        }
        Ok(())
    }

    fn until_over(&mut self, interrupted: &crossbeam_channel::Receiver<()>) -> anyhow::Result<()> {
        self.progressed = Instant::now();
        while !self.tracer.is_over() && self.tracer.elapsed_ticks() < TICKS_MAX {
            if interrupted.try_recv().is_ok() {
                bail!("interrupted; what was recorded so far is kept");
            }
            match self.observer.next(STALL.saturating_sub(self.progressed.elapsed())) {
                Some(sighting) => self.see(&sighting),
                None => bail!("no state for {} s: {} does not answer", STALL.as_secs(), self.awaited()),
            }
        }
        self.bar.finish_and_clear();
        Ok(())
    }

    /// Takes in what is still under way, until the journals are whole: the operator's comes over a network.
    fn drain(&mut self, entries: u64) {
        let limit = Instant::now() + DRAINING;
        while self.journalled < entries {
            match self.observer.next(limit.saturating_duration_since(Instant::now())) {
                Some(sighting) => self.see(&sighting),
                None => return,
            }
        }
    }

    fn see(&mut self, sighting: &Sighting) {
        let Sighting::Sample { topic, bytes, .. } = sighting else {
            return;
        };
        if let Some(at) = RELAY.iter().position(|(relayed, _)| relayed == topic)
            && let Ok((_, header)) = tandem_wire::codec::peek(bytes)
        {
            self.newest[at] = header.tick;
        }
        self.tracer.see(*topic, bytes);
        match topic {
            Topic::State => {
                self.progressed = Instant::now();
                self.bar.set_position(u64::from(self.tracer.elapsed_ticks()));
                self.bar.set_message(progress(&self.tracer));
            }
            Topic::Journal(_) => decode::<JournalBatch>(bytes)
                .into_iter()
                .for_each(|batch| self.journalled += batch.body.entries.len() as u64),
            _ => {}
        }
    }

    fn figures(&self) -> Measures {
        Measures::of(&self.tracer.trace())
    }

    /// In lockstep: whose message of the newest tick is missing.
    fn awaited(&self) -> NodeName {
        let newest = self.newest[0];
        let missing = RELAY.iter().zip(self.newest).find(|(_, tick)| *tick < newest);
        match (self.pace, missing) {
            (Pace::Lockstep, Some(((_, node), _))) => *node,
            _ => NodeName::RobotSim,
        }
    }
}

struct Report {
    figures: Measures,
    closed: Closed,
    trained: Duration,
    wall: Duration,
    configuration: Configuration,
}

impl Report {
    fn outcome(&self) -> Outcome {
        if !self.figures.reached_goal {
            Outcome::Failed
        } else if lost(&self.closed) > 0 {
            Outcome::SamplesLost
        } else {
            Outcome::Done
        }
    }

    fn print(&self, json: bool) -> anyhow::Result<()> {
        if json {
            println!("{}", serde_json::to_string(&self.as_json()?)?);
        } else {
            println!("{}", self.as_table());
        }
        Ok(())
    }

    fn as_json(&self) -> anyhow::Result<serde_json::Value> {
        let mut object = serde_json::to_value(&self.figures)?;
        let more = json!({
            "law": LawChoice::of(&self.configuration.arbiter).to_string(),
            "seed": self.configuration.rates.seed,
            "session_path": self.configuration.recorder.path,
            "rrd_path": self.configuration.recorder.rrd,
            "train_ms": self.trained.as_secs_f64() * 1e3,
            "wall_s": self.wall.as_secs_f64(),
            "messages_lost": lost(&self.closed),
        });
        if let (Some(object), serde_json::Value::Object(more)) = (object.as_object_mut(), more) {
            object.extend(more);
        }
        Ok(object)
    }

    fn as_table(&self) -> String {
        let figures = &self.figures;
        let millimetres =
            |metres: Option<f64>| metres.map_or("unknown".into(), |metres| format!("{:.1} mm", metres * 1e3));
        let plain = |value: Option<f64>| value.map_or("none".into(), |value| format!("{value:.3}"));
        let stops = match figures.stops.as_slice() {
            [] => "none".into(),
            stops => stops
                .iter()
                .map(|stop| format!("tick {} by {}: {}", stop.tick, stop.by, stop.reason))
                .collect::<Vec<_>>()
                .join("; "),
        };
        let latency = figures.latency_p50_ms.zip(figures.latency_p99_ms);
        let latency = latency.map_or("not measured".into(), |(p50, p99)| {
            format!("p50 {p50:.2} ms, p99 {p99:.2} ms")
        });
        let goal = if figures.reached_goal { "reached" } else { "NOT reached" };
        let recorder = &self.configuration.recorder;
        table::rows(&[
            (
                "goal",
                format!(
                    "{goal}, {} away after {} ticks",
                    millimetres(figures.goal_distance_m),
                    figures.ticks
                ),
            ),
            ("smallest clearance", millimetres(figures.min_clearance_m)),
            ("mean ω before the checkpoint", plain(figures.weight_mean_before)),
            ("mean ω after it", plain(figures.weight_mean_after)),
            (
                "human effort after it",
                format!("{} m/s", plain(figures.human_effort_mean_m_s)),
            ),
            ("stops", stops),
            ("command to motion", latency),
            ("messages lost", lost(&self.closed).to_string()),
            ("session", recorder.path.clone()),
            (
                "recording",
                format!("{}   (open it: rerun {})", recorder.rrd, recorder.rrd),
            ),
            (
                "model trained in",
                format!("{:.0} ms", self.trained.as_secs_f64() * 1e3),
            ),
            ("all of it took", format!("{:.2} s", self.wall.as_secs_f64())),
        ])
    }
}
