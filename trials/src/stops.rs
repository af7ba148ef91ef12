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

use tandem_recorder::{Evidence, RecordedNode, Run};
use tandem_robot_sim::RobotSim;
use tandem_robot_sim::arm::Arm;
use tandem_robot_sim::kinematics::{JointVector, forward, tool_jacobian};
use tandem_wire::{
    Envelope, Happening, Input, JournalBatch, JournalEntry, MILLISECOND, Motion, Nanos, Node, NodeName, Outbox, Ports,
    Reason, SECOND, Session, Setpoint, Stamp, Topic, Vec3, decode, restore,
};

use crate::reexecute::blueprint;
use crate::verdict::Missing;

/// An arm that still moves so long after it began to brake, or that moves faster than when it began, has driven on.
const BRAKING_LIMIT: Nanos = SECOND;
/// For so long an arm that was speeding up may go on to when it begins to brake, in seconds: its joints turn from one
/// acceleration to the other within their limits on jerk.
const TURNING_S: f64 = 0.010;

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
    watch.faster = blueprint.configuration().robot.tool_acceleration_m_s2 * TURNING_S;
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
    let input = match &entry.what {
        Happening::Sample { topic, bytes } => Input::Sample { topic: *topic, bytes },
        Happening::Wake => Input::Wake,
        Happening::Presence { peer, alive } => Input::Presence {
            peer: *peer,
            alive: *alive,
        },
        Happening::Stop => Input::Stop,
        Happening::Missed { topic, tick } => Input::Missed {
            topic: *topic,
            tick: *tick,
        },
        Happening::Output { .. } | Happening::Snapshot { .. } => return,
    };
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

/// A press of the deadman. Each operator numbers its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Press {
    holder: Option<Session>,
    number: u32,
}

/// What is known of the setpoints admitted since motion was last held.
#[derive(Clone, Copy, Debug, Default)]
struct Heard {
    /// What came first, if anything did: the press that it permitted motion by, or a word that holds motion.
    first: Option<Option<Press>>,
    /// A release was among it.
    released: bool,
}

const NO_PRESS: Press = Press {
    holder: None,
    number: 0,
};

struct Watch {
    run: RobotRun,
    motion: Option<Motion>,
    /// The last setpoint that permitted motion and was admitted, and by which press.
    permitted: Stamp,
    press: Press,
    heard: Heard,
    /// The stop under way, the press that had permitted motion, and where the tool was when the arm began to brake.
    open: Option<Stop>,
    stopped: Press,
    braked_at: Vec3,
    /// How much faster the tool may still become, in metres per second.
    faster: f64,
    /// The newest number of the arbiter's run that is listened to.
    newest: Option<(Session, u64)>,
}

impl Watch {
    const fn new(session: Session) -> Self {
        Self {
            run: RobotRun {
                session,
                stops: Vec::new(),
                first: None,
                setpoints: 0,
                setpoints_missed: 0,
                refused: 0,
                span: 0,
                missing: None,
            },
            motion: None,
            permitted: Stamp(0),
            press: NO_PRESS,
            heard: Heard {
                first: None,
                released: false,
            },
            open: None,
            stopped: NO_PRESS,
            braked_at: Vec3::ZERO,
            faster: 0.0,
            newest: None,
        }
    }

    /// Whether a millisecond could show anything: an arm that stands while motion is held has nothing to show.
    fn is_busy(&self, node: &RobotSim) -> bool {
        node.motion().is_permitted() || !node.arm().is_at_rest() || self.motion.is_none_or(Motion::is_permitted)
    }

    /// Entries are missing: a stop that was under way has no end.
    fn lose_sight(&mut self, missing: Missing) {
        self.run.stops.extend(self.open.take());
        self.motion = None;
        self.heard = Heard::default();
        self.run.missing.get_or_insert(missing);
    }

