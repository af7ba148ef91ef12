//! Our messages in Foxglove's standard schemas, for what tools draw by themselves.

use foxglove::messages::{
    Color, CubePrimitive, CylinderPrimitive, FrameTransform, FrameTransforms, LinePrimitive, Log, Point3, Pose,
    PoseInFrame, PosesInFrame, Quaternion, SceneEntity, SceneUpdate, SpherePrimitive, Timestamp, Vector3,
    line_primitive, log,
};
use tandem_wire::{Body, Cylinder, Finite, Forecast, LINKS, Nanos, SECOND, Scene, State, Vec3};

use crate::heard::{Level, Note};

/// The frame that everything is given in.
pub(super) const BASE: &str = "base";
/// An interval thinner than this could not be seen, in metres.
const THINNEST: f64 = 0.002;

const RED: Color = colour(0.82, 0.27, 0.24, 0.9);
const GREEN: Color = colour(0.2, 0.63, 0.33, 0.6);
const GREY: Color = colour(0.5, 0.5, 0.5, 0.4);
const BLUE: Color = colour(0.18, 0.49, 0.83, 0.25);
const DARK_BLUE: Color = colour(0.18, 0.49, 0.83, 1.0);

/// What a frame is called: `base`, `link1` to `link7`, `flange`, `tool`.
pub(super) fn frame_name(frame: u8) -> String {
    match usize::from(frame) {
        _ if frame == Body::BASE => BASE.to_owned(),
        LINKS => "tool".to_owned(),
        index if index + 1 == LINKS => "flange".to_owned(),
        index => format!("link{}", index + 1),
    }
}

/// Where every frame of the arm is.
pub(super) fn frames(state: &State, time: Timestamp) -> FrameTransforms {
    let poses = state.links.iter().chain([&state.tool]);
    let transform = |(frame, pose): (u8, &tandem_wire::Pose)| FrameTransform {
        timestamp: Some(time),
        parent_frame_id: BASE.to_owned(),
        child_frame_id: frame_name(frame),
        translation: Some(vector(pose.position)),
        rotation: Some(quaternion(pose.orientation)),
    };
    FrameTransforms {
        transforms: (0_u8..).zip(poses).map(transform).collect(),
    }
}

/// Where the tool is.
pub(super) fn tool_pose(state: &State, time: Timestamp) -> PoseInFrame {
    PoseInFrame {
        timestamp: Some(time),
        frame_id: BASE.to_owned(),
        pose: Some(pose(&state.tool)),
    }
}

/// The path that a forecast expects.
pub(super) fn forecast_path(forecast: &Forecast, time: Timestamp) -> PosesInFrame {
    PosesInFrame {
        timestamp: Some(time),
        frame_id: BASE.to_owned(),
        poses: forecast.points.iter().map(|point| at(point.position)).collect(),
    }
}

/// The surroundings as solids.
pub(super) fn scene_shapes(scene: &Scene, time: Timestamp) -> SceneUpdate {
    let mut obstacles = entity("obstacles", time);
    obstacles.cylinders = scene.obstacles.iter().map(cylinder).collect();
    let mut goal = entity("goal", time);
    let tolerance = 2.0 * scene.goal_tolerance.0;
    goal.spheres = vec![sphere(scene.goal, Vec3::new(tolerance, tolerance, tolerance), GREEN)];
    let mut start = entity("start", time);
    start.spheres = vec![sphere(scene.start, Vec3::new(0.01, 0.01, 0.01), GREY)];
    let mut workspace = entity("workspace", time);
    workspace.lines = vec![edges_of(scene)];
    let mut base = entity("base", time);
    base.cubes = vec![base_plate()];
    SceneUpdate {
        deletions: Vec::new(),
        entities: vec![obstacles, goal, start, workspace, base],
    }
}

/// A forecast's line, and its interval as one translucent ellipsoid a step.
pub(super) fn forecast_shapes(forecast: &Forecast, time: Timestamp) -> SceneUpdate {
    let mut shapes = entity("forecast", time);
    let size = |width: f64| (2.0 * width).max(THINNEST);
    shapes.spheres = forecast
        .points
        .iter()
        .map(|point| {
            let width = point.half_width;
            sphere(
                point.position,
                Vec3::new(size(width.x), size(width.y), size(width.z)),
                BLUE,
            )
        })
        .collect();
    shapes.lines = vec![LinePrimitive {
        r#type: line_primitive::Type::LineStrip.into(),
        pose: Some(at(Vec3::ZERO)),
        thickness: THINNEST,
        points: forecast.points.iter().map(|step| point(step.position)).collect(),
        color: Some(DARK_BLUE),
        ..LinePrimitive::default()
    }];
    SceneUpdate {
        deletions: Vec::new(),
        entities: vec![shapes],
    }
}

