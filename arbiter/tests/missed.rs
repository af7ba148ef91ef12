//! Lockstep over a bad line: what does not come in its tick, by virtual time.

mod support;

use support::*;
use tandem_arbiter::{ArbiterSettings, Event};
use tandem_wire::{Deadman, Node, Reason, Seq, Setpoint, Timing, Topic, Vec3};

const HUMAN: Vec3 = Vec3::new(0.0, 0.1, 0.0);
const RELEASED: Deadman = Deadman::Released;

fn lockstep() -> Stage {
    Stage::new(Timing::default().lockstep(), &ArbiterSettings::default())
}

/// The state, the proposal and perhaps the command of a tick; its setpoint.
fn tick(stage: &mut Stage, k: u32, deadman: Option<Deadman>) -> Setpoint {
    let (now, n) = (at(100 * u64::from(k)), u64::from(k) + 1);
    stage.step(now, Event::State(state(n, k, CENTRE)));
    stage.step(now, Event::Proposal(proposal(n, k, None)));
    let topic = Topic::Command;
    stage.step(
        now,
        match deadman {
            Some(deadman) => Event::Command(command(n, k, deadman, HUMAN)),
            None => Event::Missed { topic, tick: k },
        },
    );
    let setpoint = stage.setpoints.last().expect("every tick is answered");
    assert_eq!(setpoint.header.tick, k);
    setpoint.body
}

#[test]
fn nothing_wakes_it_and_a_tick_is_answered_once_all_three_are_there() {
    let mut stage = lockstep();
    assert_eq!(stage.arbiter.deadline(), None);
    stage.step(at(0), Event::Command(command(1, 0, RELEASED, HUMAN)));
    stage.step(at(0), Event::State(state(1, 0, CENTRE)));
    assert!(stage.setpoints.is_empty());
    stage.step(at(0), Event::Proposal(proposal(1, 0, None)));
    let setpoint = stage.setpoints[0].body;
    assert_eq!(setpoint.motion.reason(), Some(Reason::DeadmanReleased));
    assert_eq!(setpoint.command.map(|used| used.id.seq), Some(Seq(1)));
    assert_eq!(stage.arbiter.deadline(), None);
}

#[test]
fn a_tick_without_its_command_goes_on_with_the_one_before_until_that_is_too_old() {
    let mut stage = lockstep();
    tick(&mut stage, 0, Some(RELEASED));
    assert!(tick(&mut stage, 1, Some(held(1))).motion.is_permitted());
    for missed in 2..=3 {
        let setpoint = tick(&mut stage, missed, None);
        assert!(setpoint.motion.is_permitted());
        assert_eq!(setpoint.command.map(|used| used.id.seq), Some(Seq(2)));
    }
    let lost = tick(&mut stage, 4, None);
    assert_eq!(lost.motion.reason(), Some(Reason::CommandLost { silent: 300_000_000 }));
    let back = tick(&mut stage, 5, Some(held(1)));
    assert_eq!(back.motion.reason(), Some(Reason::AwaitingPress));
    assert!(tick(&mut stage, 6, Some(held(2))).motion.is_permitted());
}

#[test]
fn a_holder_that_is_missed_for_too_long_loses_the_lease_by_virtual_time() {
    let mut stage = lockstep();
    tick(&mut stage, 0, Some(RELEASED));
    assert_eq!(
        tick(&mut stage, 1, Some(held(1))).lease.map(|lease| lease.number),
        Some(1)
    );
    // The lease lasts two seconds, and no longer.
    let mut lease = (2..=21).map(|missed| tick(&mut stage, missed, None).lease);
    assert!(lease.all(|lease| lease.is_some()));
    assert_eq!(tick(&mut stage, 22, None).lease, None);
    let held_on = tick(&mut stage, 23, Some(held(1)));
    assert!(held_on.lease.is_none() && !held_on.motion.is_permitted());
    tick(&mut stage, 24, Some(RELEASED));
    let pressed = tick(&mut stage, 25, Some(held(2)));
    assert_eq!(pressed.lease.map(|lease| lease.number), Some(2));
    assert!(pressed.motion.is_permitted());
}

#[test]
fn an_emergency_stop_holds_in_ticks_without_a_command_too() {
    let mut stage = lockstep();
    tick(&mut stage, 0, Some(RELEASED));
    tick(&mut stage, 1, Some(held(1)));
    stage.step(at(150), Event::Emergency(emergency(1, None)));
    let missed = tick(&mut stage, 2, None);
    assert!(
        matches!(missed.motion.reason(), Some(Reason::EmergencyStop { .. })),
        "{missed:?}"
    );
}
