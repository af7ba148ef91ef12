//! Where the links are for given joint angles, and which joint speeds give a wished tool velocity.
//!
//! Positions in metres and directions in the axes of the base frame (`panda_link0`); a [`Twist`] is three linear
//! rows (m/s) above three angular rows (rad/s). The chain follows Craig's modified Denavit–Hartenberg convention,
//! the inverse Nakamura and Hanafusa (1986): damped least squares whose damping sets in near a singularity.
//! Sines come from `libm`; everything else is basic operations and `sqrt` in a written order, so every machine
//! gets the same bits. Nothing here allocates.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3, Vector6};

use crate::cholesky::Cholesky;
use crate::panda::{
    CHAIN, FLANGE, FLANGE_OFFSET_M, FRAMES, JOINTS, POSITION_MAX_RAD, POSITION_MIN_RAD, POSTURE_RAD, PerJoint,
    TOOL_LENGTH_M,
};

/// A velocity of a rigid body: linear rows, then angular rows.
pub type Twist = Vector6<f64>;

/// `twist = jacobian · joint speeds`.
pub type Jacobian = SMatrix<f64, 6, JOINTS>;

/// One value for each joint, as a column.
pub type JointVector = SVector<f64, JOINTS>;

/// Position and orientation of a frame, seen from the base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// `base_from_frame`: its columns are the frame's axes.
    pub rotation: Matrix3<f64>,
    /// The frame's origin, in metres.
    pub origin: Vector3<f64>,
}

impl Frame {
    /// The point with coordinates `local` in this frame, seen from the base.
    #[must_use]
    pub fn point(&self, local: [f64; 3]) -> Vector3<f64> {
        let [x, y, z] = local;
        self.origin + self.rotation.column(0) * x + self.rotation.column(1) * y + self.rotation.column(2) * z
    }

    fn axis(&self, column: usize) -> Vector3<f64> {
        self.rotation.column(column).into_owned()
    }

    fn shifted_along_z(&self, by: f64) -> Self {
        Self {
            rotation: self.rotation,
            origin: self.origin + self.rotation.column(2) * by,
        }
    }
}

/// All frames of the arm: the base, the seven links, the flange.
#[derive(Clone, Copy, Debug)]
pub struct Frames([Frame; FRAMES]);

impl Frames {
    /// The frame with this index: 0 is the base, 1 to 7 the links, [`FLANGE`] the flange.
    #[must_use]
    pub fn frame(&self, index: usize) -> &Frame {
        &self.0[index.min(FLANGE)]
    }

    /// The last frame of the arm, to which the tool is clamped.
    #[must_use]
    pub fn flange(&self) -> &Frame {
        &self.0[FLANGE]
    }

    /// The frame at the tool's tip, z along the tool.
    #[must_use]
    pub fn tool(&self) -> Frame {
        self.flange().shifted_along_z(TOOL_LENGTH_M)
    }
}

/// Forward kinematics: the pose of every frame for the joint angles `q` in radians.
///
/// `T(i−1, i) = RotX(α) · TransX(a) · RotZ(q) · TransZ(d)`, seven times, then the flange. Costs seven sines and
/// cosines and about 200 products.
#[must_use]
pub fn forward(q: &PerJoint) -> Frames {
    let base = Frame {
        rotation: Matrix3::identity(),
        origin: Vector3::zeros(),
    };
    let mut frames = [base; FRAMES];
    for joint in 0..JOINTS {
        let (before, step) = (frames[joint], &CHAIN[joint]);
        let (sin, cos) = libm::sincos(q[joint]);
        let (x, y, z) = (before.axis(0), before.axis(1), before.axis(2));
        let y_tilted = y * step.cos_alpha + z * step.sin_alpha;
        let z_tilted = z * step.cos_alpha - y * step.sin_alpha;
        frames[joint + 1] = Frame {
            rotation: Matrix3::from_columns(&[x * cos + y_tilted * sin, y_tilted * cos - x * sin, z_tilted]),
            origin: before.origin + x * step.a + z_tilted * step.d,
        };
    }
    frames[FLANGE] = frames[JOINTS].shifted_along_z(FLANGE_OFFSET_M);
    Frames(frames)
}

/// The Jacobian of a point that moves with the flange: column i is `[zᵢ × (point − oᵢ); zᵢ]`, in base axes.
#[must_use]
pub fn jacobian_at(frames: &Frames, point: &Vector3<f64>) -> Jacobian {
    let mut jacobian = Jacobian::zeros();
    for joint in 0..JOINTS {
        let frame = &frames.0[joint + 1];
        let axis = frame.axis(2);
        let linear = axis.cross(&(point - frame.origin));
        jacobian.fixed_view_mut::<3, 1>(0, joint).copy_from(&linear);
        jacobian.fixed_view_mut::<3, 1>(3, joint).copy_from(&axis);
    }
    jacobian
}

/// The Jacobian at the tip of the tool.
#[must_use]
pub fn tool_jacobian(frames: &Frames) -> Jacobian {
    jacobian_at(frames, &frames.tool().origin)
}

/// The orientation that the tool holds: straight down, its x axis pointing forward.
pub const POINTING_DOWN: Matrix3<f64> = Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0);

