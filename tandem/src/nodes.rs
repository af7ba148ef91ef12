//! The five nodes as processes of their own: flags, connecting, Ctrl-C.

use std::io::IsTerminal as _;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use anyhow::bail;
use clap::{Args, ValueEnum};
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded, unbounded};
use tandem_link::{JournalReport, Link, LinkSettings, Observer, Reach, Running, Sighting};
use tandem_operator::{SourceKind, keyboard};
use tandem_recorder::Notice;
use tandem_site::Role;
use tandem_trials::Configuration;
use tandem_wire::{NodeName, Trial};

use crate::configuration::{self, BadConfiguration, CommonFlags};
use crate::parts::{CLOSE_LIMIT, LOOP, Parts, lost};
use crate::trial::TrialMarks;
use crate::{Outcome, interrupt, keys, shipped};

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

#[derive(Args)]
pub(crate) struct RecorderFlags {
    /// The session file; the Rerun recording goes beside it.
    #[arg(long, value_name = "PATH")]
    record: PathBuf,
    /// Shows the session live in Rerun: in a viewer of this machine (spawn), in one that listens elsewhere
    /// (connect=URL), through a server that browsers come to (serve), or writes the recording there (save=PATH.rrd).
    #[arg(long, value_name = "spawn|serve|connect=URL|save=PATH", num_args = 0..=1, default_missing_value = "spawn")]
    view: Option<ViewFlag>,
    /// Draws the arm as this URDF file describes it, with its meshes, instead of its collision shapes.
    #[arg(long, value_name = "PATH")]
    urdf: Option<PathBuf>,
    #[command(flatten)]
    node: NodeFlags,
}

/// Where a session is shown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum ViewFlag {
    Spawn,
    Serve,
    Connect(String),
    Save(String),
}

impl FromStr for ViewFlag {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            None if text == "spawn" => Ok(Self::Spawn),
            None if text == "serve" => Ok(Self::Serve),
            Some(("connect", url)) if !url.is_empty() => Ok(Self::Connect(url.to_owned())),
            Some(("save", path)) if !path.is_empty() => Ok(Self::Save(path.to_owned())),
            _ => Err("use spawn, serve, connect=URL or save=PATH".to_owned()),
        }
    }
}

impl ViewFlag {
    /// The settings that mean the same.
    pub(crate) fn overrides(&self) -> Vec<(&'static str, String)> {
        match self {
            Self::Spawn => vec![("recorder.live", "spawn".to_owned())],
            Self::Serve => vec![("recorder.live", "serve".to_owned())],
            Self::Connect(url) => vec![
                ("recorder.live", "connect".to_owned()),
                ("recorder.viewer", url.clone()),
            ],
            Self::Save(path) => vec![("recorder.rrd", path.clone())],
        }
    }
}

/// A process around one node: connected, and listening for Ctrl-C.
struct Process {
    link: Link,
    interrupted: Receiver<()>,
}

impl Process {
    /// Connects, for as long as it takes; `None` if the user gave up first.
    fn begin(parts: &Parts, name: NodeName) -> anyhow::Result<Option<Self>> {
        let interrupted = interrupt::catch()?;
        let settings = parts.link_settings();
        let reach = Reach::new(settings, Some(Role::of(name)))?;
        eprintln!("{name}: {}", describe(settings, &reach));
        let Some(link) = connect(settings, &reach, || interrupted.try_recv().is_ok())? else {
            return Ok(None);
        };
        eprintln!("{name}: ready, robot {:?}; Ctrl-C ends it", link.robot().as_str());
        Ok(Some(Self { link, interrupted }))
    }

    /// Runs until Ctrl-C, or until the node ends by itself.
    fn wait(&self, running: &Running) {
        while !running.is_finished() && self.interrupted.recv_timeout(POLL).is_err() {}
    }

    fn end(&self, running: Running, name: NodeName) -> anyhow::Result<Outcome> {
        running.stop();
        let Some(report) = running.join() else {
            bail!("{name} panicked: please report this")
        };
        self.link.close();
        if let Some(awaited) = report.awaited {
            bail!("{name}: {awaited} did not answer for two seconds, so lockstep cannot go on");
        }
        tell_of_journal(name, &report.journal);
        let lost = report.dropped + report.journal.lost;
        eprintln!(
            "{name}: ended after {} steps, {lost} inputs or journal entries lost",
            report.steps
        );
        Ok(if lost > 0 { Outcome::SamplesLost } else { Outcome::Done })
    }
}

/// Says what a person should know of a journal that no recorder took whole.
pub(crate) fn tell_of_journal(name: NodeName, journal: &JournalReport) {
    if journal.disk_failed {
        eprintln!("{name}: the disk failed, so its journal was sent and not kept; gaps in it stay");
    }
    if let Some(folder) = &journal.kept {
        eprintln!(
            "{name}: no recorder said that it has all of the journal, so it stays in {}",
            folder.display()
        );
    }
}

