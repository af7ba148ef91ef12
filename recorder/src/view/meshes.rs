//! The arm as it really looks, moved by its joint angles.

use std::sync::Arc;

use rerun::components::{FillMode, RotationQuat};
use rerun::{AsComponents, Rgba32};
use tandem_wire::State;

use super::{Drawing, Sheet, colours, fixed, single};
use crate::urdf::{Joint, Origin, Quaternion, Shape, Urdf, Visual};

/// What the arm hangs on in the view.
const ROOT: &str = "world/arm";

/// An arm that is drawn by its URDF file: the shapes once, the joints at every state.
#[derive(Clone, Debug)]
pub(crate) struct Meshes {
    /// Everything that stays as it is; the meshes' bytes are shared, not copied.
    shapes: Arc<Vec<Drawing>>,
    /// The joints that move: which entity, and how.
    joints: Arc<Vec<(String, Joint)>>,
}

impl Meshes {
    pub(crate) fn new(urdf: &Urdf) -> Self {
        let (mut shapes, mut joints) = (Vec::new(), Vec::new());
        let mut paths: Vec<String> = Vec::with_capacity(urdf.links.len());
        for link in &urdf.links {
            let parent = link.parent.as_ref().and_then(|joint| paths.get(joint.parent));
            let path = format!("{}/{}", parent.map_or(ROOT, String::as_str), entity(&link.name));
            if let Some(joint) = &link.parent {
                match joint.moved_by {
                    Some(_) => joints.push((path.clone(), joint.clone())),
                    None => shapes.push(fixed(&path, &transform(&joint.origin, joint.origin.rotation))),
                }
            }
            for (number, visual) in link.visuals.iter().enumerate() {
                draw_visual(&format!("{path}/look{number}"), visual, &mut shapes);
            }
            paths.push(path);
        }
        Self {
            shapes: Arc::new(shapes),
            joints: Arc::new(joints),
        }
    }

    /// What holds at all times.
    pub(crate) fn opening(&self) -> &[Drawing] {
        &self.shapes
    }

    pub(super) fn draw(&self, state: &State, sheet: &mut Sheet<'_>) {
        for (path, joint) in self.joints.iter() {
            let angle = joint.moved_by.and_then(|number| state.joints.get(number));
            let turn = Quaternion::around(joint.axis, angle.map_or(0.0, |angle| angle.0));
            sheet.draw(path, &transform(&joint.origin, joint.origin.rotation.after(turn)));
        }
    }
}

/// A link's name as part of a path.
fn entity(name: &str) -> String {
    let plain = |c: char| {
        if c.is_alphanumeric() || c == '_' || c == '-' {
            c
        } else {
            '_'
        }
    };
    name.chars().map(plain).collect()
}

fn transform(origin: &Origin, rotation: Quaternion) -> rerun::Transform3D {
    rerun::Transform3D::from_translation(origin.xyz.map(single))
        .with_quaternion(RotationQuat(rerun::Quaternion::from_xyzw(rotation.0.map(single))))
}

fn draw_visual(path: &str, visual: &Visual, shapes: &mut Vec<Drawing>) {
    let Visual { origin, shape, colour } = visual;
    let place = transform(origin, origin.rotation);
    let place = match shape {
        Shape::Mesh { scale, .. } => place.with_scale(scale.map(single)),
        _ => place,
    };
    shapes.push(fixed(path, &place));
    let colour = colour.map_or(colours::LINK, |parts| {
        let [r, g, b, a] = parts.map(byte);
        rerun::Color(Rgba32::from_unmultiplied_rgba(r, g, b, a))
    });
    let drawn: Box<dyn AsComponents> = match shape {
        Shape::Mesh { file, .. } => {
            let asset = rerun::Asset3D::new(file.bytes.clone()).with_media_type(file.format.clone());
            match visual.colour {
                Some(_) => Box::new(asset.with_albedo_factor(colour.0)),
                None => Box::new(asset),
            }
        }
        Shape::Box { size } => {
            let boxes = rerun::Boxes3D::from_sizes([size.map(single)]).with_colors([colour]);
            Box::new(boxes.with_fill_mode(FillMode::Solid))
        }
        Shape::Cylinder { radius, length } => {
            let cylinders = rerun::Cylinders3D::from_lengths_and_radii([single(*length)], [single(*radius)]);
            Box::new(cylinders.with_colors([colour]).with_fill_mode(FillMode::Solid))
        }
        Shape::Sphere { radius } => {
            let balls = rerun::Ellipsoids3D::from_radii([single(*radius)]).with_colors([colour]);
            Box::new(balls.with_fill_mode(FillMode::Solid))
        }
    };
    shapes.push(fixed(path, drawn.as_ref()));
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a cast of a number stops at the ends"
)]
fn byte(part: f64) -> u8 {
    (part * 255.0).round() as u8
}
