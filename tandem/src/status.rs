//! `tandem status`: every robot of the network: who is there, who drives, how fast it goes round, and what holds it.

mod show;
mod tally;

pub(crate) use tally::{Robot, skew_words, worst_skew};

use std::collections::BTreeMap;
use std::io::IsTerminal as _;
use std::time::{Duration, Instant};

use clap::Args;
use crossbeam_channel::Receiver;
use crossterm::cursor::MoveTo;
use crossterm::terminal::{Clear, ClearType};
use serde_json::json;
use tandem_link::{Clock, Link, LinkSettings, Network, Noticed, Reach};
use tandem_wire::{Nanos, NodeName, Stamp, Topic};

use crate::nodes::{self, NodeFlags};
use crate::{Outcome, interrupt};

/// How long one look watches before it tells.
const LOOK: Duration = Duration::from_secs(2);
/// How often a screen is drawn.
const REDRAW: Duration = Duration::from_secs(1);
/// How long dialling may take for one look.
const DIAL: Duration = Duration::from_secs(5);
/// What is watched, besides who is there.
const TOPICS: [Topic; 11] = [
    Topic::Command,
    Topic::Proposal,
    Topic::Setpoint,
    Topic::State,
    Topic::Storage,
    Topic::Clock(NodeName::Operator),
    Topic::Clock(NodeName::Predictor),
    Topic::Clock(NodeName::Arbiter),
    Topic::Clock(NodeName::RobotSim),
    Topic::Clock(NodeName::Recorder),
    // Says when a device's samples and the robot's states reached the operator.
    Topic::Journal(NodeName::Operator),
];

#[derive(Args)]
pub(crate) struct StatusFlags {
    /// Looks once, for two seconds, even where a terminal could show more.
    #[arg(long)]
    once: bool,
    /// Prints one JSON object; with --watch one a second, each on a line.
    #[arg(long)]
    json: bool,
    /// Goes on until Ctrl-C; the default in a terminal.
    #[arg(long, conflicts_with = "once")]
    watch: bool,
    /// Without --robot all robots are shown.
    #[command(flatten)]
    node: NodeFlags,
}

pub(crate) fn run(flags: &StatusFlags) -> anyhow::Result<Outcome> {
    let settings = nodes::as_tool(&flags.node.configuration(&[])?.link);
    let reach = Reach::new(&settings, None)?;
    let interrupted = interrupt::catch()?;
    let live = flags.watch || (!flags.once && !flags.json && std::io::stdout().is_terminal());
    let Some(link) = dial(&settings, &reach, live, &interrupted)? else {
        return Ok(Outcome::Done);
    };
    let robots = watched(flags.node.robot(), &reach);
    let heard = visible(&reach);
    let network = Network::watch(&link, &robots, &heard)?;
    let mut watch = Watch {
        network,
        heard,
        robots: BTreeMap::new(),
        began: Clock::of_process().now(),
    };
    if live {
        watch.draw(flags.json, &interrupted);
    } else {
        watch.look(LOOK);
        watch.print(flags.json);
    }
    link.close();
    Ok(if live || !watch.robots.is_empty() {
        Outcome::Done
    } else {
        Outcome::Failed
    })
}

/// Connects; for one look not for ever. `None` if the user gave up.
fn dial(
    settings: &LinkSettings,
    reach: &Reach,
    live: bool,
    interrupted: &Receiver<()>,
) -> anyhow::Result<Option<Link>> {
    let gave_up = || interrupted.try_recv().is_ok();
    match live {
        true => nodes::connect(settings, reach, gave_up),
        false => nodes::connect_within(DIAL, settings, reach, gave_up),
    }
}

/// The robots to watch: the one that was named, or all that this member has to do with.
fn watched(named: Option<&str>, reach: &Reach) -> Vec<String> {
    let own = reach.secured.as_ref().map(|secured| &secured.identity.member.robots);
    match (named, own) {
        (Some(name), _) => vec![name.to_owned()],
        (None, Some(robots)) => robots.chunks().map(str::to_owned).collect(),
        (None, None) => vec!["*".to_owned()],
    }
}

/// What this member may hear of the topics; the rest would only be denied.
fn visible(reach: &Reach) -> Vec<Topic> {
    use tandem_site::policy::{hears, hears_all};
    let role = reach.secured.as_ref().map(|secured| secured.identity.member.role);
    let may = |topic: &Topic| role.is_none_or(|role| hears_all(role) || hears(role).contains(topic));
    TOPICS.into_iter().filter(may).collect()
}

struct Watch {
    network: Network,
    /// The topics that this member may hear.
    heard: Vec<Topic>,
    robots: BTreeMap<String, Robot>,
    began: Stamp,
}

impl Watch {
    fn take(&mut self, noticed: Noticed) {
        let Noticed {
            at,
            robot,
            topic,
            bytes,
            alive,
        } = noticed;
        let robot = self.robots.entry(robot.to_string()).or_default();
        match (topic, alive) {
            (Topic::Alive(node), true) => drop(robot.alive.insert(node)),
            (Topic::Alive(node), false) => drop(robot.alive.remove(&node)),
            _ => robot.hear(at, topic, &bytes),
        }
    }

    /// Watches for so long.
    fn look(&mut self, time: Duration) {
        let until = Instant::now() + time;
        while let Some(left) = until.checked_duration_since(Instant::now()) {
            if let Some(noticed) = self.network.next(left) {
                self.take(noticed);
            }
        }
        let now = Clock::of_process().now();
        self.robots.values_mut().for_each(|robot| robot.forget(now));
    }

    /// Tells once a second, until Ctrl-C.
    fn draw(&mut self, as_json: bool, interrupted: &Receiver<()>) {
        while interrupted.try_recv().is_err() {
            self.look(REDRAW);
            if !as_json && std::io::stdout().is_terminal() {
                print!("{}{}", Clear(ClearType::All), MoveTo(0, 0));
            }
            self.print(as_json);
        }
    }

    fn watched(&self) -> Nanos {
        Clock::of_process().now().since(self.began)
    }

    fn print(&self, as_json: bool) {
        let watched = self.watched();
        if as_json {
            let robots: Vec<_> = self
                .robots
                .iter()
                .map(|(name, robot)| show::json(name, robot, &self.heard, watched))
                .collect();
            println!(
                "{}",
                json!({ "watched_s": tandem_wire::seconds(watched), "robots": robots })
            );
        } else if self.robots.is_empty() {
            println!("no robot is there: no node says that it is, and no state comes");
        } else {
            self.robots
                .iter()
                .for_each(|(name, robot)| print!("{}", show::text(name, robot, &self.heard, watched)));
        }
    }
}
