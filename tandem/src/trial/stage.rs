//! Where trials take place: two joined Zenoh sessions and a recorder that stay, and four nodes that are built anew for
//! every trial from its own configuration.
//!
//! Nodes that live for one trial keep conditions apart for certain: nothing that one law learnt or one human felt is
//! left for the next. Before new ones start, the old ones' presence has gone, so that nobody waits for a ghost.

mod following;
mod recording;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use anyhow::bail;
use crossbeam_channel::Receiver;
use tandem_link::{Link, Observer, Running, Sighting};
use tandem_operator::Status;
use tandem_trials::{Blueprint, Trace, Tracer};
use tandem_wire::{JournalBatch, NodeName, Pace, Topic, Trial, Vec3, decode, seconds};

pub(crate) use self::following::{End, Following};
use self::recording::Recording;
use super::TrialMarks;
use crate::parts::{LOOP, Parts};

/// How long the nodes may take to find each other, or to be gone.
const GATHERING: Duration = Duration::from_secs(10);
/// How long the last words may be on their way.
const DRAINING: Duration = Duration::from_secs(1);
/// How often the nodes are looked after while nothing is heard.
const POLL: Duration = Duration::from_millis(50);
/// In lockstep: control periods between two trials, so that their times do not touch.
const GAP_TICKS: u32 = 10;

/// A trial that was driven.
#[derive(Debug)]
pub(crate) struct Driven {
    pub(crate) end: End,
    pub(crate) trace: Trace,
    /// The session file, relative to the run's folder.
    pub(crate) session: String,
    /// Where in the session it began and how long it took, in the session's own seconds.
    pub(crate) began_s: f64,
    pub(crate) lasted_s: f64,
}

/// Where a simulated human wished to be, by the robot's ticks.
type Wishes = Arc<Mutex<Vec<(u32, Vec3)>>>;

/// What is to be driven.
pub(crate) struct Task<'a> {
    pub(crate) number: u32,
    pub(crate) label: String,
    pub(crate) blueprint: &'a Blueprint,
    pub(crate) limit_s: u32,
}

/// Sessions, recorder and whoever watches.
pub(crate) struct Stage {
    edge: Link,
    remote: Link,
    pace: Pace,
    folder: PathBuf,
    observer: Observer,
    marks: TrialMarks,
    recording: Option<Recording>,
    present: BTreeSet<NodeName>,
    /// Journal entries seen of the nodes at work.
    journalled: u64,
    next_tick: u32,
    messages_lost: u64,
    sessions: Vec<String>,
}

impl Stage {
    /// Joins two sessions over loopback, as the demo does, for trials whose files go into `folder`.
    pub(crate) fn open(blueprint: &Blueprint, folder: PathBuf) -> anyhow::Result<Self> {
        let robot = blueprint.configuration().link.robot.parse()?;
        let pace = blueprint.timing().pace;
        let (edge, remote) = Link::open_pair(&robot)?;
        Ok(Self {
            observer: Observer::new(&edge, pace)?,
            marks: TrialMarks::new(edge.clone()),
            edge,
            remote,
            pace,
            folder,
            recording: None,
            present: BTreeSet::new(),
            journalled: 0,
            next_tick: 0,
            messages_lost: 0,
            sessions: Vec::new(),
        })
    }

    /// In lockstep: the number of the next trial's first control period.
    pub(crate) const fn next_tick(&self) -> u32 {
        self.next_tick
    }

    /// Messages that are missing from the session files that were closed so far.
    pub(crate) const fn messages_lost(&self) -> u64 {
        self.messages_lost
    }

    /// The session files, relative to the run's folder.
    pub(crate) fn sessions(&self) -> &[String] {
        &self.sessions
    }

    /// Ends the recorder and the sessions: what was heard is in the files.
    pub(crate) fn close(mut self) -> anyhow::Result<Closed> {
        let closed = self.close_recording();
        self.remote.close();
        self.edge.close();
        closed.map(|()| Closed {
            messages_lost: self.messages_lost(),
            sessions: self.sessions().to_vec(),
        })
    }

