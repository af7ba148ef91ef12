//! One trial as the report needs it: who drove what, its figures, and curves thin enough to draw a thousand of.

use serde::Serialize;

use crate::Measures;
use crate::trace::{ForecastMade, Point, Trace};

/// Points of a curve that is drawn: more cannot be told apart in a picture of a trial.
const POINTS: usize = 120;
/// Arrows of the human's velocity along a path.
const ARROWS: usize = 24;
/// How far ahead such an arrow looks, in seconds.
const ARROW_S: f64 = 0.25;
/// Forecasts of one trial that are drawn: with a forecast at every tick they would cover everything else.
const FORECASTS: usize = 4;

/// Who drove what, and how it ended.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Identity {
    /// The trial's number in the run.
    pub number: u32,
    /// Who drove.
    pub participant: String,
    /// Under which condition.
    pub condition: String,
    /// In which context.
    pub context: String,
    /// How the context lies to the demonstrations.
    pub group: String,
    /// Which repetition, from 1.
    pub repetition: u32,
    /// The seed of its human.
    pub seed: u64,
    /// Whether it was judged a success.
    pub success: bool,
    /// Why, if somebody said.
    pub reason: Option<String>,
    /// What the person wrote down.
    pub note: String,
    /// The session file, relative to the run's folder.
    pub session: String,
    /// Where in the session it begins, in seconds.
    pub began_s: f64,
}

impl Identity {
    /// What trials share that differ in nothing but the condition.
    #[must_use]
    pub fn pairing(&self) -> (&str, &str, u32) {
        (&self.participant, &self.context, self.repetition)
    }
}

/// A trial of the report.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Case {
    /// Who drove what.
    #[serde(flatten)]
    pub identity: Identity,
    /// Its figures.
    pub measures: Measures,
    /// The human's weight after the checkpoint, if it never changed there.
    pub constant_weight: Option<f64>,
    /// How alike neighbouring steps' efforts are: their correlation at a distance of one step.
    pub autocorrelation: Option<f64>,
    /// What is drawn.
    #[serde(skip)]
    pub curves: Curves,
}

impl Case {
    /// Takes from a trace what the report needs; the trace can be dropped then.
    #[must_use]
    pub fn new(identity: Identity, trace: &Trace) -> Self {
        let measures = Measures::of(trace);
        Self {
            identity,
            constant_weight: constant_weight(trace),
            autocorrelation: autocorrelation(&measures.human_effort_steps_m_s),
            curves: Curves::of(trace),
            measures,
        }
    }
}

fn constant_weight(trace: &Trace) -> Option<f64> {
    let decided = trace.ticks.iter().filter_map(|tick| tick.decision.as_ref());
    let shared = decided.filter(|decision| decision.is_permitted() && decision.robot.is_some());
    let mut weights = shared.map(|decision| decision.weight);
    let first = weights.next()?;
    weights.all(|weight| (weight - first).abs() < 1e-9).then_some(first)
}

fn autocorrelation(steps: &[f64]) -> Option<f64> {
    if steps.len() < 3 {
        return None;
    }
    let mean = steps.iter().sum::<f64>() / steps.len() as f64;
    let spread: f64 = steps.iter().map(|step| (step - mean) * (step - mean)).sum();
    let shared: f64 = steps.windows(2).map(|pair| (pair[0] - mean) * (pair[1] - mean)).sum();
    (spread > 0.0).then(|| shared / spread)
}

/// A point of a picture: seen from above, the base's y to the right and its x downwards, in metres; or seconds and ω.
pub type Dot = [f32; 2];

/// The curves of one trial.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curves {
    /// What the tool did.
    pub tool: Vec<Dot>,
    /// Where the first forecast was made.
    pub checkpoint: Option<Dot>,
    /// Forecasts, at most four of them.
    pub forecasts: Vec<Vec<Dot>>,
    /// The interval around the last one, as a closed outline.
    pub band: Vec<Dot>,
    /// Where a simulated human wished to be.
    pub wish: Vec<Dot>,
    /// The human's velocity: from the tool to where a quarter of a second of it leads.
    pub human: Vec<[Dot; 2]>,
    /// Seconds since the trial began, and ω, while motion was permitted.
    pub weight: Vec<Dot>,
    /// When the first forecast was made, in seconds since the trial began.
    pub checkpoint_s: Option<f32>,
    /// The control period in seconds.
    pub period_s: f32,
    /// Obstacles: centre and radius.
    pub obstacles: Vec<(Dot, f32)>,
    /// Goal and its tolerance.
    pub goal: Option<(Dot, f32)>,
    /// When it was stopped, in seconds since the trial began.
    pub stops_s: Vec<f32>,
}

