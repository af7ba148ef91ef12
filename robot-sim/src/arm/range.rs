//! How fast a joint may turn near the end of its range.

use super::{PLAN_S, TICK_S};
use crate::panda::{ACCELERATION_MAX_RAD_S2, POSITION_MAX_RAD, POSITION_MIN_RAD, SPEED_MAX_RAD_S};

/// A plan brakes a joint before this distance from the end of its range, with this share of its acceleration.
const SOFT_MARGIN_RAD: f64 = 0.010;
const SOFT_BRAKE_SHARE: f64 = 0.3;
/// The last clamp brakes with more, later.
const HARD_BRAKE_SHARE: f64 = 0.9;

/// The highest speed from which `deceleration` still stops within `distance`, `reaction` seconds from now.
///
/// `v·reaction + v²/(2·deceleration) = distance`. With `reaction` one tick this is exact for a motion in ticks: a
/// speed within the bound leaves a distance from which braking by `deceleration · tick` is within it again.
pub(super) fn brake(distance: f64, deceleration: f64, reaction: f64) -> f64 {
    let lost = deceleration * reaction;
    (lost * lost + 2.0 * deceleration * distance.max(0.0)).sqrt() - lost
}

pub(super) fn soft_speed_range(joint: usize, angle: f64) -> (f64, f64) {
    let allowed = |distance: f64| {
        brake(
            distance - SOFT_MARGIN_RAD,
            SOFT_BRAKE_SHARE * ACCELERATION_MAX_RAD_S2[joint],
            2.0 * PLAN_S,
        )
    };
    (
        -allowed(angle - POSITION_MIN_RAD[joint]),
        allowed(POSITION_MAX_RAD[joint] - angle),
    )
}

pub(super) fn hard_speed_range(joint: usize, angle: f64) -> (f64, f64) {
    let allowed = |distance: f64| {
        brake(distance, HARD_BRAKE_SHARE * ACCELERATION_MAX_RAD_S2[joint], TICK_S).min(SPEED_MAX_RAD_S[joint])
    };
    (
        -allowed(angle - POSITION_MIN_RAD[joint]),
        allowed(POSITION_MAX_RAD[joint] - angle),
    )
}
