//! Where the arm is closest to an obstacle: a line from one to the other, and how long it is once that is not far.

use tandem_wire::{Clearance, Cylinder, Scene, State, Vec3};

use super::{Sheet, colours, xyz};
use crate::arm::{Placed, place};

/// The range in which the closest place of a body's axis is looked for shrinks by a third each time: after so many times
/// it is a micrometre long.
const THIRDS: u32 = 36;
/// Closer than this, in metres, the distance stands beside the line. A label hides what is behind it, and further away that
/// is worth more.
const CLOSE_M: f64 = 0.05;

pub(super) fn draw(scene: &Scene, state: &State, sheet: &mut Sheet<'_>) {
    if scene.obstacles.is_empty() {
        return;
    }
    let nearest = state.clearance.and_then(|clearance| {
        let line = between(scene, state, clearance)?;
        Some((line, clearance.distance.0))
    });
    let (line, distance) = nearest.unzip();
    let words = distance
        .filter(|metres| *metres < CLOSE_M)
        .map(|metres| format!("{:.0} mm", metres * 1e3));
    let line = rerun::LineStrips3D::new(line.map(|ends| ends.map(xyz)))
        .with_colors([colours::NEAREST])
        .with_radii([0.003])
        .with_labels(words)
        .with_show_labels(true);
    sheet.draw("world/nearest", &line);
}

/// From the surface of the body to that of the obstacle; `None` if the scene has no such two.
fn between(scene: &Scene, state: &State, clearance: Clearance) -> Option<[Vec3; 2]> {
    let obstacle = scene.obstacles.get(usize::from(clearance.obstacle))?;
    let body = place(scene.bodies.get(usize::from(clearance.body))?, state)?;
    let on_axis = closest_to(obstacle, &body);
    let there = within(obstacle, on_axis);
    let apart = there - on_axis;
    let surface = (body.radius / apart.norm().max(1e-9)).min(1.0);
    Some([on_axis + apart * surface, there])
}

/// The distance to what is convex has one valley along a line.
fn closest_to(obstacle: &Cylinder, body: &Placed) -> Vec3 {
    let at = |share: f64| body.from + (body.to - body.from) * share;
    let distance = |share: f64| (within(obstacle, at(share)) - at(share)).norm();
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..THIRDS {
        let third = (high - low) / 3.0;
        match distance(low + third) <= distance(high - third) {
            true => high -= third,
            false => low += third,
        }
    }
    at(0.5 * (low + high))
}

/// The point of a standing cylinder that is closest to this one.
fn within(obstacle: &Cylinder, point: Vec3) -> Vec3 {
    let away = point - obstacle.foot;
    let level = Vec3::new(away.x, away.y, 0.0).capped(obstacle.radius.0);
    obstacle.foot + Vec3::new(level.x, level.y, away.z.clamp(0.0, obstacle.height.0.max(0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::Finite;

    fn close(one: Vec3, other: Vec3) -> bool {
        (one - other).norm() < 1e-5
    }

    #[test]
    fn the_line_goes_from_the_body_to_the_obstacle_beside_over_and_across_it() {
        let obstacle = Cylinder {
            foot: Vec3::new(0.5, 0.0, 0.0),
            radius: Finite(0.02),
            height: Finite(0.2),
        };
        let ends = |from: Vec3, to: Vec3| {
            let body = Placed {
                from,
                to,
                radius: 0.01,
                is_tool: false,
            };
            let on_axis = closest_to(&obstacle, &body);
            [on_axis, within(&obstacle, on_axis)]
        };
        let [axis, there] = ends(Vec3::new(0.6, 0.0, 0.1), Vec3::new(0.6, 0.3, 0.1));
        assert!(close(axis, Vec3::new(0.6, 0.0, 0.1)) && close(there, Vec3::new(0.52, 0.0, 0.1)));
        let [axis, there] = ends(Vec3::new(0.4, 0.0, 0.3), Vec3::new(0.6, 0.0, 0.25));
        assert!(axis.x > 0.5 && (there.z - 0.2).abs() < 1e-9, "{axis:?} {there:?}");
        let [axis, there] = ends(Vec3::new(0.6, -0.2, 0.1), Vec3::new(0.6, 0.2, 0.1));
        assert!(close(axis, Vec3::new(0.6, 0.0, 0.1)) && close(there, Vec3::new(0.52, 0.0, 0.1)));
    }
}
