//! Where each of the two wants to go, and what came of it.

use std::collections::VecDeque;

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

/// The tool moves this far between two of the human's wishes that stay, in metres.
const APART_M: f64 = 0.02;
/// A wish that stays shows a velocity times this: short enough that many do not hide the path.
const STAYS_S: f64 = 0.4;
/// Wishes that stay; beyond, the oldest go.
const WISHES: usize = 128;

/// What the human wanted along the way: short strokes that stay, so that one sees at the end where the two disagreed.
#[derive(Debug, Default)]
pub(super) struct Wished {
    strokes: VecDeque<[Vec3; 2]>,
}

impl Wished {
    pub(super) fn draw(&mut self, setpoint: &Setpoint, tool: Vec3, sheet: &mut Sheet<'_>) {
        let is_far = self
            .strokes
            .back()
            .is_none_or(|[from, _]| (tool - *from).norm() >= APART_M);
        if !is_far || !setpoint.motion.is_permitted() || setpoint.human.norm() < LEAST_M_S {
            return;
        }
        if self.strokes.len() == WISHES {
            self.strokes.pop_front();
        }
        self.strokes.push_back([tool, tool + setpoint.human * STAYS_S]);
        let strokes = self.strokes.iter().map(|stroke| stroke.map(xyz));
        let strokes = rerun::LineStrips3D::new(strokes).with_colors([colours::HUMAN]);
        sheet.draw("world/wished", &strokes.with_radii([0.001]));
        let strokes = self.strokes.iter().map(|stroke| stroke.map(plan));
        let strokes = rerun::LineStrips2D::new(strokes).with_colors([colours::HUMAN]);
        sheet.draw("plan/wished", &strokes.with_radii([0.0008]).with_draw_order(15.0));
    }
}
