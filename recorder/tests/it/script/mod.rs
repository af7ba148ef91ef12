//! A session written down by hand: what five nodes would say of one trial of the planar task, message by message.
//!
//! The human drives alone to the checkpoint, then shares with the robot; at tick 62 the operator's commands stop for
//! six ticks. The arm is a sketch of two links, right enough to look at.

#![allow(dead_code, reason = "every test uses another part")]

pub(crate) mod mixture;
use tandem_recorder::{Output, Recorder};
use tandem_wire::{
    Aabb, Body, Clearance, Command, Cylinder, Deadman, Envelope, Finite, Forecast, ForecastPoint, Guidance, Happening,
    Input, JournalBatch, JournalEntry, LINKS, Law, Limited, Message, MessageId, Motion, Node, NodeInfo, NodeName,
    Numbering, Obeyed, Outbox, Ports, Pose, Proposal, Reason, Refusals, Scene, Seq, Session, Setpoint, Stamp, State,
    TaskFrame, Timing, Topic, Trial, Used, Vec3, encode,
};

pub(crate) const PERIOD: u64 = 100_000_000;
pub(crate) const STEPS: u32 = 84;
const CHECKPOINT: u32 = 41;
/// The frame behind the links is the tool's.
const TOOL_FRAME: u8 = 8;
const _: () = assert!(TOOL_FRAME as usize == LINKS);
const SILENCE: std::ops::Range<u32> = 62..68;

/// One sample as it travels, and when it arrives.
#[derive(Clone)]
pub(crate) struct Sample {
    pub(crate) at: Stamp,
    pub(crate) topic: Topic,
    pub(crate) bytes: Vec<u8>,
}

/// The whole session.
pub(crate) fn session() -> Vec<Sample> {
    let mut script = Script::default();
    script.begin();
    for tick in 0..STEPS {
        script.tick(tick);
    }
    script.end();
    script.samples.sort_by_key(|sample| sample.at);
    script.samples
}

/// Feeds the samples to a recorder and collects its outputs, the final counts included.
pub(crate) fn record(samples: &[Sample], timing: Timing) -> Vec<Output> {
    let mut recorder = Recorder::new(timing);
    let (mut outbox, mut outputs) = (Outbox::default(), Vec::new());
    let mut last = Stamp(0);
    for Sample { at, topic, bytes } in samples {
        let event = Recorder::event(Input::Sample { topic: *topic, bytes });
        recorder.step(*at, event, &mut outbox);
        outputs.extend(outbox.drain());
        last = *at;
    }
    // Once to ask for the journals' ends, and once because nobody answers.
    for _ in 0..2 {
        recorder.step(last, Recorder::event(Input::Stop), &mut outbox);
        outputs.extend(outbox.drain());
    }
    outputs
}

struct Script {
    samples: Vec<Sample>,
    numbers: [Numbering; 8],
    tool: Vec3,
    journal: u64,
    last_setpoint: Option<(MessageId, Setpoint)>,
    now: Stamp,
}

impl Default for Script {
    fn default() -> Self {
        Self {
            samples: Vec::new(),
            numbers: std::array::from_fn(|i| Numbering::new(Session(100 + i as u64))),
            tool: path(0.0, 0.12),
            journal: 0,
            last_setpoint: None,
            now: Stamp(0),
        }
    }
}

impl Script {
    fn say<M: Message>(&mut self, topic: Topic, number: usize, tick: u32, body: M) -> MessageId {
        let message = self.numbers[number].envelope(self.now, tick, body);
        let mut bytes = Vec::new();
        encode(&message, &mut bytes);
        let late = Stamp(self.now.0 + 2_000_000 * (number as u64 + 1));
        self.samples.push(Sample { at: late, topic, bytes });
        message.header.id()
    }

    fn begin(&mut self) {
        for (node, model) in [(NodeName::Predictor, vec![7; 3000]), (NodeName::Arbiter, Vec::new())] {
            let info = NodeInfo {
                session: Session(101),
                config: format!("[{node}]\nseed = 7\n"),
                seed: 7,
                build: "0.1.0 (test)".into(),
                model,
            };
            self.say(Topic::Info(node), 7, 0, info);
        }
        self.say(Topic::Scene, 5, 0, scene());
        let label = "planar task, A = 0.12, adaptive".into();
        self.say(Topic::Trial, 6, 0, Trial::Begin { number: 1, label });
    }

