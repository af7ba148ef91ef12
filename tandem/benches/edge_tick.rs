//! What one whole tick costs at the edge, without the network: bytes of a command in, through predictor, arbiter and
//! robot-sim with every message encoded and decoded between them, bytes of the next state out.

use criterion::{Criterion, criterion_group, criterion_main};
use tandem_arbiter::{Arbiter, ArbiterSettings};
use tandem_cesn::{Demonstration, Model, Settings};
use tandem_operator::{HumanSettings, Operator, OperatorSettings};
use tandem_predictor::{Predictor, PredictorSettings};
use tandem_robot_sim::{RobotSim, RobotSimSettings};
use tandem_wire::{
    Envelope, Header, Input, Node, Outbox, Ports, Seq, Session, Stamp, State, TaskFrame, Timing, Topic, Trial, decode,
    encode,
};

const SESSION: Session = Session(1);

/// A node with what its shell would keep for it.
struct Seat<N: Node> {
    node: N,
    outbox: Outbox<N::Output>,
    bytes: Vec<u8>,
}

impl<N: Ports> Seat<N> {
    fn new(node: N) -> Self {
        Self {
            node,
            outbox: Outbox::default(),
            bytes: Vec::with_capacity(4096),
        }
    }

    /// Hands over a sample and copies the answer on `wanted`, if there is one, to `out`.
    fn pass(&mut self, now: Stamp, topic: Topic, sample: &[u8], wanted: Topic, out: &mut Vec<u8>) {
        self.node
            .step(now, N::event(Input::Sample { topic, bytes: sample }), &mut self.outbox);
        for output in self.outbox.drain() {
            if N::sample(&output, &mut self.bytes) == Some(wanted) {
                out.clear();
                out.extend_from_slice(&self.bytes);
            }
        }
    }
}

/// The loop in lockstep, at some tick.
struct Loop {
    operator: Seat<Operator>,
    predictor: Seat<Predictor>,
    arbiter: Seat<Arbiter>,
    robot: Seat<RobotSim>,
    timing: Timing,
    tick: u32,
    state: Vec<u8>,
    command: Vec<u8>,
    proposal: Vec<u8>,
    setpoint: Vec<u8>,
}

impl Loop {
    fn new(model: Model) -> Self {
        let timing = Timing::default().lockstep();
        let frame = TaskFrame::default();
        let robot = RobotSim::new(SESSION, timing, &RobotSimSettings::default()).expect("the shipped scene");
        let mut this = Self {
            operator: Seat::new(Operator::new(
                SESSION,
                timing,
                frame,
                1,
                &OperatorSettings::default(),
                &HumanSettings::default(),
            )),
            predictor: Seat::new(
                Predictor::new(SESSION, timing, frame, model, &PredictorSettings::default())
                    .expect("the shipped model"),
            ),
            arbiter: Seat::new(
                Arbiter::new(SESSION, timing, &ArbiterSettings::default()).expect("the shipped workspace"),
            ),
            robot: Seat::new(robot),
            timing,
            tick: 0,
            state: Vec::new(),
            command: Vec::new(),
            proposal: Vec::new(),
            setpoint: Vec::new(),
        };
        let header = Header {
            tick: 0,
            session: Session(2),
            seq: Seq(1),
            sent: Stamp(0),
        };
        let mut begin = Vec::new();
        encode(
            &Envelope {
                header,
                body: Trial::Begin {
                    number: 1,
                    label: String::new(),
                },
            },
            &mut begin,
        );
        this.robot
            .pass(Stamp(0), Topic::Trial, &begin, Topic::State, &mut this.state);
        this
    }

    fn operate(&mut self) {
        let now = Stamp::of_tick(self.tick, self.timing.period);
        self.operator
            .pass(now, Topic::State, &self.state, Topic::Command, &mut self.command);
    }

    /// What happens at the edge once the command is there.
    fn edge(&mut self) {
        let now = Stamp::of_tick(self.tick, self.timing.period);
        let (arbiter, out) = (&mut self.arbiter, &mut self.setpoint);
        self.predictor
            .pass(now, Topic::State, &self.state, Topic::Proposal, &mut self.proposal);
        arbiter.pass(now, Topic::State, &self.state, Topic::Setpoint, out);
        arbiter.pass(now, Topic::Command, &self.command, Topic::Setpoint, out);
        arbiter.pass(now, Topic::Proposal, &self.proposal, Topic::Setpoint, out);
        self.robot
            .pass(now, Topic::Setpoint, &self.setpoint, Topic::State, &mut self.state);
        self.tick += 1;
    }
}

fn model() -> Model {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/demonstrations");
    let read = |name: &str| {
        let text = std::fs::read_to_string(format!("{folder}/{name}")).expect("a shipped demonstration");
        Demonstration::from_csv(name, &text).expect("a shipped demonstration")
    };
    let demonstrations = ["planar_a08.csv", "planar_a11.csv", "planar_a14.csv"].map(read);
    Model::train(&demonstrations, &Settings::default()).expect("the shipped demonstrations train")
}

fn benches(criterion: &mut Criterion) {
    let model = model();
    criterion.bench_function("edge: one trial of 80 ticks, per trial", |bencher| {
        bencher.iter_batched(
            || Loop::new(model.clone()),
            |mut looped| {
                for _ in 0..80 {
                    looped.operate();
                    looped.edge();
                }
                looped
            },
            criterion::BatchSize::LargeInput,
        );
    });
    criterion.bench_function("edge: 20 ticks under shared control", |bencher| {
        bencher.iter_batched(
            || shared(model.clone()),
            |mut looped| {
                for _ in 0..20 {
                    looped.operate();
                    looped.edge();
                }
                looped
            },
            criterion::BatchSize::LargeInput,
        );
    });
}

/// The loop twelve ticks after the checkpoint or so, where human and robot share the command and the arm moves.
fn shared(model: Model) -> Loop {
    let mut looped = Loop::new(model);
    for _ in 0..55 {
        looped.operate();
        looped.edge();
    }
    let state = decode::<State>(&looped.state).expect("a state").body;
    let setpoint = state.obeys.expect("a setpoint").setpoint;
    assert!(setpoint.guidance.is_some() && setpoint.motion.is_permitted() && !state.at_rest);
    looped
}

criterion_group!(edge, benches);
criterion_main!(edge);
