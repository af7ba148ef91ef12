//! The path that the tool has taken, in the colour of who drove.

use rerun::Color;
use tandem_wire::{State, Vec3};

use super::{Sheet, colours, plan, xyz};

/// Segments per entity. A segment more means that its whole block is sent again, so a block is as short as keeps the
/// number of entities small: at 64, a state costs at most 2 kB however long the path has grown.
const BLOCK: usize = 64;
/// The tool must have moved this far for a new segment, in metres; thinner cannot be seen.
const STEP_M: f64 = 0.001;

/// The path so far, in blocks of segments; only the last is still growing.
#[derive(Debug, Default)]
pub(super) struct Trace {
    last: Option<Vec3>,
    block: u32,
    points: Vec<Vec3>,
    colours: Vec<Color>,
}

impl Trace {
    /// Lets the path grow to `tool`.
    pub(super) fn draw(&mut self, tool: Vec3, colour: Color, sheet: &mut Sheet<'_>) {
        let Some(last) = self.last else {
            self.last = Some(tool);
            self.points.push(tool);
            return;
        };
        if (tool - last).norm() < STEP_M {
            return;
        }
        if self.colours.len() == BLOCK {
            self.block += 1;
            self.colours.clear();
            self.points.clear();
            self.points.push(last);
        }
        self.last = Some(tool);
        self.points.push(tool);
        self.colours.push(colour);
        self.draw_block(sheet);
    }

    fn draw_block(&self, sheet: &mut Sheet<'_>) {
        let pairs = || self.points.windows(2);
        let strips = rerun::LineStrips3D::new(pairs().map(|pair| [xyz(pair[0]), xyz(pair[1])]));
        let strips = strips.with_colors(self.colours.iter().copied()).with_radii([0.0018]);
        sheet.draw(&format!("world/path/{}", self.block), &strips);
        let strips = rerun::LineStrips2D::new(pairs().map(|pair| [plan(pair[0]), plan(pair[1])]));
        let strips = strips.with_colors(self.colours.iter().copied()).with_radii([0.0014]);
        sheet.draw(&format!("plan/path/{}", self.block), &strips.with_draw_order(20.0));
    }
}

/// The colour of who drives.
pub(super) fn colour(state: &State) -> Color {
    match state.obeys {
        Some(obeyed) if obeyed.setpoint.motion.is_permitted() => colours::of_weight(obeyed.setpoint.weight.0),
        _ => colours::HELD,
    }
}
