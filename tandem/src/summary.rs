//! A trial in numbers, from the messages that crossed the network; pure, and the same at any pace.
//!
//! One tick counts once, with the last setpoint that was decided in it. The trial is over when motion has been
//! permitted and then held for [`QUIET_TICKS`] ticks; those ticks do not count, nor does the release that began them.

use serde::Serialize;
use tandem_wire::{Envelope, Motion, Scene, Setpoint, State, Vec3};

/// After this many ticks without motion the human has finished: a stop that the human answers is shorter.
const QUIET_TICKS: u32 = 10;

/// What a trial has come to so far.
#[derive(Debug, Default)]
pub(crate) struct Summary {
    goal: Option<(Vec3, f64)>,
    began_at: Option<u32>,
    state_tick: u32,
    current: Option<(u32, Setpoint)>,
    last_motion_tick: Option<u32>,
    tool: Option<Vec3>,
    at_rest: bool,
    /// Whether there was guidance in this trial: the checkpoint stays passed when the predictor is lost.
    passed_checkpoint: bool,
    smallest_clearance: Option<f64>,
    before: Mean,
    after: Mean,
    effort: Mean,
    setpoint_motion: Option<Motion>,
    state_motion: Option<Motion>,
    stops: Vec<Stop>,
}

/// A stop, as it was published.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Stop {
    /// Ticks since the trial began.
    pub tick: u32,
    /// Who stopped.
    pub by: &'static str,
    /// Why, in words.
    pub reason: String,
    #[serde(skip)]
    absolute_tick: u32,
}

#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    sum: f64,
    count: u32,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.count += 1;
    }

    fn value(self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / f64::from(self.count))
    }
}

/// The figures of a trial.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Figures {
    /// Whether the tool came to rest within the tolerance of the goal.
    pub reached_goal: bool,
    /// Its distance to the goal at the end.
    pub goal_distance_m: Option<f64>,
    /// Control periods from the trial's begin to the last motion.
    pub ticks: u32,
    /// The smallest distance of arm or tool to an obstacle.
    pub min_clearance_m: Option<f64>,
    /// Mean norm of the human's velocity over the ticks after the checkpoint, before weight and limits.
    pub human_effort_mean_m_s: Option<f64>,
    /// Mean weight of the human over all ticks with motion.
    pub weight_mean: Option<f64>,
    /// The same before the checkpoint.
    pub weight_mean_before: Option<f64>,
    /// The same after it.
    pub weight_mean_after: Option<f64>,
    /// Stops on the way, in order.
    pub stops: Vec<Stop>,
}

impl Summary {
    pub(crate) fn see_scene(&mut self, scene: &Scene) {
        self.goal = Some((scene.goal, scene.goal_tolerance.0));
    }

    pub(crate) fn see_state(&mut self, state: &Envelope<State>) {
        if state.body.trial == 0 {
            return;
        }
        self.state_tick = state.header.tick;
        self.began_at.get_or_insert(state.body.trial_start);
        self.tool = Some(state.body.tool.position);
        self.at_rest = state.body.at_rest;
        if self.is_over() {
            return;
        }
        let moving = self.last_motion_tick.is_some();
        if let Some(closest) = state.body.closest.filter(|_| moving) {
            let smallest = self.smallest_clearance.unwrap_or(f64::INFINITY);
            self.smallest_clearance = Some(smallest.min(closest.distance.0));
        }
        let was = self.state_motion.replace(state.body.motion);
        self.note_stop("robot-sim", state.header.tick, was, state.body.motion);
    }

    pub(crate) fn see_setpoint(&mut self, setpoint: &Envelope<Setpoint>) {
        if self.began_at.is_none() || self.is_over() {
            return;
        }
        let tick = setpoint.header.tick;
        if let Some((decided, last)) = self.current
            && decided != tick
        {
            self.count(decided, &last);
        }
        self.current = Some((tick, setpoint.body));
        let was = self.setpoint_motion.replace(setpoint.body.motion);
        self.note_stop("arbiter", tick, was, setpoint.body.motion);
    }

    fn count(&mut self, tick: u32, setpoint: &Setpoint) {
        if !setpoint.motion.is_permitted() {
            return;
        }
        self.last_motion_tick = Some(tick);
        self.passed_checkpoint |= setpoint.guidance.is_some();
        if self.passed_checkpoint {
            self.after.add(setpoint.weight.0);
            self.effort.add(setpoint.human.norm());
        } else {
            self.before.add(setpoint.weight.0);
        }
    }

    fn note_stop(&mut self, by: &'static str, tick: u32, was: Option<Motion>, is: Motion) {
        if let (Some(Motion::Permitted { .. }), Motion::Held(reason)) = (was, is) {
            let since = tick.saturating_sub(self.began_at.unwrap_or(tick));
            self.stops.push(Stop {
                tick: since,
                by,
                reason: reason.to_string(),
                absolute_tick: tick,
            });
        }
    }

    /// Whether the human has finished, or given up.
    pub(crate) fn is_over(&self) -> bool {
        self.last_motion_tick
            .is_some_and(|last| self.state_tick > last.saturating_add(QUIET_TICKS))
    }

    /// Ticks since the trial began.
    pub(crate) fn ticks(&self) -> u32 {
        self.state_tick.saturating_sub(self.began_at.unwrap_or(self.state_tick))
    }

    /// One line on where the trial is.
    pub(crate) fn progress(&self) -> String {
        let Some((_, setpoint)) = &self.current else {
            return "waiting for the first setpoint".into();
        };
        let phase = setpoint.guidance.map_or_else(String::new, |guidance| {
            format!(
                ", step {:.0} of {}",
                guidance.phase.0.min(f64::from(guidance.last_step)),
                guidance.last_step
            )
        });
        match setpoint.motion {
            Motion::Permitted { .. } if setpoint.guidance.is_none() => "human alone, before the checkpoint".into(),
            Motion::Permitted { .. } => format!("shared, ω = {:.2}{phase}", setpoint.weight.0),
            Motion::Held(reason) => format!("held: {reason}"),
        }
    }

    /// The figures of the trial so far.
    pub(crate) fn figures(&self) -> Figures {
        let end = self.last_motion_tick.unwrap_or(self.state_tick);
        let began = self.began_at.unwrap_or(end);
        let distance = self.goal.zip(self.tool).map(|((goal, _), tool)| (goal - tool).norm());
        let total = Mean {
            sum: self.before.sum + self.after.sum,
            count: self.before.count + self.after.count,
        };
        Figures {
            reached_goal: distance
                .zip(self.goal)
                .is_some_and(|(distance, (_, tolerance))| self.at_rest && distance <= tolerance),
            goal_distance_m: distance,
            ticks: if self.last_motion_tick.is_some() {
                end.saturating_sub(began).saturating_add(1)
            } else {
                0
            },
            min_clearance_m: self.smallest_clearance,
            human_effort_mean_m_s: self.effort.value(),
            weight_mean: total.value(),
            weight_mean_before: self.before.value(),
            weight_mean_after: self.after.value(),
            stops: self
                .stops
                .iter()
                .filter(|stop| stop.absolute_tick <= end)
                .cloned()
                .collect(),
        }
    }
}
