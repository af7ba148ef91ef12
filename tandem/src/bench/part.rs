//! One side of a measurement, from inside: says `ready`, works until its input ends, tells what it saw as one JSON object.

use std::io::Read as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use clap::{Args, ValueEnum};
use serde::{Deserialize, Serialize};
use tandem_link::yardstick::{self, Everything, Fleet, Passed, Side};
use tandem_link::{Link, LinkSettings, Running};
use tandem_operator::SourceKind;
use tandem_trials::Configuration;
use tandem_wire::{Delivery, Nanos, Pace};

use super::clock::{origin_ns, processor_time};
use super::payload::{command_bytes, setpoint_bytes, state_bytes};
use super::tap::{Arrival, Arrivals, Tapped};
use crate::Outcome;
use crate::parts::Parts;

/// Bulk traffic goes in pieces of this many bytes.
const PIECE: usize = 64 << 10;
/// So many bytes a second.
pub(super) const FLOOD_BYTES_S: f64 = 20e6;

/// What a part does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Part {
    /// Listens: nothing but a router.
    Router,
    /// Dials: an operator for each robot.
    Operators,
    /// Dials: arbiter and robot for each robot.
    Robots,
    /// Listens: router, arbiter and robot in one.
    Edge,
    /// Dials: bare Zenoh's operator.
    BareCommand,
    /// Listens: bare Zenoh's arbiter and robot.
    BareObey,
    /// Dials: a bare session for each operator.
    BareOperators,
    /// Dials: a bare session for each robot.
    BareRobots,
    /// Dials: bulk traffic under a robot's name.
    Flood,
    /// Dials: takes everything about a robot.
    Taker,
}

#[derive(Args)]
pub(crate) struct PartFlags {
    #[arg(value_enum)]
    part: Part,
    #[arg(long)]
    endpoint: String,
    #[arg(long)]
    hz: f64,
    #[arg(long)]
    robots: u32,
    /// How many robots share a session.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    together: u32,
}

impl PartFlags {
    fn period(&self) -> Duration {
        Duration::from_secs_f64(1.0 / self.hz)
    }
}

/// What a part tells at its end.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Told {
    /// Where this process's clock has its zero, on the machine's.
    pub(super) origin_ns: i64,
    /// How many processors it kept busy, from when it was ready until it was asked to end.
    pub(super) busy: f64,
    /// Commands that reached robots.
    pub(super) arrivals: Vec<Arrival>,
    /// Bytes taken or given.
    pub(super) bytes: u64,
    /// For how long, in seconds.
    pub(super) seconds: f64,
}

pub(crate) fn run(flags: &PartFlags) -> anyhow::Result<Outcome> {
    let mut told = match flags.part {
        Part::Router => {
            let link = Link::open(&link_settings(flags, 0, true))?;
            let busy = ready_until_asked()?;
            link.close();
            Told {
                busy,
                ..Told::default()
            }
        }
        Part::Operators | Part::Robots | Part::Edge => nodes(flags)?,
        Part::BareCommand | Part::BareObey => bare(flags)?,
        Part::BareOperators => bare_fleet(flags, Side::Operators, command_bytes())?,
        Part::BareRobots => bare_fleet(flags, Side::Robots, state_bytes())?,
        Part::Flood => flood(flags)?,
        Part::Taker => take(flags)?,
    };
    told.origin_ns = origin_ns()?;
    println!("{}", serde_json::to_string(&told)?);
    Ok(Outcome::Done)
}

/// The name of the `index`-th robot.
pub(super) fn robot_name(index: u32) -> String {
    format!("bench-{index}")
}

fn link_settings(flags: &PartFlags, index: u32, listens: bool) -> LinkSettings {
    let endpoint = vec![flags.endpoint.clone()];
    let (listen, connect) = if listens {
        (endpoint, vec![])
    } else {
        (vec![], endpoint)
    };
    LinkSettings {
        robot: robot_name(index),
        listen,
        connect,
        // Nobody records, so the journals are sent to nobody; on disk they would only be left over.
        spool_mib: 0,
        ..LinkSettings::default()
    }
}

/// Returns how many processors this process kept busy meanwhile.
fn ready_until_asked() -> anyhow::Result<f64> {
    println!("ready");
    let (began, before) = (Instant::now(), processor_time()?);
    // A parent that is gone asks, too.
    let _ = std::io::stdin().read_to_end(&mut Vec::new());
    Ok((processor_time()? - before).as_secs_f64() / began.elapsed().as_secs_f64())
}