    fn tick(&mut self, tick: u32) {
        self.now = Stamp::of_tick(tick, PERIOD);
        let state = self.say(Topic::State, 0, tick, self.state());
        let step = f64::from(tick);
        let silent = SILENCE.contains(&tick);
        let wish = path(step + 1.0, 0.12) + deviation(step);
        let human = if silent || tick < 2 {
            Vec3::ZERO
        } else {
            (wish - self.tool) * 6.0
        };
        let deadman = if tick < 2 {
            Deadman::Released
        } else {
            Deadman::Held { press: 1 }
        };
        let mut used = None;
        if !silent {
            let command = Command {
                velocity: human,
                deadman,
                seen: Some(state),
            };
            let id = self.say(Topic::Command, 1, tick, command);
            used = Some(Used {
                id,
                sent: self.now,
                age: 1_500_000,
                seen: Some(state),
            });
        }
        if tick == CHECKPOINT {
            self.say(Topic::Forecast, 3, tick, forecast());
        }
        let guidance = (tick >= CHECKPOINT).then(|| guidance(step, self.tool));
        let id = self.say(
            Topic::Proposal,
            2,
            tick,
            Proposal {
                seen: Some(state),
                guidance,
            },
        );
        let proposal = Some(Used {
            id,
            sent: self.now,
            age: 1_000_000,
            seen: Some(state),
        });
        let motion = match tick {
            0 | 1 => Motion::Held(Reason::DeadmanReleased),
            _ if silent => Motion::Held(Reason::CommandLost { silent: 250_000_000 }),
            _ => Motion::Permitted { press: 1 },
        };
        self.arbitrate(tick, state, human, guidance, motion, used, proposal);
        if tick % 10 == 9 {
            self.journal();
        }
    }

    #[expect(clippy::too_many_arguments, reason = "what goes into an arbitration")]
    fn arbitrate(
        &mut self,
        tick: u32,
        seen: MessageId,
        human: Vec3,
        guidance: Option<Guidance>,
        motion: Motion,
        command: Option<Used>,
        proposal: Option<Used>,
    ) {
        let robot = guidance.map_or(Vec3::ZERO, |guidance| guidance.velocity);
        let weight = guidance.map_or(1.0, |g| ((g.ratio.0 - 1.0) / (g.ratio_high.0 - 1.0)).clamp(0.15, 1.0));
        let blended = human * weight + robot * (1.0 - weight);
        let velocity = if motion.is_permitted() { blended } else { Vec3::ZERO };
        let setpoint = Setpoint {
            velocity,
            motion,
            lease: None,
            asks: None,
            law: Law::Adaptive,
            weight: Finite(weight),
            human,
            guidance,
            blended,
            limited: Limited::default(),
            command,
            proposal,
            seen: Some(seen),
            refused: Refusals::default(),
        };
        let id = self.say(Topic::Setpoint, 4, tick, setpoint);
        self.tool = self.tool + velocity * 0.1;
        self.last_setpoint = Some((id, setpoint));
    }

    fn state(&self) -> State {
        let (links, tool) = arm(self.tool);
        let obeyed = |(id, setpoint)| Obeyed {
            id,
            arrived: self.now,
            moved: self.now,
            setpoint,
        };
        let scene = scene();
        let clearance = scene.obstacles.iter().map(|obstacle| {
            let to = self.tool - obstacle.foot;
            Vec3::new(to.x, to.y, 0.0).norm() - obstacle.radius.0 - 0.005
        });
        let distance = clearance.fold(f64::INFINITY, f64::min);
        let clearance = Some(Clearance {
            distance: Finite(distance),
            body: 4,
            obstacle: 0,
        });
        let motion = self
            .last_setpoint
            .map_or(Motion::Held(Reason::NoSetpointYet), |(_, s)| s.motion);
        State {
            trial: 1,
            trial_start: 0,
            joints: [Finite(0.1); 7],
            joint_velocities: [Finite(0.0); 7],
            links,
            tool,
            tool_velocity: self.last_setpoint.map_or(Vec3::ZERO, |(_, setpoint)| setpoint.velocity),
            clearance,
            closest: clearance,
            motion,
            at_rest: false,
            obeys: self.last_setpoint.map(obeyed),
            arrivals: None,
            refused: Refusals::default(),
        }
    }

    fn journal(&mut self) {
        let entry = JournalEntry {
            at: self.now,
            wall: self.now,
            what: Happening::Wake,
        };
        let batch = JournalBatch {
            first: self.journal,
            lost: 0,
            entries: vec![entry; 10],
        };
        self.journal += 10;
        self.say(Topic::Journal(NodeName::Arbiter), 7, 0, batch);
    }

    fn end(&mut self) {
        let outcome = "goal reached after 8.4 s".into();
        self.say(Topic::Trial, 6, STEPS, Trial::End { number: 1, outcome });
    }
}

/// The planar task's path over the first obstacle and under the second.
fn path(step: f64, height: f64) -> Vec3 {
    let t = (step / f64::from(STEPS - 1)).clamp(0.0, 1.0);
    let s = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
    let x = 0.6 * s;
    let bump = |centre: f64, width: f64| libm::exp(-((x - centre) / width) * ((x - centre) / width));
    let y = height * bump(0.28, 0.07) - height * (0.8 + 2.0 * (height - 0.11)) * bump(0.46, 0.06);
    TaskFrame::default().to_base([x, y])
}

