//! Scripted timelines in, every setpoint out.

mod support;

use support::*;
use tandem_arbiter::{ArbiterSettings, Authority, Event, LawName};
use tandem_wire::{Deadman, Malformed, Seq, Session, Timing, Topic, Unreadable, Vec3};

const HUMAN: Vec3 = Vec3::new(0.0, 0.1, 0.0);
const ROBOT_WANTS: Vec3 = Vec3::new(0.1, 0.0, 0.0);

fn real() -> Stage {
    Stage::new(Timing::default(), &ArbiterSettings::default())
}

/// One round of the stream in real time: state, proposal and command number `n`, a millisecond apart, at `20·n` ms.
fn round(stage: &mut Stage, n: u64, deadman: Deadman, ratio: Option<f64>) {
    let tick = u32::try_from(n / 5).expect("short");
    stage.step(at(20 * n), Event::State(state(n, tick, CENTRE)));
    let guidance = ratio.map(|ratio| guidance(ratio, ROBOT_WANTS));
    stage.step(at(20 * n + 1), Event::Proposal(proposal(n, tick, guidance)));
    stage.step(at(20 * n + 2), Event::Command(command(n, tick, deadman, HUMAN)));
}

fn rounds(stage: &mut Stage, range: std::ops::Range<u64>, deadman: Deadman, ratio: Option<f64>) {
    for n in range {
        round(stage, n, deadman, ratio);
    }
}

#[test]
fn a_session_from_the_first_press_through_sharing_to_the_goodbye() {
    let mut stage = real();
    stage.pass(at(20));
    rounds(&mut stage, 1..5, Deadman::Released, None);
    rounds(&mut stage, 5..10, held(1), None);
    rounds(&mut stage, 10..15, held(1), Some(1.0));
    rounds(&mut stage, 15..20, held(1), Some(1.25));
    assert_eq!(stage.arbiter.authority(), Authority::Shared { press: 1 });
    rounds(&mut stage, 20..22, Deadman::Released, Some(1.25));
    stage.step(at(445), Event::Stop);
    stage.step(at(450), Event::Command(command(30, 6, held(2), HUMAN)));
    insta::assert_snapshot!(stage.told(), @r"
      0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
     22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×4
    102 ms  (0.000 0.100 0.000) ω=1.00 press 1  ×5
    202 ms  (0.090 0.010 0.000) ω=0.10 press 1  ×5
    302 ms  (0.050 0.050 0.000) ω=0.50 press 1  ×5
    402 ms  (0.000 0.000 0.000) ω=0.50 held: the deadman is released  ×2
    445 ms  (0.000 0.000 0.000) ω=0.50 held: the node is shutting down
    ");
    assert_eq!(stage.arbiter.authority(), Authority::Closed);
}

#[test]
fn commands_fall_silent_and_come_back_with_the_same_press() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Deadman::Released, None);
    rounds(&mut stage, 3..6, held(1), None);
    for n in 6..14 {
        stage.step(at(20 * n), Event::State(state(n, 1, CENTRE)));
    }
    rounds(&mut stage, 14..16, held(1), None);
    rounds(&mut stage, 16..18, held(2), None);
    insta::assert_snapshot!(stage.told(), @r"
      0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
     22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
     62 ms  (0.000 0.100 0.000) ω=1.00 press 1  ×3
    202 ms  (0.000 0.000 0.000) ω=1.00 held: the operator's commands stopped 100 ms ago  ×4
    282 ms  (0.000 0.000 0.000) ω=1.00 held: waiting for a fresh press of the deadman  ×2
    322 ms  (0.000 0.100 0.000) ω=1.00 press 2  ×2
    ");
}

#[test]
fn the_state_falls_silent_while_commands_go_on() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Deadman::Released, None);
    rounds(&mut stage, 3..6, held(1), None);
    for n in 6..13 {
        let mut late = command(n, 1, held(1), HUMAN);
        late.body.seen = Some(id(ROBOT, 5));
        stage.step(at(20 * n), Event::Command(late));
    }
    rounds(&mut stage, 13..15, held(1), None);
    rounds(&mut stage, 15..16, held(2), None);
    insta::assert_snapshot!(stage.told(), @r"
      0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
     22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
     62 ms  (0.000 0.100 0.000) ω=1.00 press 1  ×8
    200 ms  (0.000 0.000 0.000) ω=1.00 held: the robot's state stopped 100 ms ago  ×4
    262 ms  (0.000 0.000 0.000) ω=1.00 held: waiting for a fresh press of the deadman  ×2
    302 ms  (0.000 0.100 0.000) ω=1.00 press 2
    ");
}

