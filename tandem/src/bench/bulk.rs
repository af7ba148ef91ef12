//! `tandem bench bulk`: what a recorder, one who takes everything and bulk traffic on the link's router cost the commands.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::Context as _;
use clap::Args;
use serde_json::json;
use tandem_link::net::free_port;
use tandem_trials::statistics::{Interval, interval_over_rounds, quantile};

use super::Figures;
use super::child::Child;
use super::latency::{hertz, latencies, seconds};
use super::part::{FLOOD_BYTES_S, Part, robot_name};
use crate::Outcome;

/// Commands may come this much later at p99, in milliseconds.
const LIMIT_MS: f64 = 5.0;
/// How long a side runs before it counts.
const WARM: Duration = Duration::from_millis(1000);
/// What the resamples are drawn from.
const SEED: u64 = 1;

#[derive(Args)]
pub(crate) struct BulkFlags {
    /// How long to measure, with and without load together.
    #[arg(long, default_value_t = 60.0, value_parser = seconds)]
    seconds: f64,
    /// In how many rounds, with and without load in turns.
    #[arg(long, default_value_t = 6, value_parser = clap::value_parser!(u32).range(3..=200))]
    rounds: u32,
    /// Commands a second.
    #[arg(long, default_value_t = 50.0, value_parser = hertz)]
    hz: f64,
    /// Leaves the bulk traffic out, and who takes it: what the recorder, and the viewer it streams to, cost by themselves.
    #[arg(long)]
    without_bulk: bool,
    /// Lets the recorder stream to the Rerun viewer there, as in rerun+http://127.0.0.1:9876/proxy.
    #[arg(long, value_name = "URL")]
    rerun: Option<String>,
    /// Prints one JSON object.
    #[arg(long)]
    json: bool,
}

impl BulkFlags {
    /// What shares the router with the commands, in words.
    fn load(&self, taken_mb_s: f64) -> String {
        let recorder = match &self.rerun {
            Some(url) => format!("a recorder that streams to {url}"),
            None => "a recorder".to_owned(),
        };
        if self.without_bulk {
            return recorder;
        }
        let offered = FLOOD_BYTES_S * 1e-6;
        format!("{recorder}, {offered:.0} MB/s of bulk, and one who takes everything: {taken_mb_s:.1} MB/s of it")
    }
}

struct Round {
    unloaded: Vec<f64>,
    loaded: Vec<f64>,
    /// What was taken of the bulk traffic, in bytes a second.
    taken: f64,
}

pub(crate) fn run(flags: &BulkFlags) -> anyhow::Result<Outcome> {
    let each = Duration::from_secs_f64(flags.seconds / f64::from(flags.rounds) / 2.0);
    let mut rounds = Vec::new();
    for number in 1..=flags.rounds {
        eprintln!("bench: round {number} of {}", flags.rounds);
        let (unloaded, _) = measure(flags, each, false)?;
        let (loaded, taken) = measure(flags, each, true)?;
        rounds.push(Round {
            unloaded,
            loaded,
            taken,
        });
    }
    let all = |of: fn(&Round) -> &Vec<f64>| Figures::of(rounds.iter().flat_map(of).copied().collect());
    let unloaded = all(|round| &round.unloaded).context("no command reached the robot")?;
    let loaded = all(|round| &round.loaded).context("no command reached the robot under load")?;
    let later = interval_of_p99(&rounds, |unloaded, loaded| loaded - unloaded)?;
    let ratio = interval_of_p99(&rounds, |unloaded, loaded| loaded / unloaded)?;
    let offered = if flags.without_bulk { 0.0 } else { FLOOD_BYTES_S * 1e-6 };
    let taken = rounds.iter().map(|round| round.taken).sum::<f64>() / rounds.len() as f64;
    let is_kept = later.value <= LIMIT_MS;
    if flags.json {
        let object = json!({"hz": flags.hz, "rounds": flags.rounds, "unloaded": unloaded, "loaded": loaded,
            "p99_later_ms": later, "p99_ratio": ratio, "bulk_offered_mb_s": offered, "bulk_taken_mb_s": taken * 1e-6,
            "is_within_limit": is_kept});
        println!("{object}");
    } else {
        println!(
            "operator to robot, {} commands a second, through the router of both",
            flags.hz
        );
        println!("  alone      {}", unloaded.row());
        println!("  with load  {}", loaded.row());
        println!("  load       {}", flags.load(taken * 1e-6));
        let (value, low, high) = (later.value, later.low, later.high);
        println!("  p99 later by {value:.2} ms (95 %: {low:.2} to {high:.2}); at most {LIMIT_MS} ms is promised");
        let (value, low, high) = (ratio.value, ratio.low, ratio.high);
        println!("  p99 with load over p99 alone: {value:.2} (95 %: {low:.2} to {high:.2})");
    }
    Ok(if is_kept { Outcome::Done } else { Outcome::Failed })
}

