//! What the robot says of itself: the arm, looked at, as a state.

use nalgebra::{Rotation3, UnitQuaternion};

use tandem_wire::{Arrivals, Cylinder, Finite, Motion, Pose, Refusals, State, Vec3};

use crate::inner::Inner;
use crate::kinematics::{Frame, JointVector, tool_jacobian};
use crate::panda::PerJoint;

/// What a state says besides the arm.
pub(crate) struct Situation {
    pub(crate) trial: u32,
    pub(crate) trial_start: u32,
    pub(crate) motion: Motion,
    pub(crate) arrivals: Option<Arrivals>,
    pub(crate) refused: Refusals,
}

/// Looks at the arm. Starts a new interval for the smallest clearance.
pub(crate) fn report(inner: &mut Inner, obstacles: &[Cylinder], situation: Situation) -> State {
    let (frames, clearance, closest) = inner.look(obstacles);
    let arm = inner.arm();
    let twist = tool_jacobian(&frames) * JointVector::from(*arm.speeds());
    State {
        trial: situation.trial,
        trial_start: situation.trial_start,
        joints: finite(arm.angles()),
        joint_velocities: finite(arm.speeds()),
        links: std::array::from_fn(|link| pose(frames.frame(link + 1))),
        tool: pose(&frames.tool()),
        tool_velocity: Vec3::new(twist[0], twist[1], twist[2]),
        clearance,
        closest,
        motion: situation.motion,
        at_rest: arm.is_at_rest(),
        obeys: inner.obeyed(),
        arrivals: situation.arrivals,
        refused: situation.refused,
    }
}

fn finite(values: &PerJoint) -> [Finite; 7] {
    values.map(Finite)
}

fn pose(frame: &Frame) -> Pose {
    let rotation = Rotation3::from_matrix_unchecked(frame.rotation);
    let quaternion = UnitQuaternion::from_rotation_matrix(&rotation);
    Pose {
        position: Vec3::new(frame.origin.x, frame.origin.y, frame.origin.z),
        orientation: [quaternion.i, quaternion.j, quaternion.k, quaternion.w].map(Finite),
    }
}
