//! Obstacles, and how far the arm is from them.
//!
//! An obstacle is an upright solid cylinder. The distance of a point to it is signed (negative inside), 1-Lipschitz
//! and convex, because the cylinder is; along a segment it is convex too, so halving the segment on the sign of the
//! slope finds its minimum for certain.

use nalgebra::Vector3;

use tandem_wire::{Clearance, Cylinder, Finite};

use crate::kinematics::Frames;
use crate::panda::ARM_CAPSULES;

/// No scene holds more obstacles than this, so that an inner tick has a bounded cost.
pub const OBSTACLES_MAX: usize = 16;

/// The smallest distance between the arm and the obstacles; `None` without obstacles.
///
/// Accurate to 1e-7 m for every posture of this arm: the search ends on an interval of `length / 2²²` and the
/// distance is 1-Lipschitz. Allocates nothing.
#[must_use]
pub fn clearance(frames: &Frames, obstacles: &[Cylinder]) -> Option<Clearance> {
    closer_than(None, frames, obstacles)
}

/// The smaller of `so_far` and [`clearance`]: pairs that cannot come below `so_far` are passed over, which makes
/// it cheap enough for every inner tick. Looks at the first [`OBSTACLES_MAX`] obstacles.
#[must_use]
pub fn closer_than(so_far: Option<Clearance>, frames: &Frames, obstacles: &[Cylinder]) -> Option<Clearance> {
    let mut nearest = so_far;
    for (body, capsule) in (0..).zip(&ARM_CAPSULES) {
        let frame = frames.frame(capsule.frame);
        let segment = Segment::between(frame.point(capsule.start), frame.point(capsule.end));
        for (obstacle, cylinder) in (0..).zip(obstacles.iter().take(OBSTACLES_MAX)) {
            let at_least = distance_to(cylinder, &segment.at(0.5)) - 0.5 * segment.length - capsule.radius;
            if nearest.is_some_and(|nearest| at_least >= nearest.distance.0) {
                continue;
            }
            let distance = Finite(distance_to_segment(cylinder, &segment) - capsule.radius);
            if nearest.is_none_or(|nearest| distance < nearest.distance) {
                nearest = Some(Clearance {
                    distance,
                    body,
                    obstacle,
                });
            }
        }
    }
    nearest
}

/// Whether arm and obstacle touch.
#[must_use]
pub fn is_contact(clearance: &Clearance) -> bool {
    clearance.distance.0 <= 0.0
}

struct Segment {
    start: Vector3<f64>,
    along: Vector3<f64>,
    length: f64,
}

impl Segment {
    fn between(start: Vector3<f64>, end: Vector3<f64>) -> Self {
        let along = end - start;
        Self {
            start,
            along,
            length: along.norm(),
        }
    }

    fn at(&self, part: f64) -> Vector3<f64> {
        self.start + self.along * part
    }
}

/// No segment of the arm is longer than 0.3 m, and 0.3 m / 2²² < 1e-7 m.
const HALVINGS: usize = 22;

/// Signed distance of a point to the surface of a cylinder.
fn distance_to(cylinder: &Cylinder, point: &Vector3<f64>) -> f64 {
    let (dx, dy) = (point.x - cylinder.foot.x, point.y - cylinder.foot.y);
    let radial = (dx * dx + dy * dy).sqrt() - cylinder.radius.0;
    let above_foot = point.z - cylinder.foot.z;
    let axial = larger(above_foot - cylinder.height.0, -above_foot);
    if radial > 0.0 && axial > 0.0 {
        (radial * radial + axial * axial).sqrt()
    } else {
        larger(radial, axial)
    }
}

/// Spelled out, because `f64::max` leaves the sign of a zero to the processor, and states repeat to the bit.
fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

fn distance_to_segment(cylinder: &Cylinder, segment: &Segment) -> f64 {
    if slope_at(cylinder, segment, 0.0) >= 0.0 {
        return distance_to(cylinder, &segment.start);
    }
    if slope_at(cylinder, segment, 1.0) <= 0.0 {
        return distance_to(cylinder, &segment.at(1.0));
    }
    let (mut falling, mut rising) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (falling + rising);
        if slope_at(cylinder, segment, middle) < 0.0 {
            falling = middle
        } else {
            rising = middle
        }
    }
    distance_to(cylinder, &segment.at(0.5 * (falling + rising)))
}

/// A number with the sign of the distance's slope along the segment; where the distance has an edge, of one of its
/// slopes, which serves a bisection as well.
fn slope_at(cylinder: &Cylinder, segment: &Segment, part: f64) -> f64 {
    let (point, along) = (segment.at(part), &segment.along);
    let (dx, dy) = (point.x - cylinder.foot.x, point.y - cylinder.foot.y);
    let from_axis = (dx * dx + dy * dy).sqrt();
    let radial = from_axis - cylinder.radius.0;
    let outward = dx * along.x + dy * along.y;
    let above_foot = point.z - cylinder.foot.z;
    let above_top = above_foot - cylinder.height.0;
    let (axial, upward) = if above_top > -above_foot {
        (above_top, along.z)
    } else {
        (-above_foot, -along.z)
    };
    if radial > 0.0 && axial > 0.0 {
        radial * outward / from_axis + axial * upward
    } else if radial >= axial {
        outward
    } else {
        upward
    }
}