fn deviation(step: f64) -> Vec3 {
    Vec3::new(0.012 * libm::sin(step / 9.0), 0.006 * libm::cos(step / 7.0), 0.0)
}

fn width(step: f64) -> (f64, f64) {
    let grown = 1.0 + 0.9 * ((step - 41.0) / 42.0).clamp(0.0, 1.0);
    (0.006 * grown * grown, grown)
}

fn forecast() -> Forecast {
    let point = |step: u32| {
        let (half, ratio) = width(f64::from(step));
        ForecastPoint {
            position: path(f64::from(step), 0.115),
            half_width: Vec3::new(half, half * 0.6, 0.0),
            ratio: Finite(ratio),
        }
    };
    Forecast {
        number: 1,
        context: vec![Finite(0.25), Finite(0.1)],
        model: [7; 32],
        first_step: CHECKPOINT,
        period: PERIOD,
        points: (CHECKPOINT..STEPS).map(point).collect(),
    }
}

fn guidance(step: f64, tool: Vec3) -> Guidance {
    let (half, ratio) = width(step);
    Guidance {
        forecast: 1,
        phase: Finite(step),
        last_step: STEPS - 1,
        velocity: ((path(step + 1.0, 0.115) - tool) * 10.0).capped(0.5),
        position: path(step, 0.115),
        half_width: Vec3::new(half, half * 0.6, 0.0),
        ratio: Finite(ratio),
        ratio_high: Finite(2.2),
    }
}

pub(crate) fn scene() -> Scene {
    let frame = TaskFrame::default();
    let cylinder = |x: f64| {
        let foot = frame.to_base([x, 0.0]);
        Cylinder {
            foot: Vec3::new(foot.x, foot.y, 0.0),
            radius: Finite(0.02),
            height: Finite(0.2),
        }
    };
    let body = |frame: u8, length: f64, radius: f64| Body {
        frame,
        from: Vec3::ZERO,
        to: Vec3::new(0.0, 0.0, length),
        radius: Finite(radius),
    };
    Scene {
        obstacles: vec![cylinder(0.28), cylinder(0.46)],
        bodies: vec![
            body(Body::BASE, 0.3, 0.07),
            body(1, 0.42, 0.06),
            body(3, 0.42, 0.05),
            body(5, -0.1, 0.045),
            body(TOOL_FRAME, 0.2, 0.005),
        ],
        start: frame.to_base([0.0, 0.0]),
        goal: frame.to_base([0.6, 0.0]),
        goal_tolerance: Finite(0.01),
        workspace: Aabb {
            min: Vec3::new(0.25, -0.4, 0.05),
            max: Vec3::new(0.7, 0.4, 0.4),
        },
        period: PERIOD,
    }
}

fn arm(tip: Vec3) -> ([Pose; LINKS], Pose) {
    let shoulder = Vec3::new(0.0, 0.0, 0.333);
    let wrist = tip + Vec3::new(0.0, 0.0, 0.32);
    let reach = wrist - shoulder;
    let up = (0.42_f64 * 0.42 - reach.dot(reach) / 4.0).max(0.0).sqrt();
    let elbow = shoulder + reach * 0.5 + Vec3::new(0.0, 0.0, up);
    let upright = |position| Pose {
        position,
        orientation: [0.0, 0.0, 0.0, 1.0].map(Finite),
    };
    let upper = towards(shoulder, elbow);
    let fore = towards(elbow, wrist);
    let flange = upright(tip + Vec3::new(0.0, 0.0, 0.2));
    let links = [
        upright(shoulder),
        upper,
        upper,
        fore,
        fore,
        upright(wrist),
        upright(wrist),
        flange,
    ];
    (links, upright(tip))
}

/// A frame at `from` whose z axis points to `to`.
fn towards(from: Vec3, to: Vec3) -> Pose {
    let way = to - from;
    let d = way * (1.0 / way.norm());
    let w = 1.0 + d.z;
    let norm = (d.x * d.x + d.y * d.y + w * w).sqrt();
    Pose {
        position: from,
        orientation: [-d.y / norm, d.x / norm, 0.0, w / norm].map(Finite),
    }
}

/// A state as the robot would say it, for tests of a single message.
pub(crate) fn a_state(tick: u32, seq: u64) -> Envelope<State> {
    let script = Script::default();
    Envelope {
        header: tandem_wire::Header {
            tick,
            session: Session(1),
            seq: Seq(seq),
            sent: Stamp(0),
        },
        body: script.state(),
    }
}
