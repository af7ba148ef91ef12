//! Any sequence of drives or events: no panic, and what the robot promises holds.

mod support;

use proptest::prelude::*;
use support::*;
use tandem_robot_sim::arm::{Arm, Drive, TICK_S, ToolBounds};
use tandem_robot_sim::kinematics::{forward, joints_for};
use tandem_robot_sim::panda::{
    ACCELERATION_MAX_RAD_S2, JERK_MAX_RAD_S3, JOINTS, POSITION_MAX_RAD, POSITION_MIN_RAD, SPEED_MAX_RAD_S,
};
use tandem_robot_sim::{Event, RobotSim};
use tandem_wire::{
    Aabb, Input, MILLISECOND, Motion, Node, Outbox, Pace, Ports, Reason, Session, Stamp, Timing, Topic, Vec3,
};

/// Far larger than the arm reaches, so that joints come to the ends of their ranges and the arm to its singularities.
const NO_WALLS: Aabb = Aabb {
    min: Vec3::new(-2.0, -2.0, -2.0),
    max: Vec3::new(2.0, 2.0, 2.0),
};
const ROUNDING: f64 = 1e-9;

fn velocity() -> impl Strategy<Value = Vec3> {
    let axis = || prop_oneof![6 => -0.6..0.6, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY), 1 => Just(-1e300)];
    let wild = (axis(), axis(), axis()).prop_map(|(x, y, z)| Vec3::new(x, y, z));
    let tame = (-0.6..0.6, -0.6..0.6, -0.6..0.6).prop_map(|(x, y, z)| Vec3::new(x, y, z));
    prop_oneof![1 => wild, 5 => tame]
}

/// Each drive for a while: some for a tick, some long enough to reach the end of the arm's reach.
fn drives() -> impl Strategy<Value = Vec<(Drive, u32)>> {
    let drive = prop_oneof![5 => velocity().prop_map(Drive::Follow), 1 => Just(Drive::Stop)];
    let ticks = prop_oneof![1_u32..30, 100_u32..2500];
    prop::collection::vec((drive, ticks), 1..12)
}

fn start() -> Arm {
    Arm::standing(joints_for(&nalgebra::Vector3::new(0.5, -0.3, 0.15)).expect("the start can be reached"))
}

/// Checks position, speed and acceleration; returns the largest jerk as a share of its limit.
fn assert_limits(arm: &Arm, before: &Arm) -> Result<f64, TestCaseError> {
    let mut jerk_share: f64 = 0.0;
    for joint in 0..JOINTS {
        let angle = arm.angles()[joint];
        prop_assert!(
            angle >= POSITION_MIN_RAD[joint] && angle <= POSITION_MAX_RAD[joint],
            "joint {joint} at {angle}"
        );
        let speed = (angle - before.angles()[joint]) / TICK_S;
        prop_assert!(
            speed.abs() <= SPEED_MAX_RAD_S[joint] + ROUNDING,
            "joint {joint}: {speed} rad/s"
        );
        let acceleration = (arm.speeds()[joint] - before.speeds()[joint]) / TICK_S;
        let limit = ACCELERATION_MAX_RAD_S2[joint];
        prop_assert!(
            acceleration.abs() <= limit + ROUNDING,
            "joint {joint}: {acceleration} rad/s²"
        );
        let jerk = (arm.accelerations()[joint] - before.accelerations()[joint]) / TICK_S;
        jerk_share = jerk_share.max(jerk.abs() / JERK_MAX_RAD_S3[joint]);
    }
    Ok(jerk_share)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_limit_holds_at_every_tick_wherever_the_arm_is_driven(
        drives in drives(), speed in 0.05..1.7, acceleration in 0.1..13.0,
    ) {
        let bounds = ToolBounds { workspace: NO_WALLS, speed, acceleration };
        let mut arm = start();
        for (drive, ticks) in drives {
            for _ in 0..ticks {
                let before = arm.clone();
                arm.tick(drive, &bounds);
                let jerk = assert_limits(&arm, &before)?;
                // Above its limit only where a joint must not run into the end of its range: see `arm.rs`.
                prop_assert!(jerk <= 2.0, "jerk {jerk}");
            }
        }
    }

    #[test]
    fn a_stop_brings_every_joint_to_rest_within_a_second(drives in drives()) {
        let bounds = ToolBounds { workspace: NO_WALLS, speed: 0.5, acceleration: 4.0 };
        let mut arm = start();
        for (drive, ticks) in drives {
            (0..ticks).for_each(|_| arm.tick(drive, &bounds));
        }
        (0..1000).for_each(|_| arm.tick(Drive::Stop, &bounds));
        prop_assert!(arm.is_at_rest());
        let before = arm.clone();
        (0..100).for_each(|_| arm.tick(Drive::Stop, &bounds));
        prop_assert_eq!(arm.angles(), before.angles());
    }

    #[test]
    fn the_tool_stays_in_its_workspace(drives in drives()) {
        let workspace = Aabb { min: Vec3::new(0.35, -0.35, 0.1), max: Vec3::new(0.6, 0.1, 0.4) };
        let bounds = ToolBounds { workspace, speed: 0.5, acceleration: 4.0 };
        let mut arm = start();
        for (drive, ticks) in drives {
            for _ in 0..ticks {
                arm.tick(drive, &bounds);
                let tool = forward(arm.angles()).tool().origin;
                let lag = 0.005;
                let inside = |axis: usize, low: f64, high: f64| tool[axis] > low - lag && tool[axis] < high + lag;
                prop_assert!(inside(0, 0.35, 0.6) && inside(1, -0.35, 0.1) && inside(2, 0.1, 0.4), "{}", tool);
                let nearly = Vec3::new(1e-12, 1e-12, 1e-12);
                let walls = Aabb { min: workspace.min - nearly, max: workspace.max + nearly };
                prop_assert!(walls.contains(arm.reference()), "{:?}", arm.reference());
            }
        }
    }
}