/// The rotation, as axis times angle, that still separates `is` from `wanted`; exact to third order, and pointing
/// the right way up to half a turn. `½ Σ isᵢ × wantedᵢ` over the three axes, after Luh, Walker and Paul (1980).
#[must_use]
pub fn rotation_error(is: &Matrix3<f64>, wanted: &Matrix3<f64>) -> Vector3<f64> {
    let turn = |axis: usize| is.column(axis).cross(&wanted.column(axis));
    (turn(0) + turn(1) + turn(2)) * 0.5
}

/// What one step of inverse kinematics found.
#[derive(Clone, Copy, Debug)]
pub struct Resolution {
    /// The joint speeds, in rad/s.
    pub speeds: JointVector,
    /// The smallest singular value of the Jacobian: how far the arm is from a singularity.
    pub weakest: f64,
}

/// Below this smallest singular value the inverse is damped and the tool slowed down. The shipped paths keep
/// above 0.15, so that they are followed exactly.
pub const WEAK: f64 = 0.10;

/// The damping at a singularity itself: a lost direction gets no joint speed above `|twist| / (2 · 0.08)`.
const DAMPING_MAX: f64 = 0.08;

/// Keeps the normal matrix positive where nothing else does; shifts singular values by less than 5e-9 where no
/// damping is active.
const DAMPING_FLOOR_SQUARED: f64 = 1e-9;

/// One step of inverse kinematics: the joint speeds that give `twist` and otherwise come close to `preferred`.
///
/// `q̇ = q̇₀ + Jᵀ (J Jᵀ + λ² I)⁻¹ (twist − J q̇₀)`: least squares in the twist, and `preferred` (q̇₀) projected onto
/// what the twist leaves free. `λ² = (1 − (σ/WEAK)²) · DAMPING_MAX²` below `σ = WEAK`, σ the smallest singular
/// value, and zero above, so λ sets in smoothly. Two factorisations of a 6×6 matrix; total for finite input.
#[must_use]
pub fn resolve(jacobian: &Jacobian, twist: &Twist, preferred: &JointVector) -> Resolution {
    let normal = jacobian * jacobian.transpose();
    let factor = Cholesky::of(&normal, DAMPING_FLOOR_SQUARED);
    let weakest = factor.smallest_singular_value();
    let factor = if weakest < WEAK {
        let closeness = 1.0 - (weakest / WEAK) * (weakest / WEAK);
        Cholesky::of(&normal, DAMPING_FLOOR_SQUARED + closeness * DAMPING_MAX * DAMPING_MAX)
    } else {
        factor
    };
    let missing = twist - jacobian * preferred;
    Resolution {
        speeds: preferred + jacobian.transpose() * factor.solve(&missing),
        weakest,
    }
}

/// Within this distance of a limit a joint prefers to move away from it.
const LIMIT_MARGIN_RAD: f64 = 0.30;
/// How fast it prefers to do so right at the limit.
const LIMIT_SPEED_RAD_S: f64 = 0.60;
/// How fast the posture is restored, per second.
const POSTURE_GAIN_PER_S: f64 = 0.5;
/// No joint prefers to restore the posture faster than this.
const POSTURE_SPEED_RAD_S: f64 = 0.25;

/// The joint speeds that the arm would choose if it had no task: back to the preferred posture, away from limits.
#[must_use]
pub fn preferred_speeds(q: &PerJoint) -> JointVector {
    JointVector::from_fn(|joint, _| {
        let posture = POSTURE_GAIN_PER_S * (POSTURE_RAD[joint] - q[joint]);
        let push = |distance: f64| (1.0 - distance / LIMIT_MARGIN_RAD).clamp(0.0, 1.0) * LIMIT_SPEED_RAD_S;
        posture.clamp(-POSTURE_SPEED_RAD_S, POSTURE_SPEED_RAD_S) + push(q[joint] - POSITION_MIN_RAD[joint])
            - push(POSITION_MAX_RAD[joint] - q[joint])
    })
}

/// Why no joint angles were found for a pose.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("the arm cannot bring its tool there: it ends {missed_by_m:.4} m and {turned_off_rad:.4} rad away")]
pub struct Unreachable {
    /// How far the tool stays from the wished point, in metres.
    pub missed_by_m: f64,
    /// How far it stays turned from the wished orientation, in radians.
    pub turned_off_rad: f64,
}

