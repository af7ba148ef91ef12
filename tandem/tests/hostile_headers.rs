//! Ticks, sequence numbers, sessions and stamps from the ends of their ranges, in any order, at every node.

#![allow(clippy::unwrap_used, reason = "a helper of tests may fail like a test")]

use std::sync::Arc;

use tandem_arbiter::{Arbiter, ArbiterSettings};
use tandem_cesn::{Demonstration, Model, Settings};
use tandem_operator::{HumanSettings, Operator, OperatorSettings};
use tandem_predictor::{Predictor, PredictorSettings};
use tandem_robot_sim::{RobotSim, RobotSimSettings};
use tandem_wire::{
    Command, Deadman, Envelope, Finite, Guidance, Header, Input, Law, Limited, Message, MessageId, Motion, Node,
    Outbox, Ports, Proposal, Refusals, Seq, Session, Setpoint, Stamp, State, TaskFrame, Timing, Topic, Trial, Vec3,
    decode, encode,
};

const LIVES: u64 = 40;
const EVENTS: u32 = 120;

/// Numbers that a generator with a fixed seed picks from.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, sides: u64) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % sides
    }

    fn word(&mut self, usual: u64) -> u64 {
        [usual, usual, usual, usual + 1, 0, 1, u64::MAX - 1, u64::MAX][usize::try_from(self.roll(8)).unwrap()]
    }

    fn half(&mut self, usual: u32) -> u32 {
        [usual, usual, usual, usual + 1, 0, 1, u32::MAX - 1, u32::MAX][usize::try_from(self.roll(8)).unwrap()]
    }

    fn number(&mut self) -> f64 {
        [0.0, -0.3, 0.5, 1e308, -1e308, 5e-324][usize::try_from(self.roll(6)).unwrap()]
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.number(), self.number(), self.number())
    }

    fn deadman(&mut self, usual: u32) -> Deadman {
        match self.roll(3) {
            0 => Deadman::Released,
            _ => Deadman::Held {
                press: self.half(usual),
            },
        }
    }

    fn seen(&mut self, usual: u64) -> Option<MessageId> {
        (self.roll(5) > 0).then(|| MessageId {
            session: Session(self.roll(2)),
            seq: Seq(self.word(usual)),
        })
    }

    fn guidance(&mut self) -> Guidance {
        Guidance {
            forecast: self.half(1),
            phase: Finite(self.number()),
            last_step: self.half(83),
            velocity: self.vector(),
            position: self.vector(),
            half_width: self.vector(),
            ratio: Finite(self.number()),
            ratio_high: Finite(self.number()),
        }
    }

    fn bytes(&mut self, usual: u32, body: impl Message) -> Vec<u8> {
        let header = Header {
            tick: self.half(usual),
            session: Session(self.roll(2)),
            seq: Seq(self.word(u64::from(usual))),
            sent: Stamp(self.word(u64::from(usual))),
        };
        let mut bytes = Vec::new();
        encode(&Envelope { header, body }, &mut bytes);
        bytes
    }

    fn sample(&mut self, topic: Topic, usual: u32, real: &State) -> Vec<u8> {
        match topic {
            Topic::Command => {
                let (velocity, deadman, seen) = (self.vector(), self.deadman(usual), self.seen(u64::from(usual)));
                self.bytes(
                    usual,
                    Command {
                        velocity,
                        deadman,
                        seen,
                    },
                )
            }
            Topic::Proposal => {
                let (seen, guidance) = (self.seen(u64::from(usual)), Some(self.guidance()));
                self.bytes(usual, Proposal { seen, guidance })
            }
            Topic::Trial => {
                let begin = Trial::Begin {
                    number: self.half(usual),
                    label: String::new(),
                };
                self.bytes(usual, begin)
            }
            Topic::Setpoint => {
                let setpoint = self.setpoint(usual);
                self.bytes(usual, setpoint)
            }
            _ => {
                let mut state = *real;
                (state.trial, state.trial_start) = (self.half(1), self.half(1));
                state.tool.position = self.vector();
                state.motion = Motion::Permitted {
                    press: self.half(usual),
                };
                self.bytes(usual, state)
            }
        }
    }

    fn setpoint(&mut self, usual: u32) -> Setpoint {
        Setpoint {
            velocity: self.vector(),
            motion: Motion::Permitted {
                press: self.half(usual),
            },
            lease: None,
            asks: None,
            law: Law::Adaptive,
            weight: Finite(self.number()),
            human: self.vector(),
            guidance: Some(self.guidance()),
            blended: self.vector(),
            limited: Limited::default(),
            command: None,
            proposal: None,
            seen: self.seen(u64::from(usual)),
            refused: Refusals::default(),
        }
    }
}

