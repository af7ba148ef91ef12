//! A forecast in the base frame, and the guidance it gives at a phase.
//!
//! At phase `j` (in steps of the demonstrations) the robot wants
//!
//! `velocity = ((ŷ(j + 1) − tool) − (1 − c)·(ŷ(j) − tool)) / Δt`, no faster than its limit,
//!
//! with `ŷ` linear between steps and constant after the last, and `c` the share of the present error that one step
//! shall correct. At `c = 1` it is `(ŷ(j + 1) − tool)/Δt`, the whole way to the next point; at `c = 0` the forecast's
//! own velocity. Across the forecast's way it may be another share, `c×`: with `o = ŷ(j) − tool`, the way's direction
//! `t` and `o× = o − (o·t) t`,
//!
//! `velocity ← velocity − s (c − c×) o× / Δt`, `s = min(1, |ŷ(j + 1) − ŷ(j)| / (Δt · 20 mm/s))`,
//!
//! so that at `c× = 0` the robot keeps the time along the way and leaves to the human on which side of it they go,
//! until the forecast comes to rest, where there is no way to be across of.

use bincode::{Decode, Encode};
use tandem_cesn::{Forecast as ModelForecast, Model};
use tandem_wire::{Finite, Forecast, ForecastPoint, Guidance, Nanos, TaskFrame, Vec3};

/// How a forecast becomes a velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Following {
    /// The share of the present error that is corrected in one step.
    pub(crate) correction: f64,
    /// The same across the forecast's way; no larger.
    pub(crate) across: f64,
    /// In metres per second.
    pub(crate) speed_limit: f64,
    /// The control period in seconds.
    pub(crate) period_s: f64,
}

/// At this speed of the forecast, in metres per second, its direction is taken in full.
const MOVING: f64 = 0.02;

impl Following {
    /// What of the correction `off` is left out because it leads across the way to the forecast's next step.
    fn yielding(&self, way: Vec3, off: Vec3) -> Vec3 {
        let (length, spared) = (way.norm(), self.correction - self.across);
        if spared <= 0.0 || length <= f64::EPSILON {
            return Vec3::ZERO;
        }
        let direction = way * (1.0 / length);
        let across = off - direction * off.dot(direction);
        across * (spared * (length / (MOVING * self.period_s)).min(1.0))
    }
}

/// A forecast and where the movement is on it.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
pub(crate) struct Course {
    number: u32,
    first: u32,
    last: u32,
    /// One for each step from `first` to `last`.
    points: Vec<ForecastPoint>,
    ratio_high: f64,
    phase: f64,
}

impl Course {
    /// The model's forecast, carried into the base frame. `None` if it has no steps, or more than can be counted.
    pub(crate) fn new(
        number: u32,
        model: &Model,
        forecast: &ModelForecast,
        frame: &TaskFrame,
        phase: f64,
    ) -> Option<Self> {
        let steps = forecast.steps();
        let last = u32::try_from(steps.end.checked_sub(1)?).ok()?;
        let points: Vec<ForecastPoint> = steps.map_while(|step| point(forecast, frame, step)).collect();
        (!points.is_empty()).then_some(Self {
            number,
            first: u32::try_from(forecast.first_step()).ok()?,
            last,
            points,
            ratio_high: model.calibration().rho_hi,
            phase: phase.min(f64::from(last)),
        })
    }

    /// Whether it is one that [`Self::new`] can have made.
    pub(crate) fn is_possible(&self) -> bool {
        let steps = self.last.checked_sub(self.first).map(u64::from);
        steps.is_some_and(|steps| self.points.len() as u64 == steps + 1)
            && [self.ratio_high, self.phase].iter().all(|number| number.is_finite())
    }

    /// Where the movement is, in steps.
    pub(crate) fn phase(&self) -> f64 {
        self.phase
    }

    /// Moves on by so many ticks, up to the last step.
    pub(crate) fn advance(&mut self, ticks: u32) {
        self.phase = (self.phase + f64::from(ticks)).min(f64::from(self.last));
    }

    /// What the robot wants with its tool at `tool`.
    ///
    /// Only within the task's plane: the demonstrations know no height, so the robot neither lifts nor lowers the tool,
    /// and a human who does is not pulled back, nor does the pull eat up the speed limit.
    pub(crate) fn guidance(&self, tool: Vec3, frame: &TaskFrame, following: &Following) -> Guidance {
        let (now, next) = (self.at(self.phase), self.at(self.phase + 1.0));
        let off = now.position - tool;
        let way = (next.position - tool) - off * (1.0 - following.correction);
        let way = way - following.yielding(next.position - now.position, off);
        let in_plane = frame.vector_to_base([way.dot(frame.x_axis), way.dot(frame.y_axis)]);
        Guidance {
            forecast: self.number,
            phase: Finite(self.phase),
            last_step: self.last,
            velocity: (in_plane * (1.0 / following.period_s)).capped(following.speed_limit),
            position: now.position,
            half_width: now.half_width,
            ratio: now.ratio,
            ratio_high: Finite(self.ratio_high),
        }
    }

    /// The whole forecast as a message.
    pub(crate) fn message(&self, context: &[f64], model: &Model, period: Nanos) -> Forecast {
        Forecast {
            number: self.number,
            context: context.iter().copied().map(Finite).collect(),
            model: model.hash(),
            first_step: self.first,
            period,
            points: self.points.clone(),
        }
    }

