//! The scene, the arm and a forecast as coloured points, for viewers that draw points but no shapes.

use foxglove::bytes::{BufMut, Bytes, BytesMut};
use foxglove::messages::{PackedElementField, PointCloud, Timestamp, packed_element_field};
use tandem_wire::{Body, Cylinder, Forecast, Scene, State, Vec3};

use super::standard::BASE;
use crate::arm::placed;

/// Points along the arm are this far apart, in metres.
const ALONG_ARM_M: f64 = 0.02;
/// Points around an obstacle's rim.
const RIM: u32 = 24;
/// Rims on an obstacle, foot and top included.
const RIMS: u32 = 6;

const RED: [u8; 3] = [214, 74, 66];
const GREEN: [u8; 3] = [72, 190, 110];
const GREY: [u8; 3] = [196, 200, 208];
const YELLOW: [u8; 3] = [250, 220, 90];
const BLUE: [u8; 3] = [66, 150, 250];

/// Bytes of a point: three floats and four bytes of colour.
const STRIDE: u32 = 16;

/// The axes of the arm's bodies.
pub(super) fn of_arm(bodies: &[Body], state: &State, time: Timestamp) -> PointCloud {
    let mut cloud = Cloud::default();
    for body in placed(bodies, state) {
        let colour = if body.is_tool { YELLOW } else { GREY };
        cloud.line(body.from, body.to, colour);
    }
    cloud.finish(time)
}

/// Obstacles as stacked rims, start and goal as a point each.
pub(super) fn of_scene(scene: &Scene, time: Timestamp) -> PointCloud {
    let mut cloud = Cloud::default();
    for obstacle in &scene.obstacles {
        cloud.cylinder(obstacle);
    }
    cloud.point(scene.start, GREY);
    cloud.point(scene.goal, GREEN);
    cloud.finish(time)
}

/// The expected path, and the ends of its interval along each axis that has one.
pub(super) fn of_forecast(forecast: &Forecast, time: Timestamp) -> PointCloud {
    let mut cloud = Cloud::default();
    for point in &forecast.points {
        let Vec3 { x, y, z } = point.half_width;
        cloud.point(point.position, BLUE);
        for axis in [Vec3::new(x, 0.0, 0.0), Vec3::new(0.0, y, 0.0), Vec3::new(0.0, 0.0, z)] {
            if axis.norm() > 0.0 {
                cloud.point(point.position + axis, BLUE);
                cloud.point(point.position - axis, BLUE);
            }
        }
    }
    cloud.finish(time)
}

#[derive(Default)]
struct Cloud {
    data: BytesMut,
}

impl Cloud {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a tenth of a micrometre is enough to look at"
    )]
    fn point(&mut self, at: Vec3, [red, green, blue]: [u8; 3]) {
        for coordinate in at.to_array() {
            self.data.put_f32_le(coordinate as f32);
        }
        self.data.put_slice(&[red, green, blue, u8::MAX]);
    }

    /// Bodies are shorter than a metre or so; one that claims to be longer gets its points further apart.
    fn line(&mut self, from: Vec3, to: Vec3, colour: [u8; 3]) {
        const MOST: f64 = 100.0;
        let steps = ((to - from).norm() / ALONG_ARM_M).clamp(1.0, MOST).ceil();
        let mut step = 0.0;
        while step <= steps {
            self.point(from + (to - from) * (step / steps), colour);
            step += 1.0;
        }
    }

    fn cylinder(&mut self, obstacle: &Cylinder) {
        for rim in 0..RIMS {
            let height = obstacle.height.0 * f64::from(rim) / f64::from(RIMS - 1);
            for corner in 0..RIM {
                let angle = std::f64::consts::TAU * f64::from(corner) / f64::from(RIM);
                let (sine, cosine) = libm::sincos(angle);
                let out = Vec3::new(cosine, sine, 0.0) * obstacle.radius.0;
                self.point(obstacle.foot + out + Vec3::new(0.0, 0.0, height), RED);
            }
        }
    }

    fn finish(self, time: Timestamp) -> PointCloud {
        PointCloud {
            timestamp: Some(time),
            frame_id: BASE.to_owned(),
            pose: None,
            point_stride: STRIDE,
            fields: fields(),
            data: Bytes::from(self.data),
        }
    }
}

fn fields() -> Vec<PackedElementField> {
    let float = packed_element_field::NumericType::Float32;
    let byte = packed_element_field::NumericType::Uint8;
    let layout = [
        ("x", 0, float),
        ("y", 4, float),
        ("z", 8, float),
        ("red", 12, byte),
        ("green", 13, byte),
        ("blue", 14, byte),
        ("alpha", 15, byte),
    ];
    let field = |(name, offset, kind): (&str, u32, packed_element_field::NumericType)| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: kind.into(),
    };
    layout.map(field).into()
}
