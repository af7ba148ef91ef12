//! Whether the arm can go where a context wishes, asked of its kinematics before anybody drives.

use nalgebra::Vector3;
use tandem_operator::{FamilyPath, LAST_STEP};
use tandem_robot_sim::kinematics::joints_for;
use tandem_wire::{TaskFrame, Vec3};

use super::{Context, Plan};
use crate::Configuration;

/// A context's path leads where the arm cannot go.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "{place}: the robot cannot follow context {context} (amplitude {amplitude_m} m): at step {step} of its path, \
     base ({:.3}, {:.3}, {:.3}) m, {why}",
    point.x, point.y, point.z
)]
pub struct OutOfReach {
    /// Where the plan names the context.
    pub place: tandem_settings::Place,
    /// The context.
    pub context: String,
    /// Its amplitude, in metres.
    pub amplitude_m: f64,
    /// The step of its path.
    pub step: u32,
    /// Where that is, in the base frame, in metres.
    pub point: Vec3,
    /// What is in the way.
    pub why: String,
}

/// Every so many steps the inverse kinematics is asked; the workspace's box is checked at every step.
const ASKED_EVERY: u32 = 6;

impl Plan {
    /// Checks that the arm can follow a context's path, in every condition's workspace. The wish's random deviations
    /// come on top and are not checked.
    ///
    /// # Errors
    /// At the first step that is out of reach.
    pub fn check_reach(&self, context: &Context) -> Result<(), OutOfReach> {
        let mut asked = Vec::new();
        for condition in &self.conditions {
            let Ok(configuration) = self.configuration(condition, context) else {
                continue;
            };
            let Ok(frame) = configuration.task.frame() else {
                continue;
            };
            // Most conditions share robot and task, and asking takes its time.
            let same = (
                frame,
                configuration.robot.clone(),
                configuration.arbiter.workspace_min_m,
            );
            if !asked.contains(&same) {
                follow(context, &configuration, &frame)?;
                asked.push(same);
            }
        }
        Ok(())
    }
}

fn follow(context: &Context, configuration: &Configuration, frame: &TaskFrame) -> Result<(), OutOfReach> {
    let path = FamilyPath::new(context.settings.amplitude_m);
    let mut step = 0;
    while f64::from(step) <= LAST_STEP {
        let point = frame.to_base(path.at(f64::from(step)));
        if let Some(why) = obstacle_to(point, step, configuration) {
            return Err(OutOfReach {
                place: context.place.clone(),
                context: context.name.clone(),
                amplitude_m: context.settings.amplitude_m,
                step,
                point,
                why,
            });
        }
        step += 1;
    }
    Ok(())
}

fn obstacle_to(point: Vec3, step: u32, configuration: &Configuration) -> Option<String> {
    let at = [point.x, point.y, point.z];
    let (robot, arbiter) = (&configuration.robot, &configuration.arbiter);
    let boxes = [
        ("robot-sim", robot.workspace_min_m, robot.workspace_max_m),
        ("arbiter", arbiter.workspace_min_m, arbiter.workspace_max_m),
    ];
    for (section, min, max) in boxes {
        if (0..3).any(|axis| !(min[axis]..=max[axis]).contains(&at[axis])) {
            return Some(format!(
                "outside of {section}.workspace_min_m {min:?} to workspace_max_m {max:?}"
            ));
        }
    }
    if !step.is_multiple_of(ASKED_EVERY) {
        return None;
    }
    let unreachable = joints_for(&Vector3::new(point.x, point.y, point.z)).err()?;
    Some(unreachable.to_string())
}
