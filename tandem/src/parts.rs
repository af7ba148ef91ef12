//! The nodes' shells, started from one configuration: what the demo and the processes share.

use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;

use anyhow::{Context as _, bail};
use tandem_arbiter::Arbiter;
use tandem_cesn::Model;
use tandem_link::{
    Clock, Device, Dropped, Faults, Link, LinkSettings, Running, ShellOptions, SpoolOptions, fresh_session, spawn,
};
use tandem_operator::Operator;
use tandem_predictor::Predictor;
use tandem_recorder::{Closed, Entry, Provenance, Recorder, RecorderConfig, Sinks};
use tandem_robot_sim::RobotSim;
use tandem_trials::{Blueprint, Configuration};
use tandem_wire::codec::to_bytes;
use tandem_wire::{NodeInfo, NodeName, Ports};

use crate::BUILD;
use crate::configuration::BadConfiguration;

/// The nodes without which no tick is complete.
pub(crate) const LOOP: [NodeName; 4] = [
    NodeName::Operator,
    NodeName::Predictor,
    NodeName::Arbiter,
    NodeName::RobotSim,
];

/// How long a closing recorder may take to write what it has.
pub(crate) const CLOSE_LIMIT: Duration = Duration::from_secs(5);

/// What nodes are built from.
pub(crate) struct Parts {
    blueprint: Blueprint,
    await_peers: Vec<NodeName>,
}

impl Parts {
    pub(crate) fn link_settings(&self) -> &LinkSettings {
        &self.blueprint.configuration().link
    }

    /// # Errors
    /// If settings that are each right cannot be right together.
    pub(crate) fn new(configuration: Configuration, model: Option<Model>) -> anyhow::Result<Self> {
        let blueprint = Blueprint::new(configuration, fresh_session(), model).map_err(BadConfiguration::from)?;
        Ok(Self::of(blueprint))
    }

    /// The same nodes for another run.
    ///
    /// # Errors
    /// As [`Parts::new`].
    pub(crate) fn afresh(&self) -> anyhow::Result<Self> {
        let (configuration, models) = (self.blueprint.configuration(), self.blueprint.models());
        let blueprint = Blueprint::with_models(configuration.clone(), fresh_session(), models.to_vec());
        Ok(Self {
            blueprint: blueprint.map_err(BadConfiguration::from)?,
            await_peers: self.await_peers.clone(),
        })
    }

    pub(crate) fn of(blueprint: Blueprint) -> Self {
        Self {
            blueprint,
            await_peers: LOOP.to_vec(),
        }
    }

    /// In lockstep nodes also wait for the recorder, so that the record begins with the first message.
    pub(crate) fn recorded_from_the_start(mut self) -> Self {
        self.await_peers.push(NodeName::Recorder);
        self
    }

    fn options<N: Ports>(&self) -> ShellOptions {
        let configuration = self.blueprint.configuration();
        let lockstep = self.blueprint.timing().pace == tandem_wire::Pace::Lockstep && N::NAME != NodeName::Recorder;
        let model = match N::NAME {
            NodeName::Predictor => self.blueprint.model_bytes(),
            _ => Vec::new(),
        };
        ShellOptions {
            timing: self.blueprint.timing(),
            info: NodeInfo {
                session: self.blueprint.session(),
                config: configuration.to_toml(),
                seed: configuration.rates.seed,
                build: BUILD.to_owned(),
                model,
            },
            impairment: configuration.impairment.clone(),
            queue: match N::NAME {
                NodeName::Recorder => configuration.recorder.input_queue,
                _ => ShellOptions::QUEUE,
            },
            await_peers: if lockstep {
                self.await_peers
                    .iter()
                    .copied()
                    .filter(|name| *name != N::NAME)
                    .collect()
            } else {
                vec![]
            },
            spool: SpoolOptions::new(&configuration.link, self.blueprint.session()),
            clocks: configuration.clock.clone(),
            faults: Faults::default(),
        }
    }

    pub(crate) fn operator(&self, link: &Link, show: impl FnMut(String) + Send + 'static) -> anyhow::Result<Running> {
        let mut show = show;
        self.watched_operator(link, move |status| show(status.to_string()))
    }

    /// An operator whose thoughts `watch` is told.
    pub(crate) fn watched_operator(
        &self,
        link: &Link,
        watch: impl FnMut(&tandem_operator::Status) + Send + 'static,
    ) -> anyhow::Result<Running> {
        let mut watch = watch;
        let local = move |_, output| {
            if let tandem_operator::Output::Status(status) = output {
                watch(&status);
            }
        };
        Ok(spawn(
            link,
            self.blueprint.operator(),
            self.options::<Operator>(),
            local,
        )?)
    }

