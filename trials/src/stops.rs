//! How a recorded robot stopped: when it last heard something that let it move, when it began to brake, when it stood,
//! and by what it moved again. From its own journal, on its own clock, millisecond by millisecond.
//!
//! States come every twenty milliseconds, which is too coarse to measure a stop with. So the robot is executed again
//! from its journal, and between two entries a copy of it is woken at every millisecond, which changes nothing: a robot
//! simulates what it missed. The copy shows what the arm did then.
//!
//! ```text
//!   the last setpoint        noticed    began                         at rest
//!   that let it move ────────── │ ──────── │ ──── braking ─────────────── │ ──── … ──── again, by a press
//!   (heard)                    motion is held; the arm takes it up with its next plan
//! ```

mod watch;

use tandem_recorder::{Evidence, RecordedNode, Run};
use tandem_robot_sim::RobotSim;
use tandem_wire::{
    Happening, Input, JournalBatch, JournalEntry, MILLISECOND, Nanos, Node, NodeName, Outbox, Ports, Reason, Session,
    Setpoint, Stamp, Topic, decode, restore,
};

use crate::reexecute::blueprint;
use crate::verdict::Missing;
use watch::Watch;

/// What becomes of one run of a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotRun {
    /// Which run.
    pub session: Session,
    /// Its stops from motion, in order.
    pub stops: Vec<Stop>,
    /// The first motion of this run, if there was any.
    pub first: Option<Again>,
    /// Setpoints that it admitted.
    pub setpoints: u64,
    /// Numbers between these that it did not: lost on their way, or refused.
    pub setpoints_missed: u64,
    /// Messages that it refused.
    pub refused: u64,
    /// Time executed.
    pub span: Nanos,
    /// What of the journal is missing, if anything is: stops in it are not here.
    pub missing: Option<Missing>,
}

/// One stop from motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// Why it stopped, as it said first.
    pub reason: Reason,
    /// The press that had permitted motion.
    pub press: u32,
    /// When the last setpoint that permitted motion had arrived.
    pub heard: Stamp,
    /// When it held motion.
    pub noticed: Stamp,
    /// When the arm began to brake: its first plan under that.
    pub began: Option<Stamp>,
    /// When every joint stood.
    pub at_rest: Option<Stamp>,
    /// How fast the tool was when the arm began to brake, in metres per second.
    pub speed_m_s: f64,
    /// How far the tool came from there, in metres.
    pub way_m: f64,
    /// The arm was seen to speed up while motion was held, or did not come to rest.
    pub drove_on: bool,
    /// By what it moved again.
    pub again: Option<Again>,
}

/// Motion that was permitted after a stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Again {
    /// When.
    pub at: Stamp,
    /// By which press.
    pub press: u32,
    /// Whether this press was made after the stop, as far as the robot can know: it is another one, or another operator's,
    /// or a release was heard in between; and after a silence it is not the first thing heard.
    pub fresh: bool,
}

/// Looks at every run of the robot. `progress` is told how many journal entries more are done.
pub fn stops(evidence: &Evidence, mut progress: impl FnMut(u64)) -> Vec<RobotRun> {
    let runs = evidence
        .journals
        .iter()
        .filter(|(run, _)| run.node == NodeName::RobotSim);
    runs.map(|(run, journal)| of_run(*run, evidence.nodes.get(run), journal, &mut progress))
        .collect()
}

fn of_run(
    run: Run,
    recorded: Option<&RecordedNode>,
    journal: &[JournalBatch],
    progress: &mut dyn FnMut(u64),
) -> RobotRun {
    let mut watch = Watch::new(run.session);
    match recorded.ok_or(Missing::Configuration) {
        Ok(recorded) => {
            if let Err(why) = follow(run.session, recorded, journal, &mut watch, progress) {
                watch.run.missing = Some(why);
            }
        }
        Err(why) => watch.run.missing = Some(why),
    }
    watch.finish()
}

/// Executes the run again and shows `watch` every millisecond of it.
fn follow(
    session: Session,
    recorded: &RecordedNode,
    journal: &[JournalBatch],
    watch: &mut Watch,
    progress: &mut dyn FnMut(u64),
) -> Result<(), Missing> {
    let blueprint = blueprint(session, recorded, Vec::new())?;
    watch.expect_acceleration(blueprint.configuration().robot.tool_acceleration_m_s2);
    let build = || {
        let built = blueprint.robot_sim();
        built.map_err(|why| Missing::Buildable { why: why.to_string() })
    };
    let (mut node, mut next, mut now) = (Some(build()?), 0_u64, None);
    for part in journal {
        for (entry, index) in part.entries.iter().zip(part.first..) {
            if index < next {
                continue;
            }
            if index > next {
                (node, now) = (None, None);
                watch.lose_sight(Missing::Gap {
                    from: next,
                    to: index - 1,
                    lost: part.lost.min(index - next),
                });
            }
            next = index.saturating_add(1);
            match (&mut node, &entry.what) {
                (Some(node), _) => step(node, entry, &mut now, watch),
                (None, Happening::Snapshot { bytes }) => {
                    let mut fresh = build()?;
                    node = restore(&mut fresh, bytes).is_ok().then_some(fresh);
                }
                (None, _) => {}
            }
        }
        progress(part.entries.len() as u64);
    }
    Ok(())
}

fn step(node: &mut RobotSim, entry: &JournalEntry, now: &mut Option<Stamp>, watch: &mut Watch) {
    let Some(input) = entry.what.input() else { return };
    if let Some(before) = now.replace(entry.at) {
        between(node, before, entry.at, watch);
    }
    let refused = node.refused().count;
    node.step(entry.at, RobotSim::event(input), &mut Outbox::default());
    watch.run.refused = node.refused().count;
    if let Input::Sample {
        topic: Topic::Setpoint,
        bytes,
    } = input
        && node.refused().count == refused
        && let Ok(setpoint) = decode::<Setpoint>(bytes)
    {
        watch.hear(entry.at, &setpoint);
    }
    watch.look(entry.at, node);
}

/// Every millisecond between two entries, as a copy of the robot shows it.
fn between(node: &RobotSim, before: Stamp, after: Stamp, watch: &mut Watch) {
    watch.run.span += after.since(before);
    let mut at = Stamp((before.0 / MILLISECOND + 1) * MILLISECOND);
    if at >= after || !watch.is_busy(node) {
        return;
    }
    let (mut copy, mut outbox) = (node.clone(), Outbox::default());
    while at < after {
        copy.step(at, RobotSim::event(Input::Wake), &mut outbox);
        outbox.drain().for_each(drop);
        watch.look(at, &copy);
        at = at.after(MILLISECOND);
    }
}
