//! The numbers over time, and the lane of who drives.

use std::collections::VecDeque;

use rerun::Color;
use tandem_wire::{Envelope, Guidance, MessageId, Nanos, Pace, Scene, Setpoint, Stamp, State, Vec3, seconds};

use super::{Drawing, Sheet, colours, fixed};
use crate::sinks::Drops;
use crate::tally::Counts;

/// Commands whose arrival is remembered until the robot moves by them: five seconds' worth at 50 Hz.
const COMMANDS: usize = 256;

/// Who drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Driver {
    /// The human alone: there is no forecast, or the weight is 1.
    Human,
    /// Both.
    Shared,
    /// The robot alone.
    Robot,
    /// Nobody: motion is held.
    Held,
}

impl Driver {
    pub(super) const ALL: [Self; 4] = [Self::Human, Self::Shared, Self::Robot, Self::Held];

    pub(super) fn of(setpoint: &Setpoint) -> Self {
        let weight = setpoint.weight.0;
        if !setpoint.motion.is_permitted() {
            Self::Held
        } else if setpoint.guidance.is_none() || weight >= 1.0 {
            Self::Human
        } else if weight <= 0.0 {
            Self::Robot
        } else {
            Self::Shared
        }
    }

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Human => "human",
            Self::Shared => "shared",
            Self::Robot => "robot",
            Self::Held => "held",
        }
    }

    /// Its height in the plot of who drives: the more human, the higher.
    const fn level(self) -> f64 {
        match self {
            Self::Human => 3.0,
            Self::Shared => 2.0,
            Self::Robot => 1.0,
            Self::Held => 0.0,
        }
    }

    fn series(self) -> String {
        format!("plots/driver/{}", self.name())
    }

    pub(super) const fn colour(self) -> Color {
        match self {
            Self::Human => colours::HUMAN,
            Self::Shared => colours::SHARED,
            Self::Robot => colours::ROBOT,
            Self::Held => colours::HELD,
        }
    }
}

/// Names and colours of all lines.
pub(super) fn styles() -> Vec<Drawing> {
    let line = |path: &str, name: &str, colour: Color, width: f32| {
        let style = rerun::SeriesLines::new().with_names([name]).with_colors([colour]);
        fixed(&format!("plots/{path}"), &style.with_widths([width]))
    };
    let (human, robot, result) = (colours::HUMAN, colours::ROBOT, colours::RESULT);
    let drivers = rerun::StateConfiguration::new()
        .with_values(Driver::ALL.map(Driver::name))
        .with_colors(Driver::ALL.map(Driver::colour));
    let driver = |driver: Driver| {
        let style = rerun::SeriesPoints::new()
            .with_names([driver.name()])
            .with_colors([driver.colour()]);
        let style = style
            .with_markers([rerun::components::MarkerShape::Square])
            .with_marker_sizes([6.0]);
        fixed(&driver.series(), &style)
    };
    let mut styles = Driver::ALL.map(driver).to_vec();
    styles.extend([
        fixed("lanes/driver", &drivers),
        // Its colour is who drives, and changes.
        fixed(
            "plots/weight/human",
            &rerun::SeriesLines::new()
                .with_names(["human's weight ω"])
                .with_widths([2.5]),
        ),
        line("effort/human", "human's command", human, 2.0),
        line("effort/robot", "robot's proposal", robot, 2.0),
        line("effort/tool", "tool", result, 1.0),
        line("interval/x", "half-width x", robot, 1.5),
        line("interval/y", "half-width y", colours::SHARED, 1.5),
        line("interval/z", "half-width z", colours::GOAL, 1.5),
        line("ratio/now", "ratio to training", robot, 2.0),
        line("ratio/high", "human gets all at", human, 1.0),
        line("across/tool", "tool", result, 2.0),
        line("across/forecast", "forecast", robot, 1.5),
        line("across/low", "interval, low", robot, 0.75),
        line("across/high", "interval, high", robot, 0.75),
        line("clearance", "clearance", colours::OBSTACLE, 2.0),
        line("latency", "command to motion", human, 1.5),
        line("arrivals/success_rate", "setpoints in time", robot, 1.5),
        line("arrivals/missed", "missed in a row", colours::OBSTACLE, 1.5),
        line("lost/missed", "missed", colours::OBSTACLE, 1.5),
        line("lost/unreadable", "unreadable", colours::SHARED, 1.5),
        line("lost/dropped_file", "dropped before the file", human, 1.5),
        line("lost/dropped_view", "dropped before a view", robot, 1.5),
    ]);
    styles
}

/// Across a path that nobody has described: the shipped task's.
pub(super) const ACROSS: Vec3 = Vec3::new(1.0, 0.0, 0.0);
/// Closer to each other than this, in metres, start and goal give no direction.
const LEAST_M: f64 = 1e-3;

/// The level direction at right angles to the way from start to goal: to the right of it.
pub(super) fn across(scene: &Scene) -> Vec3 {
    let way = scene.goal - scene.start;
    let right = Vec3::new(way.y, -way.x, 0.0);
    match right.norm() > LEAST_M {
        true => right * (1.0 / right.norm()),
        false => ACROSS,
    }
}