/// Everything that a node publishes can be read by whoever gets it: above all, its numbers are finite.
fn assert_readable(topic: Topic, bytes: &[u8]) {
    let read = match topic {
        Topic::Command => decode::<Command>(bytes).map(drop),
        Topic::Proposal => decode::<Proposal>(bytes).map(drop),
        Topic::Setpoint => decode::<Setpoint>(bytes).map(drop),
        Topic::State => decode::<State>(bytes).map(drop),
        _ => Ok(()),
    };
    assert_eq!(read, Ok(()), "{topic}");
}

/// Many short lives: in a long one the last sequence number there is comes soon, and then nothing else is admitted.
fn torment<N: Ports>(make: impl Fn() -> N, real: &State) {
    for seed in 0..LIVES {
        let (mut node, mut dice, mut now) = (make(), Dice(seed), Stamp(0));
        let (mut outbox, mut bytes) = (Outbox::default(), Vec::new());
        for usual in 1..EVENTS {
            // The last steps are at the end of time.
            now = if usual + 5 > EVENTS {
                Stamp(u64::MAX)
            } else {
                now.after(dice.roll(60_000_000))
            };
            let topic = N::INPUTS[usize::try_from(dice.roll(N::INPUTS.len() as u64)).unwrap()];
            let sample = dice.sample(topic, usual, real);
            let input = match dice.roll(4) {
                0 => Input::Wake,
                _ => Input::Sample { topic, bytes: &sample },
            };
            node.step(now, N::event(input), &mut outbox);
            let _ = node.deadline();
            for output in outbox.drain() {
                if let Some(topic) = N::sample(&output, &mut bytes) {
                    assert_readable(topic, &bytes);
                }
            }
        }
    }
}

fn robot(timing: Timing) -> RobotSim {
    RobotSim::new(Session(1), timing, &RobotSimSettings::default()).expect("the shipped scene")
}

fn a_real_state() -> State {
    let (mut robot, mut outbox) = (robot(Timing::default()), Outbox::default());
    robot.step(Stamp(0), tandem_robot_sim::Event::Wake, &mut outbox);
    let states = outbox.drain().find_map(|output| match output {
        tandem_robot_sim::Output::State(state) => Some(state.body),
        tandem_robot_sim::Output::Scene(_) => None,
    });
    states.expect("the robot speaks first")
}

fn model() -> Model {
    let texts = [
        include_str!("../../examples/demonstrations/planar_a08.csv"),
        include_str!("../../examples/demonstrations/planar_a14.csv"),
    ];
    let demonstrations = texts.map(|text| Demonstration::from_csv("planar", text).expect("a demonstration"));
    let settings = Settings {
        units: 40,
        ..Settings::default()
    };
    Model::train(&demonstrations, &settings).expect("a model")
}

#[test]
fn no_header_makes_a_node_panic_or_publish_what_cannot_be_read() {
    let (real, frame) = (a_real_state(), TaskFrame::default());
    let (model, operator, human) = (Arc::new(model()), OperatorSettings::default(), HumanSettings::default());
    for timing in [Timing::default(), Timing::default().lockstep()] {
        torment(|| robot(timing), &real);
        torment(
            || Arbiter::new(Session(1), timing, &ArbiterSettings::default()).expect("the shipped workspace"),
            &real,
        );
        torment(
            || {
                let (model, settings) = (Arc::clone(&model), PredictorSettings::default());
                Predictor::new(Session(1), timing, frame, model, &settings).expect("a model of the plane")
            },
            &real,
        );
        torment(|| Operator::new(Session(1), timing, frame, 1, &operator, &human), &real);
    }
}