impl Curves {
    fn of(trace: &Trace) -> Self {
        let period = trace.period_s().unwrap_or(1.0);
        let forecast_at = trace.forecasts.first().map(|made| made.tick);
        let tools: Vec<Point> = trace
            .ticks
            .iter()
            .filter_map(|tick| Some(tick.state.as_ref()?.tool))
            .collect();
        let mut curves = Self {
            tool: thinned(&tools.iter().map(|tool| above(*tool)).collect::<Vec<_>>(), POINTS),
            checkpoint: forecast_at.and_then(|at| {
                let tick = trace.ticks.iter().find(|tick| tick.tick >= at)?;
                Some(above(tick.state.as_ref()?.tool))
            }),
            checkpoint_s: forecast_at.map(|at| small(f64::from(at) * period)),
            period_s: small(period),
            wish: thinned(
                &trace
                    .ticks
                    .iter()
                    .filter_map(|tick| tick.wish.map(above))
                    .collect::<Vec<_>>(),
                POINTS,
            ),
            human: thinned(&arrows(trace), ARROWS),
            stops_s: trace
                .stops
                .iter()
                .map(|stop| small(f64::from(stop.tick) * period))
                .collect(),
            ..Self::default()
        };
        let moving = trace.ticks.iter().filter(|tick| tick.is_moving());
        let weights = moving.filter_map(|tick| {
            let weight = tick.decision.as_ref()?.weight;
            Some([small(f64::from(tick.tick) * period), small(weight)])
        });
        curves.weight = weights.collect();
        curves.take_forecasts(&trace.forecasts);
        if let Some(scene) = &trace.scene {
            let obstacles = scene.obstacles.iter();
            curves.obstacles = obstacles.map(|one| (above(one.foot), small(one.radius_m))).collect();
            curves.goal = Some((above(scene.goal), small(scene.goal_tolerance_m)));
        }
        curves
    }

    fn take_forecasts(&mut self, made: &[ForecastMade]) {
        let drawn = thinned(&made.iter().collect::<Vec<_>>(), FORECASTS);
        self.forecasts = drawn
            .iter()
            .map(|made| {
                thinned(
                    &made.positions.iter().map(|point| above(*point)).collect::<Vec<_>>(),
                    POINTS,
                )
            })
            .collect();
        self.band = made.last().map(band).unwrap_or_default();
    }
}

fn arrows(trace: &Trace) -> Vec<[Dot; 2]> {
    let moving = trace.ticks.iter().filter(|tick| tick.is_moving());
    moving
        .filter_map(|tick| {
            let (from, human) = (tick.state.as_ref()?.tool, tick.decision.as_ref()?.human);
            let to = [0, 1, 2].map(|axis| from[axis] + ARROW_S * human[axis]);
            Some([above(from), above(to)])
        })
        .collect()
}

/// The interval across the path: there and back again, each point moved by its half-width along the path's normal.
fn band(made: &ForecastMade) -> Vec<Dot> {
    let pairs: Vec<(&Point, &Point)> = made.positions.iter().zip(&made.half_widths).collect();
    let pairs = thinned(&pairs, POINTS);
    let side = |sign: f64| -> Vec<Dot> {
        (0..pairs.len())
            .map(|place| {
                let (here, width) = pairs[place];
                let (before, after) = (
                    pairs[place.saturating_sub(1)].0,
                    pairs[(place + 1).min(pairs.len() - 1)].0,
                );
                let [x, y] = [after[0] - before[0], after[1] - before[1]];
                let length = libm::hypot(x, y);
                let [nx, ny] = if length > 0.0 {
                    [-y / length, x / length]
                } else {
                    [1.0, 0.0]
                };
                let half = libm::hypot(nx * width[0], ny * width[1]);
                above([here[0] + sign * half * nx, here[1] + sign * half * ny, here[2]])
            })
            .collect()
    };
    let mut outline = side(1.0);
    outline.extend(side(-1.0).into_iter().rev());
    outline
}

fn above([x, y, _]: Point) -> Dot {
    [small(y), small(x)]
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "a thousandth of a pixel is enough for a picture"
)]
const fn small(value: f64) -> f32 {
    value as f32
}

/// At most `most` of them, evenly chosen, the last one among them.
pub(super) fn thinned<T: Clone>(all: &[T], most: usize) -> Vec<T> {
    if all.len() <= most || most < 2 {
        return all.to_vec();
    }
    (0..most)
        .map(|place| all[place * (all.len() - 1) / (most - 1)].clone())
        .collect()
}