    /// Takes in a setpoint that the robot admitted.
    fn hear(&mut self, at: Stamp, setpoint: &Envelope<Setpoint>) {
        let (session, seq) = (setpoint.header.session, setpoint.header.seq.0);
        if let Some((known, newest)) = self.newest.replace((session, seq))
            && known == session
        {
            self.run.setpoints_missed += seq.saturating_sub(newest).saturating_sub(1);
        }
        self.run.setpoints += 1;
        let press = match setpoint.body.motion {
            Motion::Permitted { press: number } => {
                let holder = setpoint.body.lease.map(|lease| lease.holder);
                Some(Press { holder, number })
            }
            Motion::Held(reason) => {
                self.heard.released |= reason == Reason::DeadmanReleased;
                None
            }
        };
        self.heard.first.get_or_insert(press);
        if let Some(press) = press {
            (self.permitted, self.press) = (at, press);
        }
    }

    fn look(&mut self, at: Stamp, node: &RobotSim) {
        let motion = node.motion();
        let before = self.motion.replace(motion);
        match (before, motion) {
            (Some(Motion::Permitted { press }), Motion::Held(reason)) => self.stop(at, press, reason),
            (Some(Motion::Held(_)) | None, Motion::Permitted { press }) => self.go(at, press),
            _ => {}
        }
        if motion.reason().is_some() {
            self.brake(at, node.arm());
        }
    }

    fn stop(&mut self, at: Stamp, press: u32, reason: Reason) {
        // Unless the stop is one by silence, it was a setpoint that said so.
        self.heard = Heard {
            first: (!is_loss(reason)).then_some(None),
            released: reason == Reason::DeadmanReleased,
        };
        self.stopped = self.press;
        self.open = Some(Stop {
            reason,
            press,
            heard: self.permitted,
            noticed: at,
            began: None,
            at_rest: None,
            speed_m_s: 0.0,
            way_m: 0.0,
            drove_on: false,
            again: None,
        });
    }

    fn go(&mut self, at: Stamp, press: u32) {
        let mut fresh = self.heard.first != Some(Some(self.press));
        let Some(mut stop) = self.open.take() else {
            self.run.first.get_or_insert(Again { at, press, fresh });
            return;
        };
        fresh &= self.press != self.stopped || self.heard.released;
        stop.again = Some(Again { at, press, fresh });
        self.run.stops.push(stop);
    }

    fn brake(&mut self, at: Stamp, arm: &Arm) {
        let Some(stop) = &mut self.open else { return };
        let (place, speed) = tool(arm);
        let Some(began) = stop.began else {
            // An arm that stands has nothing to brake.
            if arm.plans_next() || arm.is_at_rest() {
                (stop.began, stop.speed_m_s) = (Some(at), speed);
                stop.at_rest = arm.is_at_rest().then_some(at);
                self.braked_at = place;
            }
            return;
        };
        if stop.at_rest.is_some() {
            stop.drove_on |= !arm.is_at_rest();
            return;
        }
        stop.way_m = (place - self.braked_at).norm();
        stop.drove_on |= speed > stop.speed_m_s + self.faster || at.since(began) > BRAKING_LIMIT;
        stop.at_rest = arm.is_at_rest().then_some(at);
    }

    fn finish(mut self) -> RobotRun {
        self.run.stops.extend(self.open);
        self.run
    }
}

/// Whether the robot stopped because it heard nothing any more that counts.
const fn is_loss(reason: Reason) -> bool {
    matches!(
        reason,
        Reason::SetpointLost { .. } | Reason::LoopTooOld | Reason::SetpointsMissed { .. }
    )
}

/// Where the tool is and how fast it moves.
fn tool(arm: &Arm) -> (Vec3, f64) {
    let frames = forward(arm.angles());
    let place = frames.tool().origin;
    let twist = tool_jacobian(&frames) * JointVector::from(*arm.speeds());
    let velocity = Vec3::new(twist[0], twist[1], twist[2]);
    (Vec3::new(place.x, place.y, place.z), velocity.norm())
}
