//! Several operators, and somebody who stops them all: scripted timelines in, every setpoint out.

mod support;

use support::*;
use tandem_arbiter::{ArbiterSettings, Event};
use tandem_wire::{Deadman, Emergency, Label, Lease, MessageId, Motion, Reason, Refusal, Session, Timing, Vec3, Wish};

const HUMAN: Vec3 = Vec3::new(0.0, 0.1, 0.0);
const OTHER: Session = Session(8);
const RELEASED: Deadman = Deadman::Released;

fn real() -> Stage {
    Stage::new(Timing::default(), &ArbiterSettings::default())
}

/// State `n` at `20·n` ms, then a command of the first operator and one of the other.
fn round(stage: &mut Stage, n: u64, one: Option<Deadman>, other: Option<Deadman>) {
    stage.step(at(20 * n), Event::State(state(n, 0, CENTRE)));
    if let Some(deadman) = one {
        let command = command_of(OPERATOR, n, deadman, HUMAN);
        stage.step(at(20 * n + 2), Event::Command(command));
    }
    if let Some(deadman) = other {
        let command = command_of(OTHER, n, deadman, -HUMAN);
        stage.step(at(20 * n + 3), Event::Command(command));
    }
}

fn rounds(stage: &mut Stage, range: std::ops::Range<u64>, one: Option<Deadman>, other: Option<Deadman>) {
    range.for_each(|n| round(stage, n, one, other));
}

fn lease(stage: &Stage) -> Option<Lease> {
    stage.setpoints.last().and_then(|setpoint| setpoint.body.lease)
}

fn holder(stage: &Stage) -> Option<Session> {
    lease(stage).map(|lease| lease.holder)
}

fn motion(stage: &Stage) -> Motion {
    stage.setpoints.last().expect("it says something").body.motion
}

#[test]
fn the_first_to_press_drives_and_another_press_is_refused_and_counted() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Some(RELEASED), Some(RELEASED));
    assert_eq!(holder(&stage), None);
    stage.step(at(59), Event::Claim(claim(OPERATOR, 1, Wish::Drive, "ada")));
    rounds(&mut stage, 3..5, Some(held(1)), Some(RELEASED));
    rounds(&mut stage, 5..8, Some(held(1)), Some(held(1)));
    rounds(&mut stage, 8..9, Some(held(1)), Some(RELEASED));
    let name = Label::new("ada");
    let number = 1;
    let holder = OPERATOR;
    assert_eq!(lease(&stage), Some(Lease { number, holder, name }));
    insta::assert_snapshot!(stage.told(), @r"
     0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
    22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
    62 ms  (0.000 0.100 0.000) ω=1.00 press 1, refused 3: another operator holds the lease  ×6
    ");
    assert!(stage.setpoints.iter().all(|setpoint| setpoint.body.velocity.y >= 0.0));
}

#[test]
fn whoever_gives_the_lease_up_leaves_it_to_the_next_press_and_a_held_one_is_none() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Some(RELEASED), Some(RELEASED));
    rounds(&mut stage, 3..5, Some(held(1)), Some(held(1)));
    stage.step(at(105), Event::Claim(claim(OPERATOR, 1, Wish::Release, "ada")));
    assert_eq!((motion(&stage), holder(&stage)), (Motion::Held(Reason::NoLease), None));
    rounds(&mut stage, 6..8, Some(held(1)), Some(held(1)));
    assert_eq!(holder(&stage), None, "both have held since before");
    rounds(&mut stage, 8..9, Some(RELEASED), Some(RELEASED));
    rounds(&mut stage, 9..11, Some(RELEASED), Some(held(2)));
    assert_eq!(
        (motion(&stage), holder(&stage)),
        (Motion::Permitted { press: 2 }, Some(OTHER))
    );
    assert_eq!(lease(&stage).map(|lease| lease.number), Some(2));
}