/// Joint angles that put the tool's tip at `position`, [`POINTING_DOWN`], in the posture that the arm prefers.
///
/// Damped steps from the preferred posture, the last ones for accuracy alone: at most 400 steps, a few
/// milliseconds at worst. Accurate to 1e-8 m and 1e-8 rad, and at least 0.02 rad inside every joint limit.
///
/// # Errors
/// [`Unreachable`] with the remaining distance if the steps end elsewhere.
pub fn joints_for(position: &Vector3<f64>) -> Result<PerJoint, Unreachable> {
    const STEPS: usize = 400;
    const POLISH: usize = 40;
    const TOLERANCE: f64 = 1e-8;
    let mut q = POSTURE_RAD;
    for step in 0..STEPS {
        let frames = forward(&q);
        let preferred = if step + POLISH < STEPS {
            preferred_speeds(&q) * 0.1
        } else {
            JointVector::zeros()
        };
        let wanted = joined(
            &((position - frames.tool().origin) * 0.5),
            &(rotation_error(&frames.tool().rotation, &POINTING_DOWN) * 0.5),
        );
        let move_by = resolve(&tool_jacobian(&frames), &wanted, &preferred).speeds;
        for joint in 0..JOINTS {
            let inside = (POSITION_MIN_RAD[joint] + 0.02, POSITION_MAX_RAD[joint] - 0.02);
            q[joint] = (q[joint] + move_by[joint].clamp(-0.1, 0.1)).clamp(inside.0, inside.1);
        }
    }
    let tool = forward(&q).tool();
    let missed_by_m = (position - tool.origin).norm();
    let turned_off_rad = rotation_error(&tool.rotation, &POINTING_DOWN).norm();
    // A comparison with NaN is false: a position that is not finite is refused too.
    if missed_by_m <= TOLERANCE && turned_off_rad <= TOLERANCE {
        Ok(q)
    } else {
        Err(Unreachable {
            missed_by_m,
            turned_off_rad,
        })
    }
}

/// A twist from its two halves.
#[must_use]
pub fn joined(linear: &Vector3<f64>, angular: &Vector3<f64>) -> Twist {
    Twist::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A short walk of joint angles over the whole range, the same every time.
    fn postures() -> impl Iterator<Item = PerJoint> {
        (0..200_u32).map(|n| {
            std::array::from_fn(|joint| {
                let turn = f64::from(n) * (0.7548 + 0.0931 * joint as f64) + 0.37 * joint as f64;
                let part = turn - turn.floor();
                POSITION_MIN_RAD[joint] + part * (POSITION_MAX_RAD[joint] - POSITION_MIN_RAD[joint])
            })
        })
    }

    #[test]
    fn the_jacobian_is_the_derivative_of_the_tool_pose() {
        const H: f64 = 1e-6;
        for q in postures() {
            let jacobian = tool_jacobian(&forward(&q));
            for joint in 0..JOINTS {
                let moved = |by: f64| {
                    let mut q = q;
                    q[joint] += by;
                    forward(&q).tool()
                };
                let (less, more) = (moved(-H), moved(H));
                let linear = (more.origin - less.origin) / (2.0 * H);
                let angular = rotation_error(&less.rotation, &more.rotation) / (2.0 * H);
                let difference = joined(&linear, &angular) - jacobian.column(joint);
                assert!(difference.norm() < 1e-8, "{difference}");
            }
        }
    }

    #[test]
    fn the_smallest_singular_value_agrees_with_a_full_decomposition() {
        let mut near = 0;
        for q in postures() {
            let jacobian = tool_jacobian(&forward(&q));
            let found = resolve(&jacobian, &Twist::zeros(), &JointVector::zeros()).weakest;
            let exact = jacobian.singular_values()[5];
            let slack = if exact < 0.5 * WEAK { 1.02 } else { 1.25 };
            assert!(
                found >= exact - 1e-6 && found <= slack * exact + 1e-4,
                "found {found}, exact {exact}"
            );
            near += usize::from(exact < WEAK);
        }
        assert!(near > 10, "the postures must reach singularities too");
    }

    #[test]
    fn away_from_singularities_the_twist_is_met_exactly_whatever_is_preferred() {
        let twist = Twist::new(0.1, -0.2, 0.05, 0.3, 0.1, -0.2);
        let mut met = 0;
        for q in postures() {
            let jacobian = tool_jacobian(&forward(&q));
            let resolution = resolve(&jacobian, &twist, &preferred_speeds(&q));
            if resolution.weakest > WEAK {
                assert!((jacobian * resolution.speeds - twist).norm() < 1e-6);
                met += 1;
            }
        }
        assert!(met > 10);
    }

    #[test]
    fn at_a_singularity_the_speeds_stay_bounded() {
        let stretched = [0.0, 0.0, 0.0, -0.0698, 0.0, 1.6, 0.0];
        let jacobian = tool_jacobian(&forward(&stretched));
        let twist = Twist::new(0.0, 0.0, 0.5, 0.0, 0.0, 0.0);
        let resolution = resolve(&jacobian, &twist, &JointVector::zeros());
        assert!(resolution.weakest < WEAK);
        assert!(
            resolution.speeds.norm() <= 0.5 / (2.0 * DAMPING_MAX) * 3.0,
            "{}",
            resolution.speeds
        );
    }

    #[test]
    fn a_reachable_point_is_reached_and_an_unreachable_one_named() {
        let start = Vector3::new(0.5, -0.3, 0.15);
        let q = joints_for(&start).unwrap();
        assert!((forward(&q).tool().origin - start).norm() < 1e-8);
        let error = joints_for(&Vector3::new(2.0, 0.0, 0.15)).unwrap_err();
        assert!(error.missed_by_m > 0.5);
        assert!(joints_for(&Vector3::new(f64::NAN, 0.0, 0.0)).is_err());
    }
}
