//! The arm: geometry and limits of the Franka Emika Panda, and the tool that it carries. Numbers only.
//!
//! Kinematics and limits are the manufacturer's, from the Franka Control Interface documentation, page "Robot and
//! interface specifications", sections "Limits for Panda" and "Denavit–Hartenberg parameters"
//! (<https://frankaemika.github.io/docs/control_parameters.html>). The capsules enlarge the coarse collision
//! geometry that the manufacturer publishes with its `franka_description` package for the arm's own
//! self-collision check. Lengths in metres, angles in radians, time in seconds.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_4};

/// Number of joints.
pub const JOINTS: usize = 7;

/// Number of frames: the base, one for each joint's link, and the flange.
pub const FRAMES: usize = 9;

/// Index of the flange (`panda_link8`) among the frames.
pub const FLANGE: usize = 8;

/// One value for each joint, base first.
pub type PerJoint = [f64; JOINTS];

/// The fixed part of the step from one frame to the next, in the convention of Craig (modified
/// Denavit–Hartenberg): rotate by `alpha` about x, shift by `a` along x, rotate by the joint angle about z, shift
/// by `d` along z.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Shift along x, in metres.
    pub a: f64,
    /// Shift along z, in metres.
    pub d: f64,
    /// sin(alpha). Alpha is always a multiple of π/2; a sine that is exactly −1, 0 or 1 (and a cosine that is
    /// exactly 0 or 1) keeps the chain free of the 6e-17 that `cos(π/2)` would bring in.
    pub sin_alpha: f64,
    /// cos(alpha).
    pub cos_alpha: f64,
}

const fn step(a: f64, d: f64, sin_alpha: f64, cos_alpha: f64) -> Step {
    Step {
        a,
        d,
        sin_alpha,
        cos_alpha,
    }
}

/// The seven moving steps, base first.
pub const CHAIN: [Step; JOINTS] = [
    step(0.0, 0.333, 0.0, 1.0),
    step(0.0, 0.0, -1.0, 0.0),
    step(0.0, 0.316, 1.0, 0.0),
    step(0.0825, 0.0, 1.0, 0.0),
    step(-0.0825, 0.384, -1.0, 0.0),
    step(0.0, 0.0, 1.0, 0.0),
    step(0.088, 0.0, 1.0, 0.0),
];

/// From the last link's frame along its z axis to the flange.
pub const FLANGE_OFFSET_M: f64 = 0.107;

/// From the flange along its z axis to the tip of the tool.
pub const TOOL_LENGTH_M: f64 = 0.20;

/// Radius of the tool.
pub const TOOL_RADIUS_M: f64 = 0.005;

/// Lowest joint positions, in radians.
pub const POSITION_MIN_RAD: PerJoint = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973];

/// Highest joint positions, in radians.
pub const POSITION_MAX_RAD: PerJoint = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973];

/// Highest joint speeds, in rad/s.
pub const SPEED_MAX_RAD_S: PerJoint = [2.1750, 2.1750, 2.1750, 2.1750, 2.6100, 2.6100, 2.6100];

/// Highest joint accelerations, in rad/s².
pub const ACCELERATION_MAX_RAD_S2: PerJoint = [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0];

/// Highest joint jerks, in rad/s³.
pub const JERK_MAX_RAD_S3: PerJoint = [7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0];

/// Highest speed of the end effector that the manufacturer allows, in m/s. The node's own bound is lower.
pub const TOOL_SPEED_MAX_M_S: f64 = 1.7;

/// Highest acceleration of the end effector that the manufacturer allows, in m/s².
pub const TOOL_ACCELERATION_MAX_M_S2: f64 = 13.0;

/// The posture that the arm prefers when the task leaves it a choice: the manufacturer's ready posture with the
/// last joint turned to the middle of its range, where the flange's x axis points forward.
pub const POSTURE_RAD: PerJoint = [0.0, -FRAC_PI_4, 0.0, -3.0 * FRAC_PI_4, 0.0, FRAC_PI_2, 0.0];

/// A part of the arm that can come near something.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// The pedestal and the seven moving links: 0 to 7.
    Link(u8),
    /// The clamp on the flange that holds the tool.
    Hand,
    /// The tool.
    Tool,
}

