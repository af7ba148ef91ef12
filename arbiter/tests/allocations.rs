//! After start-up a step allocates nothing: shown by an allocator that counts.

#![expect(
    unsafe_code,
    reason = "a global allocator cannot be written without it; this one only counts"
)]

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use support::*;
use tandem_arbiter::{Arbiter, ArbiterSettings, Event, Output};
use tandem_wire::{Deadman, Input, Node, Outbox, Ports, Session, Timing, Topic, Vec3, encode};

struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: every call goes to the system's allocator unchanged; the counter is a plain cell of this thread.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `alloc` above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// Everything that happens in five control periods, as bytes and wakes.
fn bytes_of(rounds: std::ops::Range<u64>) -> Vec<(u64, Topic, Vec<u8>)> {
    let mut samples = Vec::new();
    for n in rounds {
        let tick = u32::try_from(n / 5).expect("short");
        let deadman = if n.is_multiple_of(50) {
            Deadman::Released
        } else {
            held(u32::try_from(n / 50).expect("short"))
        };
        let wanted = guidance(1.2, Vec3::new(0.1, 0.0, 0.0));
        let mut of = [Vec::new(), Vec::new(), Vec::new()];
        encode(&state(n, tick, CENTRE), &mut of[0]);
        encode(&proposal(n, tick, Some(wanted)), &mut of[1]);
        encode(&command(n, tick, deadman, Vec3::new(9.0, 0.1, 0.0)), &mut of[2]);
        let topics = [Topic::State, Topic::Proposal, Topic::Command];
        samples.extend(topics.into_iter().zip(of).map(|(topic, bytes)| (n * 20, topic, bytes)));
        samples.push((n * 20, Topic::Command, vec![1, 2, 3]));
    }
    samples
}

#[test]
fn a_step_allocates_nothing_after_start_up() {
    let mut arbiter = Arbiter::new(Session(3), Timing::default(), &ArbiterSettings::default()).unwrap();
    let (mut outbox, mut bytes, mut answers) = (Outbox::default(), Vec::with_capacity(1024), 0);
    let samples = bytes_of(1..400);
    let before = ALLOCATIONS.with(Cell::get);
    let mut step = |millis, input| {
        arbiter.step(at(millis), Arbiter::event(input), &mut outbox);
        for output in outbox.drain() {
            let Output::Setpoint(setpoint) = output;
            answers += u32::from(setpoint.body.motion.is_permitted());
            Arbiter::sample(&output, &mut bytes);
        }
    };
    for (millis, topic, bytes) in &samples {
        step(*millis, Input::Sample { topic: *topic, bytes });
    }
    for millis in 8_000..9_000 {
        step(millis, Input::Wake);
    }
    step(9_000, Input::Stop);
    assert_eq!(ALLOCATIONS.with(Cell::get) - before, 0);
    assert!(answers > 300, "the robot hardly moved: {answers}");
    assert!(matches!(Arbiter::event(Input::Wake), Event::Wake));
}