#[test]
fn a_supervisor_takes_over_and_must_press_afresh_and_nobody_else_can() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Some(RELEASED), Some(RELEASED));
    rounds(&mut stage, 3..6, Some(held(1)), Some(held(1)));
    stage.step(at(125), Event::Claim(claim(OTHER, 1, Wish::TakeOver, "eve")));
    round(&mut stage, 7, Some(held(1)), None);
    assert_eq!(holder(&stage), Some(OPERATOR));
    let refused = stage.setpoints.last().expect("it answers").body.refused.last;
    assert_eq!(refused, Some(Refusal::NotSupervisor));
    stage.step(at(145), Event::Claim(claim(OTHER, 2, Wish::TakeOver, "supervisor")));
    assert_eq!(
        (motion(&stage), holder(&stage)),
        (Motion::Held(Reason::SecondOperator), Some(OTHER))
    );
    rounds(&mut stage, 8..10, Some(held(1)), Some(held(1)));
    assert_eq!(motion(&stage), Motion::Held(Reason::AwaitingPress));
    rounds(&mut stage, 10..12, Some(held(2)), Some(held(2)));
    assert_eq!(motion(&stage), Motion::Permitted { press: 2 });
    assert!(
        stage.setpoints.last().expect("it answers").body.velocity.y < 0.0,
        "the supervisor drives"
    );
    // A claim with a number that was used already, captured and played back or made up, changes nothing.
    stage.step(at(244), Event::Claim(claim(OTHER, 2, Wish::Drive, "supervisor")));
    stage.step(at(245), Event::Claim(claim(OPERATOR, 1, Wish::Drive, "ada")));
    stage.step(at(246), Event::Claim(claim(OTHER, 2, Wish::Release, "supervisor")));
    assert_eq!(holder(&stage), Some(OTHER));
}

#[test]
fn a_supervisor_who_has_only_watched_keeps_what_it_took_over_until_it_presses() {
    let settings = ArbiterSettings {
        lease_idle_ms: 200,
        ..ArbiterSettings::default()
    };
    let mut stage = Stage::new(Timing::default(), &settings);
    rounds(&mut stage, 1..3, Some(RELEASED), Some(RELEASED));
    rounds(&mut stage, 3..30, Some(held(1)), Some(RELEASED));
    stage.step(at(585), Event::Claim(claim(OTHER, 1, Wish::TakeOver, "supervisor")));
    rounds(&mut stage, 30..32, Some(RELEASED), Some(RELEASED));
    rounds(&mut stage, 32..34, Some(held(2)), Some(RELEASED));
    assert_eq!(holder(&stage), Some(OTHER));
    rounds(&mut stage, 34..36, Some(held(2)), Some(held(1)));
    assert_eq!(motion(&stage), Motion::Permitted { press: 1 });
}

#[test]
fn a_forged_claim_of_the_last_number_there_is_does_not_silence_the_ones_that_follow() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Some(RELEASED), Some(RELEASED));
    stage.step(at(46), Event::Claim(claim(OTHER, 1, Wish::Drive, "supervisor")));
    rounds(&mut stage, 3..6, Some(held(1)), Some(RELEASED));
    stage.step(at(125), Event::Claim(claim(OTHER, u64::MAX, Wish::Drive, "nobody")));
    stage.step(at(126), Event::Claim(claim(OTHER, 2, Wish::TakeOver, "supervisor")));
    assert_eq!(holder(&stage), Some(OTHER));
}

#[test]
fn a_holder_that_falls_silent_stops_at_once_and_loses_the_lease_after_two_seconds() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Some(RELEASED), Some(RELEASED));
    rounds(&mut stage, 3..6, Some(held(1)), Some(RELEASED));
    rounds(&mut stage, 6..80, None, Some(RELEASED));
    assert!(matches!(motion(&stage), Motion::Held(Reason::CommandLost { .. })));
    rounds(&mut stage, 80..82, None, Some(held(1)));
    assert_eq!(holder(&stage), Some(OPERATOR), "not yet: it may come back");
    rounds(&mut stage, 82..108, None, Some(RELEASED));
    rounds(&mut stage, 108..110, None, Some(held(2)));
    assert_eq!(
        (motion(&stage), holder(&stage)),
        (Motion::Permitted { press: 2 }, Some(OTHER))
    );
    rounds(&mut stage, 110..112, Some(held(1)), Some(held(2)));
    assert_eq!(holder(&stage), Some(OTHER), "whoever comes back has to wait");
}