/// A capsule fixed to a frame: all points within `radius` of the segment from `start` to `end`.
#[derive(Clone, Copy, Debug)]
pub struct Capsule {
    /// The part that it covers.
    pub part: Part,
    /// The frame that it moves with.
    pub frame: usize,
    /// One end of the segment, in that frame.
    pub start: [f64; 3],
    /// The other end.
    pub end: [f64; 3],
    /// The radius.
    pub radius: f64,
}

/// What we add to the manufacturer's radii, which follow the shells closely: cables and covers stand out a little.
const MARGIN_M: f64 = 0.010;

const fn link(number: u8, start: [f64; 3], end: [f64; 3], radius: f64) -> Capsule {
    Capsule {
        part: Part::Link(number),
        frame: number as usize,
        start,
        end,
        radius: radius + MARGIN_M,
    }
}

/// 0.055 m and 0.065 m along the direction in which the last link's side bulge points, 45° from its x axis.
const BULGE_NEAR_M: f64 = 0.055 * FRAC_1_SQRT_2;
const BULGE_FAR_M: f64 = 0.065 * FRAC_1_SQRT_2;

/// Number of capsules.
pub const CAPSULES: usize = 12;

/// The capsules, tool first because it is nearly always the nearest, so that the search can skip the rest.
///
/// Links: segments of `franka_description`, radii larger by 10 mm. The clamp is ours: a flange of ISO
/// 9409-1-50 measures 63 mm across, and the clamp reaches 20 mm below it plus its own rounding. The tool is a rod
/// from the flange whose rounded tip ends at [`TOOL_LENGTH_M`].
pub const ARM_CAPSULES: [Capsule; CAPSULES] = [
    Capsule {
        part: Part::Tool,
        frame: FLANGE,
        start: [0.0, 0.0, TOOL_RADIUS_M],
        end: [0.0, 0.0, TOOL_LENGTH_M - TOOL_RADIUS_M],
        radius: TOOL_RADIUS_M,
    },
    Capsule {
        part: Part::Hand,
        frame: FLANGE,
        start: [0.0; 3],
        end: [0.0, 0.0, 0.020],
        radius: 0.035,
    },
    link(7, [0.0, 0.0, -0.060], [0.0, 0.0, 0.080], 0.040),
    link(
        7,
        [BULGE_NEAR_M, BULGE_NEAR_M, 0.082],
        [BULGE_FAR_M, BULGE_FAR_M, 0.082],
        0.030,
    ),
    link(6, [0.0, 0.0, -0.070], [0.0, 0.0, 0.010], 0.050),
    link(5, [0.0, 0.080, -0.200], [0.0, 0.080, -0.060], 0.025),
    link(5, [0.0, 0.0, -0.310], [0.0, 0.0, -0.210], 0.060),
    link(4, [0.0, 0.0, -0.060], [0.0, 0.0, 0.060], 0.060),
    link(3, [0.0, 0.0, -0.220], [0.0, 0.0, -0.070], 0.060),
    link(2, [0.0, 0.0, -0.060], [0.0, 0.0, 0.060], 0.060),
    link(1, [0.0, 0.0, -0.333], [0.0, 0.0, -0.050], 0.060),
    link(0, [-0.090, 0.0, 0.060], [-0.060, 0.0, 0.060], 0.060),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_preferred_posture_lies_well_inside_the_limits() {
        for joint in 0..JOINTS {
            assert!(POSTURE_RAD[joint] > POSITION_MIN_RAD[joint] + 0.3, "joint {joint}");
            assert!(POSTURE_RAD[joint] < POSITION_MAX_RAD[joint] - 0.3, "joint {joint}");
        }
    }

    #[test]
    fn every_part_has_a_capsule_on_a_frame_that_exists() {
        for number in 0..8 {
            assert!(
                ARM_CAPSULES.iter().any(|capsule| capsule.part == Part::Link(number)),
                "link {number}"
            );
        }
        assert!(ARM_CAPSULES.iter().any(|capsule| capsule.part == Part::Hand));
        assert!(
            ARM_CAPSULES
                .iter()
                .all(|capsule| capsule.frame < FRAMES && capsule.radius > 0.0)
        );
    }
}
