//! Two runs of the same session in one picture: the original, and what would have been.
//!
//! | entities | what |
//! | --- | --- |
//! | `world/original/…`, `world/alternative/…` | arm, path, forecast of each |
//! | `plan/original/…`, `plan/alternative/…` | the same from above |
//! | `plots/<figure>/original`, `…/alternative` | the human's weight, effort, clearance, distance from the forecast |
//! | `plots/apart` | how far the two tools are from each other |
//! | `lanes/original`, `lanes/alternative` | who drives |
//! | `now` | what was changed, and what cannot be known |

use rerun::Color;
use tandem_wire::{Body, Forecast, Setpoint, Stamp, State, Vec3};

use super::plots::Driver;
use super::trace::Trace;
use super::{Drawing, Moment, Sheet, arm, colours, fixed, plan, surroundings, xyz};
use crate::heard::{Entry, Heard, Sample};

/// Which of the two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// As it was.
    Original,
    /// As it would have been.
    Alternative,
}

impl Side {
    const BOTH: [Self; 2] = [Self::Original, Self::Alternative];

    const fn name(self) -> &'static str {
        match self {
            Self::Original => "original",
            Self::Alternative => "alternative",
        }
    }

    const fn colour(self) -> Color {
        match self {
            Self::Original => colours::ORIGINAL,
            Self::Alternative => colours::ALTERNATIVE,
        }
    }
}

/// Draws both sides as they are heard.
#[derive(Debug)]
pub(crate) struct Comparison {
    halves: [Half; 2],
    has_scene: bool,
    /// Where `trial_time` is zero.
    origin: Option<Stamp>,
}

#[derive(Debug, Default)]
struct Half {
    bodies: Vec<Body>,
    trial: Option<(u32, u32)>,
    trace: Trace,
    tool: Option<Vec3>,
    driver: Option<Driver>,
}

impl Comparison {
    pub(crate) fn new() -> Self {
        Self {
            halves: [Half::default(), Half::default()],
            has_scene: false,
            origin: None,
        }
    }

    /// Names and colours, and the words that stand over everything.
    pub(crate) fn opening(words: &str) -> Vec<Drawing> {
        let mut drawings = vec![
            fixed("world", &rerun::ViewCoordinates::RIGHT_HAND_Z_UP()),
            fixed("now", &rerun::TextDocument::from_markdown(words)),
        ];
        for side in Side::BOTH {
            let line = |figure: &str, width: f32| {
                let style = rerun::SeriesLines::new().with_names([side.name()]);
                let style = style.with_colors([side.colour()]).with_widths([width]);
                fixed(&format!("plots/{figure}/{}", side.name()), &style)
            };
            drawings.extend(["weight", "effort", "clearance", "off_forecast"].map(|figure| line(figure, 2.0)));
            let drivers = rerun::StateConfiguration::new()
                .with_values(Driver::ALL.map(Driver::name))
                .with_colors(Driver::ALL.map(Driver::colour));
            drawings.push(fixed(&format!("lanes/{}", side.name()), &drivers));
        }
        let apart = rerun::SeriesLines::new().with_names(["tools apart"]);
        let apart = apart.with_colors([colours::ALTERNATIVE]).with_widths([2.0]);
        drawings.push(fixed("plots/apart", &apart));
        drawings
    }

    pub(crate) fn draw(&mut self, side: Side, heard: &Heard, drawings: &mut Vec<Drawing>) {
        let origin = *self.origin.get_or_insert(heard.session_time);
        let moment = Moment {
            tick: heard.tick,
            session_time: heard.session_time,
            trial_time: heard.session_time.since(origin),
        };
        let mut sheet = Sheet {
            moment,
            drawings,
            side: Some(side.name()),
        };
        let Entry::Sample(sample) = &heard.entry else { return };
        match sample {
            Sample::Scene(message) => {
                self.halves[side as usize].bodies.clone_from(&message.body.bodies);
                if !std::mem::replace(&mut self.has_scene, true) {
                    sheet.side = None;
                    surroundings::draw(&message.body, &mut sheet);
                }
            }
            Sample::State(message) => self.draw_state(side, &message.body, &mut sheet),
            Sample::Setpoint(message) => self.draw_setpoint(side, &message.body, &mut sheet),
            Sample::Forecast(message) => draw_forecast(side, &message.body, &mut sheet),
            _ => {}
        }
    }

    fn draw_state(&mut self, side: Side, state: &State, sheet: &mut Sheet<'_>) {
        let half = &mut self.halves[side as usize];
        let trial = (state.trial, state.trial_start);
        if state.trial != 0 && half.trial.replace(trial) != Some(trial) {
            half.trace = Trace::default();
            for path in ["world/path", "plan/path", "world/forecast", "plan/forecast"] {
                sheet.draw(path, &rerun::Clear::recursive());
            }
        }
        let tool = state.tool.position;
        half.tool = Some(tool);
        arm::draw_in(side.colour(), &half.bodies, state, sheet);
        arm::draw_tool(side.colour(), state, sheet);
        half.trace.draw(tool, side.colour(), sheet);
        if let Some(clearance) = state.closest.or(state.clearance) {
            sheet.plot(&format!("plots/clearance/{}", side.name()), clearance.distance.0 * 1e3);
        }
        let tools = [self.halves[0].tool, self.halves[1].tool];
        if let ([Some(one), Some(other)], Side::Alternative) = (tools, side) {
            sheet.plot("plots/apart", (one - other).norm() * 1e3);
        }
    }

    fn draw_setpoint(&mut self, side: Side, setpoint: &Setpoint, sheet: &mut Sheet<'_>) {
        let name = side.name();
        sheet.plot(&format!("plots/weight/{name}"), setpoint.weight.0);
        sheet.plot(&format!("plots/effort/{name}"), setpoint.human.norm());
        let half = &mut self.halves[side as usize];
        if let (Some(guidance), Some(tool)) = (&setpoint.guidance, half.tool) {
            let off = (guidance.position - tool).norm() * 1e3;
            sheet.plot(&format!("plots/off_forecast/{name}"), off);
        }
        let driver = Driver::of(setpoint);
        if half.driver.replace(driver) != Some(driver) {
            sheet.side = None;
            sheet.draw(&format!("lanes/{name}"), &rerun::StateChange::single(driver.name()));
        }
    }
}

/// Its line alone: two intervals over each other could not be told apart.
fn draw_forecast(side: Side, forecast: &Forecast, sheet: &mut Sheet<'_>) {
    let points = || forecast.points.iter().map(|point| point.position);
    let line = rerun::LineStrips3D::new([rerun::LineStrip3D::from_iter(points().map(xyz))]);
    let line = line.with_colors([side.colour()]).with_radii([0.0006]);
    sheet.draw("world/forecast", &line);
    let line = rerun::LineStrips2D::new([points().map(plan).collect::<Vec<_>>()]);
    let line = line.with_colors([side.colour()]).with_radii([0.0005]);
    sheet.draw("plan/forecast", &line.with_draw_order(4.0));
}
