//! `tandem replay`: plays a session file into a Rerun view, or onto the network under another robot's name.
//!
//! It commands nobody: on the network it says what was seen (state, proposal, forecast, scene, trial), not what a robot
//! obeys. Only `--drive` does, in `drive.rs`, as an operator would.

mod drive;
mod keyboard;
mod player;
mod report;
mod show;
mod target;

use std::io::{self, IsTerminal as _};
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context as _, bail};
use clap::Args;
use crossbeam_channel::Receiver;
use tandem_link::Reach;
use tandem_recorder::{PLAYED, Place, Provenance, Recorded, RecorderConfig, RecorderSettings, Recording};
use tandem_wire::{Nanos, Pace, RobotName, SECOND, Stamp, Timing, Topic, keys};

use crate::configuration::BadConfiguration;
use crate::nodes::{self, NodeFlags};
use crate::session;
use crate::{BUILD, Outcome, interrupt, verify};
use player::{Plan, Player, Speed};
use report::Report;
use show::Show;
use target::{Network, Screen, Target};

#[derive(Args)]
pub(crate) struct ReplayFlags {
    /// The session file; later parts of it beside it are played with it.
    #[arg(value_name = "SESSION.mcap")]
    session: PathBuf,
    /// Further parts of the same session, instead of those beside the first.
    #[arg(value_name = "PART.mcap")]
    more: Vec<PathBuf>,
    /// Executes every node again from its own journal and compares each output byte for byte, instead of playing. Exit
    /// code 0: identical; 1: a node diverged; 3: the recording is incomplete.
    #[arg(long, conflicts_with_all = ["speed", "from", "until", "repeats", "paused", "topics", "view", "rrd", "robot", "listen", "connect"])]
    verify: bool,
    /// Notes the verdict beside the session file, as SESSION.verdict.json, where `tandem session info` finds it.
    #[arg(long, requires = "verify")]
    note: bool,
    /// Times the recorded speed, 0.1 to 100, or max [default: 1, and max into a file].
    #[arg(long, value_parser = speed)]
    speed: Option<Speed>,
    /// Begins this many seconds into the session.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    from: f64,
    /// Ends this many seconds into the session.
    #[arg(long, value_name = "SECONDS")]
    until: Option<f64>,
    /// Begins again at the end.
    #[arg(long = "loop")]
    repeats: bool,
    /// Waits at the beginning, until a key lets it go on or step.
    #[arg(long, conflicts_with = "rrd")]
    paused: bool,
    /// Plays these topics only, as in state,scene. Nothing that a robot obeys is published.
    #[arg(long, value_name = "TOPICS", value_delimiter = ',', value_parser = topic)]
    topics: Vec<Topic>,
    /// Publishes a topic under another name, as in state=ghost-state.
    #[arg(long, value_name = "TOPIC=NAME", value_parser = rename, requires = "robot")]
    rename: Vec<(Topic, String)>,
    /// Shows it in the Rerun viewer, at URL if one is given; this is the default.
    #[arg(long, value_name = "URL", num_args = 0..=1, require_equals = true, default_missing_value = "", conflicts_with_all = ["robot", "listen", "connect"])]
    view: Option<String>,
    /// Draws the arm as this URDF file describes it, with its meshes.
    #[arg(long, value_name = "PATH", conflicts_with_all = ["robot", "listen", "connect"])]
    urdf: Option<PathBuf>,
    /// Writes a Rerun recording instead.
    #[arg(long, value_name = "PATH", conflicts_with_all = ["view", "repeats", "robot", "listen", "connect"])]
    rrd: Option<PathBuf>,
    /// Drives the live robot --robot NAME along the recorded path, while somebody at this terminal holds the deadman, the
    /// space bar, down: the path of the tool, through that robot's own arbiter and limits. A robot that stands elsewhere is first eased in or
    /// refused; see `[replay]` in the configuration.
    #[arg(long, conflicts_with_all = ["verify", "repeats", "paused", "topics", "rename", "view", "rrd"])]
    drive: bool,
    /// Prints the summary as one JSON object.
    #[arg(long)]
    json: bool,
    /// With --robot NAME and --listen or --connect it is published for others, under that name.
    #[command(flatten)]
    node: NodeFlags,
}

fn speed(text: &str) -> Result<Speed, String> {
    if text == "max" {
        return Ok(Speed::Max);
    }
    let times: f64 = text
        .parse()
        .map_err(|error| format!("{error}: write a number, or max"))?;
    if !(0.1..=100.0).contains(&times) {
        return Err("choose 0.1 to 100, or max".to_owned());
    }
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "between 100 and 100 000"
    )]
    let per_mille = (times * 1000.0).round() as u32;
    Ok(Speed::PerMille(per_mille))
}