#[test]
fn a_backlog_that_arrives_in_order_is_old_all_the_same() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Deadman::Released, None);
    rounds(&mut stage, 3..6, held(1), None);
    for n in 6..60 {
        stage.step(at(20 * n), Event::State(state(n, 1, CENTRE)));
        if n >= 35 {
            stage.step(at(20 * n + 1), Event::Command(command(n - 29, 1, held(1), HUMAN)));
        }
    }
    insta::assert_snapshot!(stage.told(), @r"
      0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
     22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
     62 ms  (0.000 0.100 0.000) ω=1.00 press 1  ×3
    202 ms  (0.000 0.000 0.000) ω=1.00 held: the operator's commands stopped 100 ms ago  ×25
    702 ms  (0.000 0.000 0.000) ω=1.00 held: commands answer a state that is too old, refused 24: made from a state that is too old  ×24
    ");
}

#[test]
fn the_predictor_vanishes_and_the_human_has_everything_at_once() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Deadman::Released, None);
    rounds(&mut stage, 3..10, held(1), Some(1.0));
    for n in 10..18 {
        stage.step(at(20 * n), Event::State(state(n, 2, CENTRE)));
        stage.step(at(20 * n + 2), Event::Command(command(n, 2, held(1), HUMAN)));
    }
    insta::assert_snapshot!(stage.told(), @r"
      0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
     22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
     62 ms  (0.090 0.010 0.000) ω=0.10 press 1  ×11
    282 ms  (0.000 0.100 0.000) ω=1.00 press 1  ×4
    ");
    assert_eq!(stage.arbiter.authority(), Authority::Human { press: 1 });
}

#[test]
fn a_second_operator_is_refused_and_counted_while_the_first_drives() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Deadman::Released, None);
    for n in 3..6 {
        round(&mut stage, n, held(1), None);
        let mut other = command(n, 0, held(7), -HUMAN);
        other.header.session = Session(99);
        stage.step(at(20 * n + 3), Event::Command(other));
    }
    insta::assert_snapshot!(stage.told(), @r"
     0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
    22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
    62 ms  (0.000 0.100 0.000) ω=1.00 press 1, refused 2: another operator holds the lease  ×3
    ");
}

#[test]
fn what_is_repeated_reordered_or_unreadable_is_counted_and_changes_nothing() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Deadman::Released, None);
    round(&mut stage, 3, held(1), None);
    stage.step(at(63), Event::Command(command(3, 0, held(2), -HUMAN)));
    stage.step(at(64), Event::Command(command(2, 0, held(2), -HUMAN)));
    stage.step(at(65), Event::State(state(3, 0, CENTRE)));
    stage.step(at(66), Event::Proposal(proposal(1, 0, None)));
    let why = Malformed::NotFinite;
    stage.step(
        at(67),
        Event::Unreadable(Unreadable {
            topic: Topic::Command,
            why,
        }),
    );
    round(&mut stage, 4, held(1), None);
    insta::assert_snapshot!(stage.told(), @r"
     0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
    22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
    62 ms  (0.000 0.100 0.000) ω=1.00 press 1, refused 5: unreadable  ×2
    ");
}

#[test]
fn a_forged_number_at_the_end_of_counting_does_not_silence_the_operator() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Deadman::Released, None);
    round(&mut stage, 3, held(1), None);
    let mut forged = command(3, 0, held(9), -HUMAN);
    forged.header.seq = Seq(u64::MAX);
    stage.step(at(65), Event::Command(forged));
    let mut forged = state(3, u32::MAX, CENTRE);
    forged.header.seq = Seq(4);
    stage.step(at(66), Event::State(forged));
    rounds(&mut stage, 4..10, held(1), None);
    insta::assert_snapshot!(stage.told(), @r"
     0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
    22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
    62 ms  (0.000 0.100 0.000) ω=1.00 press 1, refused 2: numbered further ahead than time allows  ×7
    ");
}

#[test]
fn a_state_that_the_robot_cannot_have_sent_yet_excuses_no_old_command() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Deadman::Released, None);
    rounds(&mut stage, 3..6, held(1), None);
    let mut overtook = command(6, 1, held(1), HUMAN);
    overtook.body.seen = Some(id(ROBOT, 7));
    stage.step(at(115), Event::Command(overtook));
    let mut claims = command(7, 1, held(1), HUMAN);
    claims.body.seen = Some(id(ROBOT, 1000));
    stage.step(at(116), Event::Command(claims));
    rounds(&mut stage, 7..8, held(1), None);
    insta::assert_snapshot!(stage.told(), @r"
     0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
    22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
    62 ms  (0.000 0.100 0.000) ω=1.00 press 1, refused 1: made from a state that is too old  ×5
    ");
}

