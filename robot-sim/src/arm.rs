//! The moving arm: joint angles and speeds, advanced in inner ticks of one millisecond.
//!
//! Every ten ticks the tool's velocity becomes joint speeds ([`plan`](Arm::tick)); in between the joints ramp
//! towards them. Two things are held so that nothing drifts: the tool follows a *reference* point, the integral of
//! the velocity in force, and its orientation stays [`POINTING_DOWN`]. A planar task commands no vertical velocity, so
//! the reference's height, and with it the tool's, stays what it was at the start.
//!
//! Limits, from the outside in: the tool's workspace, speed and acceleration bound the reference; a joint near the end
//! of its range is slowed and the others take over its share; joint speeds and accelerations scale the whole plan, so
//! that the tool slows down but keeps its direction; and every single tick is clamped once more, so that position,
//! speed and acceleration hold whatever was planned. Two things are softer. The tool may overshoot a wall of the
//! workspace by millimetres, in turns so hard that the joints cannot brake as quickly as the reference: driven at random,
//! 30 000 times, by more than 8 mm and less than 10. And
//! jerk is exceeded where the last clamp must act: in three ticks of a million when driven at random against the ends
//! of every range, never on a path that ships.

mod range;
mod reference;

use nalgebra::Vector3;

use tandem_wire::{Aabb, Malformed, Memory, Remember, Vec3};

use crate::kinematics::{
    Frames, Jacobian, JointVector, POINTING_DOWN, Twist, WEAK, forward, joined, preferred_speeds, resolve,
    rotation_error, tool_jacobian,
};
use crate::panda::{
    ACCELERATION_MAX_RAD_S2, JERK_MAX_RAD_S3, JOINTS, POSITION_MAX_RAD, POSITION_MIN_RAD, PerJoint, SPEED_MAX_RAD_S,
};
use range::{hard_speed_range, soft_speed_range};
pub(crate) use reference::RAMP_SHARE;
use reference::{Reference, between, room};

/// Length of an inner tick, in seconds.
pub const TICK_S: f64 = 1e-3;

/// Inner ticks from one step of inverse kinematics to the next.
pub const TICKS_PER_PLAN: u32 = 10;

/// The same in seconds.
const PLAN_S: f64 = TICKS_PER_PLAN as f64 * TICK_S;

/// What the arm is told to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// Move the tool with this velocity, in m/s.
    Follow(Vec3),
    /// Come to rest, and stay there.
    Stop,
}

/// What bounds the tool's motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolBounds {
    /// Where its tip may be.
    pub workspace: Aabb,
    /// How fast it may go, in m/s.
    pub speed: f64,
    /// How quickly its velocity may change, in m/s².
    pub acceleration: f64,
}

/// The arm's whole state.
#[derive(Clone, Debug, PartialEq)]
pub struct Arm {
    angles: PerJoint,
    speeds: PerJoint,
    accelerations: PerJoint,
    /// The accelerations wished for until the next plan.
    planned: PerJoint,
    ticks_to_plan: u32,
    reference: Reference,
    /// The smallest singular value at the last plan.
    weakest: f64,
}

/// How quickly the tool returns to its reference, per second. A tenth of the planning rate: quick, far from ringing.
const POSITION_GAIN_PER_S: f64 = 10.0;
/// The same for orientation.
const ORIENTATION_GAIN_PER_S: f64 = 10.0;
/// After a stop the reference is kept if it is this close, so that stops do not add up to a drift.
const LAG_KEPT_M: f64 = 0.001;
/// The posture is restored in full only above this tool speed, and not at all at rest: an elbow that moves while the
/// tool stands still would be motion that nobody asked for.
const POSTURE_FROM_M_S: f64 = 0.05;
/// Slow-down at a singularity. Never zero: the arm must be able to leave.
const SLOWEST: f64 = 0.2;
/// What a plan may use of a joint's speed and acceleration; the rest is for the clamps below it.
const PLANNED_SHARE: f64 = 0.9;
/// A tool this much faster than it may come at a wall must only brake.
const WALL_SLACK_M_S: f64 = 0.02;
/// What rounding may add to a limit, and how far (in m, and m/s) a reference can be, before an arm that is read back is
/// one that cannot have been.
const POSSIBLE: f64 = 1.0 + 1e-9;
const FARTHEST_M: f64 = 10.0;
/// Slower than this, a stopping joint stands.
const STANDING_RAD_S: f64 = 1e-7;

impl Arm {
    /// An arm that stands still with these joint angles.
    #[must_use]
    pub fn standing(angles: PerJoint) -> Self {
        Self {
            angles,
            speeds: [0.0; JOINTS],
            accelerations: [0.0; JOINTS],
            planned: [0.0; JOINTS],
            ticks_to_plan: 0,
            reference: Reference {
                position: wire(&forward(&angles).tool().origin),
                velocity: Vec3::ZERO,
            },
            weakest: f64::INFINITY,
        }
    }

