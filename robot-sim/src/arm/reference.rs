//! The point that the tool follows, within the tool's speed, acceleration and workspace.

use tandem_wire::{Aabb, Vec3};

use super::range::brake;
use super::{PLAN_S, ToolBounds};

/// The reference waits where the tool has fallen behind by this much.
const LAG_MAX_M: f64 = 0.010;
/// What the change of speed, and the braking before the workspace's wall in each axis, may use of the tool's
/// acceleration: together √(0.8² + 3 · 0.3²) < 1.
pub(crate) const RAMP_SHARE: f64 = 0.8;
const WALL_SHARE: f64 = 0.3;
/// Braking before a wall begins early enough to take this long to begin: the joints follow the reference that late.
const WALL_REACTION_S: f64 = 4.0 * PLAN_S;

/// The point that the tool is held to, and how it moves.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Reference {
    pub(super) position: Vec3,
    pub(super) velocity: Vec3,
}

impl Reference {
    /// The velocity one plan from now on the way to `wished`: within the tool's acceleration, and slow enough for
    /// reference and tool to stop before the wall, whichever is nearer to it.
    pub(super) fn ramped(&self, wished: Vec3, tool: Vec3, bounds: &ToolBounds) -> Vec3 {
        let ((low, high), (tool_low, tool_high)) = (room(self.position, bounds), room(tool, bounds));
        let (low, high) = (-smaller(-low, -tool_low), smaller(high, tool_high));
        let inside = |velocity: Vec3| between(velocity, low, high);
        let change = inside(wished) - self.velocity;
        inside(self.velocity + change.capped(RAMP_SHARE * bounds.acceleration * PLAN_S))
    }

    /// Moves on by one plan, unless that would leave the tool too far behind; never through a wall, which rounding to
    /// whole plans would otherwise do by some micrometres.
    pub(super) fn advance(&mut self, velocity: Vec3, lag: Vec3, workspace: &Aabb) {
        let moved = (self.velocity + velocity) * (0.5 * PLAN_S);
        self.velocity = velocity;
        let next = (lag + moved).norm();
        if next <= LAG_MAX_M || next < lag.norm() {
            let (back, forth) = (workspace.min - self.position, workspace.max - self.position);
            self.position = self.position + between(moved, smaller(back, Vec3::ZERO), -smaller(-forth, Vec3::ZERO));
        }
    }
}

/// Each component of `vector`, kept between those of `low` and `high`.
pub(super) fn between(vector: Vec3, low: Vec3, high: Vec3) -> Vec3 {
    Vec3::new(
        vector.x.clamp(low.x, high.x),
        vector.y.clamp(low.y, high.y),
        vector.z.clamp(low.z, high.z),
    )
}

/// The velocities, lowest and highest in each axis, from which a point can still be stopped before the wall.
pub(super) fn room(point: Vec3, bounds: &ToolBounds) -> (Vec3, Vec3) {
    let stop = |distance: f64| brake(distance, WALL_SHARE * bounds.acceleration, WALL_REACTION_S);
    let each = |distance: Vec3| Vec3::new(stop(distance.x), stop(distance.y), stop(distance.z));
    (-each(point - bounds.workspace.min), each(bounds.workspace.max - point))
}

/// The smaller of each pair of components.
fn smaller(a: Vec3, b: Vec3) -> Vec3 {
    let of = |a: f64, b: f64| if a < b { a } else { b };
    Vec3::new(of(a.x, b.x), of(a.y, b.y), of(a.z, b.z))
}