#[test]
fn whoever_presses_in_vain_is_named_to_the_holder_until_somebody_gets_the_lease() {
    let mut stage = real();
    let asks = |stage: &Stage| stage.setpoints.last().expect("it answers").body.asks;
    rounds(&mut stage, 1..3, Some(RELEASED), Some(RELEASED));
    rounds(&mut stage, 3..5, Some(held(1)), Some(RELEASED));
    assert_eq!(asks(&stage), None);
    stage.step(at(105), Event::Claim(claim(OTHER, 1, Wish::Drive, "bob")));
    rounds(&mut stage, 6..8, Some(held(1)), Some(held(1)));
    assert_eq!(asks(&stage), Some(Label::new("bob")));
    rounds(&mut stage, 8..700, Some(held(1)), Some(RELEASED));
    assert_eq!(asks(&stage), None, "it is no news after ten seconds");
    stage.step(at(14_005), Event::Claim(claim(OTHER, 2, Wish::Drive, "bob")));
    stage.step(at(14_006), Event::Claim(claim(OPERATOR, 1, Wish::Release, "ada")));
    rounds(&mut stage, 701..703, Some(RELEASED), Some(RELEASED));
    rounds(&mut stage, 703..704, Some(RELEASED), Some(held(2)));
    assert_eq!((holder(&stage), asks(&stage)), (Some(OTHER), None));
}

#[test]
fn a_holder_that_has_let_go_for_long_gives_way_to_a_press() {
    let settings = ArbiterSettings {
        lease_idle_ms: 200,
        ..ArbiterSettings::default()
    };
    let mut stage = Stage::new(Timing::default(), &settings);
    rounds(&mut stage, 1..3, Some(RELEASED), Some(RELEASED));
    rounds(&mut stage, 3..5, Some(held(1)), Some(RELEASED));
    rounds(&mut stage, 5..7, Some(RELEASED), Some(held(1)));
    assert_eq!(holder(&stage), Some(OPERATOR));
    rounds(&mut stage, 7..20, Some(RELEASED), Some(RELEASED));
    rounds(&mut stage, 20..21, Some(RELEASED), Some(held(2)));
    assert_eq!(
        (motion(&stage), holder(&stage)),
        (Motion::Permitted { press: 2 }, Some(OTHER))
    );
}

/// A stage whose holder is about to have let go for long, and somebody whose press was refused and is still held.
fn with_a_refused_press_that_is_held() -> Stage {
    let settings = ArbiterSettings {
        lease_idle_ms: 200,
        ..ArbiterSettings::default()
    };
    let mut stage = Stage::new(Timing::default(), &settings);
    rounds(&mut stage, 1..3, Some(RELEASED), Some(RELEASED));
    rounds(&mut stage, 3..5, Some(held(1)), Some(RELEASED));
    rounds(&mut stage, 5..30, Some(RELEASED), Some(held(1)));
    stage
}

#[test]
fn a_press_that_was_refused_does_not_drive_once_the_holder_has_let_go_for_long() {
    let mut stage = with_a_refused_press_that_is_held();
    assert_eq!(
        (motion(&stage), holder(&stage)),
        (Motion::Held(Reason::DeadmanReleased), Some(OPERATOR))
    );
    round(&mut stage, 30, Some(RELEASED), Some(held(2)));
    assert_eq!(
        (motion(&stage), holder(&stage)),
        (Motion::Permitted { press: 2 }, Some(OTHER)),
        "another press does, even if its release was lost on the way"
    );
}