/// One thing that happens to the node, before the stage makes an event of it.
#[derive(Clone, Debug)]
enum Happening {
    Setpoint {
        skip: u64,
        motion: Motion,
        velocity: Vec3,
        seen_back: u64,
        session: u64,
        tick_off: u32,
    },
    Begin(u32),
    End(u32),
    Garbage(Vec<u8>),
    /// The setpoint of a tick so far from the newest does not come.
    Missed(u32),
    Wake,
    Stop,
}

fn motion() -> impl Strategy<Value = Motion> {
    let held = prop_oneof![
        3 => Just(Reason::DeadmanReleased),
        1 => Just(Reason::LoopTooOld),
        1 => Just(Reason::NoCommandYet),
    ];
    prop_oneof![4 => (1_u32..4).prop_map(pressed), 1 => held.prop_map(Motion::Held)]
}

fn happening() -> impl Strategy<Value = (u64, Happening)> {
    let sent = (
        0_u64..3,
        motion(),
        velocity(),
        0_u64..40,
        prop_oneof![9 => Just(3_u64), 1 => Just(4)],
        0_u32..20,
    );
    let setpoint = sent.prop_map(
        |(skip, motion, velocity, seen_back, session, off)| Happening::Setpoint {
            skip,
            motion,
            velocity,
            seen_back,
            session,
            tick_off: off / 19,
        },
    );
    let what = prop_oneof![
        30 => setpoint,
        2 => (0_u32..5).prop_map(Happening::Begin),
        2 => (0_u32..5).prop_map(Happening::End),
        2 => prop::collection::vec(any::<u8>(), 0..600).prop_map(Happening::Garbage),
        4 => prop_oneof![9 => Just(0), 1 => any::<u32>()].prop_map(Happening::Missed),
        6 => Just(Happening::Wake),
        1 => Just(Happening::Stop),
    ];
    (prop_oneof![20 => 0_u64..60, 1 => 0_u64..5000], what)
}

