//! The five nodes as processes of their own: flags, connecting, Ctrl-C.

mod dialling;
mod process;
mod recorder;
mod show;
mod watcher;

use std::io::IsTerminal as _;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use anyhow::bail;
use clap::{Args, ValueEnum};
use tandem_link::{Link, Observer, Running, Sighting};
use tandem_operator::{SourceKind, keyboard};
use tandem_settings::Choice as _;
use tandem_trials::Configuration;
use tandem_wire::{NodeName, Trial};

use crate::configuration::{self, BadConfiguration, CommonFlags};
use crate::parts::{LOOP, Parts};
use crate::trial::TrialMarks;
use crate::{Outcome, shipped};
pub(crate) use dialling::{as_tool, connect, connect_within, describe, dial};
pub(crate) use process::tell_of_journal;
use process::{POLL, Process};
pub(crate) use recorder::{RecorderFlags, recorder};
pub(crate) use show::ShowFlags;

/// Flags that say whom to talk to.
#[derive(Args, Clone, Debug)]
pub(crate) struct NodeFlags {
    /// The robot's name, as it stands in the keys.
    #[arg(long)]
    robot: Option<String>,
    /// Whom to connect to, such as tcp/127.0.0.1:7447; tried for ever.
    #[arg(long, value_name = "ENDPOINT")]
    connect: Vec<String>,
    /// Where to listen; whoever listens routes for the others, so one process is enough.
    #[arg(long, value_name = "ENDPOINT")]
    listen: Vec<String>,
    /// The folder with this machine's certificates, which tandem keys makes: every connection is TLS, and each role may do
    /// what is its own.
    #[arg(long, value_name = "DIR")]
    site: Option<PathBuf>,
    /// Which member of the site this is [default: the one whose role is needed].
    #[arg(long, value_name = "NAME")]
    member: Option<String>,
    /// Allows listening beyond this machine without certificates.
    #[arg(long)]
    insecure: bool,
    #[command(flatten)]
    common: CommonFlags,
}

impl NodeFlags {
    /// Whether they name anybody to talk to or as.
    pub(crate) fn is_network(&self) -> bool {
        self.robot.is_some() || !self.connect.is_empty() || !self.listen.is_empty()
    }

    /// The robot, if one is named.
    pub(crate) fn robot(&self) -> Option<&str> {
        self.robot.as_deref()
    }

    pub(crate) fn configuration(&self, more: &[(&str, String)]) -> Result<Configuration, BadConfiguration> {
        let list = |endpoints: &[String]| format!("{endpoints:?}");
        let mut overrides = more.to_vec();
        overrides.extend(self.robot.iter().map(|robot| ("link.robot", robot.clone())));
        if !self.connect.is_empty() {
            overrides.push(("link.connect", list(&self.connect)));
        }
        if !self.listen.is_empty() {
            overrides.push(("link.listen", list(&self.listen)));
        }
        let site = self
            .site
            .iter()
            .map(|folder| ("link.site", folder.display().to_string()));
        overrides.extend(site);
        overrides.extend(self.member.iter().map(|member| ("link.member", member.clone())));
        if self.insecure {
            overrides.push(("link.insecure", "true".into()));
        }
        configuration::load(&self.common, &overrides)
    }
}

/// Where the operator's motion comes from.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum SourceFlag {
    /// A simulated human, who drives one trial.
    Simulated,
    /// The keys of this terminal.
    Keyboard,
}

#[derive(Args)]
pub(crate) struct OperatorFlags {
    /// Where motion comes from.
    #[arg(long, value_enum)]
    source: Option<SourceFlag>,
    #[command(flatten)]
    node: NodeFlags,
}

#[derive(Args)]
pub(crate) struct PredictorFlags {
    /// The model file [default: trained on the shipped demonstrations].
    #[arg(long, value_name = "MODEL.cesn")]
    model: Option<PathBuf>,
    #[command(flatten)]
    node: NodeFlags,
}

#[derive(Args)]
pub(crate) struct ArbiterFlags {
    #[command(flatten)]
    node: NodeFlags,
}

#[derive(Args)]
pub(crate) struct RobotSimFlags {
    #[command(flatten)]
    node: NodeFlags,
}

