//! `tandem bench fleet`: how many robots one router carries.

use std::collections::BTreeMap;
use std::time::Duration;

use anyhow::{Context as _, bail};
use clap::Args;
use serde::Serialize;
use tandem_link::net::free_port;

use super::Figures;
use super::child::Child;
use super::latency::{hertz, seconds};
use super::part::{Part, Told};
use crate::Outcome;

/// A command that takes longer is late.
const LATE_MS: f64 = 10.0;
/// At most so many of them may be.
const RATE: f64 = 1e-5;
/// Up to so many robots.
const ROBOTS: u32 = 50;
/// How long all of them run before it counts.
const WARM_NS: u64 = 2_000_000_000;

#[derive(Args)]
pub(crate) struct FleetFlags {
    /// How long to measure each number of robots.
    #[arg(long, default_value_t = 60.0, value_parser = seconds)]
    seconds: f64,
    /// How many robots, one measurement after the other.
    #[arg(long, value_delimiter = ',', default_value = "1,10,50,100", value_parser = clap::value_parser!(u32).range(1..=500))]
    robots: Vec<u32>,
    /// Commands a second, for each robot.
    #[arg(long, default_value_t = 100.0, value_parser = hertz)]
    hz: f64,
    /// Instead of Tandem's nodes: bare Zenoh sessions that send and hear as much. What is late then, Zenoh and this machine
    /// make late.
    #[arg(long)]
    bare: bool,
    /// Lets so many robots share a session, and so many operators: as many arms of one cell, steered from one desk.
    #[arg(long, default_value_t = 1, conflicts_with = "bare", value_parser = clap::value_parser!(u32).range(1..))]
    together: u32,
    /// Prints one JSON object for each number of robots.
    #[arg(long)]
    json: bool,
}

/// What became of the commands to so many robots.
#[derive(Serialize)]
struct Fleet {
    robots: u32,
    hz: f64,
    /// Commands between the first and the last that count.
    ticks: u64,
    /// Those that took longer, or that no robot ever heard of.
    late: u64,
    /// The latter.
    lost: u64,
    busy: Busy,
    #[serde(flatten)]
    figures: Figures,
}

/// How many processors each process kept busy.
#[derive(Clone, Copy, Serialize)]
struct Busy {
    router: f64,
    robots: f64,
    operators: f64,
}

pub(crate) fn run(flags: &FleetFlags) -> anyhow::Result<Outcome> {
    let mut is_kept = true;
    for robots in &flags.robots {
        eprintln!("bench: {robots} robots for {} s", flags.seconds);
        let fleet = measure(*robots, flags)?;
        is_kept &= fleet.robots > ROBOTS || fleet.is_kept();
        if flags.json {
            println!("{}", serde_json::to_string(&fleet)?);
        } else {
            println!("{}", fleet.row());
        }
    }
    if !flags.json {
        println!(
            "late: not there within {LATE_MS} ms; promised are at most {RATE:e} of the ticks up to {ROBOTS} robots"
        );
    }
    Ok(if is_kept { Outcome::Done } else { Outcome::Failed })
}

fn measure(robots: u32, flags: &FleetFlags) -> anyhow::Result<Fleet> {
    let endpoint = format!("tcp/127.0.0.1:{}", free_port()?);
    let router = Child::start(Part::Router, &endpoint, flags.hz, robots)?;
    let sides = if flags.bare {
        [Part::BareRobots, Part::BareOperators]
    } else {
        [Part::Robots, Part::Operators]
    };
    let side = |side| Child::start_together(side, &endpoint, flags.hz, robots, flags.together);
    let arms = side(sides[0])?;
    let operators = side(sides[1])?;
    std::thread::sleep(Duration::from_nanos(WARM_NS) + Duration::from_secs_f64(flags.seconds));
    // The robots first: they say what has arrived until then.
    let arms = arms.finish()?;
    let operators = operators.finish()?;
    let busy = Busy {
        router: router.finish()?.busy,
        robots: arms.busy,
        operators: operators.busy,
    };
    Fleet::of(robots, flags.hz, busy, &arms, &operators)
}

impl Fleet {
    fn of(robots: u32, hz: f64, busy: Busy, arms: &Told, operators: &Told) -> anyhow::Result<Self> {
        let mut of_robot: BTreeMap<u32, Vec<_>> = BTreeMap::new();
        for arrival in &arms.arrivals {
            of_robot.entry(arrival.robot).or_default().push(arrival);
        }
        if of_robot.len() != robots as usize {
            bail!("only {} of {robots} robots heard a command", of_robot.len());
        }
        let firsts = of_robot.values().filter_map(|arrivals| arrivals.first());
        let all_there = firsts.map(|arrival| arrival.arrived_ns).max().unwrap_or(0);
        let counted = all_there.saturating_add(WARM_NS);
        let apart = i128::from(arms.origin_ns) - i128::from(operators.origin_ns);
        let (mut ticks, mut latencies) = (0, Vec::new());
        for arrivals in of_robot.values() {
            let counted: Vec<_> = arrivals
                .iter()
                .filter(|arrival| arrival.arrived_ns >= counted)
                .collect();
            if let (Some(first), Some(last)) = (counted.first(), counted.last()) {
                ticks += last.number.saturating_sub(first.number) + 1;
            }
            let took = |arrival: &&&super::tap::Arrival| {
                (i128::from(arrival.arrived_ns) - i128::from(arrival.sent_ns) + apart) as f64 * 1e-6
            };
            latencies.extend(counted.iter().map(took));
        }
        let lost = ticks.saturating_sub(latencies.len() as u64);
        let slow = latencies.iter().filter(|took| **took > LATE_MS).count() as u64;
        Ok(Self {
            robots,
            hz,
            ticks,
            late: slow + lost,
            lost,
            busy,
            figures: Figures::of(latencies).context("no command reached a robot in time to count")?,
        })
    }

    fn is_kept(&self) -> bool {
        self.late as f64 <= self.ticks as f64 * RATE
    }

    fn row(&self) -> String {
        let Self {
            robots,
            ticks,
            late,
            lost,
            busy,
            ..
        } = self;
        let rate = *late as f64 / *ticks as f64;
        let kept = if self.is_kept() { "" } else { "  TOO MANY" };
        let counts = format!("{ticks:>8} ticks  {late:>6} late ({rate:.1e}), {lost} of them lost{kept}");
        let processors = format!(
            "processors busy: router {:.2}, robots {:.2}, operators {:.2}",
            busy.router, busy.robots, busy.operators
        );
        let indent = " ".repeat(13);
        format!(
            "{robots:>4} robots  {counts}\n{indent}{}\n{indent}{processors}",
            self.figures.row()
        )
    }
}
