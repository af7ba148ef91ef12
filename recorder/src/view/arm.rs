//! The arm as the capsules it checks collisions with.

use rerun::components::FillMode;
use tandem_wire::{Body, State};

use super::{Sheet, colours, plan, single, xyz};
use crate::arm::placed;

pub(super) fn draw(bodies: &[Body], state: &State, sheet: &mut Sheet<'_>) {
    let placed: Vec<_> = placed(bodies, state).collect();
    let capsules = rerun::Capsules3D::from_endpoints_and_radii(
        placed.iter().map(|body| xyz(body.from)),
        placed.iter().map(|body| xyz(body.to)),
        placed.iter().map(|body| single(body.radius)),
    );
    let colours = placed
        .iter()
        .map(|body| if body.is_tool { colours::TOOL } else { colours::LINK });
    sheet.draw(
        "world/arm",
        &capsules.with_colors(colours).with_fill_mode(FillMode::Solid),
    );
}

/// The tip of the tool, which neither shapes nor meshes show.
pub(super) fn draw_tool(state: &State, sheet: &mut Sheet<'_>) {
    let tip = xyz(state.tool.position);
    let dot = rerun::Points3D::new([tip])
        .with_radii([0.007])
        .with_colors([colours::TOOL]);
    sheet.draw("world/tool", &dot);
    let dot = rerun::Points2D::new([plan(state.tool.position)]);
    let dot = dot
        .with_radii([0.007])
        .with_colors([colours::TOOL])
        .with_draw_order(40.0);
    sheet.draw("plan/tool", &dot);
}