    /// Drives a trial to its end. `steer` is called with the nodes' keyboard and whoever follows the trial, and returns
    /// when the trial is over; [`Following::until_over`] does for simulated humans.
    pub(crate) fn drive(
        &mut self,
        task: &Task<'_>,
        interrupted: &Receiver<()>,
        steer: impl FnOnce(&mut Following<'_>) -> anyhow::Result<End>,
    ) -> anyhow::Result<Driven> {
        self.journalled = 0;
        let parts = Parts::of(task.blueprint.clone()).recorded_from_the_start();
        let session = self
            .recording
            .as_ref()
            .map(|recording| recording.file.clone())
            .unwrap_or_default();
        let wishes = Wishes::default();
        let nodes = self.start(&parts, &wishes)?;
        let tick = self.next_tick;
        let mut following = Following {
            tracer: Tracer::of_trial(task.number),
            nodes: &nodes,
            stage: self,
            interrupted,
            newest: [None; 4],
            progressed: Instant::now(),
            began: None,
            limit_ticks: ticks(task),
        };
        let begin = Trial::Begin {
            number: task.number,
            label: task.label.clone(),
        };
        let end = match following.gather() {
            Err(error) => Ok(End::Aborted(error.to_string())),
            Ok(()) => following.stage.marks.mark_at(tick, begin).and_then(|()| {
                following.progressed = Instant::now();
                steer(&mut following)
            }),
        };
        let newest = following.newest[0].unwrap_or(tick);
        let began = following.began;
        let mut tracer = std::mem::take(&mut following.tracer);
        let outcome = Trial::End {
            number: task.number,
            outcome: end.as_ref().map_or("failed".to_owned(), End::to_string),
        };
        let marked = self.marks.mark_at(newest, outcome);
        let stopped = self.stop(nodes, &mut tracer);
        let end = end?;
        marked?;
        stopped?;
        if self.pace == Pace::Lockstep {
            self.next_tick = newest.saturating_add(GAP_TICKS);
        }
        if let Ok(wishes) = wishes.lock() {
            wishes.iter().for_each(|(tick, wish)| tracer.see_wish(*tick, *wish));
        }
        let trace = tracer.trace();
        let period = seconds(task.blueprint.timing().period);
        let began_s = match self.pace {
            Pace::Lockstep => f64::from(trace.began_at) * period,
            Pace::Real => began.map_or(0.0, |began| seconds(began.0.saturating_sub(self.first_message().0))),
        };
        Ok(Driven {
            end,
            lasted_s: trace.ticks.last().map_or(0.0, |last| f64::from(last.tick) * period),
            trace,
            session,
            began_s,
        })
    }

    fn start(&self, parts: &Parts, wishes: &Wishes) -> anyhow::Result<Vec<(NodeName, Running)>> {
        let wishes = Arc::clone(wishes);
        let watch = move |status: &Status| {
            if let (Some(seen), Some(wish), Ok(mut wishes)) = (status.seen, status.wish, wishes.lock()) {
                wishes.push((seen.tick, wish));
            }
        };
        Ok(vec![
            (NodeName::Operator, parts.watched_operator(&self.remote, watch)?),
            (NodeName::Predictor, parts.predictor(&self.edge)?),
            (NodeName::Arbiter, parts.arbiter(&self.edge)?),
            (NodeName::RobotSim, parts.robot_sim(&self.edge)?),
        ])
    }

    /// Ends the nodes, takes in the rest of their journals, and waits until nobody is there any more.
    fn stop(&mut self, nodes: Vec<(NodeName, Running)>, tracer: &mut Tracer) -> anyhow::Result<()> {
        let mut entries = 0;
        for (_, node) in &nodes {
            node.stop();
        }
        for (_, node) in nodes {
            // A node that panicked has made itself known by its silence; its journal's end is lost.
            if let Some(report) = node.join() {
                entries += report.journal.entries - report.journal.lost;
            }
        }
        let limit = Instant::now() + DRAINING;
        while self.journalled < entries {
            match self.observer.next(limit.saturating_duration_since(Instant::now())) {
                Some(sighting) => self.see(&sighting, tracer),
                None => break,
            }
        }
        self.settle(&LOOP)
    }

    /// Waits until these nodes' presence is gone.
    fn settle(&mut self, gone: &[NodeName]) -> anyhow::Result<()> {
        let limit = Instant::now() + GATHERING;
        while let Some(name) = gone.iter().copied().find(|name| self.present.contains(name)) {
            match self.observer.next(limit.saturating_duration_since(Instant::now())) {
                Some(sighting) => self.note(&sighting),
                None => bail!(
                    "{name} has ended, but its presence did not vanish within {} s",
                    GATHERING.as_secs()
                ),
            }
        }
        Ok(())
    }

    fn see(&mut self, sighting: &Sighting, tracer: &mut Tracer) {
        self.note(sighting);
        if let Sighting::Sample { topic, bytes, .. } = sighting {
            tracer.see(*topic, bytes);
        }
    }

    fn note(&mut self, sighting: &Sighting) {
        if let (Some(recording), Sighting::Sample { topic, at, .. }) = (&mut self.recording, sighting)
            && !matches!(topic, Topic::Journal(_))
        {
            recording.first.get_or_insert(*at);
        }
        match sighting {
            Sighting::Presence { peer, alive: true } => {
                self.present.insert(*peer);
            }
            Sighting::Presence { peer, alive: false } => {
                self.present.remove(peer);
            }
            Sighting::Sample {
                topic: Topic::Journal(_),
                bytes,
                ..
            } => decode::<JournalBatch>(bytes)
                .into_iter()
                .for_each(|batch| self.journalled += batch.body.entries.len() as u64),
            Sighting::Sample { .. } => {}
        }
    }
}

/// What a run left.
pub(crate) struct Closed {
    pub(crate) messages_lost: u64,
    pub(crate) sessions: Vec<String>,
}

/// So many control periods a trial may take: the human's own limit, and some for who does not even begin.
fn ticks(task: &Task<'_>) -> u32 {
    let periods = f64::from(task.limit_s) / task.blueprint.timing().period_s().max(1e-3);
    // At most 3600 s of a millisecond each.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive and below 4 million"
    )]
    let periods = periods.ceil() as u32;
    periods.saturating_add(30)
}

