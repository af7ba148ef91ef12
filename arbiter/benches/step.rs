//! What one decision costs, from the command's bytes to the setpoint's. Target: 5 µs.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use tandem_arbiter::{Arbiter, ArbiterSettings, Event};
use tandem_wire::{
    Command, Deadman, Envelope, Finite, Guidance, Header, Input, MILLISECOND, MessageId, Motion, Node, Outbox, Ports,
    Pose, Proposal, Reason, Refusals, Seq, Session, Stamp, State, Timing, Topic, Vec3, encode,
};

const SEEN: MessageId = MessageId {
    session: Session(4),
    seq: Seq(1),
};

fn header(session: u64, seq: u64) -> Header {
    Header {
        tick: 1,
        session: Session(session),
        seq: Seq(seq),
        sent: Stamp(0),
    }
}

fn command(seq: u64, deadman: Deadman) -> Envelope<Command> {
    let body = Command {
        velocity: Vec3::new(0.1, 0.05, 0.0),
        deadman,
        seen: Some(SEEN),
    };
    Envelope {
        header: header(1, seq),
        body,
    }
}

fn state() -> Envelope<State> {
    let tool = Pose {
        position: Vec3::new(0.5, 0.0, 0.15),
        ..Pose::default()
    };
    let body = State {
        trial: 1,
        trial_start: 0,
        joints: Default::default(),
        joint_velocities: Default::default(),
        links: Default::default(),
        tool,
        tool_velocity: Vec3::ZERO,
        clearance: None,
        closest: None,
        motion: Motion::Held(Reason::NoSetpointYet),
        at_rest: true,
        obeys: None,
        arrivals: None,
        refused: Refusals::default(),
    };
    Envelope {
        header: header(4, 1),
        body,
    }
}

fn proposal() -> Envelope<Proposal> {
    let guidance = Guidance {
        velocity: Vec3::new(0.1, 0.0, 0.0),
        ratio: Finite(1.2),
        ratio_high: Finite(1.5),
        ..Guidance::default()
    };
    let body = Proposal {
        seen: Some(SEEN),
        guidance: Some(guidance),
    };
    Envelope {
        header: header(2, 1),
        body,
    }
}

/// An arbiter that shares the command with a forecast.
fn sharing(outbox: &mut Outbox<<Arbiter as Node>::Output>) -> Arbiter {
    let mut arbiter = Arbiter::new(Session(3), Timing::default(), &ArbiterSettings::default())
        .expect("the defaults make a workspace");
    for event in [
        Event::State(state()),
        Event::Proposal(proposal()),
        Event::Command(command(1, Deadman::Released)),
        Event::Command(command(2, Deadman::Held { press: 1 })),
    ] {
        arbiter.step(Stamp(MILLISECOND), event, outbox);
    }
    outbox.drain().for_each(drop);
    arbiter
}

fn one_command(c: &mut Criterion) {
    let mut outbox = Outbox::default();
    let mut arbiter = sharing(&mut outbox);
    let (mut seq, mut incoming, mut outgoing) = (2, Vec::new(), Vec::new());
    encode(&command(3, Deadman::Held { press: 1 }), &mut incoming);
    c.bench_function("arbiter: command bytes → step → setpoint bytes", |b| {
        b.iter(|| {
            seq += 1;
            incoming[16..24].copy_from_slice(&u64::to_le_bytes(seq));
            let input = Input::Sample {
                topic: Topic::Command,
                bytes: black_box(&incoming),
            };
            arbiter.step(Stamp(2 * MILLISECOND), Arbiter::event(input), &mut outbox);
            for output in outbox.drain() {
                Arbiter::sample(&output, &mut outgoing);
            }
            black_box(outgoing.len())
        });
    });
}

criterion_group!(benches, one_command);
criterion_main!(benches);
