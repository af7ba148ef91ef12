//! Where the arm's collision shapes are: the bodies of the scene at the poses of the state.

use tandem_wire::{Body, Pose, State, Vec3};

/// A body of the arm where it is now, in the base frame.
pub(crate) struct Placed {
    /// One end of its axis.
    pub(crate) from: Vec3,
    /// The other end.
    pub(crate) to: Vec3,
    /// In metres.
    pub(crate) radius: f64,
    /// Whether it is fixed to the tool.
    pub(crate) is_tool: bool,
}

/// Every body at the pose of its frame; a body of a frame that does not exist is left out.
pub(crate) fn placed<'a>(bodies: &'a [Body], state: &'a State) -> impl Iterator<Item = Placed> + 'a {
    bodies.iter().filter_map(|body| place(body, state))
}

/// One body at the pose of its frame; `None` if that does not exist.
pub(crate) fn place(body: &Body, state: &State) -> Option<Placed> {
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
        radius: body.radius.0,
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