fn topic(text: &str) -> Result<Topic, String> {
    let known = PLAYED.into_iter().find(|topic| topic.suffix() == text);
    known.ok_or_else(|| format!("choose from {}", PLAYED.map(Topic::suffix).join(", ")))
}

/// A new name must not be a topic of ours: renamed to "command", a state would be one.
fn rename(text: &str) -> Result<(Topic, String), String> {
    let (old, new) = text.split_once('=').ok_or("write TOPIC=NAME")?;
    let old = topic(old)?;
    let fits = new.parse::<RobotName>().is_ok() && keys::parse(&format!("{}/r/{new}", keys::ROOT)).is_none();
    if fits {
        Ok((old, new.to_owned()))
    } else {
        Err(format!(
            "{new:?} cannot be used: choose letters, digits, '-' or '_', and no topic of Tandem's"
        ))
    }
}

pub(crate) fn run(flags: &ReplayFlags) -> anyhow::Result<Outcome> {
    if flags.verify {
        return verify::run(&flags.session, &flags.more, flags.json, flags.note);
    }
    let interrupted = interrupt::catch()?;
    if flags.drive {
        let recording = session::load(&flags.session, &flags.more)?;
        session::warn(&recording);
        let timing = session::timing(&recording);
        let (from, until) = (nanos(flags.from), flags.until.map_or(u64::MAX, nanos));
        let timed = recording.messages.iter().zip(instants(&recording.messages, timing));
        let between = timed.filter(|(_, at)| (from..=until).contains(at));
        let between: Vec<&Recorded> = between.map(|(message, _)| message).collect();
        return drive::run(flags, &recording, &between, &interrupted);
    }
    fits(flags)?;
    let (recording, reel) = session::open(&flags.session, &flags.more)?;
    session::warn(&recording);
    let timing = session::timing(&recording);
    // The session's time begins with its first message, whether that one is played or not.
    let timed = recording.messages.iter().zip(instants(&recording.messages, timing));
    let (messages, instants): (Vec<&Recorded<Place>>, Vec<Nanos>) = timed
        .filter(|(message, _)| flags.topics.is_empty() || flags.topics.contains(&message.topic))
        .filter(|(message, _)| !flags.node.is_network() || target::SHOWN.contains(&message.topic))
        .unzip();
    let plan = Plan {
        from: nanos(flags.from),
        until: flags.until.map_or(u64::MAX, nanos),
        speed: flags.speed.unwrap_or(if flags.rrd.is_some() {
            Speed::Max
        } else {
            Speed::PerMille(1000)
        }),
        repeats: flags.repeats,
        paused: flags.paused,
    };
    let player = Player::new(instants, plan, Stamp(0));
    if player.is_empty() {
        bail!("{}", nothing(flags, &recording));
    }
    let Some(target) = open(flags, &recording, timing, &interrupted)? else {
        return Ok(Outcome::Failed);
    };
    let began = Instant::now();
    let is_live = flags.rrd.is_none();
    let mut show = Show::new(&messages, reel, player, target, is_live, interrupted);
    let played = show.run();
    let report = show.end();
    played?;
    report.print(flags.json, flags.rrd.as_deref(), &recording, began.elapsed());
    Ok(match report {
        Report { was_there: false, .. } => Outcome::Failed,
        Report { lost: 1.., .. } => Outcome::SamplesLost,
        Report { .. } => Outcome::Done,
    })
}

/// Refuses flags of which nothing would be seen.
fn fits(flags: &ReplayFlags) -> Result<(), BadConfiguration> {
    let refuse = |why: String| Err(BadConfiguration::Conflict(why));
    if flags.paused && !(io::stdin().is_terminal() && io::stderr().is_terminal()) {
        return refuse("--paused needs a terminal: without keys it would never go on".to_owned());
    }
    let hidden = |topic: &&Topic| flags.node.is_network() && !target::SHOWN.contains(topic);
    let renamed = flags.rename.iter().map(|(topic, _)| topic);
    if let Some(topic) = flags.topics.iter().chain(renamed.clone()).find(hidden) {
        return refuse(format!(
            "{topic} is not published: a replay says nothing that a robot obeys. Choose from {}, or see it in a viewer, \
             without --robot, --listen and --connect",
            target::SHOWN.map(Topic::suffix).join(", ")
        ));
    }
    let left_out = |topic: &&Topic| !flags.topics.is_empty() && !flags.topics.contains(topic);
    if let Some(topic) = renamed.clone().find(left_out) {
        return refuse(format!(
            "--rename names {topic}, and --topics leaves it out: add it there"
        ));
    }
    Ok(())
}

