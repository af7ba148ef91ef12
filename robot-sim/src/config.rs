//! The `[robot-sim]` section, and the checked surroundings it becomes.

use std::sync::Arc;

use nalgebra::Vector3;

use tandem_settings::{choices, settings};
use tandem_wire::{Aabb, Body, Cylinder, Finite, LINKS, Scene, Timing, Vec3};

use crate::arm::{RAMP_SHARE, TICK_S, ToolBounds};
use crate::kinematics::{Unreachable, joints_for};
use crate::panda::{ARM_CAPSULES, Capsule, FLANGE, PerJoint};
use crate::scene::OBSTACLES_MAX;

choices! {
    /// How setpoints are expected to come.
    pub enum LinkName {
        /// As a stream at the loop's rate; silence stops.
        Stream = "stream",
        /// One every millisecond, as Franka's control interface expects them; twenty misses in a row stop.
        Franka = "franka",
    }
}

settings! {
    /// The simulated arm and what stands around it. All coordinates are in the arm's base frame.
    pub struct RobotSimSettings("robot-sim") {
        /// How setpoints are expected to come. For "franka" set arbiter.setpoint_hz = 1000, too.
        pub link: LinkName = LinkName::Stream;
        /// The fastest the tool moves, in metres per second, whatever is asked.
        pub tool_speed_m_s: f64 = 0.5, in 0.01..=1.7;
        /// How quickly the tool's velocity changes at most, in metres per second squared; also how hard it stops. Above
        /// about 4 the joints' own limits begin to decide, and a workspace's wall is overshot by more than a centimetre.
        pub tool_acceleration_m_s2: f64 = 4.0, in 0.1..=13.0;
        /// The corner of the workspace with the smallest coordinates, in metres.
        pub workspace_min_m: [f64; 3] = [0.2, -0.5, 0.02], in -2.0..=2.0;
        /// The corner with the largest.
        pub workspace_max_m: [f64; 3] = [0.8, 0.5, 0.8], in -2.0..=2.0;
        /// Where the tool's tip starts, in metres.
        pub start_m: [f64; 3] = [0.5, -0.3, 0.15], in -2.0..=2.0;
        /// Where it shall go, in metres.
        pub goal_m: [f64; 3] = [0.5, 0.3, 0.15], in -2.0..=2.0;
        /// Within this distance of the goal it has arrived, in metres.
        pub goal_tolerance_m: f64 = 0.010, in 0.001..=0.5;
        /// Where obstacles stand, x and y in metres: upright cylinders, at most sixteen.
        pub obstacles_m: Vec<[f64; 2]> = [[0.5, -0.02], [0.5, 0.16]], in -2.0..=2.0;
        /// Their radius, in metres.
        pub obstacle_radius_m: f64 = 0.020, in 0.001..=0.5;
        /// Their height above the table, in metres.
        pub obstacle_height_m: f64 = 0.20, in 0.001..=1.5;
    }
}

/// Why settings that are each in range cannot be used together.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum UnusableScene {
    /// A workspace whose smallest corner is not smaller than its largest.
    #[error("robot-sim.workspace_min_m[{axis}] = {min} must be less than robot-sim.workspace_max_m[{axis}] = {max}")]
    WorkspaceTurnedOver {
        /// Which axis, from 0.
        axis: usize,
        /// Its lower bound.
        min: f64,
        /// Its upper bound.
        max: f64,
    },
    /// A start outside of the workspace.
    #[error("robot-sim.start_m[{axis}] = {start} lies outside of the workspace, {min} to {max}")]
    StartOutside {
        /// Which axis, from 0.
        axis: usize,
        /// Where the tool would start.
        start: f64,
        /// The workspace's lower bound.
        min: f64,
        /// Its upper bound.
        max: f64,
    },
    /// A start that the arm cannot reach.
    #[error("robot-sim.start_m cannot be reached with the tool pointing down")]
    StartUnreachable(#[source] Unreachable),
    /// More obstacles than are looked at in every inner tick.
    #[error("robot-sim.obstacles_m names {count} obstacles; at most {OBSTACLES_MAX} are allowed")]
    TooManyObstacles {
        /// How many.
        count: usize,
    },
}

/// Everything about arm and surroundings that stays as it is: checked, so nobody asks again.
#[derive(Clone, Debug)]
pub(crate) struct Surroundings {
    pub(crate) bounds: ToolBounds,
    /// How setpoints are expected to come.
    pub(crate) link: LinkName,
    /// The most inner ticks that one step simulates; see [`stop_ticks_max`].
    pub(crate) stop_ticks_max: u32,
    /// The joint angles at the start.
    pub(crate) start: PerJoint,
    /// What is published; shared, so that publishing it every second allocates nothing.
    pub(crate) scene: Arc<Scene>,
}

