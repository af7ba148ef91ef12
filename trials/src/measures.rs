//! The figures of a trial.
//!
//! A tick *with motion* is one whose last setpoint permits it. The *checkpoint* lies before the first tick with motion
//! for which there was a forecast, and stays passed when the predictor is lost later. `h` is the human's velocity as
//! commanded, `r` the robot's, `ω` the human's weight, `Δt` the control period.

use serde::{Deserialize, Serialize};
use tandem_wire::Vec3;

use crate::smoothness::sparc;
use crate::trace::{Drops, Guided, Point, Stand, Stop, Tick, Trace};

/// Slower than this, a velocity has no direction worth comparing, in metres per second.
const STILL: f64 = 1e-3;

/// The figures of a trial; `None` where it gives no occasion to measure.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measures {
    /// Whether the tool came to rest within the tolerance of the goal.
    pub reached_goal: bool,
    /// Its distance to the goal at the end.
    pub goal_distance_m: Option<f64>,
    /// Control periods from the trial's begin to the last one with motion.
    pub ticks: u32,
    /// From the first to the last tick with motion, both included.
    pub duration_s: Option<f64>,
    /// `Σ |p(k+1) − p(k)|` of the tool, from the first tick with motion on, at the control period.
    pub path_length_m: Option<f64>,
    /// Spectral arc length of the tool's speed, see [`sparc`]: negative, and nearer to zero the smoother.
    pub smoothness_sparc: Option<f64>,
    /// The smallest distance of arm or tool to an obstacle from the first tick with motion on; negative inside.
    pub min_clearance_m: Option<f64>,
    /// How often an obstacle was touched; a touch that lasts counts once.
    pub contacts: u32,
    /// The paper's effort: the mean of `|h|` over the ticks with motion after the checkpoint, before weight and limits.
    pub human_effort_mean_m_s: Option<f64>,
    /// Its integral `Σ |h| Δt` over the same ticks: how far the human's commands alone would have gone.
    pub human_effort_integral_m: Option<f64>,
    /// `|h|` at each *shared step*: the ticks with motion on which the forecast's phase lies before its last step, so
    /// that waiting at the goal does not count. The samples of the paper's tests.
    pub human_effort_steps_m_s: Vec<f64>,
    /// Mean ω over all ticks with motion.
    pub weight_mean: Option<f64>,
    /// The same before the checkpoint.
    pub weight_mean_before: Option<f64>,
    /// The same after it.
    pub weight_mean_after: Option<f64>,
    /// Mean `|h − r|` over the ticks with motion and a forecast.
    pub disagreement_mean_m_s: Option<f64>,
    /// Mean cosine between `h` and `r` over those of them on which both are faster than a millimetre per second: 1 is
    /// agreement, −1 is contradiction.
    pub agreement_cosine_mean: Option<f64>,
    /// Mean distance of the tool from the forecast position, over the ticks with motion and a forecast.
    pub tracking_forecast_mean_m: Option<f64>,
    /// The largest such distance.
    pub tracking_forecast_max_m: Option<f64>,
    /// Mean distance of the tool from where the simulated human wished to be, over the ticks with motion; `None` for a
    /// person.
    pub tracking_wish_mean_m: Option<f64>,
    /// The same after the checkpoint only.
    pub tracking_wish_after_mean_m: Option<f64>,
    /// Half of the commands reached the arm's motion within this time.
    pub latency_p50_ms: Option<f64>,
    /// All but one in a hundred did.
    pub latency_p99_ms: Option<f64>,
    /// Messages that were dropped or lost.
    pub drops: Drops,
    /// Stops on the way, in order.
    pub stops: Vec<Stop>,
}

impl Measures {
    /// The figures of `trace`. Total: an empty trace has no figures.
    #[must_use]
    pub fn of(trace: &Trace) -> Self {
        let mut means = Means::default();
        trace.ticks.iter().for_each(|tick| means.see(tick));
        let period = trace.period_s();
        let motion = trace.motion();
        let way = Way::of(trace);
        let goal_distance = goal_distance(trace);
        Self {
            reached_goal: reached(trace, goal_distance),
            goal_distance_m: goal_distance,
            ticks: motion.map_or(0, |(_, last)| last.saturating_add(1)),
            duration_s: motion
                .zip(period)
                .map(|((first, last), period)| (f64::from(last - first) + 1.0) * period),
            path_length_m: way.length,
            smoothness_sparc: period.and_then(|period| sparc(&way.speeds, period)),
            min_clearance_m: way.nearest,
            contacts: way.contacts,
            human_effort_mean_m_s: means.effort.value(),
            human_effort_integral_m: period
                .filter(|_| means.effort.count > 0)
                .map(|period| means.effort.sum * period),
            human_effort_steps_m_s: means.steps,
            weight_mean: means.before.and(means.after).value(),
            weight_mean_before: means.before.value(),
            weight_mean_after: means.after.value(),
            disagreement_mean_m_s: means.disagreement.value(),
            agreement_cosine_mean: means.cosine.value(),
            tracking_forecast_mean_m: means.tracking.value(),
            tracking_forecast_max_m: means.tracking.largest,
            tracking_wish_mean_m: means.wish.value(),
            tracking_wish_after_mean_m: means.wish_after.value(),
            latency_p50_ms: trace.latency.map(|latency| latency.p50_ms),
            latency_p99_ms: trace.latency.map(|latency| latency.p99_ms),
            drops: trace.drops,
            stops: trace.stops.clone(),
        }
    }
}