/// A line of the log.
pub(super) fn log_line(note: &Note, time: Timestamp) -> Log {
    let level = match note.level {
        Level::Info => log::Level::Info,
        Level::Warning => log::Level::Warning,
        Level::Error => log::Level::Error,
    };
    Log {
        timestamp: Some(time),
        level: level.into(),
        message: note.text.clone(),
        name: note.about.to_string(),
        ..Log::default()
    }
}

/// Nanoseconds since 1970 as Foxglove writes them.
pub(super) fn timestamp(nanos: Nanos) -> Timestamp {
    let seconds = u32::try_from(nanos / SECOND).unwrap_or(u32::MAX);
    let rest = u32::try_from(nanos % SECOND).expect("less than a second has fewer than 2^30 nanoseconds");
    Timestamp::new(seconds, rest)
}

pub(super) fn vector(v: Vec3) -> Vector3 {
    Vector3 { x: v.x, y: v.y, z: v.z }
}

pub(super) fn pose(pose: &tandem_wire::Pose) -> Pose {
    Pose {
        position: Some(vector(pose.position)),
        orientation: Some(quaternion(pose.orientation)),
    }
}

fn quaternion([x, y, z, w]: [Finite; 4]) -> Quaternion {
    Quaternion {
        x: x.0,
        y: y.0,
        z: z.0,
        w: w.0,
    }
}

fn point(v: Vec3) -> Point3 {
    Point3 { x: v.x, y: v.y, z: v.z }
}

pub(super) fn at(position: Vec3) -> Pose {
    Pose {
        position: Some(vector(position)),
        orientation: Some(Quaternion {
            x: 0.0,
            y: 0.0,
            z: 0.0,
            w: 1.0,
        }),
    }
}

fn entity(id: &str, time: Timestamp) -> SceneEntity {
    SceneEntity {
        timestamp: Some(time),
        frame_id: BASE.to_owned(),
        id: id.to_owned(),
        ..SceneEntity::default()
    }
}

fn cylinder(obstacle: &Cylinder) -> CylinderPrimitive {
    let middle = obstacle.foot + Vec3::new(0.0, 0.0, obstacle.height.0 / 2.0);
    let diameter = 2.0 * obstacle.radius.0;
    CylinderPrimitive {
        pose: Some(at(middle)),
        size: Some(vector(Vec3::new(diameter, diameter, obstacle.height.0))),
        bottom_scale: 1.0,
        top_scale: 1.0,
        color: Some(RED),
    }
}

fn sphere(centre: Vec3, size: Vec3, color: Color) -> SpherePrimitive {
    SpherePrimitive {
        pose: Some(at(centre)),
        size: Some(vector(size)),
        color: Some(color),
    }
}

fn base_plate() -> CubePrimitive {
    CubePrimitive {
        pose: Some(at(Vec3::new(0.0, 0.0, -0.005))),
        size: Some(vector(Vec3::new(0.2, 0.2, 0.01))),
        color: Some(GREY),
    }
}

/// The twelve edges of the workspace, which would hide everything as a solid.
fn edges_of(scene: &Scene) -> LinePrimitive {
    let (low, high) = (scene.workspace.min, scene.workspace.max);
    let pick = |bit: u8, corner: u8, low: f64, high: f64| if corner & bit == 0 { low } else { high };
    let corner = |index: u8| {
        let x = pick(1, index, low.x, high.x);
        let y = pick(2, index, low.y, high.y);
        point(Vec3::new(x, y, pick(4, index, low.z, high.z)))
    };
    let edges = (0_u8..8).flat_map(|from| [1_u8, 2, 4].map(|bit| (from, from | bit)));
    LinePrimitive {
        r#type: line_primitive::Type::LineList.into(),
        pose: Some(at(Vec3::ZERO)),
        thickness: THINNEST,
        points: edges
            .filter(|(from, to)| from != to)
            .flat_map(|(from, to)| [corner(from), corner(to)])
            .collect(),
        color: Some(GREY),
        ..LinePrimitive::default()
    }
}

const fn colour(r: f64, g: f64, b: f64, a: f64) -> Color {
    Color { r, g, b, a }
}