/// Raised once the parent asks for the end.
fn asked() -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    let raised = Arc::clone(&stop);
    std::thread::spawn(move || {
        let _ = std::io::stdin().read_to_end(&mut Vec::new());
        raised.store(true, Ordering::Relaxed);
    });
    stop
}

/// Real nodes, with a session for each robot or for so many of them together. The robots' first words need no trial: commands
/// are decided upon and obeyed, if only by standing still.
fn nodes(flags: &PartFlags) -> anyhow::Result<Told> {
    let arrivals = Arrivals::default();
    let mut sessions: Vec<Link> = Vec::new();
    let mut running: Vec<Running> = Vec::new();
    for index in 0..flags.robots {
        let mut configuration = Configuration {
            link: link_settings(flags, index, flags.part == Part::Edge),
            ..Configuration::default()
        };
        configuration.rates.stream_hz = flags.hz;
        configuration.operator.source = SourceKind::Simulated;
        let parts = Parts::new(configuration, None)?;
        if index % flags.together == 0 {
            sessions.push(Link::open(parts.link_settings())?);
        }
        let session = sessions.last().context("the first robot opens one")?;
        let link = session.about(robot_name(index).parse()?);
        if flags.part == Part::Operators {
            running.push(parts.operator(&link, |_| {})?);
        } else {
            running.push(parts.arbiter(&link)?);
            let (tap, ahead) = (arrivals.clone(), phase(index, flags));
            running.push(parts.robot_sim_as(&link, |robot| Tapped::new(robot, index, ahead, tap))?);
        }
    }
    let busy = ready_until_asked()?;
    let told = Told {
        busy,
        arrivals: arrivals.take(),
        ..Told::default()
    };
    running.iter().for_each(Running::stop);
    for node in running {
        if node.join().is_none() {
            bail!("a node panicked: please report this");
        }
    }
    sessions.iter().for_each(Link::close);
    Ok(told)
}

/// Where in the period a robot's states are due, evenly among the fleet.
fn phase(index: u32, flags: &PartFlags) -> Nanos {
    let phase = flags.period() * index / flags.robots;
    u64::try_from(phase.as_nanos()).unwrap_or(0)
}

fn bare(flags: &PartFlags) -> anyhow::Result<Told> {
    let stop = asked();
    if flags.part == Part::BareCommand {
        println!("ready");
        yardstick::command(&flags.endpoint, flags.period(), command_bytes(), &stop)?;
        return Ok(Told::default());
    }
    let passed = yardstick::obey(&flags.endpoint, setpoint_bytes(), &stop, || println!("ready"))?;
    Ok(Told {
        arrivals: passed.into_iter().map(|passed| arrival(0, passed)).collect(),
        ..Told::default()
    })
}

fn bare_fleet(flags: &PartFlags, side: Side, bytes: usize) -> anyhow::Result<Told> {
    let fleet = Fleet::start(side, flags.robots, &flags.endpoint, flags.period(), bytes)?;
    let busy = ready_until_asked()?;
    let of_robot = (0..).zip(fleet.heard());
    let arrivals = of_robot.flat_map(|(robot, heard)| heard.into_iter().map(move |passed| arrival(robot, passed)));
    Ok(Told {
        busy,
        arrivals: arrivals.collect(),
        ..Told::default()
    })
}

fn arrival(robot: u32, passed: Passed) -> Arrival {
    Arrival {
        robot,
        number: passed.number,
        sent_ns: passed.sent.0,
        arrived_ns: passed.arrived.0,
    }
}

fn flood(flags: &PartFlags) -> anyhow::Result<Told> {
    let link = Link::open(&link_settings(flags, 0, false))?;
    println!("ready");
    let stop = asked();
    let (began, mut pieces) = (Instant::now(), 0_u32);
    while !stop.load(Ordering::Relaxed) {
        let due = began + Duration::from_secs_f64(f64::from(pieces) * PIECE as f64 / FLOOD_BYTES_S);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        link.publish_as("bulk", Delivery::Bulk, Pace::Real, vec![0; PIECE])?;
        pieces += 1;
    }
    let told = Told {
        bytes: u64::from(pieces) * PIECE as u64,
        seconds: began.elapsed().as_secs_f64(),
        ..Told::default()
    };
    link.close();
    Ok(told)
}

fn take(flags: &PartFlags) -> anyhow::Result<Told> {
    let link = Link::open(&link_settings(flags, 0, false))?;
    let everything = Everything::about(&link)?;
    let began = Instant::now();
    ready_until_asked()?;
    let told = Told {
        bytes: everything.bytes(),
        seconds: began.elapsed().as_secs_f64(),
        ..Told::default()
    };
    link.close();
    Ok(told)
}