/// `tandem operator`.
pub(crate) fn operator(flags: &OperatorFlags) -> anyhow::Result<Outcome> {
    let source = flags.source.map(|source| match source {
        SourceFlag::Simulated => SourceKind::Simulated,
        SourceFlag::Keyboard => SourceKind::Keyboard,
    });
    let source = source.map(|source| ("operator.source", source.name().to_owned()));
    let configuration = flags.node.configuration(source.as_slice())?;
    if configuration.operator.source == SourceKind::Replayed {
        let why = "operator.source = \"replayed\" is what tandem replay --drive sets: use that command".to_owned();
        return Err(BadConfiguration::Conflict(why).into());
    }
    let keyboard = configuration.operator.source == SourceKind::Keyboard;
    if keyboard && !std::io::stdin().is_terminal() {
        bail!(keyboard::KeyboardError::NotATerminal);
    }
    let parts = Parts::new(configuration, None)?;
    let Some(process) = Process::begin(&parts, NodeName::Operator)? else {
        return Ok(Outcome::Done);
    };
    let status = Arc::new(Mutex::new(String::from("waiting for the robot")));
    let shown = Arc::clone(&status);
    let running = parts.operator(&process.link, move |text| {
        if let Ok(mut status) = shown.lock() {
            *status = text;
        }
    })?;
    let steered = if keyboard {
        steer(&process, &running, &status)
    } else {
        run_one_trial(&process, &running)
    };
    // Whatever went wrong, the node says goodbye with the deadman released.
    let ended = process.end(running, NodeName::Operator);
    steered.and(ended)
}

/// Hands the terminal to the keyboard until the user leaves it.
fn steer(process: &Process, running: &Running, status: &Mutex<String>) -> anyhow::Result<()> {
    let device = running.device();
    let send = |bytes| {
        // A full queue drops the sample; the node counts a silent device as released.
        let _ = device.send(bytes);
        let leave = running.is_finished() || process.interrupted.try_recv().is_ok();
        if leave {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    };
    keyboard::run(send, || status.lock().map(|text| text.clone()).unwrap_or_default())?;
    Ok(())
}

/// Begins a trial for the simulated human once everybody is there, and says so again for whoever restarts.
fn run_one_trial(process: &Process, running: &Running) -> anyhow::Result<()> {
    let presence = Observer::of_presence(&process.link)?;
    let mut missing = LOOP.to_vec();
    let mut marks = TrialMarks::new(process.link.clone());
    while !running.is_finished() && process.interrupted.try_recv().is_err() {
        match presence.next(POLL) {
            Some(Sighting::Presence { peer, alive: true }) => missing.retain(|name| *name != peer),
            Some(_) => {}
            None if missing.is_empty() => {
                marks.mark(Trial::Begin {
                    number: 1,
                    label: "simulated".into(),
                })?;
                if process.interrupted.recv_timeout(REPEAT).is_ok() {
                    return Ok(());
                }
            }
            None => {}
        }
    }
    Ok(())
}

/// How often a running trial is announced again.
const REPEAT: Duration = Duration::from_secs(1);

/// `tandem predictor`.
pub(crate) fn predictor(flags: &PredictorFlags) -> anyhow::Result<Outcome> {
    let model = flags
        .model
        .as_ref()
        .map(|path| ("predictor.model", path.display().to_string()));
    let configuration = flags.node.configuration(model.as_slice())?;
    let model = shipped::model_or(&configuration.predictor.model)?;
    let parts = Parts::new(configuration, Some(model))?;
    serve(&parts, NodeName::Predictor, Parts::predictor)
}

/// `tandem arbiter`.
pub(crate) fn arbiter(flags: &ArbiterFlags) -> anyhow::Result<Outcome> {
    serve(
        &Parts::new(flags.node.configuration(&[])?, None)?,
        NodeName::Arbiter,
        Parts::arbiter,
    )
}

/// `tandem robot-sim`.
pub(crate) fn robot_sim(flags: &RobotSimFlags) -> anyhow::Result<Outcome> {
    serve(
        &Parts::new(flags.node.configuration(&[])?, None)?,
        NodeName::RobotSim,
        Parts::robot_sim,
    )
}

fn serve(
    parts: &Parts,
    name: NodeName,
    start: fn(&Parts, &Link) -> anyhow::Result<Running>,
) -> anyhow::Result<Outcome> {
    let Some(mut process) = Process::begin(parts, name)? else {
        return Ok(Outcome::Done);
    };
    let mut running = start(parts, &process.link)?;
    let mut lost = false;
    while process.wait_for_roster(&running)? {
        eprintln!("{name}: site.toml has changed, so this node ends, at rest, and all connections begin anew");
        lost |= matches!(process.end(running, name)?, Outcome::SamplesLost);
        if !process.begin_anew(name)? {
            return Ok(if lost { Outcome::SamplesLost } else { Outcome::Done });
        }
        // Another run, as after a start by hand: receivers take a session's numbers once and in order.
        running = start(&parts.afresh()?, &process.link)?;
    }
    let ended = process.end(running, name)?;
    Ok(if lost { Outcome::SamplesLost } else { ended })
}
