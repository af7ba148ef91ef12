//! One message of every kind, with every field set to something that is not its default.

use tandem_wire::*;

pub(crate) fn header() -> Header {
    Header {
        tick: 41,
        session: Session(0x0123_4567_89ab_cdef),
        seq: Seq(9),
        sent: Stamp(4_100_000_000),
    }
}

fn id(seq: u64) -> MessageId {
    MessageId {
        session: Session(77),
        seq: Seq(seq),
    }
}

fn pose(x: f64) -> Pose {
    Pose {
        position: Vec3::new(x, 0.25, 0.5),
        orientation: [Finite(0.0), Finite(0.6), Finite(0.8), Finite(0.0)],
    }
}

fn guidance() -> Guidance {
    Guidance {
        forecast: 2,
        phase: Finite(41.5),
        last_step: 83,
        velocity: Vec3::new(0.0, 0.125, 0.0),
        position: Vec3::new(0.5, 0.0, 0.15),
        half_width: Vec3::new(0.002, 0.003, 0.0),
        ratio: Finite(1.125),
        ratio_high: Finite(1.75),
    }
}

pub(crate) fn command() -> Command {
    Command {
        velocity: Vec3::new(0.25, -0.5, 0.0),
        deadman: Deadman::Held { press: 3 },
        seen: Some(id(40)),
    }
}

pub(crate) fn proposal() -> Proposal {
    Proposal {
        seen: Some(id(41)),
        guidance: Some(guidance()),
    }
}

pub(crate) fn forecast() -> Forecast {
    let point = ForecastPoint {
        position: Vec3::new(0.5, 0.1, 0.15),
        half_width: Vec3::new(0.001, 0.002, 0.0),
        ratio: Finite(1.25),
    };
    Forecast {
        number: 2,
        context: vec![Finite(0.28), Finite(0.12)],
        model: [0xab; 32],
        first_step: 41,
        period: 100 * MILLISECOND,
        points: vec![point; 2],
    }
}

pub(crate) fn setpoint() -> Setpoint {
    let used = |seq| {
        Some(Used {
            id: id(seq),
            sent: Stamp(4_099_000_000),
            age: 250_000,
            seen: Some(id(39)),
        })
    };
    Setpoint {
        velocity: Vec3::new(0.125, 0.25, 0.0),
        motion: Motion::Permitted { press: 3 },
        lease: Some(Lease {
            number: 2,
            holder: Session(88),
            name: Label::new("ada"),
        }),
        asks: Some(Label::new("bob")),
        law: Law::Constant(Finite(0.25)),
        weight: Finite(0.25),
        human: Vec3::new(0.25, -0.5, 0.0),
        guidance: Some(guidance()),
        blended: Vec3::new(0.125, 0.375, 0.0),
        limited: Limited {
            workspace: false,
            speed: true,
            acceleration: false,
        },
        command: used(40),
        proposal: used(41),
        seen: Some(id(41)),
        refused: Refusals {
            count: 2,
            last: Some(Refusal::OutOfOrder),
        },
    }
}

pub(crate) fn state() -> State {
    let clearance = Clearance {
        distance: Finite(0.0625),
        body: 9,
        obstacle: 1,
    };
    State {
        trial: 1,
        trial_start: 12,
        joints: [0.0, -0.5, 0.0, -2.0, 0.0, 1.5, 0.75].map(Finite),
        joint_velocities: [0.5, 0.25, 0.0, -0.25, 0.0, 0.125, 0.0].map(Finite),
        links: std::array::from_fn(|link| pose(link as f64)),
        tool: pose(0.5),
        tool_velocity: Vec3::new(0.125, 0.25, 0.0),
        clearance: Some(clearance),
        closest: Some(Clearance {
            obstacle: 0,
            ..clearance
        }),
        motion: Motion::Held(Reason::SetpointLost {
            silent: 101 * MILLISECOND,
        }),
        at_rest: false,
        obeys: Some(Obeyed {
            id: id(40),
            arrived: Stamp(4_000_000_001),
            moved: Stamp(4_001_000_000),
            setpoint: setpoint(),
        }),
        arrivals: Some(Arrivals {
            success_rate: Finite(0.75),
            missed: 3,
            longest: 7,
        }),
        refused: Refusals {
            count: 1,
            last: Some(Refusal::LoopTooOld),
        },
    }
}

pub(crate) fn scene() -> Scene {
    Scene {
        obstacles: vec![Cylinder {
            foot: Vec3::new(0.5, 0.0, 0.0),
            radius: Finite(0.02),
            height: Finite(0.2),
        }],
        bodies: vec![Body {
            frame: Body::BASE,
            from: Vec3::ZERO,
            to: Vec3::new(0.0, 0.0, 0.25),
            radius: Finite(0.0625),
        }],
        start: Vec3::new(0.5, -0.3, 0.15),
        goal: Vec3::new(0.5, 0.3, 0.15),
        goal_tolerance: Finite(0.01),
        workspace: Aabb {
            min: Vec3::new(0.25, -0.5, 0.0),
            max: Vec3::new(0.75, 0.5, 0.5),
        },
        period: 100 * MILLISECOND,
    }
}

pub(crate) fn trial() -> Trial {
    Trial::Begin {
        number: 1,
        label: "first".into(),
    }
}

pub(crate) fn claim() -> Claim {
    Claim {
        wish: Wish::TakeOver,
        name: Label::new("supervisor"),
    }
}

pub(crate) fn emergency() -> Emergency {
    Emergency::Clear {
        stop: id(3),
        by: Label::new("ada"),
    }
}

pub(crate) fn info() -> NodeInfo {
    NodeInfo {
        session: Session(77),
        config: "[loop]\n".into(),
        seed: 1,
        build: "0.1.0".into(),
        model: vec![1, 2, 3],
    }
}

pub(crate) fn journal() -> JournalBatch {
    let entry = |what| JournalEntry {
        at: Stamp(4_100_000_000),
        wall: Stamp(5),
        what,
    };
    JournalBatch {
        first: 10,
        lost: 1,
        entries: vec![
            entry(Happening::Sample {
                topic: Topic::State,
                bytes: vec![1, 2],
            }),
            entry(Happening::Wake),
            entry(Happening::Presence {
                peer: NodeName::Recorder,
                alive: true,
            }),
            entry(Happening::Output {
                topic: Topic::Journal(NodeName::Arbiter),
                bytes: vec![3],
            }),
            entry(Happening::Stop),
            entry(Happening::Snapshot { bytes: vec![4, 5] }),
            entry(Happening::Missed {
                topic: Topic::Command,
                tick: 41,
            }),
        ],
    }
}

#[allow(dead_code, reason = "the benchmark leaves it out")]
pub(crate) const fn storage() -> Storage {
    Storage {
        condition: Condition::NoSpace,
        dropped: 12,
    }
}

#[allow(dead_code, reason = "the benchmark leaves it out")]
pub(crate) fn clock() -> ClockReport {
    let peer = PeerClock {
        node: NodeName::RobotSim,
        session: Session(77),
        offset: -1_500_000_000,
        uncertainty: 150_000,
        round_trip: 290_000,
        round_trip_median: 310_000,
        round_trip_worst: 2_400_000,
        samples: 32,
        steps: 1,
        skew: 3_250_000_000,
        is_skewed: true,
    };
    ClockReport { peers: vec![peer] }
}

#[allow(dead_code, reason = "the benchmark leaves it out")]
pub(crate) const fn pong() -> Pong {
    Pong {
        heard: Stamp(4_099_900_000),
        unix_nanos: 1_700_000_000_000_000_000,
    }
}
