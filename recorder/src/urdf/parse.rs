//! From a URDF's text to links.

use std::path::Path;

use roxmltree::{Document, Node};
use tandem_wire::JOINTS;

use super::{Joint, Link, Shape, UrdfError, Visual, mesh};

/// Where something lies in its parent's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Origin {
    /// In metres.
    pub(crate) xyz: [f64; 3],
    pub(crate) rotation: Quaternion,
}

/// A rotation; x, y, z, w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Quaternion(pub(crate) [f64; 4]);

impl Quaternion {
    /// A turn by `angle` radians around `axis`, whose length does not matter; none if it has none.
    pub(crate) fn around(axis: [f64; 3], angle: f64) -> Self {
        let [x, y, z] = axis;
        let length = (x * x + y * y + z * z).sqrt();
        if !(length > 0.0 && length.is_finite()) {
            return Self([0.0, 0.0, 0.0, 1.0]);
        }
        let part = libm::sin(angle / 2.0) / length;
        Self([x * part, y * part, z * part, libm::cos(angle / 2.0)])
    }

    /// This turn after `first`: `self * first`.
    pub(crate) fn after(self, first: Self) -> Self {
        let ([ax, ay, az, aw], [bx, by, bz, bw]) = (self.0, first.0);
        Self([
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ])
    }

    /// Roll about x, then pitch about y, then yaw about z, all fixed axes.
    fn of_rpy([roll, pitch, yaw]: [f64; 3]) -> Self {
        let about = Self::around;
        let tilted = about([0.0, 1.0, 0.0], pitch).after(about([1.0, 0.0, 0.0], roll));
        about([0.0, 0.0, 1.0], yaw).after(tilted)
    }
}

/// The text of a URDF file, and where complaints about it point.
struct Source<'a> {
    path: &'a Path,
    document: &'a Document<'a>,
}

/// The links of a URDF file, parents before their children.
pub(super) fn links(path: &Path, text: &str) -> Result<Vec<Link>, UrdfError> {
    let document = Document::parse(text).map_err(|source| UrdfError::Xml {
        path: path.to_owned(),
        source,
    })?;
    let source = Source {
        path,
        document: &document,
    };
    let robot = document.root_element();
    if !robot.has_tag_name("robot") {
        return Err(source.wrong(robot, "a URDF file begins with <robot>".to_owned()));
    }
    source.links(robot)
}

