//! `tandem bench latency`: no slower than bare Zenoh?

use std::time::Duration;

use anyhow::Context as _;
use clap::Args;
use serde_json::json;
use tandem_link::net::free_port;
use tandem_trials::statistics::{Interval, interval_over_rounds, quantile};

use super::Figures;
use super::child::Child;
use super::part::{Part, Told};
use crate::Outcome;

/// How long a chain runs before what it does counts.
const WARM: Duration = Duration::from_millis(500);
/// What the resamples are drawn from.
const SEED: u64 = 1;

#[derive(Args)]
pub(crate) struct LatencyFlags {
    /// How long to measure, both chains together.
    #[arg(long, default_value_t = 60.0, value_parser = super::latency::seconds)]
    seconds: f64,
    /// In how many rounds; each begins both chains anew, in turns.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(3..=200))]
    rounds: u32,
    /// Commands a second.
    #[arg(long, default_value_t = 50.0, value_parser = super::latency::hertz)]
    hz: f64,
    /// Prints one JSON object.
    #[arg(long)]
    json: bool,
}

pub(super) fn seconds(text: &str) -> Result<f64, String> {
    within(text, 1.0, 3600.0, "seconds")
}

pub(super) fn hertz(text: &str) -> Result<f64, String> {
    within(text, 5.0, 1000.0, "hertz")
}

fn within(text: &str, low: f64, high: f64, unit: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| (low..=high).contains(number));
    number.ok_or_else(|| format!("use a number from {low} to {high} {unit}"))
}

/// What one round measured, in milliseconds.
struct Round {
    tandem: Vec<f64>,
    bare: Vec<f64>,
}

pub(crate) fn run(flags: &LatencyFlags) -> anyhow::Result<Outcome> {
    let each = Duration::from_secs_f64(flags.seconds / f64::from(flags.rounds) / 2.0);
    let mut rounds = Vec::new();
    for number in 1..=flags.rounds {
        eprintln!("bench: round {number} of {}", flags.rounds);
        let tandem = || chain([Part::Edge, Part::Operators], flags.hz, each);
        let bare = || chain([Part::BareObey, Part::BareCommand], flags.hz, each);
        // In turns, so that neither always has the better half of the machine's minute.
        let round = if number % 2 == 1 {
            let tandem = tandem()?;
            Round { tandem, bare: bare()? }
        } else {
            let bare = bare()?;
            Round {
                tandem: tandem()?,
                bare,
            }
        };
        rounds.push(round);
    }
    let ratios = (ratio(&rounds, 0.5)?, ratio(&rounds, 0.99)?);
    let all = |of: fn(&Round) -> &Vec<f64>| Figures::of(rounds.iter().flat_map(of).copied().collect());
    let tandem = all(|round| &round.tandem).context("no command reached the robot")?;
    let bare = all(|round| &round.bare).context("nothing passed the bare chain")?;
    // What cannot be told apart is not called slower.
    let is_slower = ratios.0.low > 1.0 || ratios.1.low > 1.0;
    if flags.json {
        let object = json!({"hz": flags.hz, "rounds": flags.rounds, "tandem": tandem, "bare_zenoh": bare,
            "ratio_p50": ratios.0, "ratio_p99": ratios.1, "is_slower": is_slower});
        println!("{object}");
    } else {
        println!(
            "operator to robot over loopback TCP, two processes, {} commands a second",
            flags.hz
        );
        println!("  tandem      {}", tandem.row());
        println!("  bare Zenoh  {}", bare.row());
        println!("  ratio       p50 {}, p99 {}", words(&ratios.0), words(&ratios.1));
        println!("  {}", verdict([&ratios.0, &ratios.1]));
    }
    Ok(if is_slower { Outcome::Failed } else { Outcome::Done })
}

/// Slower or not is told only where the intervals leave no doubt.
fn verdict(ratios: [&Interval; 2]) -> &'static str {
    if ratios.iter().any(|ratio| ratio.low > 1.0) {
        "tandem is SLOWER than bare Zenoh"
    } else if ratios.iter().all(|ratio| ratio.high <= 1.0) {
        "tandem is no slower than bare Zenoh"
    } else {
        "this run cannot tell them apart: more seconds narrow the intervals"
    }
}

fn words(interval: &Interval) -> String {
    format!(
        "{:.2} (95 %: {:.2} to {:.2})",
        interval.value, interval.low, interval.high
    )
}

fn ratio(rounds: &[Round], level: f64) -> anyhow::Result<Interval> {
    let at = |rounds: &[&Round], of: fn(&Round) -> &Vec<f64>| {
        let mut all: Vec<f64> = rounds.iter().flat_map(|round| of(round)).copied().collect();
        all.sort_by(f64::total_cmp);
        quantile(&all, level)
    };
    let figure = |rounds: &[&Round]| {
        let bare = at(rounds, |round| &round.bare)?;
        Some(at(rounds, |round| &round.tandem)? / bare)
    };
    Ok(interval_over_rounds(rounds, SEED, figure)?)
}

/// Runs two processes, of which the second dials the first, and returns what each command took, in milliseconds.
fn chain(parts: [Part; 2], hz: f64, lasting: Duration) -> anyhow::Result<Vec<f64>> {
    let endpoint = format!("tcp/127.0.0.1:{}", free_port()?);
    let edge = Child::start(parts[0], &endpoint, hz, 1)?;
    let operator = Child::start(parts[1], &endpoint, hz, 1)?;
    std::thread::sleep(WARM + lasting);
    let edge = edge.finish()?;
    Ok(latencies(&edge, &operator.finish()?))
}

/// What each command took, in milliseconds, once the chain was warm.
pub(super) fn latencies(robots: &Told, operators: &Told) -> Vec<f64> {
    let apart = i128::from(robots.origin_ns) - i128::from(operators.origin_ns);
    let first = robots
        .arrivals
        .iter()
        .map(|arrival| arrival.arrived_ns)
        .min()
        .unwrap_or(0);
    let warm = first.saturating_add(u64::try_from(WARM.as_nanos()).unwrap_or(0));
    let warmed = robots.arrivals.iter().filter(|arrival| arrival.arrived_ns >= warm);
    warmed
        .map(|arrival| (i128::from(arrival.arrived_ns) - i128::from(arrival.sent_ns) + apart) as f64 * 1e-6)
        .collect()
}