/// Connects, for as long as it takes; `None` if the user gave up first, as `gave_up` tells.
pub(crate) fn connect(
    settings: &LinkSettings,
    reach: &Reach,
    gave_up: impl Fn() -> bool,
) -> anyhow::Result<Option<Link>> {
    let (sender, opened) = bounded(1);
    let (robot, dialled) = (settings.robot.parse()?, reach.clone());
    // Dialling blocks until somebody answers; meanwhile Ctrl-C must still work.
    std::thread::spawn(move || drop(sender.send(Link::open_at(robot, &dialled))));
    let mut knocking = Knocking::new(reach);
    loop {
        match opened.recv_timeout(POLL) {
            Ok(link) => return Ok(Some(link?)),
            Err(RecvTimeoutError::Disconnected) => bail!("the connection attempt ended without a result"),
            Err(RecvTimeoutError::Timeout) if gave_up() => return Ok(None),
            Err(RecvTimeoutError::Timeout) => knocking.tell(),
        }
    }
}

/// Says, while a process dials with certificates, why nobody lets it in.
struct Knocking<'a> {
    reach: &'a Reach,
    next: Instant,
    answers: (Sender<String>, Receiver<String>),
    said: Vec<String>,
}

impl<'a> Knocking<'a> {
    fn new(reach: &'a Reach) -> Self {
        Self {
            reach,
            next: Instant::now() + KNOCK,
            answers: unbounded(),
            said: Vec::new(),
        }
    }

    fn tell(&mut self) {
        if Instant::now() >= self.next {
            self.next = Instant::now() + KNOCK_AGAIN;
            let (reach, sender) = (self.reach.clone(), self.answers.0.clone());
            std::thread::spawn(move || {
                for door in reach.knock() {
                    let why = match door.answer {
                        Err(why) => why.to_string(),
                        Ok(None) => format!(
                            "somebody answers at {}, but not as Tandem without certificates does; if it has some, say --site",
                            door.endpoint
                        ),
                        Ok(Some(_)) => continue,
                    };
                    // Whoever got in meanwhile does not listen any more.
                    drop(sender.send(why));
                }
            });
        }
        for why in self.answers.1.try_iter() {
            if !self.said.contains(&why) {
                eprintln!("still dialling: {why}");
                self.said.push(why);
            }
        }
    }
}

/// How long dialling may take before somebody looks why.
const KNOCK: Duration = Duration::from_secs(2);
/// How often it is looked again.
const KNOCK_AGAIN: Duration = Duration::from_secs(10);

/// How often a process looks whether its node has ended.
const POLL: Duration = Duration::from_millis(100);

/// Whom it will talk to, in words.
pub(crate) fn describe(settings: &LinkSettings, reach: &Reach) -> String {
    let who = reach.secured.as_ref().map(|secured| {
        let (member, days) = (&secured.identity.member, secured.identity.certificate.days_left());
        let soon = if days < keys::SOON {
            format!(", whose certificate ENDS in {days} days")
        } else {
            String::new()
        };
        format!("as {}{soon}, ", member.common_name)
    });
    let who = who.unwrap_or_default();
    match (reach.listen.as_slice(), reach.connect.as_slice()) {
        ([], connect) if settings.connect.is_empty() => {
            format!(
                "{who}connecting to {} (no --listen or --connect given)",
                connect.join(", ")
            )
        }
        ([], connect) => format!("{who}connecting to {}", connect.join(", ")),
        (listen, []) => format!("{who}listening on {}", listen.join(", ")),
        (listen, connect) => format!(
            "{who}listening on {}, connecting to {}",
            listen.join(", "),
            connect.join(", ")
        ),
    }
}

/// `tandem operator`.
pub(crate) fn operator(flags: &OperatorFlags) -> anyhow::Result<Outcome> {
    let source = flags
        .source
        .map(|source| ("operator.source", format!("{source:?}").to_lowercase()));
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
    let Some(process) = Process::begin(parts, name)? else {
        return Ok(Outcome::Done);
    };
    let running = start(parts, &process.link)?;
    process.wait(&running);
    process.end(running, name)
}

/// `tandem recorder`.
pub(crate) fn recorder(flags: &RecorderFlags) -> anyhow::Result<Outcome> {
    let mut overrides = vec![
        ("recorder.path", flags.record.display().to_string()),
        ("recorder.rrd", flags.record.with_extension("rrd").display().to_string()),
    ];
    overrides.extend(flags.view.iter().flat_map(ViewFlag::overrides));
    overrides.extend(
        flags
            .urdf
            .iter()
            .map(|path| ("recorder.urdf", path.display().to_string())),
    );
    let parts = Parts::new(flags.node.configuration(&overrides)?, None)?;
    let sinks = parts.sinks()?;
    let process = match Process::begin(&parts, NodeName::Recorder) {
        Ok(Some(process)) => process,
        // An empty session file is a whole one, too.
        gave_up => {
            // Nothing was heard, so nothing can have been lost.
            let _ = sinks.close(CLOSE_LIMIT);
            return gave_up.map(|_| Outcome::Done);
        }
    };
    let recorder = parts.recorder(&process.link, sinks)?;
    process.wait(recorder.node());
    let closed = recorder.stop()?;
    process.link.close();
    for ended in &closed.sinks {
        let taken = ended
            .messages
            .map_or("an unknown number of".into(), |messages| messages.to_string());
        eprintln!(
            "recorder: {} ended after {taken} messages, {} missed",
            ended.sink, ended.dropped
        );
    }
    for notice in &closed.notices {
        eprintln!("recorder: {notice}");
    }
    let channels: Vec<_> = closed.drops.session_file.by_channel().collect();
    if !channels.is_empty() {
        eprintln!("recorder: {}", Notice::Dropped { channels });
    }
    Ok(if lost(&closed) > 0 {
        Outcome::SamplesLost
    } else {
        Outcome::Done
    })
}