impl Source<'_> {
    fn wrong(&self, node: Node<'_, '_>, what: String) -> UrdfError {
        UrdfError::Content {
            path: self.path.to_owned(),
            line: self.document.text_pos_at(node.range().start).row,
            what,
        }
    }

    fn links(&self, robot: Node<'_, '_>) -> Result<Vec<Link>, UrdfError> {
        let joints: Vec<_> = children(robot, "joint").collect();
        let mut hangs = Vec::with_capacity(joints.len());
        for joint in &joints {
            hangs.push((self.end(*joint, "parent")?, self.end(*joint, "child")?));
        }
        let mut named = Vec::new();
        for link in children(robot, "link") {
            named.push((self.attribute(link, "name")?, link));
        }
        let is_root = |(name, _): &&(&str, _)| !hangs.iter().any(|(_, child)| child == name);
        let Some((root, element)) = named.iter().find(is_root) else {
            return Err(self.wrong(robot, "no link is the first one: each hangs on another".to_owned()));
        };
        let mut links = vec![self.link(root, *element, None)?];
        let mut moved = 0;
        // Depth first, so that the arm's joints are counted outwards before a side branch's.
        let mut branches: Vec<(usize, usize)> = outgoing(&hangs, root, 0);
        while let Some((joint, parent)) = branches.pop() {
            let child = hangs[joint].1;
            let Some((name, element)) = named.iter().find(|(name, _)| *name == child) else {
                return Err(self.wrong(joints[joint], format!("there is no link {child:?}")));
            };
            if links.iter().any(|link: &Link| link.name == *name) {
                return Err(self.wrong(joints[joint], format!("the link {child:?} hangs on two others")));
            }
            let joint = self.joint(joints[joint], parent, &mut moved)?;
            links.push(self.link(name, *element, Some(joint))?);
            branches.extend(outgoing(&hangs, name, links.len() - 1));
        }
        Ok(links)
    }

    fn joint(&self, node: Node<'_, '_>, parent: usize, moved: &mut usize) -> Result<Joint, UrdfError> {
        let is_revolute = matches!(node.attribute("type"), Some("revolute" | "continuous"));
        let moved_by = (is_revolute && *moved < JOINTS).then_some(*moved);
        *moved += usize::from(moved_by.is_some());
        let axis =
            child(node, "axis").map_or(Ok([1.0, 0.0, 0.0]), |axis| self.numbers(axis, "xyz", [1.0, 0.0, 0.0]))?;
        Ok(Joint {
            parent,
            origin: self.origin(node)?,
            axis,
            moved_by,
        })
    }

    fn link(&self, name: &str, node: Node<'_, '_>, parent: Option<Joint>) -> Result<Link, UrdfError> {
        let mut visuals = Vec::new();
        for visual in children(node, "visual") {
            visuals.push(self.visual(visual)?);
        }
        let name = name.to_owned();
        Ok(Link { name, parent, visuals })
    }

    fn visual(&self, node: Node<'_, '_>) -> Result<Visual, UrdfError> {
        let geometry = child(node, "geometry").and_then(|geometry| geometry.children().find(Node::is_element));
        let Some(geometry) = geometry else {
            return Err(self.wrong(node, "a visual without a geometry".to_owned()));
        };
        Ok(Visual {
            origin: self.origin(node)?,
            shape: self.shape(geometry)?,
            colour: self.colour(node)?,
        })
    }

    fn shape(&self, node: Node<'_, '_>) -> Result<Shape, UrdfError> {
        let length = |name| self.numbers(node, name, [0.0]).map(|[number]| number);
        match node.tag_name().name() {
            "mesh" => Ok(Shape::Mesh {
                file: mesh(self.path, self.attribute(node, "filename")?)?,
                scale: self.numbers(node, "scale", [1.0; 3])?,
            }),
            "box" => Ok(Shape::Box {
                size: self.numbers(node, "size", [0.0; 3])?,
            }),
            "cylinder" => Ok(Shape::Cylinder {
                radius: length("radius")?,
                length: length("length")?,
            }),
            "sphere" => Ok(Shape::Sphere {
                radius: length("radius")?,
            }),
            other => Err(self.wrong(node, format!("a shape {other:?} is not known"))),
        }
    }

    /// The colour that stands in the visual itself, or the one of that name in the robot.
    fn colour(&self, visual: Node<'_, '_>) -> Result<Option<[f64; 4]>, UrdfError> {
        let Some(material) = child(visual, "material") else {
            return Ok(None);
        };
        let named = || {
            let robot = self.document.root_element();
            let name = material.attribute("name")?;
            let same = children(robot, "material").find(|other| other.attribute("name") == Some(name));
            child(same?, "color")
        };
        let colour = child(material, "color").or_else(named);
        colour
            .map(|colour| self.numbers(colour, "rgba", [0.8, 0.8, 0.8, 1.0]))
            .transpose()
    }

    fn origin(&self, node: Node<'_, '_>) -> Result<Origin, UrdfError> {
        let Some(origin) = child(node, "origin") else {
            let rotation = Quaternion([0.0, 0.0, 0.0, 1.0]);
            return Ok(Origin {
                xyz: [0.0; 3],
                rotation,
            });
        };
        Ok(Origin {
            xyz: self.numbers(origin, "xyz", [0.0; 3])?,
            rotation: Quaternion::of_rpy(self.numbers(origin, "rpy", [0.0; 3])?),
        })
    }

    /// So many finite numbers in an attribute, or `absent` if it is not there.
    fn numbers<const N: usize>(&self, node: Node<'_, '_>, name: &str, absent: [f64; N]) -> Result<[f64; N], UrdfError> {
        let Some(text) = node.attribute(name) else {
            return Ok(absent);
        };
        let read: Option<Vec<f64>> = text
            .split_whitespace()
            .map(|word| word.parse().ok().filter(|number: &f64| number.is_finite()))
            .collect();
        read.and_then(|numbers| numbers.try_into().ok())
            .ok_or_else(|| self.wrong(node, format!("{name}={text:?} should be {N} numbers")))
    }

    fn attribute<'n>(&self, node: Node<'n, '_>, name: &str) -> Result<&'n str, UrdfError> {
        let absent = || self.wrong(node, format!("<{}> lacks {name}=", node.tag_name().name()));
        node.attribute(name).ok_or_else(absent)
    }

    /// The link at one end of a joint.
    fn end<'n>(&self, joint: Node<'n, '_>, end: &str) -> Result<&'n str, UrdfError> {
        let absent = || self.wrong(joint, format!("a joint without <{end} link=…>"));
        let end = joint.children().find(|node| node.has_tag_name(end));
        end.and_then(|end| end.attribute("link")).ok_or_else(absent)
    }
}

/// The joints that hang on the link `name`, which has this index; the first of them last.
fn outgoing(hangs: &[(&str, &str)], name: &str, index: usize) -> Vec<(usize, usize)> {
    let all = hangs.iter().enumerate().rev();
    let of_link = all.filter(|(_, (parent, _))| *parent == name);
    of_link.map(|(joint, _)| (joint, index)).collect()
}

fn children<'a, 'i>(node: Node<'a, 'i>, name: &'static str) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(move |child| child.has_tag_name(name))
}

fn child<'a, 'i>(node: Node<'a, 'i>, name: &'static str) -> Option<Node<'a, 'i>> {
    children(node, name).next()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roll_comes_before_yaw() {
        let quarter = std::f64::consts::FRAC_PI_2;
        let Quaternion(q) = Quaternion::of_rpy([quarter, 0.0, quarter]);
        // z is rolled onto −y, which the yaw takes to x.
        let expected = [0.5, 0.5, 0.5, 0.5];
        assert!(q.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{q:?}");
    }
}
