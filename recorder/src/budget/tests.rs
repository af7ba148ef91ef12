//! One command's way round the loop, over three machines whose clocks are seconds apart.

use super::*;
use tandem_wire::{
    Deadman, Finite, Header, JournalEntry, MILLISECOND, Motion, Obeyed, PeerClock, Pose, Reason, Refusals, Seq,
    Session, Used, Vec3, encode,
};

const OPERATOR: Session = Session(1);
const ARBITER: Session = Session(2);
const ROBOT: Session = Session(3);
/// True time at which the story begins, as each clock shows it.
const AT_OPERATOR: u64 = 10_000 * MILLISECOND;
const AT_ARBITER: u64 = 500_000 * MILLISECOND;
const AT_ROBOT: u64 = 90_000 * MILLISECOND;

fn header(session: Session, seq: u64, sent: u64) -> Header {
    Header {
        tick: 0,
        session,
        seq: Seq(seq),
        sent: Stamp(sent),
    }
}

fn id(session: Session, seq: u64) -> MessageId {
    MessageId { session, seq: Seq(seq) }
}

fn said(by: NodeName, session: Session, of: &[(NodeName, Session, i64)]) -> Sample {
    let clock = |&(node, session, offset): &(NodeName, Session, i64)| PeerClock {
        node,
        session,
        offset,
        uncertainty: 7_000,
        round_trip: 14_000,
        round_trip_median: 14_000,
        round_trip_worst: 14_000,
        samples: 1,
        steps: 0,
        skew: 0,
        is_skewed: false,
    };
    let peers = of.iter().map(clock).collect();
    let body = ClockReport { peers };
    let header = header(session, 1, 0);
    Sample::Clock(by, Envelope { header, body })
}

fn state(seq: u64, sent: u64, obeys: Option<Obeyed>) -> Sample {
    let body = State {
        trial: 0,
        trial_start: 0,
        joints: [Finite(0.0); 7],
        joint_velocities: [Finite(0.0); 7],
        links: [Pose::default(); 8],
        tool: Pose::default(),
        tool_velocity: Vec3::ZERO,
        clearance: None,
        closest: None,
        motion: Motion::Held(Reason::NoTrial),
        at_rest: true,
        obeys,
        arrivals: None,
        refused: Refusals::default(),
    };
    let header = header(ROBOT, seq, sent);
    Sample::State(Box::new(Envelope { header, body }))
}

fn setpoint(used: Used) -> Setpoint {
    Setpoint {
        command: Some(used),
        ..idle()
    }
}

fn idle() -> Setpoint {
    Setpoint {
        velocity: Vec3::ZERO,
        motion: Motion::Held(Reason::NoTrial),
        lease: None,
        asks: None,
        law: tandem_wire::Law::default(),
        weight: Finite(1.0),
        human: Vec3::ZERO,
        guidance: None,
        blended: Vec3::ZERO,
        limited: tandem_wire::Limited::default(),
        command: None,
        proposal: None,
        seen: None,
        refused: Refusals::default(),
    }
}

fn journal(entries: Vec<(u64, Happening)>) -> Sample {
    let entry = |(wall, what)| JournalEntry {
        at: Stamp(wall),
        wall: Stamp(wall),
        what,
    };
    let body = JournalBatch {
        first: 0,
        lost: 0,
        entries: entries.into_iter().map(entry).collect(),
    };
    let batch = Envelope {
        header: header(OPERATOR, 1, 0),
        body,
    };
    Sample::Journal(JournalPart::of(NodeName::Operator, &batch))
}