    /// The forecast at a phase: linear between steps, constant outside of them.
    fn at(&self, phase: f64) -> ForecastPoint {
        let behind = phase - f64::from(self.first);
        let index = (1..self.points.len())
            .take_while(|index| *index as f64 <= behind)
            .count();
        let (low, high) = (self.points[index], self.points[(index + 1).min(self.points.len() - 1)]);
        let share = (behind - index as f64).clamp(0.0, 1.0);
        let mean = |a: Vec3, b: Vec3| a + (b - a) * share;
        ForecastPoint {
            position: mean(low.position, high.position),
            half_width: mean(low.half_width, high.half_width),
            ratio: Finite(low.ratio.0 + (high.ratio.0 - low.ratio.0) * share),
        }
    }
}

/// One step of the model's forecast, in the base frame.
fn point(forecast: &ModelForecast, frame: &TaskFrame, step: usize) -> Option<ForecastPoint> {
    let pair = |values: Option<&[f64]>| values?.first_chunk::<2>().copied();
    Some(ForecastPoint {
        position: frame.to_base(pair(forecast.mean(step))?),
        half_width: extent_in_base(pair(forecast.half_width(step))?, frame),
        ratio: Finite(forecast.ratio(step)?),
    })
}

/// Half the sides of the box, along the base's axes, around an interval of half-widths along the task's axes.
///
/// Exact where the axes coincide, as in the shipped task; elsewhere the box is the smallest that holds the whole
/// interval. Its height is zero: the model says nothing about it.
fn extent_in_base(half_width: [f64; 2], frame: &TaskFrame) -> Vec3 {
    let size = |v: Vec3| Vec3::new(v.x.abs(), v.y.abs(), v.z.abs());
    size(frame.x_axis) * half_width[0] + size(frame.y_axis) * half_width[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    const FOLLOWING: Following = Following {
        correction: 1.0,
        across: 1.0,
        speed_limit: 0.5,
        period_s: 0.1,
    };

    /// A forecast that moves 10 mm along the base's y with every step, from step 41 to 44.
    fn course(phase: f64) -> Course {
        let point = |step: f64| ForecastPoint {
            position: Vec3::new(0.4, 0.01 * step, 0.15),
            half_width: Vec3::new(0.001 * step, 0.0, 0.0),
            ratio: Finite(1.0 + 0.1 * step),
        };
        Course {
            number: 1,
            first: 41,
            last: 44,
            points: [0.0, 1.0, 2.0, 3.0].map(point).to_vec(),
            ratio_high: 1.5,
            phase,
        }
    }

    fn guidance(course: &Course, tool: Vec3) -> Guidance {
        course.guidance(tool, &TaskFrame::default(), &FOLLOWING)
    }

    #[test]
    fn the_velocity_leads_to_where_the_forecast_is_one_step_later() {
        let given = guidance(&course(41.5), Vec3::new(0.4, 0.005, 0.15));
        assert!((given.velocity - Vec3::new(0.0, 0.1, 0.0)).norm() < 1e-12);
        assert!((given.position.y - 0.005).abs() < 1e-12);
        assert!((given.half_width.x - 0.0005).abs() < 1e-12);
        assert!((given.ratio.0 - 1.05).abs() < 1e-12);
    }

    #[test]
    fn the_robot_is_capped_and_keeps_its_height() {
        let given = guidance(&course(41.0), Vec3::new(0.2, -0.5, 0.9));
        assert!((given.velocity.norm() - 0.5).abs() < 1e-12);
        assert_eq!(given.velocity.z, 0.0);
    }

    #[test]
    fn after_the_last_step_it_holds_the_last_position() {
        let mut course = course(43.7);
        course.advance(1);
        let here = Vec3::new(0.4, 0.03, 0.15);
        assert_eq!(guidance(&course, here).phase, Finite(44.0));
        assert!(guidance(&course, here).velocity.norm() < 1e-12);
        course.advance(u32::MAX);
        let given = guidance(&course, here + Vec3::new(0.0, 0.01, 0.0));
        assert!((given.velocity.y + 0.1).abs() < 1e-12);
    }

    #[test]
    fn feed_forward_ignores_the_share_of_the_error_it_is_told_to() {
        let off = Vec3::new(0.42, 0.0, 0.15);
        let with = |correction| {
            let following = Following {
                correction,
                across: correction,
                ..FOLLOWING
            };
            course(41.0).guidance(off, &TaskFrame::default(), &following).velocity
        };
        assert!((with(0.0) - Vec3::new(0.0, 0.1, 0.0)).norm() < 1e-12);
        assert!((with(0.5) - Vec3::new(-0.1, 0.1, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn across_the_way_the_human_may_be_left_alone() {
        let off = Vec3::new(0.42, -0.004, 0.15);
        let with = |across| {
            let following = Following { across, ..FOLLOWING };
            let velocity = |phase| course(phase).guidance(off, &TaskFrame::default(), &following).velocity;
            [velocity(41.0), velocity(44.0)]
        };
        let [moving, resting] = with(0.0);
        assert!((moving - Vec3::new(0.0, 0.14, 0.0)).norm() < 1e-12, "{moving:?}");
        assert_eq!(resting, with(1.0)[1], "where it rests it leads to the forecast");
        assert!((with(0.5)[0] - Vec3::new(-0.1, 0.14, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn half_widths_follow_the_axes_of_the_task() {
        let shipped = extent_in_base([0.001, 0.002], &TaskFrame::default());
        assert_eq!(shipped, Vec3::new(0.002, 0.001, 0.0));
        let half = 0.5_f64.sqrt();
        let turned = TaskFrame {
            x_axis: Vec3::new(half, half, 0.0),
            y_axis: Vec3::new(-half, half, 0.0),
            ..TaskFrame::default()
        };
        let extent = extent_in_base([0.001, 0.001], &turned);
        assert!((extent.x - 0.002 * half).abs() < 1e-15 && (extent.y - 0.002 * half).abs() < 1e-15);
    }
}