/// Plays the happenings and returns every byte that the robot published.
fn play(timing: Timing, happenings: &[(u64, Happening)]) -> Result<Vec<u8>, TestCaseError> {
    let mut stage = Stage::new(timing, &tandem_robot_sim::RobotSimSettings::default());
    let mut seq = 10;
    let mut closed = false;
    let mut permitted_by_sender = false;
    for (wait, happening) in happenings {
        stage.pass(stage.now.after(wait * MILLISECOND));
        match happening {
            Happening::Setpoint {
                skip,
                motion,
                velocity,
                seen_back,
                session,
                tick_off,
            } => {
                seq += skip;
                let newest = stage.states.last().map(|state| state.header);
                let echo = newest.map_or(0, |header| header.seq.0.saturating_sub(*seen_back));
                let tick = newest.map_or(0, |header| header.tick) + tick_off;
                let mut setpoint = setpoint(seq, tick, *motion, *velocity, seen(echo));
                setpoint.header.session = Session(*session);
                let refused = stage.states.last().map_or(0, |state| state.body.refused.count);
                stage.step(Event::Setpoint(setpoint));
                let admitted = stage
                    .states
                    .last()
                    .is_some_and(|state| state.body.refused.count == refused);
                permitted_by_sender |= admitted && motion.is_permitted();
            }
            Happening::Begin(number) => stage.step(begin(*number)),
            Happening::End(number) => stage.step(end(*number)),
            Happening::Garbage(bytes) => {
                for topic in [Topic::Setpoint, Topic::Trial, Topic::State] {
                    stage.step(RobotSim::event(Input::Sample { topic, bytes }));
                }
            }
            Happening::Missed(off) => {
                let tick = stage
                    .states
                    .last()
                    .map_or(0, |state| state.header.tick)
                    .saturating_add(*off);
                let topic = Topic::Setpoint;
                stage.step(Event::Missed { topic, tick });
            }
            Happening::Wake => stage.step(Event::Wake),
            Happening::Stop => stage.step(Event::Stop),
        }
        let arm = stage.robot.arm();
        prop_assert!(
            permitted_by_sender || arm.speeds() == &[0.0; 7],
            "it moves and nobody permitted it"
        );
        for joint in 0..JOINTS {
            prop_assert!(arm.angles()[joint] >= POSITION_MIN_RAD[joint]);
            prop_assert!(arm.angles()[joint] <= POSITION_MAX_RAD[joint]);
            prop_assert!(arm.speeds()[joint].abs() <= SPEED_MAX_RAD_S[joint] + ROUNDING);
        }
        // Whatever happened, silence has stopped the arm by now: the watchdog's limit and a generous ramp.
        if *wait > 1100 && timing.pace == Pace::Real && !closed {
            prop_assert!(arm.is_at_rest());
        }
        closed |= matches!(happening, Happening::Stop);
    }
    Ok(bytes_of(&stage))
}

fn bytes_of(stage: &Stage) -> Vec<u8> {
    let (mut all, mut one) = (Vec::new(), Vec::new());
    for state in &stage.states {
        tandem_wire::encode(state, &mut one);
        tandem_wire::decode::<tandem_wire::State>(&one).expect("what the robot publishes can be read");
        all.extend_from_slice(&one);
    }
    all
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn whatever_happens_the_robot_keeps_its_limits_and_repeats_itself(
        happenings in prop::collection::vec(happening(), 1..80),
    ) {
        for timing in [Timing::default(), Timing::default().lockstep()] {
            prop_assert_eq!(play(timing, &happenings)?, play(timing, &happenings)?);
        }
    }
}

#[test]
fn how_often_it_is_woken_does_not_change_where_the_arm_goes() {
    let run = |waking: u64| {
        let mut stage = Stage::real();
        stage.stream(at(100), RELEASED, Vec3::ZERO);
        stage.stream(at(400), pressed(1), Vec3::new(0.1, 0.2, 0.0));
        let mut outbox = Outbox::default();
        for millis in (stage.now.0 / MILLISECOND..800).step_by(usize::try_from(waking).unwrap()) {
            stage.robot.step(Stamp(millis * MILLISECOND), Event::Wake, &mut outbox);
        }
        stage.robot.step(at(800), Event::Wake, &mut outbox);
        *stage.robot.arm().angles()
    };
    assert_eq!(run(1), run(7));
    assert_eq!(run(1), run(300));
}

/// Straight at every wall, edge and corner at full speed, and turned away again just before.
#[test]
fn at_full_speed_the_tool_brakes_in_time_for_every_wall() {
    let workspace = Aabb {
        min: Vec3::new(0.35, -0.35, 0.1),
        max: Vec3::new(0.6, 0.1, 0.4),
    };
    let bounds = ToolBounds {
        workspace,
        speed: 0.5,
        acceleration: 4.0,
    };
    let axis = |digit: u32| f64::from(digit % 3) - 1.0;
    let ways = |n: u32| Vec3::new(axis(n), axis(n / 3), axis(n / 9)) * bounds.speed;
    let mut farthest: f64 = 0.0;
    for run in 0..27 {
        for ticks in [1500, 300, 120] {
            let mut arm = start();
            for leg in 0..12 {
                for _ in 0..ticks {
                    arm.tick(Drive::Follow(ways((run + leg * 7) % 27)), &bounds);
                    let tool = forward(arm.angles()).tool().origin;
                    let (low, high) = (workspace.min.to_array(), workspace.max.to_array());
                    let outside = (0..3).map(|axis| (low[axis] - tool[axis]).max(tool[axis] - high[axis]));
                    farthest = outside.fold(farthest, f64::max);
                }
            }
        }
    }
    assert!(farthest < 0.0035, "{farthest} m outside");
}
