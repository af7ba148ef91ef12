//! One trial, tick by tick: what its figures, tables and plots are made of.
//!
//! A [`Trace`] is plain data and serialises to compact JSON: vectors are arrays `[x, y, z]` in the base frame, in
//! metres or metres per second, and what is absent is left out. It loses nothing of its numbers, so the [`Measures`]
//! of a trace that was stored are those of the trial itself.
//!
//! [`Measures`]: crate::Measures

use serde::{Deserialize, Serialize};
use tandem_wire::{Forecast, Limited, Motion, Scene, Setpoint, State, Vec3, seconds};

use crate::latency::Quantiles;

/// A position in metres or a velocity in metres per second, in the robot's base frame.
pub type Point = [f64; 3];

/// One trial.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Trace {
    /// Its number within the run, from 1; 0 if none began.
    pub trial: u32,
    /// What it was called when it began.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub label: String,
    /// The robot's tick at which it began; all other ticks count from there.
    pub began_at: u32,
    /// Whether it ended: the human finished or gave up, or the robot went on to something else.
    pub over: bool,
    /// Where it took place, if that was heard.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<Surroundings>,
    /// What happened, in the order of ticks; a tick of which nothing was heard is missing.
    pub ticks: Vec<Tick>,
    /// What was forecast, in the order in which it came.
    pub forecasts: Vec<ForecastMade>,
    /// When motion was stopped, in the order in which it was heard.
    pub stops: Vec<Stop>,
    /// From the operator's command to the arm's motion, if the journals told.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latency: Option<Quantiles>,
    /// What was dropped or lost on the way.
    pub drops: Drops,
}

impl Trace {
    /// The control period in seconds, if the scene was heard and says it.
    #[must_use]
    pub fn period_s(&self) -> Option<f64> {
        let period = self.scene.as_ref()?.period_s;
        (period > 0.0 && period.is_finite()).then_some(period)
    }

    /// The first and the last tick on which motion was permitted, if there was one.
    #[must_use]
    pub fn motion(&self) -> Option<(u32, u32)> {
        let mut moving = self.ticks.iter().filter(|tick| tick.is_moving()).map(|tick| tick.tick);
        let first = moving.next()?;
        Some((first, moving.next_back().unwrap_or(first)))
    }

    /// The last tick of which a state was heard.
    #[must_use]
    pub fn last_state(&self) -> Option<&Stand> {
        self.ticks.iter().rev().find_map(|tick| tick.state.as_ref())
    }
}

/// What the scene says.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Surroundings {
    /// The length of a control period.
    pub period_s: f64,
    /// Where the tool starts.
    pub start: Point,
    /// Where it shall go.
    pub goal: Point,
    /// Within this distance of the goal it has arrived.
    pub goal_tolerance_m: f64,
    /// Upright cylinders that must not be touched.
    pub obstacles: Vec<Obstacle>,
}

/// An upright cylinder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Obstacle {
    /// Centre of its foot.
    pub foot: Point,
    /// Its radius.
    pub radius_m: f64,
    /// Its height.
    pub height_m: f64,
}

/// What was heard of one tick.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tick {
    /// Control periods since the trial began.
    pub tick: u32,
    /// The arm, at the tick's first state.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub state: Option<Stand>,
    /// The last setpoint decided in this tick.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decision: Option<Decision>,
    /// Where a simulated human wished to be; no message tells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wish: Option<Point>,
}

impl Tick {
    /// Whether motion was permitted in it.
    #[must_use]
    pub fn is_moving(&self) -> bool {
        self.decision.as_ref().is_some_and(Decision::is_permitted)
    }
}

/// How the arm stood.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Stand {
    /// The tool's tip.
    pub tool: Point,
    /// Its velocity.
    pub velocity: Point,
    /// The distance to the obstacles at that instant; negative inside.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clearance_m: Option<f64>,
    /// The smallest distance since the tick before, over all states of this tick.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub closest_m: Option<f64>,
    /// Why the robot did not let itself move at the tick's last state; absent if it did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub held: Option<String>,
    /// Whether it was at rest at the tick's last state.
    pub at_rest: bool,
}

/// One arbitration.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Decision {
    /// The velocity that the robot was given.
    pub velocity: Point,
    /// Why motion was held; absent if it was permitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub held: Option<String>,
    /// The human's weight ω.
    pub weight: f64,
    /// The human's velocity as commanded: before weight and limits.
    pub human: Point,
    /// What the robot would have done, if there was a forecast.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot: Option<Guided>,
    /// Which limits changed the velocity: `workspace`, `speed`, `acceleration`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub limited: Vec<String>,
}

impl Decision {
    /// Whether motion was permitted.
    #[must_use]
    pub const fn is_permitted(&self) -> bool {
        self.held.is_none()
    }
}

