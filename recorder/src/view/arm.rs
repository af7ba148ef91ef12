//! The arm as the capsules it checks collisions with.

use rerun::components::FillMode;
use tandem_wire::{Body, Pose, State, Vec3};

use super::{Sheet, colours, single, xyz};

/// Draws every body at the pose of its frame; a body of a frame that does not exist is left out.
pub(super) fn draw(bodies: &[Body], state: &State, sheet: &mut Sheet<'_>) {
    let placed: Vec<_> = bodies.iter().filter_map(|body| placed(body, state)).collect();
    let capsules = rerun::Capsules3D::from_endpoints_and_radii(
        placed.iter().map(|body| xyz(body.from)),
        placed.iter().map(|body| xyz(body.to)),
        placed.iter().map(|body| body.radius),
    );
    let colours = placed.iter().map(|body| if body.is_tool { colours::TOOL } else { colours::LINK });
    sheet.draw("world/arm", &capsules.with_colors(colours).with_fill_mode(FillMode::Solid));
    let tip = xyz(state.tool.position);
    let dot = rerun::Points3D::new([tip]).with_radii([0.007]).with_colors([colours::TOOL]);
    sheet.draw("world/tool", &dot);
    let dot = rerun::Points2D::new([super::plan(state.tool.position)]);
    let dot = dot.with_radii([0.007]).with_colors([colours::TOOL]).with_draw_order(40.0);
    sheet.draw("plan/tool", &dot);
}

struct Placed {
    from: Vec3,
    to: Vec3,
    radius: f32,
    is_tool: bool,
}

fn placed(body: &Body, state: &State) -> Option<Placed> {
    let frame = usize::from(body.frame);
    let is_tool = frame == state.links.len();
    let pose = match state.links.get(frame) {
        Some(pose) => *pose,
        None if is_tool => state.tool,
        None if body.frame == Body::BASE => Pose {
            position: Vec3::ZERO,
            orientation: [0.0, 0.0, 0.0, 1.0].map(tandem_wire::Finite),
        },
        None => return None,
    };
    Some(Placed {
        from: in_base(&pose, body.from),
        to: in_base(&pose, body.to),
        radius: single(body.radius.0),
        is_tool,
    })
}

/// `base_from_frame * point`: with `q = (u, w)`, `p + 2 (w (u × v) + u × (u × v)) + v`.
fn in_base(pose: &Pose, v: Vec3) -> Vec3 {
    let [x, y, z, w] = pose.orientation.map(|part| part.0);
    let u = Vec3::new(x, y, z);
    let turn = cross(u, v);
    pose.position + v + (turn * w + cross(u, turn)) * 2.0
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    Vec3::new(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::Finite;

    #[test]
    fn a_quarter_turn_about_z_takes_x_to_y() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let pose = Pose {
            position: Vec3::new(1.0, 0.0, 0.5),
            orientation: [0.0, 0.0, half, half].map(Finite),
        };
        let there = in_base(&pose, Vec3::new(0.2, 0.0, 0.0));
        assert!((there - Vec3::new(1.0, 0.2, 0.5)).norm() < 1e-15);
    }
}