/// Why there is nothing to play.
fn nothing(flags: &ReplayFlags, recording: &Recording<Place>) -> String {
    let is_there = |topic: &Topic| recording.messages.iter().any(|message| message.topic == *topic);
    let there = PLAYED.into_iter().filter(is_there).map(Topic::suffix);
    let chosen = flags.topics.iter().map(|topic| topic.suffix());
    if flags.topics.is_empty() || flags.topics.iter().any(is_there) {
        "there is nothing to play: no message of these topics lies between --from and --until".to_owned()
    } else {
        format!(
            "there is nothing to play: the session has no {}; it has {}",
            chosen.collect::<Vec<_>>().join(", "),
            there.collect::<Vec<_>>().join(", ")
        )
    }
}

/// A session that ends by then is short enough for the index of its Rerun recording to be kept in memory.
const INDEXED: Nanos = 600 * SECOND;

/// The target, or `None` if the user gave up before anybody answered.
fn open(
    flags: &ReplayFlags,
    recording: &Recording<Place>,
    timing: Timing,
    interrupted: &Receiver<()>,
) -> anyhow::Result<Option<Target>> {
    if flags.node.is_network() {
        return network(flags, recording, interrupted);
    }
    let robot = recording
        .robot
        .clone()
        .context("the file does not say which robot it is about")?;
    let provenance = Provenance {
        robot,
        build: BUILD.to_owned(),
        epoch_unix_nanos: recording.epoch_unix_nanos,
    };
    let urdf = flags.urdf.as_ref().map(|path| path.display().to_string());
    let mut settings = RecorderSettings {
        urdf: urdf.unwrap_or_default(),
        ..RecorderSettings::default()
    };
    match (&flags.rrd, flags.view.as_deref()) {
        (Some(path), _) => {
            settings.rrd = path.display().to_string();
            settings.rrd_index = recording.messages.last().is_none_or(|last| last.at.0 < INDEXED);
        }
        (None, None | Some("")) => settings.live = tandem_recorder::Live::Spawn,
        (None, Some(url)) => {
            settings.live = tandem_recorder::Live::Connect;
            url.clone_into(&mut settings.viewer);
        }
    }
    let config = RecorderConfig::new(&settings)
        .map_err(|error| BadConfiguration::Conflict(error.to_string()))?
        .for_replay();
    let is_file = flags.rrd.is_some();
    let waits = is_file || flags.speed == Some(Speed::Max);
    let screen = Screen::open(config, timing, provenance, waits, is_file)?;
    Ok(Some(Target::View(Box::new(screen))))
}

fn network(
    flags: &ReplayFlags,
    recording: &Recording<Place>,
    interrupted: &Receiver<()>,
) -> anyhow::Result<Option<Target>> {
    let settings = flags.node.configuration(&[])?.link;
    if recording
        .robot
        .as_ref()
        .is_some_and(|robot| robot.as_str() == settings.robot)
    {
        let why = format!(
            "{:?} is the recorded robot's own name: give the replay another one with --robot NAME",
            settings.robot
        );
        return Err(BadConfiguration::Conflict(why).into());
    }
    let pace = match flags.speed {
        Some(Speed::Max) => Pace::Lockstep,
        _ => Pace::Real,
    };
    if !settings.site.is_empty() {
        // It plays everybody's part, and a certificate stands for one.
        let why =
            "a replay cannot be published with certificates: leave --site out, and publish it on loopback".to_owned();
        return Err(BadConfiguration::Conflict(why).into());
    }
    let reach = Reach::new(&settings, None)?;
    eprintln!("replay: {}", nodes::describe(&settings, &reach));
    let Some(link) = nodes::connect(&settings, &reach, || interrupted.try_recv().is_ok())? else {
        return Ok(None);
    };
    let only_dials = settings.listen.is_empty();
    let network = Network::open(link, pace, flags.rename.clone(), only_dials)?;
    Ok(Some(Target::Network(network)))
}

/// When each message happened on the session's time axis, from the first one on: by arrival, or in lockstep, whose
/// messages arrive as fast as they can, by tick. Marks without a tick of their own stay where they arrived.
fn instants<B>(messages: &[Recorded<B>], timing: Timing) -> Vec<Nanos> {
    let mut newest = 0;
    let stamps = messages.iter().map(|message| {
        let at = match timing.pace {
            Pace::Real => message.at,
            Pace::Lockstep => Stamp::of_tick(message.header.tick, timing.period),
        };
        newest = at.0.max(newest);
        newest
    });
    let stamps: Vec<_> = stamps.collect();
    let first = stamps.first().copied().unwrap_or(0);
    stamps.into_iter().map(|at| at - first).collect()
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a cast of a number stops at the ends"
)]
fn nanos(seconds: f64) -> Nanos {
    (seconds * 1e9).round() as Nanos
}
