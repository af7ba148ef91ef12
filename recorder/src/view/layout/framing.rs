//! What the pictures show: the task, however it lies.

use tandem_wire::{Scene, Vec3};

/// Around the task stays this share of its longer side.
const MARGIN: f64 = 0.07;
/// A task is shown as if it were at least so long, in metres: one that begins where it ends has no length.
const LEAST_M: f64 = 0.3;
/// The eye looks at a point between base and task, this share of the way out, and this high, in metres.
const TARGET_OUT: f64 = 0.6;
const TARGET_M: [f64; 2] = [0.03, 0.25];
/// From there the eye is so far outwards, to the left and up, for a task that reaches so far from the base.
const EYE_M: [f64; 3] = [0.86, -0.49, 0.47];
const REACH_M: f64 = 0.58;

/// What the pictures show, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Framing {
    /// Of the plan, the base's y.
    pub(super) across: [f64; 2],
    /// Of the plan, the base's x.
    pub(super) down: [f64; 2],
    /// Where the eye is in three dimensions, and what it looks at.
    pub(super) eye: Vec3,
    pub(super) target: Vec3,
}

impl Default for Framing {
    /// The shipped task, until a robot says otherwise.
    fn default() -> Self {
        Self::around(Vec3::new(0.5, -0.3, 0.15), Vec3::new(0.5, 0.3, 0.15))
    }
}

impl Framing {
    /// Start, goal and obstacles. The workspace may be much larger, and a wall far away is worth no room.
    pub(crate) fn of(scene: &Scene) -> Self {
        let (mut low, mut high) = (scene.start, scene.start);
        let mut hold = |point: Vec3, radius: f64| {
            low = Vec3::new(
                low.x.min(point.x - radius),
                low.y.min(point.y - radius),
                low.z.min(point.z),
            );
            high = Vec3::new(
                high.x.max(point.x + radius),
                high.y.max(point.y + radius),
                high.z.max(point.z),
            );
        };
        hold(scene.goal, 0.0);
        for obstacle in &scene.obstacles {
            hold(obstacle.foot, obstacle.radius.0);
        }
        Self::around(low, high)
    }

    fn around(low: Vec3, high: Vec3) -> Self {
        let (middle, size) = ((low + high) * 0.5, high - low);
        let longer = size.x.max(size.y).max(LEAST_M);
        // The plan is about twice as wide as it is high, and shows no less than it is asked for.
        let side = |centre: f64, length: f64| {
            let half = length.max(0.5 * longer) * 0.5 + MARGIN * longer;
            [centre - half, centre + half]
        };
        let (eye, target) = eye(low, high, middle);
        Self {
            across: side(middle.y, size.y),
            down: side(middle.x, size.x),
            eye,
            target,
        }
    }
}

/// Beyond the task and beside it, so that the arm is seen behind what it does.
fn eye(low: Vec3, high: Vec3, middle: Vec3) -> (Vec3, Vec3) {
    let distance = Vec3::new(middle.x, middle.y, 0.0).norm();
    let out = match distance > 1e-3 {
        true => Vec3::new(middle.x, middle.y, 0.0) * (1.0 / distance),
        false => Vec3::new(1.0, 0.0, 0.0),
    };
    let left = Vec3::new(-out.y, out.x, 0.0);
    let far = Vec3::new(low.x.abs().max(high.x.abs()), low.y.abs().max(high.y.abs()), 0.0);
    let scale = (far.norm() / REACH_M).max(0.5);
    let place = |along: f64, beside: f64, up: f64| out * along + left * beside + Vec3::new(0.0, 0.0, up);
    let target = place(TARGET_OUT * distance, TARGET_M[0], TARGET_M[1]);
    let [along, beside, up] = EYE_M.map(|metres| metres * scale);
    (target + place(along, beside, up), target)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::{Aabb, Cylinder, Finite};

    fn scene(start: Vec3, goal: Vec3) -> Scene {
        Scene {
            start,
            goal,
            obstacles: vec![Cylinder {
                foot: Vec3::new(start.x, goal.y, 0.0),
                radius: Finite(0.05),
                height: Finite(0.2),
            }],
            bodies: Vec::new(),
            goal_tolerance: Finite(0.01),
            workspace: Aabb { min: start, max: goal },
            period: 1,
        }
    }

    fn holds([low, high]: [f64; 2], value: f64) -> bool {
        low < value && value < high
    }

    #[test]
    fn start_goal_and_obstacles_are_in_the_plan_wherever_they_are() {
        let places = [[0.5, -0.3, 0.5, 0.3], [-0.6, 0.2, -0.1, 0.9], [0.4, 0.0, 0.4, 0.0]];
        for [a, b, c, d] in places {
            let scene = scene(Vec3::new(a, b, 0.1), Vec3::new(c, d, 0.2));
            let framing = Framing::of(&scene);
            assert!(holds(framing.down, a) && holds(framing.down, c), "{framing:?}");
            assert!(holds(framing.across, b) && holds(framing.across, d), "{framing:?}");
            let foot = scene.obstacles[0].foot;
            assert!(
                holds(framing.down, foot.x - 0.05) && holds(framing.across, foot.y + 0.05),
                "{framing:?}"
            );
        }
    }

    #[test]
    fn the_eye_is_beyond_the_task_whichever_way_the_arm_reaches() {
        for turn in [
            Vec3::new(1.0, 0.0, 0.0),
            Vec3::new(0.0, 1.0, 0.0),
            Vec3::new(-1.0, 0.0, 0.0),
        ] {
            let framing = Framing::of(&scene(turn * 0.5, turn * 0.6));
            assert!(framing.eye.dot(turn) > 0.6, "{framing:?}");
            assert!(framing.target.dot(turn) > 0.0, "{framing:?}");
        }
    }
}
