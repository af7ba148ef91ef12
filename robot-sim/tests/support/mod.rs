//! A stage for the robot: scripted setpoints in, everything it says out.

#![allow(
    dead_code,
    unreachable_pub,
    clippy::unwrap_used,
    reason = "each test file uses its part of the stage; a helper of tests may fail like a test"
)]

use std::fmt::Write as _;

use tandem_robot_sim::{Event, Output, RobotSim, RobotSimSettings};
use tandem_wire::{
    Envelope, Finite, Header, Law, Limited, MILLISECOND, MessageId, Motion, Node, Outbox, Pace, Reason, Refusals,
    Scene, Seq, Session, Setpoint, Stamp, State, Timing, Trial, Vec3,
};

pub const ROBOT: Session = Session(7);
pub const ARBITER: Session = Session(3);
pub const RELEASED: Motion = Motion::Held(Reason::DeadmanReleased);

pub fn at(millis: u64) -> Stamp {
    Stamp(millis * MILLISECOND)
}

pub fn pressed(press: u32) -> Motion {
    Motion::Permitted { press }
}

pub fn seen(seq: u64) -> Option<MessageId> {
    Some(MessageId {
        session: ROBOT,
        seq: Seq(seq),
    })
}

pub fn setpoint(seq: u64, tick: u32, motion: Motion, velocity: Vec3, seen: Option<MessageId>) -> Envelope<Setpoint> {
    let header = Header {
        tick,
        session: ARBITER,
        seq: Seq(seq),
        sent: Stamp(0),
    };
    let body = Setpoint {
        velocity,
        motion,
        lease: Some(tandem_wire::Lease {
            number: 1,
            ..tandem_wire::Lease::default()
        }),
        asks: None,
        law: Law::Human,
        weight: Finite(1.0),
        human: velocity,
        guidance: None,
        blended: velocity,
        limited: Limited::default(),
        command: None,
        proposal: None,
        seen,
        refused: Refusals::default(),
    };
    Envelope { header, body }
}

pub fn begin(number: u32) -> Event {
    trial(Trial::Begin {
        number,
        label: "a trial".into(),
    })
}

pub fn end(number: u32) -> Event {
    trial(Trial::End {
        number,
        outcome: "done".into(),
    })
}

fn trial(body: Trial) -> Event {
    Event::Trial(Envelope {
        header: Header {
            session: Session(9),
            ..Header::default()
        },
        body,
    })
}

/// The robot, its clock, and what it said.
pub struct Stage {
    pub robot: RobotSim,
    pub now: Stamp,
    pub states: Vec<Envelope<State>>,
    pub scenes: Vec<Envelope<Scene>>,
    outbox: Outbox<Output>,
    sent: u64,
    pace: Pace,
}

impl Stage {
    pub fn new(timing: Timing, settings: &RobotSimSettings) -> Self {
        Self {
            robot: RobotSim::new(ROBOT, timing, settings).unwrap(),
            now: Stamp(0),
            states: Vec::new(),
            scenes: Vec::new(),
            outbox: Outbox::default(),
            sent: 0,
            pace: timing.pace,
        }
    }

    /// In real time, with the first trial begun.
    pub fn real() -> Self {
        Self::real_with(&RobotSimSettings::default())
    }

    pub fn real_with(settings: &RobotSimSettings) -> Self {
        let mut stage = Self::new(Timing::default(), settings);
        stage.step(begin(1));
        stage
    }

    pub fn lockstep() -> Self {
        Self::new(Timing::default().lockstep(), &RobotSimSettings::default())
    }

    pub fn step(&mut self, event: Event) {
        self.robot.step(self.now, event, &mut self.outbox);
        for output in self.outbox.drain() {
            match output {
                Output::State(state) => self.states.push(state),
                Output::Scene(scene) => {
                    self.scenes.push(Envelope {
                        header: scene.header,
                        body: Scene::clone(&scene.body),
                    });
                }
            }
        }
    }

    /// Lets time pass until `then`, waking the robot whenever it asks for it.
    pub fn pass(&mut self, then: Stamp) {
        while let Some(due) = self.robot.deadline().filter(|due| *due <= then) {
            self.now = due.max(self.now);
            self.step(Event::Wake);
        }
        self.now = then;
    }

    /// The next setpoint, made from the newest state.
    pub fn send(&mut self, motion: Motion, velocity: Vec3) {
        self.sent += 1;
        let newest = self.states.last().map(|state| state.header);
        let tick = newest.map_or(0, |header| header.tick);
        self.step(Event::Setpoint(setpoint(
            self.sent,
            tick,
            motion,
            velocity,
            newest.map(|header| header.id()),
        )));
        if self.pace == Pace::Lockstep {
            self.now = self.state().header.sent;
        }
    }

    /// A stream of setpoints in real time: one every 20 ms, 2 ms after the state that it answers.
    pub fn stream(&mut self, until: Stamp, motion: Motion, velocity: Vec3) {
        while self.now < until {
            let next = Stamp((self.now.0 / (20 * MILLISECOND) + 1) * 20 * MILLISECOND);
            self.pass(next.after(2 * MILLISECOND));
            self.send(motion, velocity);
        }
    }

    pub fn state(&self) -> &Envelope<State> {
        self.states.last().expect("a state was published")
    }

    pub fn tool(&self) -> Vec3 {
        self.state().body.tool.position
    }

    /// All states, one line for each stretch in which the robot says the same of itself.
    pub fn told(&self) -> String {
        let mut text = String::new();
        let mut last = String::new();
        for state in &self.states {
            let line = summary(&state.body);
            if line != last {
                writeln!(
                    text,
                    "{:>6.0} ms  tick {:>2}  {line}",
                    state.header.sent.seconds() * 1e3,
                    state.header.tick
                )
                .unwrap();
                last = line;
            }
        }
        text
    }

    /// All states, a line for each `nth`.
    pub fn told_in_full(&self, nth: usize) -> String {
        let mut text = String::new();
        for state in self.states.iter().step_by(nth) {
            let (body, tool) = (&state.body, state.body.tool.position);
            let near = body.closest.map_or(f64::NAN, |closest| closest.distance.0);
            write!(
                text,
                "{:>6.0} ms  tick {:>2}  ",
                state.header.sent.seconds() * 1e3,
                state.header.tick
            )
            .unwrap();
            write!(
                text,
                "({:.4} {:.4} {:.4})  {:.3} m/s  ",
                tool.x,
                tool.y,
                tool.z,
                body.tool_velocity.norm()
            )
            .unwrap();
            writeln!(text, "nearest {near:.4}  {}", summary(body)).unwrap();
        }
        text
    }
}

fn summary(state: &State) -> String {
    let motion = match state.motion {
        Motion::Permitted { press } => format!("press {press}"),
        Motion::Held(reason) => format!("held: {reason}"),
    };
    let rest = if state.at_rest { ", at rest" } else { "" };
    let refused = match state.refused.last {
        Some(why) => format!(", refused {} ({why})", state.refused.count),
        None => String::new(),
    };
    format!("trial {} {motion}{rest}{refused}", state.trial)
}