pub(super) fn draw_setpoint(setpoint: &Setpoint, tool: Option<Vec3>, across: Vec3, sheet: &mut Sheet<'_>) {
    sheet.plot("plots/weight/human", setpoint.weight.0);
    let driver = Driver::of(setpoint);
    sheet.plot(&driver.series(), driver.level());
    let colour = rerun::SeriesLines::new().with_colors([driver.colour()]);
    sheet.draw("plots/weight/human", &colour);
    sheet.plot("plots/effort/human", setpoint.human.norm());
    if let Some(guidance) = &setpoint.guidance {
        sheet.plot("plots/effort/robot", guidance.velocity.norm());
        draw_guidance(guidance, tool, across, sheet);
    }
}

fn draw_guidance(guidance: &Guidance, tool: Option<Vec3>, across: Vec3, sheet: &mut Sheet<'_>) {
    let width = guidance.half_width;
    for (axis, width) in [("x", width.x), ("y", width.y), ("z", width.z)] {
        // A model of a planar task says nothing of the third axis.
        if width > 0.0 {
            sheet.plot(&format!("plots/interval/{axis}"), width * 1e3);
        }
    }
    sheet.plot("plots/ratio/now", guidance.ratio.0);
    sheet.plot("plots/ratio/high", guidance.ratio_high.0);
    let centre = guidance.position.dot(across);
    // Half-widths go along the axes: what they span in another direction.
    let half = width.dot(Vec3::new(across.x.abs(), across.y.abs(), across.z.abs()));
    sheet.plot("plots/across/forecast", centre);
    sheet.plot("plots/across/low", centre - half);
    sheet.plot("plots/across/high", centre + half);
    if let Some(tool) = tool {
        sheet.plot("plots/across/tool", tool.dot(across));
    }
}

pub(super) fn draw_state(state: &State, sheet: &mut Sheet<'_>) {
    sheet.plot("plots/effort/tool", state.tool_velocity.norm());
    if let Some(clearance) = state.closest.or(state.clearance) {
        sheet.plot("plots/clearance", clearance.distance.0 * 1e3);
    }
    if let Some(arrivals) = &state.arrivals {
        sheet.plot("plots/arrivals/success_rate", arrivals.success_rate.0);
        sheet.plot("plots/arrivals/missed", f64::from(arrivals.missed));
    }
}

pub(super) fn draw_latency(nanos: Nanos, sheet: &mut Sheet<'_>) {
    sheet.plot("plots/latency", seconds(nanos) * 1e3);
}

pub(super) fn draw_counts(counts: &Counts, drops: Drops, sheet: &mut Sheet<'_>) {
    let sum = |count: fn(&crate::StreamCount) -> u64| counts.streams.iter().map(count).sum::<u64>() as f64;
    sheet.plot("plots/lost/missed", sum(|count| count.missed));
    sheet.plot("plots/lost/unreadable", sum(|count| count.unreadable));
    sheet.plot("plots/lost/dropped_file", drops.session_file.total() as f64);
    sheet.plot("plots/lost/dropped_view", drops.views.total() as f64);
    // A line for every channel of which something is missing, and none for the others.
    for (channel, number) in drops.session_file.by_channel() {
        let channel = channel.replace('/', "-");
        sheet.plot(&format!("plots/lost/dropped_file/{channel}"), number as f64);
    }
}

/// From a command to the motion it caused, by the recorder's own clock: from hearing the command to hearing the first
/// state that obeys it, less the time that this state says motion had then lasted, which is by the robot's clock.
/// So no two clocks are compared.
#[derive(Debug)]
pub(super) struct Latency {
    pace: Pace,
    commands: VecDeque<(MessageId, Stamp)>,
}

impl Latency {
    pub(super) fn new(pace: Pace) -> Self {
        Self {
            pace,
            commands: VecDeque::with_capacity(COMMANDS),
        }
    }

    pub(super) fn commanded(&mut self, id: MessageId, at: Stamp) {
        if self.commands.len() == COMMANDS {
            self.commands.pop_front();
        }
        self.commands.push_back((id, at));
    }

    /// The latency, the first time that a state obeys a command.
    pub(super) fn moved(&mut self, at: Stamp, state: &Envelope<State>) -> Option<Nanos> {
        let obeyed = state
            .body
            .obeys
            .filter(|obeyed| obeyed.setpoint.motion.is_permitted())?;
        let command = obeyed.setpoint.command?;
        let index = self.commands.iter().position(|(id, _)| *id == command.id)?;
        let (_, commanded) = self.commands.drain(..=index).next_back()?;
        let lasted = match self.pace {
            // A command that the arbiter repeats moved the arm when it was young.
            Pace::Real => state.header.sent.since(obeyed.moved) + command.age,
            // Virtual time stands still while messages travel.
            Pace::Lockstep => 0,
        };
        Some(at.since(commanded).saturating_sub(lasted))
    }
}