#[test]
fn a_press_made_while_an_emergency_stop_is_in_force_does_not_drive_after_its_end() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Some(RELEASED), Some(RELEASED));
    rounds(&mut stage, 3..5, Some(held(1)), Some(RELEASED));
    rounds(&mut stage, 5..6, Some(RELEASED), Some(RELEASED));
    stage.step(at(115), Event::Emergency(emergency(1, None)));
    rounds(&mut stage, 6..10, Some(RELEASED), Some(held(1)));
    stage.step(at(195), Event::Emergency(emergency(2, Some(id(BYSTANDER, 1)))));
    rounds(&mut stage, 10..700, Some(RELEASED), Some(held(1)));
    assert!(
        stage
            .setpoints
            .iter()
            .skip(10)
            .all(|setpoint| !setpoint.body.motion.is_permitted())
    );
}

#[test]
fn what_an_operator_pressed_while_it_was_not_heard_does_not_count() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Some(RELEASED), Some(RELEASED));
    rounds(&mut stage, 3..20, Some(RELEASED), None);
    rounds(&mut stage, 20..25, Some(RELEASED), Some(held(1)));
    assert_eq!(
        (motion(&stage), holder(&stage)),
        (Motion::Held(Reason::DeadmanReleased), None)
    );
    rounds(&mut stage, 25..26, Some(RELEASED), Some(held(2)));
    assert_eq!(
        (motion(&stage), holder(&stage)),
        (Motion::Permitted { press: 2 }, Some(OTHER))
    );
}

#[test]
fn an_emergency_stop_holds_until_it_is_cleared_by_its_name_and_then_needs_a_fresh_press() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Some(RELEASED), None);
    rounds(&mut stage, 3..5, Some(held(1)), None);
    stage.step(at(90), Event::Emergency(emergency(1, None)));
    rounds(&mut stage, 5..7, Some(held(1)), None);
    rounds(&mut stage, 7..8, Some(RELEASED), None);
    rounds(&mut stage, 8..9, Some(held(2)), None);
    stage.step(at(184), Event::Emergency(emergency(2, Some(id(OPERATOR, 1)))));
    rounds(&mut stage, 10..11, Some(held(2)), None);
    stage.step(at(204), Event::Emergency(emergency(3, Some(id(BYSTANDER, 1)))));
    rounds(&mut stage, 11..13, Some(held(2)), None);
    rounds(&mut stage, 13..15, Some(held(3)), None);
    insta::assert_snapshot!(stage.told(), @r"
      0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
     22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
     62 ms  (0.000 0.100 0.000) ω=1.00 press 1  ×2
     90 ms  (0.000 0.000 0.000) ω=1.00 held: emergency stop by ada  ×7
    204 ms  (0.000 0.000 0.000) ω=1.00 held: waiting for a fresh press of the deadman  ×3
    262 ms  (0.000 0.100 0.000) ω=1.00 press 3  ×2
    ");
}

#[test]
fn an_arbiter_that_was_started_again_learns_of_the_stop_from_the_robot() {
    let mut stage = real();
    let stop = id(BYSTANDER, 4);
    for n in 1..5 {
        let mut stopped = state(n, 0, CENTRE);
        let by = Label::new("ada");
        stopped.body.motion = Motion::Held(Reason::EmergencyStop { stop, by });
        stage.step(at(20 * n), Event::State(stopped));
        let deadman = if n < 3 { RELEASED } else { held(1) };
        stage.step(at(20 * n + 2), Event::Command(command_of(OPERATOR, n, deadman, HUMAN)));
    }
    assert!(matches!(motion(&stage), Motion::Held(Reason::EmergencyStop { stop: named, .. }) if named == stop));
    stage.step(at(90), Event::Emergency(emergency(9, Some(stop))));
    // A state that was under way says it once more; it does not come back.
    let mut late = state(5, 0, CENTRE);
    let by = Label::new("ada");
    late.body.motion = Motion::Held(Reason::EmergencyStop { stop, by });
    stage.step(at(100), Event::State(late));
    rounds(&mut stage, 6..8, Some(RELEASED), None);
    rounds(&mut stage, 8..9, Some(held(2)), None);
    assert_eq!(motion(&stage), Motion::Permitted { press: 2 });
}

