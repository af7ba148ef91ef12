//! A robot that is a point, with an arbiter that believes everything: what the operator's tests play against.

#![expect(dead_code, reason = "every test file uses a part of it")]

use tandem_operator::{Event, HumanSettings, Operator, OperatorSettings, Output, SourceKind, Status};
use tandem_wire::{
    Command, Deadman, Envelope, Finite, Guidance, Header, LINKS, Law, Limited, MessageId, Motion, Node, Obeyed, Outbox,
    Pose, Rearm, Reason, Refusals, Seq, Session, Setpoint, Stamp, State, TaskFrame, Timing, Vec3,
};

pub(crate) const PERIOD: f64 = 0.1;

/// The point robot. Whatever is public may be changed between ticks.
pub(crate) struct Robot {
    pub(crate) header: Header,
    pub(crate) trial: u32,
    pub(crate) trial_start: u32,
    /// Task coordinates.
    pub(crate) tool: [f64; 2],
    pub(crate) motion: Motion,
    /// The phase and the robot's velocity that the next setpoints carry.
    pub(crate) guidance: Option<(f64, [f64; 2])>,
    pub(crate) weight: f64,
    rearm: Rearm,
    obeys: Option<Obeyed>,
}

impl Default for Robot {
    fn default() -> Self {
        Self {
            header: Header {
                session: Session(77),
                seq: Seq(1),
                ..Header::default()
            },
            trial: 0,
            trial_start: 0,
            tool: [0.0; 2],
            motion: Motion::Held(Reason::NoCommandYet),
            guidance: None,
            weight: 1.0,
            rearm: Rearm::Fresh,
            obeys: None,
        }
    }
}

impl Robot {
    pub(crate) fn begin_trial(&mut self, number: u32) {
        (self.trial, self.trial_start, self.tool) = (number, self.header.tick, [0.0; 2]);
    }

    pub(crate) fn now(&self) -> Stamp {
        Stamp::of_tick(self.header.tick, Timing::default().period)
    }

    pub(crate) fn state(&self) -> Envelope<State> {
        let mut tool = Pose::default();
        tool.position = TaskFrame::default().to_base(self.tool);
        Envelope {
            header: self.header,
            body: State {
                trial: self.trial,
                trial_start: self.trial_start,
                joints: [Finite(0.0); 7],
                joint_velocities: [Finite(0.0); 7],
                links: [Pose::default(); LINKS],
                tool,
                tool_velocity: Vec3::ZERO,
                clearance: None,
                closest: None,
                motion: self.motion,
                at_rest: false,
                obeys: self.obeys,
                arrivals: None,
                refused: Refusals::default(),
            },
        }
    }

    /// Publishes another state in the same control period.
    pub(crate) fn repeat(&mut self) -> Envelope<State> {
        self.header.seq.advance();
        self.state()
    }

    /// Stops for `why`: motion then needs a fresh press.
    pub(crate) fn stop(&mut self, why: Reason) {
        self.rearm.spend();
        self.motion = Motion::Held(why);
    }

    /// Does what the command says for one control period, if its deadman is held and fresh.
    pub(crate) fn obey(&mut self, command: &Command) {
        self.motion = match (self.rearm.see(command.deadman), command.deadman) {
            (Some(press), _) => Motion::Permitted { press },
            (None, Deadman::Released) => Motion::Held(Reason::DeadmanReleased),
            (None, Deadman::Held { .. }) => Motion::Held(Reason::AwaitingPress),
        };
        if self.motion.is_permitted() {
            let robot = self.guidance.map_or([0.0; 2], |(_, velocity)| velocity);
            let human = task_velocity(command.velocity);
            for i in 0..2 {
                self.tool[i] += PERIOD * (self.weight * human[i] + (1.0 - self.weight) * robot[i]);
            }
        }
        self.obeys = Some(self.obeyed(command));
        self.header.tick = self.header.tick.wrapping_add(1);
        self.header.seq.advance();
    }

    fn obeyed(&self, command: &Command) -> Obeyed {
        let guidance = self.guidance.map(|(phase, velocity)| Guidance {
            phase: Finite(phase),
            velocity: TaskFrame::default().vector_to_base(velocity),
            ..Guidance::default()
        });
        Obeyed {
            id: MessageId::default(),
            arrived: Stamp(0),
            moved: Stamp(0),
            setpoint: Setpoint {
                velocity: Vec3::ZERO,
                motion: self.motion,
                lease: None,
                asks: None,
                law: Law::Adaptive,
                weight: Finite(self.weight),
                human: command.velocity,
                guidance,
                blended: Vec3::ZERO,
                limited: Limited::default(),
                command: None,
                proposal: None,
                seen: Some(self.header.id()),
                refused: Refusals::default(),
            },
        }
    }
}

/// A velocity in the plane of the task.
pub(crate) fn task_velocity(velocity: Vec3) -> [f64; 2] {
    let frame = TaskFrame::default();
    [velocity.dot(frame.x_axis), velocity.dot(frame.y_axis)]
}

/// An operator with an outbox that is emptied after every step.
pub(crate) struct Rig {
    pub(crate) operator: Operator,
    outbox: Outbox<Output>,
    pub(crate) status: Option<Status>,
}

impl Rig {
    pub(crate) fn new(timing: Timing, seed: u64, settings: &OperatorSettings, human: &HumanSettings) -> Self {
        Self {
            operator: Operator::new(Session(5), timing, TaskFrame::default(), seed, settings, human),
            outbox: Outbox::default(),
            status: None,
        }
    }

    /// A simulated human in lockstep.
    pub(crate) fn simulated(seed: u64, human: &HumanSettings) -> Self {
        let timing = Timing::default().lockstep();
        Self::new(timing, seed, &OperatorSettings::default(), human)
    }

    /// A keyboard in real time.
    pub(crate) fn keyboard() -> Self {
        let settings = OperatorSettings {
            source: SourceKind::Keyboard,
            ..OperatorSettings::default()
        };
        Self::new(Timing::default(), 1, &settings, &HumanSettings::default())
    }

    pub(crate) fn step(&mut self, now: Stamp, event: Event) -> Vec<Output> {
        self.operator.step(now, event, &mut self.outbox);
        let outputs: Vec<_> = self.outbox.drain().collect();
        for output in &outputs {
            if let Output::Status(status) = output {
                self.status = Some(*status);
            }
        }
        outputs
    }

    /// Shows it the robot's state in lockstep and hands back the one command that answers.
    pub(crate) fn answer(&mut self, robot: &Robot) -> Envelope<Command> {
        let outputs = self.step(robot.now(), Event::State(Box::new(robot.state())));
        let mut commands = commands(&outputs);
        assert_eq!(commands.len(), 1, "one command answers a state");
        commands.remove(0)
    }

    /// What the status line says the operator is doing.
    pub(crate) fn doing(&self) -> String {
        self.status.map_or(String::new(), |status| status.activity.to_string())
    }
}

/// The commands among outputs.
pub(crate) fn commands(outputs: &[Output]) -> Vec<Envelope<Command>> {
    let command = |output: &Output| match output {
        Output::Command(command) => Some(*command),
        _ => None,
    };
    outputs.iter().filter_map(command).collect()
}

/// A command as a person reads it, in mm/s along the task's axes.
pub(crate) fn readable(command: &Command) -> String {
    let [x, y] = task_velocity(command.velocity).map(|v| v * 1e3);
    match command.deadman {
        Deadman::Released => "released".to_owned(),
        Deadman::Held { press } => format!("held {press} {x:+.1} {y:+.1} mm/s"),
    }
}
