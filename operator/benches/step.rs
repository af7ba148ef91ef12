//! What one step costs.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use tandem_operator::{HumanKind, HumanSettings, Operator, OperatorSettings, Output};
use tandem_wire::{
    Envelope, Finite, Header, Input, LINKS, Motion, Node, Outbox, Ports, Pose, Refusals, Seq, Session, Stamp, State,
    TaskFrame, Timing, Topic, Vec3, encode,
};

/// The state of one tick: trial 1, tool at the start, moving.
fn state(tick: u32) -> Vec<u8> {
    let tool = Pose {
        position: TaskFrame::default().to_base([0.0; 2]),
        ..Pose::default()
    };
    let state = State {
        trial: 1,
        trial_start: 0,
        joints: [Finite(0.0); 7],
        joint_velocities: [Finite(0.0); 7],
        links: [Pose::default(); LINKS],
        tool,
        tool_velocity: Vec3::ZERO,
        clearance: None,
        closest: None,
        motion: Motion::Permitted { press: 1 },
        at_rest: false,
        obeys: None,
        arrivals: None,
        refused: Refusals::default(),
    };
    let header = Header {
        tick,
        session: Session(1),
        seq: Seq(u64::from(tick) + 1),
        sent: Stamp(0),
    };
    let mut bytes = Vec::new();
    encode(&Envelope { header, body: state }, &mut bytes);
    bytes
}

/// One control period at the edge: decode the state, step, encode the answer.
fn tick(operator: &mut Operator, now: Stamp, state: &[u8], outbox: &mut Outbox<Output>, bytes: &mut Vec<u8>) -> usize {
    let event = Operator::event(Input::Sample {
        topic: Topic::State,
        bytes: state,
    });
    operator.step(now, event, outbox);
    outbox
        .drain()
        .filter_map(|output| Operator::sample(&output, bytes))
        .count()
}

fn step(criterion: &mut Criterion) {
    let timing = Timing::default().lockstep();
    let states: Vec<_> = (0..50).map(state).collect();
    for kind in [HumanKind::Pursuit, HumanKind::Compensating] {
        let human = HumanSettings {
            kind,
            ..HumanSettings::default()
        };
        let fresh = || {
            let settings = OperatorSettings::default();
            let mut operator = Operator::new(Session(1), timing, TaskFrame::default(), 1, &settings, &human);
            let mut outbox = Outbox::default();
            for state in &states[..10] {
                tick(&mut operator, Stamp(0), state, &mut outbox, &mut Vec::new());
            }
            operator
        };
        let (mut outbox, mut bytes) = (Outbox::default(), Vec::with_capacity(256));
        criterion.bench_function(&format!("40 ticks with codec, {kind:?}"), |bencher| {
            bencher.iter_batched_ref(
                fresh,
                |operator| {
                    let ticks = states[10..].iter();
                    ticks
                        .map(|state| tick(operator, Stamp(0), state, &mut outbox, &mut bytes))
                        .sum::<usize>()
                },
                BatchSize::SmallInput,
            );
        });
    }
}

criterion_group!(benches, step);
criterion_main!(benches);