#[test]
fn a_stop_is_told_even_while_nobody_commands() {
    let mut stage = real();
    stage.step(at(20), Event::State(state(1, 0, CENTRE)));
    stage.step(at(25), Event::Emergency(emergency(1, None)));
    let before = stage.setpoints.len();
    stage.pass(at(90));
    assert!(stage.setpoints.len() >= before + 3, "late joiners hear of it");
    assert!(matches!(motion(&stage), Motion::Held(Reason::EmergencyStop { .. })));
    let clear = Emergency::Clear {
        stop: MessageId::default(),
        by: Label::default(),
    };
    assert_ne!(clear, emergency(1, None).body);
}

#[test]
fn at_full_speed_the_first_press_starts_from_rest_and_is_ramped_within_the_acceleration_limit() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Some(RELEASED), None);
    for n in 3..7 {
        stage.step(at(20 * n), Event::State(state(n, 0, CENTRE)));
        let command = command_of(OPERATOR, n, held(1), Vec3::new(0.0, 0.5, 0.0));
        stage.step(at(20 * n + 2), Event::Command(command));
    }
    let speeds = stage.setpoints.iter().map(|setpoint| setpoint.body.velocity.norm());
    let speeds: Vec<f64> = speeds.collect();
    for pair in speeds.windows(2) {
        assert!(pair[1] - pair[0] <= 10.0 * 0.020 + 1e-9, "{speeds:?}");
    }
    assert!((speeds[speeds.len() - 1] - 0.5).abs() < 1e-9);
}

#[test]
fn where_it_is_asked_for_setpoints_go_out_every_millisecond_while_motion_is_permitted() {
    let settings = ArbiterSettings {
        setpoint_hz: 1000.0,
        ..ArbiterSettings::default()
    };
    let mut stage = Stage::new(Timing::default(), &settings);
    rounds(&mut stage, 1..3, Some(RELEASED), None);
    rounds(&mut stage, 3..5, Some(held(1)), None);
    let before = stage.setpoints.len();
    stage.pass(at(95));
    assert_eq!(stage.setpoints.len() - before, 12, "from 83 to 94 ms");
    stage.pass(at(400));
    assert!(matches!(
        motion(&stage),
        Motion::Held(Reason::StateLost { .. } | Reason::CommandLost { .. })
    ));
}

#[test]
fn a_ninth_operator_is_refused_in_words_until_one_leaves_and_the_holder_drives_on() {
    let mut stage = real();
    let others: Vec<Session> = (20..28).map(Session).collect();
    let speak = |stage: &mut Stage, n: u64, who: Session, deadman| {
        stage.step(at(20 * n + 4), Event::Command(command_of(who, n, deadman, -HUMAN)));
    };
    for n in 1..12 {
        round(&mut stage, n, Some(if n < 3 { RELEASED } else { held(1) }), None);
        others.iter().for_each(|who| speak(&mut stage, n, *who, RELEASED));
    }
    let last = stage.setpoints.last().expect("it answers").body;
    assert_eq!(last.refused.last, Some(Refusal::NoSeat));
    assert_eq!(
        (holder(&stage), last.motion),
        (Some(OPERATOR), Motion::Permitted { press: 1 })
    );
    // One watcher leaves; after its stream has timed out the ninth has its place, but not the lease.
    for n in 12..30 {
        round(&mut stage, n, Some(held(1)), None);
        others[1..].iter().for_each(|who| speak(&mut stage, n, *who, RELEASED));
    }
    let ninth = *others.last().expect("eight others");
    round(&mut stage, 30, Some(held(1)), None);
    speak(&mut stage, 30, ninth, held(1));
    round(&mut stage, 31, Some(held(1)), None);
    let last = stage.setpoints.last().expect("it answers").body;
    assert_eq!(last.refused.last, Some(Refusal::SecondOperator), "it is heard now");
    assert_eq!(holder(&stage), Some(OPERATOR));
}