#[cfg(test)]
mod tests {
    use tandem_link::config::PaceName;
    use tandem_link::fresh_session;
    use tandem_trials::Configuration;

    use super::*;

    #[test]
    fn a_node_that_dies_aborts_the_trial_and_the_next_one_runs() {
        let folder = std::env::temp_dir().join(format!("tandem-stage-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let model = crate::shipped::model().unwrap();
        let blueprint = |first_tick| {
            let mut configuration = Configuration::default();
            configuration.rates.pace = PaceName::Max;
            configuration.rates.first_tick = first_tick;
            Blueprint::new(configuration, fresh_session(), Some(model.clone())).unwrap()
        };
        let first = blueprint(0);
        let mut stage = Stage::open(&first, folder.clone()).unwrap();
        stage.record(&first, || "session.mcap".to_owned()).unwrap();
        let (_keep, interrupted) = crossbeam_channel::bounded(1);
        let task = |number, blueprint| Task {
            number,
            label: "test".to_owned(),
            blueprint,
            limit_s: 15,
        };
        let killed = stage.drive(&task(1, &first), &interrupted, |following| {
            while following.tracer().elapsed_ticks() < 20 {
                assert_eq!(following.poll(POLL), None);
            }
            following.nodes[1].1.stop();
            Ok(following.until_over(|_| {}))
        });
        let End::Aborted(why) = killed.unwrap().end else {
            panic!("it should be aborted");
        };
        assert!(why.contains("predictor"), "{why}");
        let second = blueprint(stage.next_tick());
        let driven = stage.drive(&task(2, &second), &interrupted, |following| {
            Ok(following.until_over(|_| {}))
        });
        let driven = driven.unwrap();
        assert_eq!(driven.end, End::Over);
        let figures = tandem_trials::Measures::of(&driven.trace);
        assert!(
            figures.reached_goal && figures.tracking_wish_mean_m.is_some(),
            "{figures:?}"
        );
        assert!(driven.began_s > 2.0, "it began after the first one: {}", driven.began_s);
        assert_eq!(stage.close().unwrap().messages_lost, 0);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
