//! What the robot costs: an inner tick, averaged over a moving second; the kinematics; a whole control period.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;

use tandem_robot_sim::arm::{Arm, Drive, ToolBounds};
use tandem_robot_sim::kinematics::{Twist, forward, joints_for, preferred_speeds, resolve, tool_jacobian};
use tandem_robot_sim::panda::PerJoint;
use tandem_robot_sim::scene::{clearance, closer_than};
use tandem_robot_sim::{Event, Output, RobotSim, RobotSimSettings};
use tandem_wire::{
    Aabb, Cylinder, Envelope, Finite, Header, Law, Limited, Motion, Node, Outbox, Reason, Refusals, Seq, Session,
    Setpoint, Stamp, State, Timing, Trial, Vec3,
};

const BOUNDS: ToolBounds = ToolBounds {
    workspace: Aabb {
        min: Vec3::new(0.2, -0.5, 0.02),
        max: Vec3::new(0.8, 0.5, 0.8),
    },
    speed: 0.5,
    acceleration: 4.0,
};
const TICKS: u32 = 1000;

fn start() -> PerJoint {
    joints_for(&Vector3::new(0.5, -0.3, 0.15)).expect("the shipped start can be reached")
}

fn obstacles() -> [Cylinder; 2] {
    [-0.02, 0.16].map(|y| Cylinder {
        foot: Vec3::new(0.5, y, 0.0),
        radius: Finite(0.02),
        height: Finite(0.2),
    })
}

/// A second of motion past both obstacles, the drive changing every 100 ms. The figure is for 1000 ticks.
fn inner_ticks(criterion: &mut Criterion) {
    let obstacles = obstacles();
    let drives: [Drive; 10] = std::array::from_fn(|n| {
        let aside = if n < 5 { -0.2 } else { 0.2 };
        Drive::Follow(Vec3::new(aside, 0.45, 0.0))
    });
    criterion.bench_function("1000 inner ticks: arm, frames and clearance", |bencher| {
        bencher.iter_batched_ref(
            || Arm::standing(start()),
            |arm| {
                let mut closest = None;
                for tick in 0..TICKS {
                    arm.tick(drives[tick as usize / 100], &BOUNDS);
                    closest = closer_than(closest, &forward(arm.angles()), &obstacles);
                }
                closest
            },
            criterion::BatchSize::SmallInput,
        );
    });
}

fn kinematics(criterion: &mut Criterion) {
    let q = start();
    let frames = forward(&q);
    let twist = Twist::new(0.1, 0.2, 0.0, 0.0, 0.0, 0.0);
    criterion.bench_function("forward kinematics", |bencher| bencher.iter(|| forward(black_box(&q))));
    criterion.bench_function("inverse kinematics step", |bencher| {
        bencher.iter(|| {
            let frames = forward(black_box(&q));
            resolve(&tool_jacobian(&frames), &twist, &preferred_speeds(&q))
        });
    });
    let obstacles = obstacles();
    criterion.bench_function("clearance", |bencher| {
        bencher.iter(|| clearance(black_box(&frames), &obstacles))
    });
}

/// A lockstep setpoint: the checks, 100 inner ticks, the state.
fn control_period(criterion: &mut Criterion) {
    let timing = Timing::default().lockstep();
    let mut robot =
        RobotSim::new(Session(1), timing, &RobotSimSettings::default()).expect("the shipped settings can be used");
    let mut outbox = Outbox::default();
    let trial = Trial::Begin {
        number: 1,
        label: String::new(),
    };
    robot.step(
        Stamp(0),
        Event::Trial(Envelope {
            header: Header::default(),
            body: trial,
        }),
        &mut outbox,
    );
    let mut newest = newest_state(&mut outbox).expect("a trial begins with a state");
    criterion.bench_function("control period: setpoint in, 100 inner ticks, state out", |bencher| {
        bencher.iter(|| {
            robot.step(Stamp(0), Event::Setpoint(answer(&newest)), &mut outbox);
            newest = newest_state(&mut outbox).expect("each setpoint is answered");
        });
    });
}

fn newest_state(outbox: &mut Outbox<Output>) -> Option<Envelope<State>> {
    outbox.drain().fold(None, |newest, output| match output {
        Output::State(state) => Some(state),
        Output::Scene(_) => newest,
    })
}

/// To and fro, a second each way.
fn answer(state: &Envelope<State>) -> Envelope<Setpoint> {
    let tick = state.header.tick;
    let velocity = Vec3::new(0.0, if (tick / 10).is_multiple_of(2) { 0.3 } else { -0.3 }, 0.0);
    let motion = if tick == 0 {
        Motion::Held(Reason::DeadmanReleased)
    } else {
        Motion::Permitted { press: 1 }
    };
    let body = Setpoint {
        velocity,
        motion,
        lease: Some(tandem_wire::Lease {
            number: 1,
            ..tandem_wire::Lease::default()
        }),
        asks: None,
        law: Law::Human,
        weight: Finite(1.0),
        human: velocity,
        guidance: None,
        blended: velocity,
        limited: Limited::default(),
        command: None,
        proposal: None,
        seen: Some(state.header.id()),
        refused: Refusals::default(),
    };
    let header = Header {
        tick,
        session: Session(2),
        seq: Seq(u64::from(tick) + 1),
        sent: Stamp(0),
    };
    Envelope { header, body }
}

criterion_group!(benches, inner_ticks, kinematics, control_period);
criterion_main!(benches);