/// The robot's part in a decision.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Guided {
    /// Its velocity.
    pub velocity: Point,
    /// Where on the demonstrations' time axis the movement was, in steps.
    pub phase: f64,
    /// The forecast's last step.
    pub last_step: u32,
    /// The forecast position at that phase.
    pub position: Point,
    /// Half the width of the prediction interval around it, per axis.
    pub half_width: Point,
    /// The interval's width relative to training.
    pub ratio: f64,
}

/// A forecast, when it was made.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ForecastMade {
    /// Control periods since the trial began.
    pub tick: u32,
    /// The condition, in the model's own frame.
    pub context: Vec<f64>,
    /// The step of the first position.
    pub first_step: u32,
    /// Time between steps.
    pub period_s: f64,
    /// Forecast positions, step by step.
    pub positions: Vec<Point>,
    /// Half the width of the interval per axis, step by step.
    pub half_widths: Vec<Point>,
}

/// A stop, as it was published: motion was permitted and then held.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stop {
    /// Control periods since the trial began.
    pub tick: u32,
    /// Who stopped.
    pub by: Stopper,
    /// Why, in words.
    pub reason: String,
}

/// Who can stop the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stopper {
    /// The arbiter, in a setpoint.
    Arbiter,
    /// The robot itself.
    RobotSim,
}

impl std::fmt::Display for Stopper {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Arbiter => "arbiter",
            Self::RobotSim => "robot-sim",
        })
    }
}

/// Messages that did not count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Drops {
    /// Dropped by the arbiter during the trial, as it says.
    pub by_arbiter: u64,
    /// Dropped by the robot during the trial, as it says.
    pub by_robot: u64,
    /// Numbers missing from the streams of states and setpoints, as the listener heard them.
    pub unheard: u64,
    /// Samples that were no message.
    pub unreadable: u64,
}

impl Drops {
    /// All of them.
    #[must_use]
    pub const fn total(&self) -> u64 {
        self.by_arbiter
            .saturating_add(self.by_robot)
            .saturating_add(self.unheard)
            .saturating_add(self.unreadable)
    }
}

fn held(motion: Motion) -> Option<String> {
    motion.reason().map(|reason| reason.to_string())
}

impl From<&Scene> for Surroundings {
    fn from(scene: &Scene) -> Self {
        Self {
            period_s: seconds(scene.period),
            start: scene.start.to_array(),
            goal: scene.goal.to_array(),
            goal_tolerance_m: scene.goal_tolerance.0,
            obstacles: scene
                .obstacles
                .iter()
                .map(|cylinder| Obstacle {
                    foot: cylinder.foot.to_array(),
                    radius_m: cylinder.radius.0,
                    height_m: cylinder.height.0,
                })
                .collect(),
        }
    }
}

impl From<&State> for Stand {
    fn from(state: &State) -> Self {
        Self {
            tool: state.tool.position.to_array(),
            velocity: state.tool_velocity.to_array(),
            clearance_m: state.clearance.map(|clearance| clearance.distance.0),
            closest_m: state.closest.map(|closest| closest.distance.0),
            held: held(state.motion),
            at_rest: state.at_rest,
        }
    }
}

impl Stand {
    /// Takes in a later state of the same tick.
    pub(crate) fn refresh(&mut self, state: &State) {
        let closest = state.closest.map(|closest| closest.distance.0);
        self.closest_m = match (self.closest_m, closest) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        };
        self.held = held(state.motion);
        self.at_rest = state.at_rest;
    }
}

impl From<&Setpoint> for Decision {
    fn from(setpoint: &Setpoint) -> Self {
        Self {
            velocity: setpoint.velocity.to_array(),
            held: held(setpoint.motion),
            weight: setpoint.weight.0,
            human: setpoint.human.to_array(),
            robot: setpoint.guidance.map(|guidance| Guided {
                velocity: guidance.velocity.to_array(),
                phase: guidance.phase.0,
                last_step: guidance.last_step,
                position: guidance.position.to_array(),
                half_width: guidance.half_width.to_array(),
                ratio: guidance.ratio.0,
            }),
            limited: limits(setpoint.limited),
        }
    }
}

fn limits(limited: Limited) -> Vec<String> {
    [
        (limited.workspace, "workspace"),
        (limited.speed, "speed"),
        (limited.acceleration, "acceleration"),
    ]
    .into_iter()
    .filter(|(active, _)| *active)
    .map(|(_, name)| name.to_owned())
    .collect()
}

impl ForecastMade {
    pub(crate) fn new(tick: u32, forecast: &Forecast) -> Self {
        let rounded = |vector: Vec3| vector.to_array().map(tenth_of_a_micrometre);
        Self {
            tick,
            context: forecast.context.iter().map(|value| value.0).collect(),
            first_step: forecast.first_step,
            period_s: seconds(forecast.period),
            positions: forecast.points.iter().map(|point| rounded(point.position)).collect(),
            half_widths: forecast.points.iter().map(|point| rounded(point.half_width)).collect(),
        }
    }
}

/// No figure is made of these, only curves, and with a forecast at every tick they are most of a trace's length.
fn tenth_of_a_micrometre(metres: f64) -> f64 {
    (metres * 1e7).round() / 1e7
}