impl RobotSimSettings {
    /// Checks what ties several settings together, and finds the posture at the start.
    pub(crate) fn surroundings(&self, timing: &Timing) -> Result<Surroundings, UnusableScene> {
        let workspace = self.workspace()?;
        let count = self.obstacles_m.len();
        if count > OBSTACLES_MAX {
            return Err(UnusableScene::TooManyObstacles { count });
        }
        let start = joints_for(&Vector3::from(self.start_m)).map_err(UnusableScene::StartUnreachable)?;
        let scene = Scene {
            obstacles: self.obstacles_m.iter().map(|&place| self.obstacle(place)).collect(),
            bodies: ARM_CAPSULES.iter().map(body).collect(),
            start: Vec3::from(self.start_m),
            goal: Vec3::from(self.goal_m),
            goal_tolerance: Finite(self.goal_tolerance_m),
            workspace,
            period: timing.period,
        };
        let bounds = ToolBounds {
            workspace,
            speed: self.tool_speed_m_s,
            acceleration: self.tool_acceleration_m_s2,
        };
        Ok(Surroundings {
            link: self.link,
            stop_ticks_max: stop_ticks_max(&bounds, timing),
            bounds,
            start,
            scene: Arc::new(scene),
        })
    }

    fn workspace(&self) -> Result<Aabb, UnusableScene> {
        for axis in 0..3 {
            let (min, max) = (self.workspace_min_m[axis], self.workspace_max_m[axis]);
            if min >= max {
                return Err(UnusableScene::WorkspaceTurnedOver { axis, min, max });
            }
            let start = self.start_m[axis];
            if !(min..=max).contains(&start) {
                return Err(UnusableScene::StartOutside { axis, start, min, max });
            }
        }
        Ok(Aabb {
            min: Vec3::from(self.workspace_min_m),
            max: Vec3::from(self.workspace_max_m),
        })
    }

    fn obstacle(&self, [x, y]: [f64; 2]) -> Cylinder {
        Cylinder {
            foot: Vec3::new(x, y, 0.0),
            radius: Finite(self.obstacle_radius_m),
            height: Finite(self.obstacle_height_m),
        }
    }
}

/// Twice as many inner ticks as it takes to notice a silence and then to stop from full speed within the acceleration
/// limit, and a second more for the joints to settle. Only a process that was suspended comes near it.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the settings' ranges keep it below a minute's ticks, and a conversion from a float saturates"
)]
fn stop_ticks_max(bounds: &ToolBounds, timing: &Timing) -> u32 {
    let ramp_s = bounds.speed / (RAMP_SHARE * bounds.acceleration);
    let noticed_s = tandem_wire::seconds(timing.stream_timeout());
    ((2.0 * (ramp_s + noticed_s) + 1.0) / TICK_S) as u32
}

/// A capsule as it is published: the tool's and the clamp's stay on the flange, so that they need no further frame.
fn body(capsule: &Capsule) -> Body {
    const _: () = assert!(LINKS == FLANGE, "a state carries link 1 to the flange");
    let frame = capsule.frame.checked_sub(1).and_then(|link| u8::try_from(link).ok());
    Body {
        frame: frame.unwrap_or(Body::BASE),
        from: Vec3::from(capsule.start),
        to: Vec3::from(capsule.end),
        radius: Finite(capsule.radius),
    }
}

#[cfg(test)]
mod tests {
    use tandem_settings::{Document, show};

    use super::*;

    #[test]
    fn the_defaults_read_back_as_they_print_and_can_be_used() {
        let text = show(&RobotSimSettings::default());
        let settings: RobotSimSettings = Document::parse("defaults", &text).unwrap().section().unwrap();
        assert_eq!(settings, RobotSimSettings::default());
        let surroundings = settings.surroundings(&Timing::default()).unwrap();
        assert_eq!(surroundings.scene.obstacles.len(), 2);
        assert_eq!(surroundings.scene.bodies.len(), ARM_CAPSULES.len());
    }

    fn refusal(settings: &RobotSimSettings) -> String {
        settings.surroundings(&Timing::default()).unwrap_err().to_string()
    }

    #[test]
    fn settings_that_do_not_fit_together_are_refused_by_name() {
        let usual = RobotSimSettings::default;
        assert_eq!(
            refusal(&RobotSimSettings {
                workspace_min_m: [0.2, 0.6, 0.02],
                ..usual()
            }),
            "robot-sim.workspace_min_m[1] = 0.6 must be less than robot-sim.workspace_max_m[1] = 0.5"
        );
        assert_eq!(
            refusal(&RobotSimSettings {
                start_m: [0.1, 0.0, 0.15],
                ..usual()
            }),
            "robot-sim.start_m[0] = 0.1 lies outside of the workspace, 0.2 to 0.8"
        );
        assert_eq!(
            refusal(&RobotSimSettings {
                start_m: [0.8, 0.5, 0.8],
                ..usual()
            }),
            "robot-sim.start_m cannot be reached with the tool pointing down"
        );
        assert_eq!(
            refusal(&RobotSimSettings {
                obstacles_m: vec![[0.5, 0.0]; 17],
                ..usual()
            }),
            "robot-sim.obstacles_m names 17 obstacles; at most 16 are allowed"
        );
    }
}