#[cfg(test)]
mod tests {
    use tandem_wire::Vec3;

    use super::*;
    use crate::kinematics::{forward, joints_for};
    use crate::panda::{FLANGE, POSTURE_RAD, Part, TOOL_RADIUS_M};

    const POST: Cylinder = post_at(0.5, 0.0);

    const fn post_at(x: f64, y: f64) -> Cylinder {
        Cylinder {
            foot: Vec3::new(x, y, 0.0),
            radius: Finite(0.02),
            height: Finite(0.20),
        }
    }

    fn part(clearance: &Clearance) -> Part {
        ARM_CAPSULES[usize::from(clearance.body)].part
    }

    #[test]
    fn the_distance_of_a_point_is_signed() {
        let distance = |x, y, z| distance_to(&POST, &Vector3::new(x, y, z));
        assert!((distance(0.6, 0.0, 0.1) - 0.08).abs() < 1e-15);
        assert!((distance(0.5, 0.0, 0.25) - 0.05).abs() < 1e-15);
        assert!((distance(0.5, 0.05, 0.24) - 0.05).abs() < 1e-15);
        assert!((distance(0.5, 0.0, 0.1) + 0.02).abs() < 1e-15);
    }

    #[test]
    fn a_segment_is_as_near_as_the_nearest_of_its_points() {
        for n in 0..500_u32 {
            let place = |k: f64, span: f64| {
                let turn = f64::from(n) * k;
                (turn - turn.floor() - 0.5) * span
            };
            let start = Vector3::new(0.5 + place(0.618, 0.4), place(0.414, 0.4), 0.1 + place(0.732, 0.5));
            let end = Vector3::new(0.5 + place(0.236, 0.4), place(0.292, 0.4), 0.1 + place(0.177, 0.5));
            let segment = Segment::between(start, end);
            let scanned = (0..=20_000)
                .map(|step| distance_to(&POST, &segment.at(f64::from(step) / 20_000.0)))
                .fold(f64::INFINITY, f64::min);
            let found = distance_to_segment(&POST, &segment);
            assert!(
                found <= scanned + 1e-7 && found >= scanned - 0.5 * segment.length / 20_000.0,
                "{found} {scanned}"
            );
        }
    }

    #[test]
    fn the_tool_is_the_nearest_part_beside_an_obstacle() {
        let q = joints_for(&Vector3::new(0.56, 0.0, 0.15)).unwrap();
        let found = clearance(&forward(&q), &[post_at(0.9, 0.0), POST]).unwrap();
        assert_eq!((part(&found), found.obstacle), (Part::Tool, 1));
        assert!((found.distance.0 - (0.06 - 0.02 - TOOL_RADIUS_M)).abs() < 1e-7);
        assert!(!is_contact(&found));
    }

    #[test]
    fn a_tool_inside_an_obstacle_is_contact() {
        let q = joints_for(&Vector3::new(0.51, 0.0, 0.15)).unwrap();
        let found = clearance(&forward(&q), &[POST]).unwrap();
        assert!(is_contact(&found) && part(&found) == Part::Tool);
    }

    #[test]
    fn passing_over_hopeless_pairs_changes_nothing() {
        let frames = forward(&POSTURE_RAD);
        for x in 0..12_u32 {
            let obstacles = [post_at(0.1 * f64::from(x), 0.2), POST];
            let nearest = clearance(&frames, &obstacles).unwrap();
            let mut by_hand = f64::INFINITY;
            for capsule in &ARM_CAPSULES {
                let frame = frames.frame(capsule.frame);
                let segment = Segment::between(frame.point(capsule.start), frame.point(capsule.end));
                for obstacle in &obstacles {
                    by_hand = by_hand.min(distance_to_segment(obstacle, &segment) - capsule.radius);
                }
            }
            assert_eq!(nearest.distance.0.to_bits(), by_hand.to_bits());
        }
        assert_eq!(clearance(&frames, &[]), None);
    }

    #[test]
    fn the_longest_segment_keeps_the_promised_error() {
        let longest = ARM_CAPSULES
            .iter()
            .map(|capsule| (Vector3::from(capsule.end) - Vector3::from(capsule.start)).norm())
            .fold(0.0, f64::max);
        assert!(longest / f64::from(1 << HALVINGS) < 1e-7);
        assert!(ARM_CAPSULES.iter().all(|capsule| capsule.frame <= FLANGE));
    }
}