    pub(crate) fn predictor(&self, link: &Link) -> anyhow::Result<Running> {
        let node = self.blueprint.predictor()?;
        Ok(spawn(link, node, self.options::<Predictor>(), |_, _| {})?)
    }

    pub(crate) fn arbiter(&self, link: &Link) -> anyhow::Result<Running> {
        let node = self.blueprint.arbiter().map_err(BadConfiguration::from)?;
        Ok(spawn(link, node, self.options::<Arbiter>(), |_, _| {})?)
    }

    pub(crate) fn robot_sim(&self, link: &Link) -> anyhow::Result<Running> {
        self.robot_sim_as(link, |robot| robot)
    }

    /// A robot inside something that watches it.
    pub(crate) fn robot_sim_as<N>(&self, link: &Link, wrap: impl FnOnce(RobotSim) -> N) -> anyhow::Result<Running>
    where
        N: Ports + Send + 'static,
        N::Output: Send,
    {
        let node = self.blueprint.robot_sim().map_err(BadConfiguration::from)?;
        Ok(spawn(link, wrap(node), self.options::<N>(), |_, _| {})?)
    }
}

/// A recorder at work, with its file and views.
pub(crate) struct RunningRecorder {
    node: Running,
    sinks: Arc<Mutex<Sinks>>,
}

impl RunningRecorder {
    pub(crate) const fn node(&self) -> &Running {
        &self.node
    }

    /// Ends the recorder: what has arrived is written, the file closed.
    pub(crate) fn stop(self) -> anyhow::Result<Closed> {
        self.node.stop();
        let dropped = self.node.dropped();
        if self.node.join().is_none() {
            bail!("the recorder panicked: please report this; the session file ends at its last flush");
        }
        let sinks = Arc::into_inner(self.sinks).and_then(|sinks| sinks.into_inner().ok());
        let mut sinks = sinks.context("the recorder's files are still in use")?;
        sinks.count_never_heard(dropped.by_topic());
        Ok(sinks.close(CLOSE_LIMIT))
    }
}

impl Parts {
    /// Opens the session file and the views, before anything is heard: a path that cannot be written is known at once.
    pub(crate) fn sinks(&self) -> anyhow::Result<Sinks> {
        let configuration = self.blueprint.configuration();
        let config = RecorderConfig::new(&configuration.recorder)
            .map_err(|error| BadConfiguration::Conflict(error.to_string()))?;
        let provenance = Provenance {
            robot: configuration.link.robot.parse()?,
            build: BUILD.to_owned(),
            epoch_unix_nanos: Clock::of_process().origin_unix_nanos(),
        };
        Ok(Sinks::open(&config, self.blueprint.timing(), &provenance)?)
    }

    pub(crate) fn recorder(&self, link: &Link, sinks: Sinks) -> anyhow::Result<RunningRecorder> {
        let sinks = Arc::new(Mutex::new(sinks));
        let shared = Arc::clone(&sinks);
        let back = Arc::new(OnceLock::<(Device, Dropped)>::new());
        let entrance = Arc::clone(&back);
        let local = move |_, output| {
            let is_look_due = is_counts(&output);
            if let Ok(mut sinks) = shared.lock() {
                let node = entrance.get().filter(|_| is_look_due);
                // Before the counts are written, which tell of it.
                if let Some((_, dropped)) = node {
                    sinks.count_never_heard(dropped.by_topic());
                }
                sinks.handle(output);
                for notice in sinks.notices() {
                    eprintln!("recorder: {notice}");
                }
                // A second's word that finds no room in a full queue is followed by the next second's.
                let _ = node.is_some_and(|(device, _)| device.send(to_bytes(&sinks.storage())));
            }
        };
        let recorder = Recorder::new(self.blueprint.timing()).in_session(self.blueprint.session());
        let node = spawn(link, recorder, self.options::<Recorder>(), local)?;
        // Nobody else sets it.
        let _ = back.set((node.device(), node.dropped()));
        Ok(RunningRecorder { node, sinks })
    }
}

impl Parts {
    /// The recorder's node alone, for whoever steps it by hand.
    pub(crate) fn watcher(&self) -> Recorder {
        Recorder::new(self.blueprint.timing())
    }
}

/// Once a second while messages come: then somebody has to look how the session file is doing.
fn is_counts(output: &tandem_recorder::Output) -> bool {
    matches!(output, tandem_recorder::Output::Write(heard) if matches!(heard.entry, Entry::Counts(_)))
}

/// Messages that are missing from the session file; a view may miss some without harm.
pub(crate) fn lost(closed: &Closed) -> u64 {
    closed.drops.session_file.total()
}