fn distance(a: Point, b: Point) -> f64 {
    (Vec3::from(a) - Vec3::from(b)).norm()
}

fn goal_distance(trace: &Trace) -> Option<f64> {
    let scene = trace.scene.as_ref()?;
    Some(distance(scene.goal, trace.last_state()?.tool))
}

fn reached(trace: &Trace, distance: Option<f64>) -> bool {
    let within = distance
        .zip(trace.scene.as_ref())
        .is_some_and(|(distance, scene)| distance <= scene.goal_tolerance_m);
    within && trace.last_state().is_some_and(|state| state.at_rest)
}

/// A mean on its way.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    sum: f64,
    count: u32,
    largest: Option<f64>,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.count += 1;
        self.largest = Some(self.largest.map_or(value, |largest| largest.max(value)));
    }

    fn and(self, other: Self) -> Self {
        Self {
            sum: self.sum + other.sum,
            count: self.count + other.count,
            largest: None,
        }
    }

    fn value(self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / f64::from(self.count))
    }
}

/// What is averaged over the ticks with motion.
#[derive(Debug, Default)]
struct Means {
    passed_checkpoint: bool,
    before: Mean,
    after: Mean,
    effort: Mean,
    steps: Vec<f64>,
    disagreement: Mean,
    cosine: Mean,
    tracking: Mean,
    wish: Mean,
    wish_after: Mean,
}

impl Means {
    fn see(&mut self, tick: &Tick) {
        let Some(decision) = tick.decision.as_ref().filter(|decision| decision.is_permitted()) else {
            return;
        };
        let human = Vec3::from(decision.human);
        self.passed_checkpoint |= decision.robot.is_some();
        if self.passed_checkpoint {
            self.after.add(decision.weight);
            self.effort.add(human.norm());
        } else {
            self.before.add(decision.weight);
        }
        if let Some(robot) = &decision.robot {
            self.see_guided(human, robot, tick.state.as_ref());
        }
        if let Some((state, wish)) = tick.state.as_ref().zip(tick.wish) {
            self.wish.add(distance(state.tool, wish));
            if self.passed_checkpoint {
                self.wish_after.add(distance(state.tool, wish));
            }
        }
    }

    fn see_guided(&mut self, human: Vec3, robot: &Guided, state: Option<&Stand>) {
        let velocity = Vec3::from(robot.velocity);
        if robot.phase < f64::from(robot.last_step) {
            self.steps.push(human.norm());
        }
        self.disagreement.add((human - velocity).norm());
        if human.norm() > STILL && velocity.norm() > STILL {
            self.cosine.add(human.dot(velocity) / (human.norm() * velocity.norm()));
        }
        if let Some(state) = state {
            self.tracking.add(distance(state.tool, robot.position));
        }
    }
}

/// The tool's way, from the first tick with motion to the end of the trace: coming to rest belongs to it.
#[derive(Debug, Default)]
struct Way {
    length: Option<f64>,
    speeds: Vec<f64>,
    nearest: Option<f64>,
    contacts: u32,
}

impl Way {
    fn of(trace: &Trace) -> Self {
        let mut way = Self::default();
        let Some((first, _)) = trace.motion() else {
            return way;
        };
        let states = trace.ticks.iter().filter(|tick| tick.tick >= first);
        let mut before: Option<&Stand> = None;
        for state in states.filter_map(|tick| tick.state.as_ref()) {
            let step = before.map_or(0.0, |before| distance(before.tool, state.tool));
            way.length = Some(way.length.unwrap_or(0.0) + step);
            way.speeds.push(Vec3::from(state.velocity).norm());
            way.see_distance(state, before);
            before = Some(state);
        }
        way
    }

    fn see_distance(&mut self, state: &Stand, before: Option<&Stand>) {
        let touches = |state: &Stand| state.nearest_m().is_some_and(|distance| distance <= 0.0);
        if let Some(distance) = state.nearest_m() {
            self.nearest = Some(self.nearest.map_or(distance, |nearest| nearest.min(distance)));
        }
        if touches(state) && !before.is_some_and(touches) {
            self.contacts += 1;
        }
    }
}
