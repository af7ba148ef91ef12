//! A forecast and how sure it is: a line in a tube, and from above a line in a band.

use rerun::LineStrip3D;
use tandem_wire::{Forecast, ForecastPoint, Vec3};

use super::{Sheet, colours, plan, xyz};

/// Corners of the tube's cross-section.
const CORNERS: u32 = 8;
/// The corners' directions from the centre, as parts across and up. Written out, for sine and cosine are not the same
/// on every machine.
const AROUND: [(f64, f64); CORNERS as usize] = {
    let d = std::f64::consts::FRAC_1_SQRT_2;
    [
        (1.0, 0.0),
        (d, d),
        (0.0, 1.0),
        (-d, d),
        (-1.0, 0.0),
        (-d, -d),
        (0.0, -1.0),
        (d, -d),
    ]
};
/// A tube thinner than this could not be seen, in metres.
const THINNEST: f64 = 0.0005;

pub(super) fn draw_forecast(forecast: &Forecast, sheet: &mut Sheet<'_>) {
    let points = &forecast.points;
    let line = LineStrip3D::from_iter(points.iter().map(|point| xyz(point.position)));
    let line = rerun::LineStrips3D::new([line])
        .with_colors([colours::FORECAST])
        .with_radii([0.0015]);
    sheet.draw("world/forecast/line", &line);
    draw_tube(points, sheet);
    draw_band(points, sheet);
}

fn draw_tube(points: &[ForecastPoint], sheet: &mut Sheet<'_>) {
    let Ok(rings) = u32::try_from(points.len()) else {
        return;
    };
    let vertices = points.iter().enumerate().flat_map(|(index, point)| {
        let across = across(points, index);
        let (wide, high) = (reach(point, across), point.half_width.z.max(THINNEST));
        AROUND.map(|(side, up)| xyz(point.position + across * (side * wide) + Vec3::new(0.0, 0.0, up * high)))
    });
    let corner = |ring: u32, at: u32| ring * CORNERS + at % CORNERS;
    let triangles = (0..rings.saturating_sub(1)).flat_map(|ring| {
        (0..CORNERS).flat_map(move |at| {
            let (a, b) = (corner(ring, at), corner(ring, at + 1));
            let (c, d) = (corner(ring + 1, at), corner(ring + 1, at + 1));
            [[a, c, b], [b, c, d]]
        })
    });
    let tube = rerun::Mesh3D::new(vertices)
        .with_triangle_indices(triangles)
        .with_albedo_factor(colours::INTERVAL.0);
    sheet.draw("world/forecast/interval", &tube);
}

/// Rerun fills no areas in two dimensions, so the band is its two edges and a hatch between them.
fn draw_band(points: &[ForecastPoint], sheet: &mut Sheet<'_>) {
    let edge = |sign: f64| -> Vec<[f32; 2]> {
        let edge = |(index, point): (usize, &ForecastPoint)| {
            let across = across(points, index);
            plan(point.position + across * (sign * reach(point, across)))
        };
        points.iter().enumerate().map(edge).collect()
    };
    let (left, right) = (edge(1.0), edge(-1.0));
    let hatch = rerun::LineStrips2D::new(hatch(&left, &right))
        .with_colors([colours::INTERVAL])
        .with_radii([0.0015]);
    sheet.draw("plan/forecast/interval", &hatch.with_draw_order(2.0));
    let edges = rerun::LineStrips2D::new([left, right])
        .with_colors([colours::FORECAST])
        .with_radii([0.0005]);
    sheet.draw("plan/forecast/edges", &edges.with_draw_order(3.0));
    let line: Vec<_> = points.iter().map(|point| plan(point.position)).collect();
    let line = rerun::LineStrips2D::new([line])
        .with_colors([colours::FORECAST])
        .with_radii([0.001]);
    sheet.draw("plan/forecast/line", &line.with_draw_order(4.0));
}

/// Lines across the band, close enough to look like an area.
fn hatch(left: &[[f32; 2]], right: &[[f32; 2]]) -> Vec<[[f32; 2]; 2]> {
    const PER_STEP: u8 = 4;
    let between = |edge: &[[f32; 2]], index: usize, part: f32| -> Option<[f32; 2]> {
        let (from, to) = (edge.get(index)?, edge.get(index + 1)?);
        Some([from[0] + part * (to[0] - from[0]), from[1] + part * (to[1] - from[1])])
    };
    let strokes = (0..left.len()).flat_map(|index| (0..PER_STEP).map(move |part| (index, f32::from(part))));
    strokes
        .filter_map(|(index, part)| {
            let part = part / f32::from(PER_STEP);
            Some([between(left, index, part)?, between(right, index, part)?])
        })
        .collect()
}

/// The horizontal direction at right angles to the path at a point; the base's y where the path goes straight up.
fn across(points: &[ForecastPoint], index: usize) -> Vec3 {
    let position = |index: usize| points.get(index).map(|point| point.position);
    let from = position(index.saturating_sub(1)).unwrap_or_default();
    let to = position(index + 1).or_else(|| position(index)).unwrap_or_default();
    let along = to - from;
    let across = Vec3::new(-along.y, along.x, 0.0);
    let length = across.norm();
    if length > 0.0 {
        across * (1.0 / length)
    } else {
        Vec3::new(0.0, 1.0, 0.0)
    }
}

/// How far the interval, taken as an ellipsoid, reaches in a horizontal direction.
fn reach(point: &ForecastPoint, across: Vec3) -> f64 {
    let width = point.half_width;
    Vec3::new(width.x * across.x, width.y * across.y, 0.0)
        .norm()
        .max(THINNEST)
}
