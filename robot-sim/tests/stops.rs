//! Who may move the robot, and who may stop it: scripted timelines in, everything the robot says of itself out.

mod support;

use support::*;
use tandem_robot_sim::Event;
use tandem_wire::{Emergency, Envelope, Header, Label, Lease, MessageId, Motion, Reason, Refusal, Seq, Session, Vec3};

const RIGHT: Vec3 = Vec3::new(0.0, 0.2, 0.0);

fn emergency(seq: u64, clear: Option<u64>) -> Event {
    let (session, by) = (Session(6), Label::new("ada"));
    let stop = |seq| MessageId { session, seq: Seq(seq) };
    let body = clear.map_or(Emergency::Stop { by }, |seq| Emergency::Clear { stop: stop(seq), by });
    let header = Header {
        session,
        seq: Seq(seq),
        ..Header::default()
    };
    Event::Emergency(Envelope { header, body })
}

#[test]
fn an_emergency_stop_stops_whatever_setpoints_say_until_it_is_cleared_and_pressed_afresh() {
    let mut stage = Stage::real();
    stage.stream(at(100), RELEASED, Vec3::ZERO);
    stage.stream(at(300), pressed(1), RIGHT);
    stage.step(emergency(1, None));
    stage.stream(at(600), pressed(1), RIGHT);
    stage.stream(at(700), pressed(2), RIGHT);
    stage.step(emergency(2, Some(1000)));
    stage.stream(at(800), RELEASED, Vec3::ZERO);
    stage.step(emergency(3, Some(1)));
    stage.stream(at(900), RELEASED, Vec3::ZERO);
    stage.stream(at(1000), pressed(3), RIGHT);
    insta::assert_snapshot!(stage.told(), @r"
      0 ms  tick  0  trial 1 held: no setpoint has arrived yet, at rest
     40 ms  tick  0  trial 1 held: the deadman is released, at rest
    140 ms  tick  1  trial 1 press 1
    302 ms  tick  3  trial 1 held: emergency stop by ada
    380 ms  tick  3  trial 1 held: emergency stop by ada, at rest
    802 ms  tick  8  trial 1 held: waiting for a fresh press of the deadman, at rest
    840 ms  tick  8  trial 1 held: the deadman is released, at rest
    940 ms  tick  9  trial 1 press 3
    ");
}

#[test]
fn a_robot_that_was_started_again_learns_of_the_stop_from_the_arbiter() {
    let mut stage = Stage::real();
    let (stop, by) = (MessageId::default(), Label::new("ada"));
    stage.stream(at(100), Motion::Held(Reason::EmergencyStop { stop, by }), Vec3::ZERO);
    stage.stream(at(200), RELEASED, Vec3::ZERO);
    stage.stream(at(400), pressed(1), RIGHT);
    assert_eq!(
        stage.state().body.motion,
        Motion::Held(Reason::EmergencyStop { stop, by })
    );
    assert!(stage.state().body.at_rest);
}

#[test]
fn a_forged_lease_stops_the_arm_for_as_long_as_a_loss_and_then_a_fresh_press_moves_it() {
    let mut stage = Stage::real();
    stage.stream(at(100), RELEASED, Vec3::ZERO);
    stage.stream(at(200), pressed(1), RIGHT);
    let newest = stage.state().header.id();
    let mut forged = setpoint(12, 0, pressed(1), RIGHT, Some(newest));
    forged.body.lease = Some(Lease {
        number: u32::MAX,
        holder: Session(66),
        name: Label::default(),
    });
    stage.step(Event::Setpoint(forged));
    assert_eq!(stage.robot.motion(), Motion::Held(Reason::AwaitingPress));
    stage.stream(at(400), pressed(1), RIGHT);
    assert!(!stage.robot.motion().is_permitted(), "what is held does not count");
    stage.stream(at(500), RELEASED, Vec3::ZERO);
    stage.stream(at(600), pressed(2), RIGHT);
    assert_eq!(stage.robot.motion(), pressed(2));
}

#[test]
fn an_arbiter_that_was_started_again_moves_the_arm_only_by_a_press_that_follows_a_held_setpoint() {
    let mut stage = Stage::real();
    stage.stream(at(100), RELEASED, Vec3::ZERO);
    stage.stream(at(200), pressed(1), RIGHT);
    let send = |stage: &mut Stage, seq, motion| {
        let newest = stage.state().header.id();
        let mut setpoint = setpoint(seq, 0, motion, RIGHT, Some(newest));
        setpoint.header.session = Session(77);
        setpoint.body.lease = Some(Lease {
            number: 1,
            holder: Session(5),
            name: Label::default(),
        });
        stage.step(Event::Setpoint(setpoint));
        stage.robot.motion()
    };
    assert_eq!(
        send(&mut stage, 1, pressed(1)),
        pressed(1),
        "refused: the one before is alive"
    );
    stage.pass(at(420));
    assert!(matches!(
        stage.robot.motion(),
        Motion::Held(Reason::SetpointLost { .. })
    ));
    send(&mut stage, 2, RELEASED);
    assert!(
        matches!(stage.robot.motion(), Motion::Held(Reason::SetpointLost { .. })),
        "refused: the one before may only have faltered"
    );
    stage.pass(at(1220));
    assert_eq!(send(&mut stage, 2, pressed(1)), Motion::Held(Reason::AwaitingPress));
    assert_eq!(send(&mut stage, 3, RELEASED), RELEASED);
    assert_eq!(send(&mut stage, 4, pressed(1)), pressed(1));
}

#[test]
fn a_setpoint_without_a_lease_or_with_one_that_was_outdated_moves_nothing() {
    let mut stage = Stage::real();
    stage.stream(at(100), RELEASED, Vec3::ZERO);
    let send = |stage: &mut Stage, seq, motion, lease: Option<Lease>| {
        let newest = stage.state().header.id();
        let mut setpoint = setpoint(seq, 0, motion, RIGHT, Some(newest));
        setpoint.body.lease = lease;
        stage.step(Event::Setpoint(setpoint));
        stage.robot.motion()
    };
    let of = |number, holder| {
        let (holder, name) = (Session(holder), Label::default());
        Some(Lease { number, holder, name })
    };
    assert_eq!(send(&mut stage, 20, pressed(1), None), Motion::Held(Reason::NoLease));
    send(&mut stage, 21, RELEASED, of(2, 1));
    assert_eq!(send(&mut stage, 22, pressed(2), of(2, 1)), pressed(2));
    // Of the lease before, and of the same number in other hands: refused, and the motion goes on.
    assert_eq!(send(&mut stage, 23, pressed(3), of(1, 5)), pressed(2));
    assert_eq!(send(&mut stage, 23, pressed(3), of(2, 5)), pressed(2));
    // In other hands without a stop in between.
    assert_eq!(
        send(&mut stage, 24, pressed(4), of(3, 5)),
        Motion::Held(Reason::AwaitingPress)
    );
    assert_eq!(send(&mut stage, 25, RELEASED, of(3, 5)), RELEASED);
    assert_eq!(send(&mut stage, 26, pressed(2), of(3, 5)), pressed(2));
    // Handed over with a stop in between: presses of the one before do not count against the next one's.
    send(&mut stage, 27, Motion::Held(Reason::SecondOperator), of(4, 9));
    assert_eq!(send(&mut stage, 28, pressed(2), of(4, 9)), pressed(2));
    stage.pass(at(120));
    assert_eq!(stage.state().body.refused.last, Some(Refusal::SecondOperator));
    assert_eq!(stage.state().body.refused.count, 2);
}