#[test]
fn without_a_trial_nobody_drives_and_a_press_held_through_its_beginning_does_not_count() {
    let mut stage = real();
    for n in 1..9 {
        let mut idle = state(n, 0, CENTRE);
        idle.body.trial = u32::from(n >= 5);
        stage.step(at(20 * n), Event::State(idle));
        let deadman = if n < 3 { Deadman::Released } else { held(1) };
        stage.step(at(20 * n + 2), Event::Command(command(n, 0, deadman, HUMAN)));
    }
    stage.step(at(180), Event::State(state(9, 0, CENTRE)));
    stage.step(at(182), Event::Command(command(9, 0, held(2), HUMAN)));
    insta::assert_snapshot!(stage.told(), @r"
      0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
     22 ms  (0.000 0.000 0.000) ω=1.00 held: no trial is running  ×4
    102 ms  (0.000 0.000 0.000) ω=1.00 held: waiting for a fresh press of the deadman  ×4
    182 ms  (0.000 0.100 0.000) ω=1.00 press 2
    ");
}

#[test]
fn a_new_trial_forgets_the_guidance_of_the_one_before() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Deadman::Released, None);
    rounds(&mut stage, 3..8, held(1), Some(1.0));
    let mut begun = state(8, 2, CENTRE);
    (begun.body.trial, begun.body.trial_start) = (2, 2);
    stage.step(at(160), Event::State(begun));
    stage.step(at(161), Event::Command(command(8, 2, held(1), HUMAN)));
    insta::assert_snapshot!(stage.told(), @r"
      0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
     22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
     62 ms  (0.090 0.010 0.000) ω=0.10 press 1  ×5
    161 ms  (0.000 0.100 0.000) ω=1.00 press 1
    ");
}

#[test]
fn the_limits_show_in_the_record() {
    let mut stage = real();
    rounds(&mut stage, 1..3, Deadman::Released, None);
    stage.step(at(60), Event::State(state(3, 0, Vec3::new(0.79, 0.0, 0.15))));
    for n in 3..7 {
        stage.step(
            at(20 * n + 2),
            Event::Command(command(n, 0, held(1), Vec3::new(0.6, 0.8, 0.0))),
        );
    }
    insta::assert_snapshot!(stage.told(), @r"
      0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
     22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
     62 ms  (0.100 0.160 0.000) ω=1.00 press 1, limited speed acceleration workspace
     82 ms  (0.100 0.314 0.000) ω=1.00 press 1, limited speed acceleration workspace
    102 ms  (0.100 0.393 0.000) ω=1.00 press 1, limited speed acceleration workspace
    122 ms  (0.100 0.400 0.000) ω=1.00 press 1, limited speed acceleration workspace
    ");
}

/// In lockstep the arbiter answers each tick once, when all three are there, whatever their order.
#[test]
fn in_lockstep_the_order_of_arrival_does_not_matter() {
    let tick = |n: u64| {
        let k = u32::try_from(n - 1).unwrap();
        let deadman = if n < 3 { Deadman::Released } else { held(1) };
        let guidance = (n > 4).then(|| guidance(1.0 + 0.05 * (n % 7) as f64, ROBOT_WANTS));
        [
            Event::State(state(n, k, CENTRE)),
            Event::Command(command(n, k, deadman, HUMAN)),
            Event::Proposal(proposal(n, k, guidance)),
        ]
    };
    let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let run = |order: &dyn Fn(u64) -> [usize; 3]| {
        let mut stage = Stage::new(Timing::default().lockstep(), &ArbiterSettings::default());
        for n in 1..20 {
            let events = tick(n);
            for i in order(n) {
                assert_eq!(stage.setpoints.len() as u64, n - 1);
                stage.step(at(100 * (n - 1)), events[i].clone());
            }
        }
        stage.setpoints
    };
    let expected = run(&|_| orders[0]);
    assert!(
        expected.iter().any(|setpoint| setpoint.body.weight.0 < 1.0),
        "nothing was ever shared"
    );
    for order in orders {
        assert_eq!(run(&|_| order), expected);
    }
    assert_eq!(run(&|n| orders[(n % 6) as usize]), expected);
}

#[test]
fn the_laws_take_effect_only_with_guidance() {
    let mut lines = String::new();
    for law in [LawName::Fixed, LawName::Human, LawName::Robot, LawName::Constant] {
        let settings = ArbiterSettings {
            law,
            constant_weight: 0.3,
            ..ArbiterSettings::default()
        };
        let mut stage = Stage::new(Timing::default(), &settings);
        rounds(&mut stage, 1..3, Deadman::Released, None);
        rounds(&mut stage, 3..5, held(1), None);
        rounds(&mut stage, 5..7, held(1), Some(1.0));
        lines += &format!("{law:?}\n{}", stage.told());
    }
    insta::assert_snapshot!(lines, @r"
    Fixed
         0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
        22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
        62 ms  (0.000 0.100 0.000) ω=1.00 press 1  ×2
       102 ms  (0.050 0.050 0.000) ω=0.50 press 1  ×2
    Human
         0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
        22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
        62 ms  (0.000 0.100 0.000) ω=1.00 press 1  ×4
    Robot
         0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
        22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
        62 ms  (0.000 0.100 0.000) ω=1.00 press 1  ×2
       102 ms  (0.100 0.000 0.000) ω=0.00 press 1  ×2
    Constant
         0 ms  (0.000 0.000 0.000) ω=1.00 held: no command has arrived yet  ×2
        22 ms  (0.000 0.000 0.000) ω=1.00 held: the deadman is released  ×2
        62 ms  (0.000 0.100 0.000) ω=1.00 press 1  ×2
       102 ms  (0.070 0.030 0.000) ω=0.30 press 1  ×2
    ");
}
