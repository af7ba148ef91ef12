//! What is seen of a robot, millisecond by millisecond, and the stops that are in it. Pure.

use tandem_robot_sim::RobotSim;
use tandem_robot_sim::arm::Arm;
use tandem_robot_sim::kinematics::{JointVector, forward, tool_jacobian};
use tandem_wire::{Envelope, Motion, Nanos, Reason, SECOND, Session, Setpoint, Stamp, Vec3};

use super::{Again, RobotRun, Stop};
use crate::verdict::Missing;

/// An arm that still moves so long after it began to brake, or that moves faster than when it began, has driven on.
const BRAKING_LIMIT: Nanos = SECOND;
/// For so long an arm that was speeding up may go on to when it begins to brake, in seconds: its joints turn from one
/// acceleration to the other within their limits on jerk.
const TURNING_S: f64 = 0.010;

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

pub(super) struct Watch {
    pub(super) run: RobotRun,
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
    pub(super) const fn new(session: Session) -> Self {
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

    /// How quickly the arm may speed up, in m/s².
    pub(super) fn expect_acceleration(&mut self, most: f64) {
        self.faster = most * TURNING_S;
    }

    /// Whether a millisecond could show anything: an arm that stands while motion is held has nothing to show.
    pub(super) fn is_busy(&self, node: &RobotSim) -> bool {
        node.motion().is_permitted() || !node.arm().is_at_rest() || self.motion.is_none_or(Motion::is_permitted)
    }

    /// Entries are missing: a stop that was under way has no end.
    pub(super) fn lose_sight(&mut self, missing: Missing) {
        self.run.stops.extend(self.open.take());
        self.motion = None;
        self.heard = Heard::default();
        self.run.missing.get_or_insert(missing);
    }

    /// Takes in a setpoint that the robot admitted.
    pub(super) fn hear(&mut self, at: Stamp, setpoint: &Envelope<Setpoint>) {
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

    pub(super) fn look(&mut self, at: Stamp, node: &RobotSim) {
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

    pub(super) fn finish(mut self) -> RobotRun {
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
