//! Where each of the two wants to go, and what came of it.

use rerun::Color;
use tandem_wire::{Setpoint, Vec3};

use super::{Sheet, colours, plan, xyz};

/// The arrows show a velocity times this: where the tool would be then.
const AHEAD_S: f64 = 1.0;
/// A velocity below this is drawn as none: the arrow's head would be longer than its shaft.
const LEAST_M_S: f64 = 0.002;

pub(super) fn draw(setpoint: &Setpoint, tool: Vec3, sheet: &mut Sheet<'_>) {
    let robot = setpoint.guidance.map_or(Vec3::ZERO, |guidance| guidance.velocity);
    draw_arrow("human", setpoint.human, tool, colours::HUMAN, sheet);
    draw_arrow("robot", robot, tool, colours::ROBOT, sheet);
    draw_arrow("result", setpoint.velocity, tool, colours::RESULT, sheet);
}

fn draw_arrow(name: &str, velocity: Vec3, tool: Vec3, colour: Color, sheet: &mut Sheet<'_>) {
    let wish = Some(velocity * AHEAD_S).filter(|_| velocity.norm() >= LEAST_M_S);
    let arrow = rerun::Arrows3D::from_vectors(wish.map(xyz)).with_origins(wish.map(|_| xyz(tool)));
    let arrow = arrow.with_colors(wish.map(|_| colour)).with_radii(wish.map(|_| 0.004));
    sheet.draw(&format!("world/wish/{name}"), &arrow);
    let arrow = rerun::Arrows2D::from_vectors(wish.map(plan)).with_origins(wish.map(|_| plan(tool)));
    let arrow = arrow.with_colors(wish.map(|_| colour)).with_radii(wish.map(|_| 0.003));
    sheet.draw(&format!("plan/wish/{name}"), &arrow.with_draw_order(30.0));
}
