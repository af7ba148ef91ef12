//! The arm along every path that ships: it gets there, holds its tool, keeps every limit at every inner tick, and
//! nothing but the tool comes near an obstacle.

use tandem_robot_sim::RobotSimSettings;
use tandem_robot_sim::arm::{Arm, Drive, TICK_S, ToolBounds};
use tandem_robot_sim::kinematics::{Frames, POINTING_DOWN, forward, joints_for, rotation_error, tool_jacobian};
use tandem_robot_sim::panda::{
    ACCELERATION_MAX_RAD_S2, ARM_CAPSULES, JERK_MAX_RAD_S3, JOINTS, POSITION_MAX_RAD, POSITION_MIN_RAD, Part,
    SPEED_MAX_RAD_S,
};
use tandem_wire::{Aabb, Cylinder, Finite, TaskFrame, Vec3};

/// How far the demonstrated and tried paths go around the first obstacle, in metres.
const AMPLITUDES: [f64; 17] = [
    0.05, 0.06, 0.08, 0.083, 0.087, 0.09, 0.094, 0.1, 0.105, 0.11, 0.118, 0.12, 0.122, 0.128, 0.14, 0.165, 0.18,
];
const LAST_STEP: u32 = 83;
const TICKS_PER_STEP: u32 = 100;

/// The shipped bounds.
fn bounds() -> ToolBounds {
    let settings = RobotSimSettings::default();
    ToolBounds {
        workspace: Aabb {
            min: Vec3::from(settings.workspace_min_m),
            max: Vec3::from(settings.workspace_max_m),
        },
        speed: settings.tool_speed_m_s,
        acceleration: settings.tool_acceleration_m_s2,
    }
}

/// The planar task's path: over the first obstacle, under the second.
fn path(amplitude: f64, step: u32) -> Vec3 {
    let tau = f64::from(step.min(LAST_STEP)) / f64::from(LAST_STEP);
    let s = tau * tau * tau * (10.0 - 15.0 * tau + 6.0 * tau * tau);
    let x = 0.6 * s;
    let bump = |centre: f64, width: f64| libm::exp(-((x - centre) / width) * ((x - centre) / width));
    let y = amplitude * bump(0.28, 0.07) - amplitude * (0.8 + 2.0 * (amplitude - 0.11)) * bump(0.46, 0.06);
    let x = x + 0.12 * (amplitude - 0.11) * libm::sin(std::f64::consts::TAU * s);
    TaskFrame::default().to_base([x, y])
}

fn obstacles() -> [Cylinder; 2] {
    [0.28, 0.46].map(|x| {
        let foot = TaskFrame::default().to_base([x, 0.0]);
        Cylinder {
            foot: Vec3::new(foot.x, foot.y, 0.0),
            radius: Finite(0.02),
            height: Finite(0.20),
        }
    })
}

/// What was seen over a whole run, worst first.
#[derive(Debug)]
struct Seen {
    off_height: f64,
    off_orientation: f64,
    off_path: f64,
    inside_range: f64,
    speed: f64,
    acceleration: f64,
    jerk: f64,
    weakest: f64,
    others: f64,
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, f64::max)
}

/// Drives along a path as a perfect pilot would: always towards where the path is one period from now.
fn drive(amplitude: f64) -> Seen {
    let bounds = bounds();
    let at = |position: Vec3| nalgebra::Vector3::new(position.x, position.y, position.z);
    let mut arm = Arm::standing(joints_for(&at(path(amplitude, 0))).expect("the start can be reached"));
    let obstacles = obstacles();
    let mut seen = Seen {
        off_height: 0.0,
        off_orientation: 0.0,
        off_path: 0.0,
        inside_range: f64::INFINITY,
        speed: 0.0,
        acceleration: 0.0,
        jerk: 0.0,
        weakest: f64::INFINITY,
        others: f64::INFINITY,
    };
    for step in 0..LAST_STEP + 5 {
        let tool = forward(arm.angles()).tool().origin;
        seen.off_path = seen.off_path.max((at(path(amplitude, step)) - tool).norm());
        let next = path(amplitude, step + 1);
        let velocity = (next - Vec3::new(tool.x, tool.y, tool.z)) * 10.0;
        let drive = Drive::Follow(Vec3::new(velocity.x, velocity.y, 0.0));
        for _ in 0..TICKS_PER_STEP {
            let (angles, speeds, before) = (*arm.angles(), *arm.speeds(), *arm.accelerations());
            arm.tick(drive, &bounds);
            watch(&mut seen, &arm, (angles, speeds, before), &obstacles);
        }
    }
    seen
}

