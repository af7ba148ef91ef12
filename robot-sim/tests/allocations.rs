//! After start-up a step allocates nothing: shown by an allocator that counts.

#![expect(
    unsafe_code,
    reason = "a global allocator cannot be written without it; this one only counts"
)]

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use support::*;
use tandem_robot_sim::{Event, Output, RobotSim, RobotSimSettings};
use tandem_wire::{Header, MILLISECOND, Node, Outbox, Pace, Stamp, Timing, Vec3};

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call goes to the system's allocator unchanged; the counter belongs to this thread alone.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: what the caller promises about the layout is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `alloc` above, with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// Steps for `rounds` control or stream periods with presses, releases and silences; returns how often it allocated.
fn allocations(robot: &mut RobotSim, timing: Timing, rounds: u64) -> u64 {
    let (mut outbox, mut newest, mut moved) = (Outbox::default(), None, false);
    robot.step(Stamp(0), begin(1), &mut outbox);
    let before = ALLOCATIONS.get();
    for round in 0..rounds {
        newest = newest_of(&mut outbox).or(newest);
        let now = Stamp(round * timing.message_period());
        robot.step(now, Event::Wake, &mut outbox);
        let motion = if round % 50 < 5 {
            RELEASED
        } else {
            pressed(u32::try_from(round / 50).expect("few rounds"))
        };
        let velocity = Vec3::new(0.0, if round % 100 < 50 { 0.3 } else { -0.3 }, 0.0);
        newest = newest_of(&mut outbox).or(newest);
        let (tick, echo) = newest.map_or((0, None), |header| (header.tick, Some(header.id())));
        if round % 50 < 40 || timing.pace == Pace::Lockstep {
            let event = Event::Setpoint(setpoint(round + 1, tick, motion, velocity, echo));
            robot.step(now.after(2 * MILLISECOND), event, &mut outbox);
        }
        moved |= robot.motion().is_permitted() && !robot.arm().is_at_rest();
    }
    let during = ALLOCATIONS.get() - before;
    assert!(moved, "a robot that stands still proves nothing");
    during
}

fn newest_of(outbox: &mut Outbox<Output>) -> Option<Header> {
    outbox.drain().fold(None, |newest, output| match output {
        Output::State(state) => Some(state.header),
        Output::Scene(_) => newest,
    })
}

#[test]
fn a_step_allocates_nothing_at_either_pace() {
    for timing in [Timing::default(), Timing::default().lockstep()] {
        let mut robot = RobotSim::new(ROBOT, timing, &RobotSimSettings::default()).unwrap();
        assert_eq!(allocations(&mut robot, timing, 500), 0);
    }
}