    /// Joint angles, in radians.
    #[must_use]
    pub const fn angles(&self) -> &PerJoint {
        &self.angles
    }

    /// Joint speeds, in rad/s.
    #[must_use]
    pub const fn speeds(&self) -> &PerJoint {
        &self.speeds
    }

    /// Joint accelerations over the last tick, in rad/s².
    #[must_use]
    pub const fn accelerations(&self) -> &PerJoint {
        &self.accelerations
    }

    /// The point that the tool is held to.
    #[must_use]
    pub const fn reference(&self) -> Vec3 {
        self.reference.position
    }

    /// Whether every joint stands perfectly still, which only [`Drive::Stop`] brings about.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.speeds == [0.0; JOINTS] && self.reference.velocity == Vec3::ZERO
    }

    /// Advances by one millisecond under `drive`. A changed drive takes effect with the next plan, at most ten
    /// ticks later. No allocation; about a microsecond, a plan included in its share.
    pub fn tick(&mut self, drive: Drive, bounds: &ToolBounds) {
        if self.ticks_to_plan == 0 {
            self.ticks_to_plan = TICKS_PER_PLAN;
            self.plan(drive, bounds);
        }
        self.ticks_to_plan -= 1;
        for joint in 0..JOINTS {
            self.advance(joint);
        }
    }

    /// Whether the next tick makes a plan, and so takes up a changed drive.
    #[must_use]
    pub const fn plans_next(&self) -> bool {
        self.ticks_to_plan == 0
    }

    /// Lets time pass over an arm at rest without its ticks: the next one makes a plan.
    pub const fn idle(&mut self) {
        self.ticks_to_plan = 0;
    }

    fn plan(&mut self, drive: Drive, bounds: &ToolBounds) {
        let wished = match drive {
            Drive::Follow(velocity) => velocity.capped(bounds.speed) * self.slow_down(),
            Drive::Stop => Vec3::ZERO,
        };
        let frames = forward(&self.angles);
        let tool = wire(&frames.tool().origin);
        let wished = if self.runs_at_a_wall(&frames, tool, bounds) {
            Vec3::ZERO
        } else {
            wished
        };
        let velocity = self.reference.ramped(wished, tool, bounds);
        if drive == Drive::Stop && velocity == Vec3::ZERO {
            self.stand(tool, &bounds.workspace);
        } else {
            self.follow(velocity, &frames, bounds);
        }
    }

    /// Whether the tool itself, not its reference, comes at a wall faster than it may. Then the turn that the joints were
    /// busy with has to wait: they can brake at once what they cannot brake and turn.
    fn runs_at_a_wall(&self, frames: &Frames, tool: Vec3, bounds: &ToolBounds) -> bool {
        let twist = tool_jacobian(frames) * JointVector::from(self.speeds);
        let velocity = Vec3::new(twist[0], twist[1], twist[2]);
        let (low, high) = room(tool, bounds);
        let over = between(velocity, low, high) - velocity;
        over.norm() > WALL_SLACK_M_S
    }

    /// Plans the change to these joint speeds, or as large a share of it as the joints can bring about.
    fn ramp_to(&mut self, speeds: JointVector) {
        let change = speeds - JointVector::from(self.speeds);
        let share = (0..JOINTS)
            .map(|joint| PLANNED_SHARE * ACCELERATION_MAX_RAD_S2[joint] * PLAN_S / change[joint].abs())
            .fold(1.0, f64::min);
        self.planned = (change * (share / PLAN_S)).into();
    }

    /// Brings the joints to rest where they are.
    fn stand(&mut self, tool: Vec3, workspace: &Aabb) {
        self.reference.velocity = Vec3::ZERO;
        if self.nearly_stands() && !self.is_at_rest() {
            self.speeds = [0.0; JOINTS];
            self.accelerations = [0.0; JOINTS];
            if (self.reference.position - tool).norm() > LAG_KEPT_M {
                self.reference.position = between(tool, workspace.min, workspace.max);
            }
        }
        self.ramp_to(JointVector::zeros());
    }

    /// Whether what is left of the motion can be dropped without leaving the limits on acceleration and jerk.
    fn nearly_stands(&self) -> bool {
        (0..JOINTS).all(|joint| {
            self.speeds[joint].abs() <= STANDING_RAD_S
                && self.accelerations[joint].abs() <= 0.5 * JERK_MAX_RAD_S3[joint] * TICK_S
        })
    }

    /// Plans for a tool velocity at the end of this plan, and moves the reference on. Where the joints cannot speed up or
    /// brake as quickly as the reference, the tool falls behind it or ahead of it, and the lag brings it back.
    fn follow(&mut self, velocity: Vec3, frames: &Frames, bounds: &ToolBounds) {
        let tool = frames.tool();
        let lag = self.reference.position - wire(&tool.origin);
        let (low, high) = room(wire(&tool.origin), bounds);
        let linear = between(velocity + lag * POSITION_GAIN_PER_S, low, high);
        let angular = rotation_error(&tool.rotation, &POINTING_DOWN) * ORIENTATION_GAIN_PER_S;
        let twist = joined(&Vector3::new(linear.x, linear.y, linear.z), &angular);
        let preferred = preferred_speeds(&self.angles) * (velocity.norm() / POSTURE_FROM_M_S).min(1.0);
        let speeds = self.within_range(tool_jacobian(frames), twist, preferred);
        let slower = (0..JOINTS)
            .map(|joint| PLANNED_SHARE * SPEED_MAX_RAD_S[joint] / speeds[joint].abs())
            .fold(1.0, f64::min);
        self.ramp_to(speeds * slower);
        self.reference.advance(velocity * slower, lag, &bounds.workspace);
    }

    /// Solves for joint speeds that stop short of every joint's range. A joint that cannot give what the solution asks
    /// of it gives what it can, and the others are asked again; after three rounds the tool goes without.
    fn within_range(&mut self, mut jacobian: Jacobian, mut twist: Twist, mut preferred: JointVector) -> JointVector {
        let mut speeds = JointVector::zeros();
        for round in 0..3 {
            let resolution = resolve(&jacobian, &twist, &preferred);
            if round == 0 {
                self.weakest = resolution.weakest;
            }
            speeds = resolution.speeds;
            let mut all_can = true;
            for joint in 0..JOINTS {
                let (low, high) = soft_speed_range(joint, self.angles[joint]);
                let can = speeds[joint].clamp(low, high);
                if (speeds[joint] - can).abs() > 0.0 {
                    all_can = false;
                    speeds[joint] = can;
                    preferred[joint] = can;
                    twist -= jacobian.column(joint) * can;
                    jacobian.column_mut(joint).fill(0.0);
                }
            }
            if all_can {
                break;
            }
        }
        speeds
    }

    /// Whether an arm can have come to be so: the sums of a tick stay finite for any that can.
    fn is_possible(&self) -> bool {
        let within = |values: &PerJoint, limits: &PerJoint| {
            let mut pairs = values.iter().zip(limits);
            pairs.all(|(value, limit)| value.abs() <= limit * POSSIBLE)
        };
        let in_range = |joint: usize| (POSITION_MIN_RAD[joint]..=POSITION_MAX_RAD[joint]).contains(&self.angles[joint]);
        (0..JOINTS).all(in_range)
            && within(&self.speeds, &SPEED_MAX_RAD_S)
            && within(&self.accelerations, &ACCELERATION_MAX_RAD_S2)
            && within(&self.planned, &ACCELERATION_MAX_RAD_S2)
            && self.ticks_to_plan <= TICKS_PER_PLAN
            && self.reference.position.norm() <= FARTHEST_M
            && self.reference.velocity.norm() <= FARTHEST_M
            && self.weakest >= 0.0
    }

    fn slow_down(&self) -> f64 {
        (self.weakest / WEAK).clamp(SLOWEST, 1.0)
    }

    /// One joint, one tick: towards the planned acceleration as fast as jerk allows, then whatever it takes to keep
    /// speed and position, but never more than the acceleration limit.
    fn advance(&mut self, joint: usize) {
        let limit = ACCELERATION_MAX_RAD_S2[joint];
        let (angle, speed) = (self.angles[joint], self.speeds[joint]);
        let jerk = JERK_MAX_RAD_S3[joint] * TICK_S;
        let before = self.accelerations[joint];
        let wished = self.planned[joint].clamp(before - jerk, before + jerk);
        let (low, high) = hard_speed_range(joint, angle);
        let wished = wished
            .clamp((low - speed) / TICK_S, (high - speed) / TICK_S)
            .clamp(-limit, limit);
        self.accelerations[joint] = wished;
        self.speeds[joint] = speed + wished * TICK_S;
        self.angles[joint] = angle + self.speeds[joint] * TICK_S;
    }
}

impl Remember for Arm {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            angles,
            speeds,
            accelerations,
            planned,
            ticks_to_plan,
            reference,
            weakest,
        } = self;
        for joints in [angles, speeds, accelerations, planned] {
            memory.part(joints)?;
        }
        memory.part(ticks_to_plan)?;
        memory.part(&mut reference.position)?;
        memory.part(&mut reference.velocity)?;
        memory.part(weakest)?;
        memory.check(self.is_possible())
    }
}

fn wire(vector: &Vector3<f64>) -> Vec3 {
    Vec3::new(vector.x, vector.y, vector.z)
}