fn watch(seen: &mut Seen, arm: &Arm, before: ([f64; 7], [f64; 7], [f64; 7]), obstacles: &[Cylinder]) {
    let frames = forward(arm.angles());
    let tool = frames.tool();
    seen.off_height = seen.off_height.max((tool.origin.z - 0.15).abs());
    seen.off_orientation = seen
        .off_orientation
        .max(rotation_error(&tool.rotation, &POINTING_DOWN).norm());
    for joint in 0..JOINTS {
        let angle = arm.angles()[joint];
        let inside = (angle - POSITION_MIN_RAD[joint]).min(POSITION_MAX_RAD[joint] - angle);
        seen.inside_range = seen.inside_range.min(inside);
    }
    // From the angles themselves, not from what the arm says about its own speed.
    let speeds: [f64; 7] = std::array::from_fn(|joint| (arm.angles()[joint] - before.0[joint]) / TICK_S);
    let accelerations: [f64; 7] = std::array::from_fn(|joint| (speeds[joint] - before.1[joint]) / TICK_S);
    let share = |value: f64, limit: f64| value.abs() / limit;
    seen.speed = seen
        .speed
        .max(largest((0..JOINTS).map(|j| share(speeds[j], SPEED_MAX_RAD_S[j]))));
    seen.acceleration = seen.acceleration.max(largest(
        (0..JOINTS).map(|j| share(accelerations[j], ACCELERATION_MAX_RAD_S2[j])),
    ));
    let jerk = |j: usize| (accelerations[j] - before.2[j]) / TICK_S;
    seen.jerk = seen
        .jerk
        .max(largest((0..JOINTS).map(|j| share(jerk(j), JERK_MAX_RAD_S3[j]))));
    if arm.plans_next() {
        seen.weakest = seen.weakest.min(tool_jacobian(&frames).singular_values()[5]);
        seen.others = seen.others.min(clearance_of_all_but_the_tool(&frames, obstacles));
    }
}

/// Point by point along every capsule, 2 mm apart, on purpose not with the crate's own search.
fn clearance_of_all_but_the_tool(frames: &Frames, obstacles: &[Cylinder]) -> f64 {
    let mut nearest = f64::INFINITY;
    for capsule in ARM_CAPSULES.iter().filter(|capsule| capsule.part != Part::Tool) {
        let frame = frames.frame(capsule.frame);
        let (start, end) = (frame.point(capsule.start), frame.point(capsule.end));
        for n in 0..=150 {
            let point = start + (end - start) * (f64::from(n) / 150.0);
            for obstacle in obstacles {
                let aside = (point.x - obstacle.foot.x).hypot(point.y - obstacle.foot.y) - obstacle.radius.0;
                let above = point.z - obstacle.height.0;
                nearest = nearest.min(aside.max(0.0).hypot(above.max(0.0)) - capsule.radius);
            }
        }
    }
    nearest
}

#[test]
fn every_shipped_path_is_followed_within_every_limit() {
    for amplitude in AMPLITUDES {
        let seen = drive(amplitude);
        println!("A = {amplitude}: {seen:.5?}");
        let whole = 1.0 + 1e-9;
        assert!(
            seen.speed < 0.7 && seen.acceleration <= whole && seen.jerk <= whole,
            "{amplitude}: {seen:?}"
        );
        assert!(seen.inside_range > 0.17 && seen.weakest > 0.14, "{amplitude}: {seen:?}");
        assert!(
            seen.off_height < 0.0005 && seen.off_orientation < 0.001,
            "{amplitude}: {seen:?}"
        );
        assert!(seen.others > 0.09, "{amplitude}: {seen:?}");
        // The tightest turns take more acceleration than the tool is given; the pilot's next step makes up for it.
        assert!(
            seen.off_path < if amplitude < 0.15 { 0.003 } else { 0.007 },
            "{amplitude}: {seen:?}"
        );
    }
}