/// State 1 at 0 ms reaches the operator at 4; its command leaves at 9 and reaches the arbiter at 12, who decides at
/// 12.5; the robot has the setpoint at 13.5, moves at 15 and says so at 20.
fn story() -> Vec<Sample> {
    let tenths = |count: u64| count * MILLISECOND / 10;
    let used = Used {
        id: id(OPERATOR, 5),
        sent: Stamp(AT_OPERATOR + tenths(90)),
        age: tenths(5),
        seen: None,
    };
    let decided = setpoint(used);
    let obeyed = Obeyed {
        id: id(ARBITER, 8),
        arrived: Stamp(AT_ROBOT + tenths(135)),
        moved: Stamp(AT_ROBOT + tenths(150)),
        setpoint: decided,
    };
    let first = state(1, AT_ROBOT, None);
    let mut travelled = Vec::new();
    if let Sample::State(message) = &first {
        encode(message, &mut travelled);
    }
    let command = Command {
        velocity: Vec3::ZERO,
        deadman: Deadman::Released,
        seen: Some(id(ROBOT, 1)),
    };
    vec![
        first,
        journal(vec![
            (
                AT_OPERATOR + tenths(40),
                Happening::Sample {
                    topic: Topic::State,
                    bytes: travelled,
                },
            ),
            (
                AT_OPERATOR + tenths(65),
                Happening::Sample {
                    topic: Topic::Device,
                    bytes: vec![],
                },
            ),
            (
                AT_OPERATOR + tenths(90),
                Happening::Output {
                    topic: Topic::Command,
                    bytes: vec![],
                },
            ),
        ]),
        Sample::Command(Envelope {
            header: header(OPERATOR, 5, AT_OPERATOR + tenths(90)),
            body: command,
        }),
        Sample::Setpoint(Box::new(Envelope {
            header: header(ARBITER, 8, AT_ARBITER + tenths(125)),
            body: decided,
        })),
        state(2, AT_ROBOT + tenths(200), Some(obeyed)),
    ]
}

fn offsets() -> Vec<Sample> {
    let apart = |ours: u64, theirs: u64| i64::try_from(theirs).unwrap() - i64::try_from(ours).unwrap();
    let of_operator = (NodeName::Operator, OPERATOR, apart(AT_ARBITER, AT_OPERATOR));
    let of_robot = |ours| (NodeName::RobotSim, ROBOT, apart(ours, AT_ROBOT));
    vec![
        said(NodeName::Arbiter, ARBITER, &[of_operator, of_robot(AT_ARBITER)]),
        said(NodeName::Operator, OPERATOR, &[of_robot(AT_OPERATOR)]),
    ]
}

fn told(budget: &Budget) -> Vec<(&'static str, f64, u64)> {
    let row = |hop: &HopBudget| (hop.hop.as_str(), hop.recent.p50 as f64 / 1e6, hop.uncertainty);
    budget.hops().iter().map(row).collect()
}

#[test]
fn every_hop_of_a_commands_way_is_told_though_no_two_clocks_agree() {
    let mut budget = Budget::default();
    for sample in offsets().iter().chain(&story()) {
        budget.hear(sample);
    }
    assert_eq!(
        told(&budget),
        [
            ("device", 2.5, 0),
            ("command", 3.0, 7_000),
            ("decision", 0.5, 0),
            ("setpoint", 1.0, 7_000),
            ("uptake", 1.5, 0),
            ("report", 5.0, 0),
            ("state", 4.0, 7_000),
            ("command_to_motion", 6.0, 7_000),
            ("loop", 13.5, 0),
        ]
    );
}

#[test]
fn without_offsets_only_what_one_clock_saw_is_told() {
    let mut budget = Budget::default();
    story().iter().for_each(|sample| budget.hear(sample));
    let names: Vec<_> = told(&budget).into_iter().map(|(name, ..)| name).collect();
    assert_eq!(names, ["device", "decision", "uptake", "report", "loop"]);
    let is_of_one_clock = |hop: &HopBudget| hop.hop.basis() == Basis::OneClock;
    assert!(budget.hops().iter().all(is_of_one_clock));
}

#[test]
fn what_is_said_again_is_counted_once() {
    let mut budget = Budget::default();
    for sample in offsets().iter().chain(&story()).chain(&story()[3..]) {
        budget.hear(sample);
    }
    assert!(budget.hops().iter().all(|hop| hop.count == 1), "{:?}", budget.hops());
}

#[test]
fn an_offset_that_is_a_little_off_makes_no_time_below_zero() {
    let mut budget = Budget::default();
    let mut reports = offsets();
    for report in &mut reports {
        if let Sample::Clock(_, message) = report {
            for peer in &mut message.body.peers {
                peer.offset = peer.offset.saturating_add(60_000_000_000);
            }
        }
    }
    for sample in reports.iter().chain(&story()) {
        budget.hear(sample);
    }
    assert!(budget.hops().iter().any(|hop| hop.recent.p50 == 0));
}
