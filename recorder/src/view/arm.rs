//! The arm as the capsules it checks collisions with.

use rerun::Color;
use rerun::components::FillMode;
use tandem_wire::{Body, State};

use super::{Sheet, colours, plan, single, xyz};
use crate::arm::placed;

pub(super) fn draw(bodies: &[Body], state: &State, sheet: &mut Sheet<'_>) {
    draw_with(bodies, state, colours::LINK, colours::TOOL, FillMode::Solid, sheet);
}

/// The arm of one of two runs: as a wire frame in this colour, so that one sees the other through it.
pub(super) fn draw_in(colour: Color, bodies: &[Body], state: &State, sheet: &mut Sheet<'_>) {
    draw_with(bodies, state, colour, colour, FillMode::MajorWireframe, sheet);
}

fn draw_with(bodies: &[Body], state: &State, link: Color, tool: Color, fill: FillMode, sheet: &mut Sheet<'_>) {
    let placed: Vec<_> = placed(bodies, state).collect();
    let capsules = rerun::Capsules3D::from_endpoints_and_radii(
        placed.iter().map(|body| xyz(body.from)),
        placed.iter().map(|body| xyz(body.to)),
        placed.iter().map(|body| single(body.radius)),
    );
    let colours = placed.iter().map(|body| if body.is_tool { tool } else { link });
    sheet.draw("world/arm", &capsules.with_colors(colours).with_fill_mode(fill));
}

/// The tip of the tool, which neither shapes nor meshes show.
pub(super) fn draw_tool(tool: Color, state: &State, sheet: &mut Sheet<'_>) {
    let tip = xyz(state.tool.position);
    let dot = rerun::Points3D::new([tip]).with_radii([0.007]).with_colors([tool]);
    sheet.draw("world/tool", &dot);
    let dot = rerun::Points2D::new([plan(state.tool.position)]);
    let dot = dot.with_radii([0.007]).with_colors([tool]).with_draw_order(40.0);
    sheet.draw("plan/tool", &dot);
}