fn interval_of_p99(rounds: &[Round], compare: fn(f64, f64) -> f64) -> anyhow::Result<Interval> {
    let p99 = |rounds: &[&Round], of: fn(&Round) -> &Vec<f64>| {
        let mut all: Vec<f64> = rounds.iter().flat_map(|round| of(round)).copied().collect();
        all.sort_by(f64::total_cmp);
        quantile(&all, 0.99)
    };
    let figure = |rounds: &[&Round]| {
        let unloaded = p99(rounds, |round| &round.unloaded)?;
        Some(compare(unloaded, p99(rounds, |round| &round.loaded)?))
    };
    Ok(interval_over_rounds(rounds, SEED, figure)?)
}

/// What each command took, in milliseconds, and what was taken of the bulk, in bytes a second.
fn measure(flags: &BulkFlags, lasting: Duration, is_loaded: bool) -> anyhow::Result<(Vec<f64>, f64)> {
    let hz = flags.hz;
    let endpoint = format!("tcp/127.0.0.1:{}", free_port()?);
    let edge = Child::start(Part::Edge, &endpoint, hz, 1)?;
    let load = is_loaded.then(|| Load::start(&endpoint, flags)).transpose()?;
    let operator = Child::start(Part::Operators, &endpoint, hz, 1)?;
    std::thread::sleep(WARM + lasting);
    let edge = edge.finish()?;
    let operator = operator.finish()?;
    let taken = load.map_or(Ok(0.0), Load::finish)?;
    Ok((latencies(&edge, &operator), taken))
}

/// All that shares the router with the commands.
struct Load {
    recorder: Recorder,
    bulk: Option<Bulk>,
}

/// Bulk traffic, and one who takes everything.
struct Bulk {
    taker: Child,
    flood: Child,
}

impl Load {
    fn start(endpoint: &str, flags: &BulkFlags) -> anyhow::Result<Self> {
        let part = |part| Child::start(part, endpoint, 50.0, 1);
        let bulk = || -> anyhow::Result<Bulk> {
            Ok(Bulk {
                taker: part(Part::Taker)?,
                flood: part(Part::Flood)?,
            })
        };
        Ok(Self {
            recorder: Recorder::start(endpoint, flags.rerun.as_deref())?,
            bulk: (!flags.without_bulk).then(bulk).transpose()?,
        })
    }

    /// What was taken, in bytes a second.
    fn finish(self) -> anyhow::Result<f64> {
        let taken = self.bulk.map_or(Ok(0.0), Bulk::finish);
        drop(self.recorder);
        taken
    }
}

impl Bulk {
    fn finish(self) -> anyhow::Result<f64> {
        let flooded = self.flood.finish()?;
        let taken = self.taker.finish()?;
        // What arrives does so while there is bulk.
        Ok(taken.bytes as f64 / flooded.seconds)
    }
}

/// A recorder as a user would start it, writing a session file and a Rerun recording that nobody keeps.
struct Recorder {
    process: std::process::Child,
    folder: PathBuf,
}

impl Recorder {
    fn start(endpoint: &str, rerun: Option<&str>) -> anyhow::Result<Self> {
        let folder = std::env::temp_dir().join(format!("tandem-bench-{}", std::process::id()));
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let process = spawn(endpoint, &folder, rerun).context("cannot start the recorder")?;
        Ok(Self { process, folder })
    }
}

fn spawn(endpoint: &str, folder: &Path, rerun: Option<&str>) -> anyhow::Result<std::process::Child> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["recorder", "--connect", endpoint, "--robot", &robot_name(0), "--record"]);
    command.arg(folder.join("bench.mcap")).current_dir(folder);
    command.args(rerun.map(|url| format!("--view=connect={url}")));
    Ok(command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()?)
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // Nobody wants the file, so it need not end in good order.
        let _ = self.process.kill();
        let _ = self.process.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}
