//! A stage for the arbiter: messages made by hand, time moved by hand, and setpoints as one line each.

#![allow(dead_code, reason = "every test file uses some of it")]

use tandem_arbiter::{Arbiter, ArbiterSettings, Event, Output};
use tandem_wire::{
    Claim, Command, Deadman, Emergency, Envelope, Finite, Guidance, Header, Label, MILLISECOND, MessageId, Motion,
    Node, Outbox, Pose, Proposal, Reason, Refusals, Seq, Session, Setpoint, Stamp, State, Timing, Vec3, Wish,
};

pub(crate) const OPERATOR: Session = Session(1);
pub(crate) const PREDICTOR: Session = Session(2);
pub(crate) const ROBOT: Session = Session(4);
pub(crate) const BYSTANDER: Session = Session(6);

pub(crate) fn at(millis: u64) -> Stamp {
    Stamp(millis * MILLISECOND)
}

pub(crate) fn header(session: Session, seq: u64, tick: u32) -> Header {
    Header {
        tick,
        session,
        seq: Seq(seq),
        sent: Stamp(0),
    }
}

pub(crate) fn id(session: Session, seq: u64) -> MessageId {
    MessageId { session, seq: Seq(seq) }
}

/// A state whose tool is at `tool`.
pub(crate) fn state(seq: u64, tick: u32, tool: Vec3) -> Envelope<State> {
    Envelope {
        header: header(ROBOT, seq, tick),
        body: State {
            trial: 1,
            trial_start: 0,
            joints: Default::default(),
            joint_velocities: Default::default(),
            links: Default::default(),
            tool: Pose {
                position: tool,
                ..Pose::default()
            },
            tool_velocity: Vec3::ZERO,
            clearance: None,
            closest: None,
            motion: Motion::Held(Reason::NoSetpointYet),
            at_rest: false,
            obeys: None,
            arrivals: None,
            refused: Refusals::default(),
        },
    }
}

/// A command that answers the state of the same number.
pub(crate) fn command(seq: u64, tick: u32, deadman: Deadman, velocity: Vec3) -> Envelope<Command> {
    Envelope {
        header: header(OPERATOR, seq, tick),
        body: Command {
            velocity,
            deadman,
            seen: Some(id(ROBOT, seq)),
        },
    }
}

/// The same from another operator.
pub(crate) fn command_of(session: Session, seq: u64, deadman: Deadman, velocity: Vec3) -> Envelope<Command> {
    let mut command = command(seq, 0, deadman, velocity);
    command.header.session = session;
    command
}

/// An operator's word about the lease.
pub(crate) fn claim(session: Session, seq: u64, wish: Wish, name: &str) -> Envelope<Claim> {
    let name = Label::new(name);
    Envelope {
        header: header(session, seq, 0),
        body: Claim { wish, name },
    }
}

/// An emergency stop by somebody, or its end.
pub(crate) fn emergency(seq: u64, clear: Option<MessageId>) -> Envelope<Emergency> {
    let by = Label::new("ada");
    Envelope {
        header: header(BYSTANDER, seq, 0),
        body: clear.map_or(Emergency::Stop { by }, |stop| Emergency::Clear { stop, by }),
    }
}

/// A proposal that answers the state of the same number.
pub(crate) fn proposal(seq: u64, tick: u32, guidance: Option<Guidance>) -> Envelope<Proposal> {
    Envelope {
        header: header(PREDICTOR, seq, tick),
        body: Proposal {
            seen: Some(id(ROBOT, seq)),
            guidance,
        },
    }
}

/// Guidance along x, as sure as `ratio` says (1.5 gives the human everything).
pub(crate) fn guidance(ratio: f64, velocity: Vec3) -> Guidance {
    Guidance {
        forecast: 1,
        phase: Finite(41.5),
        last_step: 83,
        velocity,
        ratio: Finite(ratio),
        ratio_high: Finite(1.5),
        ..Guidance::default()
    }
}

pub(crate) const CENTRE: Vec3 = Vec3::new(0.5, 0.0, 0.15);

pub(crate) fn held(press: u32) -> Deadman {
    Deadman::Held { press }
}

/// An arbiter and everything it said.
pub(crate) struct Stage {
    pub(crate) arbiter: Arbiter,
    outbox: Outbox<Output>,
    pub(crate) setpoints: Vec<Envelope<Setpoint>>,
    now: Stamp,
}

impl Stage {
    pub(crate) fn new(timing: Timing, settings: &ArbiterSettings) -> Self {
        Self {
            arbiter: Arbiter::new(Session(3), timing, settings).expect("the workspace is not turned over"),
            outbox: Outbox::default(),
            setpoints: Vec::new(),
            now: Stamp(0),
        }
    }

    /// Lets time pass, waking the arbiter at its deadlines as the shell does, then steps it with `event`.
    pub(crate) fn step(&mut self, now: Stamp, event: Event) {
        self.pass(now);
        self.deliver(now, event);
    }

    /// Lets time pass.
    pub(crate) fn pass(&mut self, now: Stamp) {
        while let Some(due) = self.arbiter.deadline().filter(|due| *due < now) {
            let due = due.max(self.now);
            self.deliver(due, Event::Wake);
            assert!(self.arbiter.deadline() > Some(due), "a wake must move the deadline on");
        }
    }

    fn deliver(&mut self, now: Stamp, event: Event) {
        self.now = now;
        self.arbiter.step(now, event, &mut self.outbox);
        let said = self.outbox.drain().map(|Output::Setpoint(setpoint)| setpoint);
        self.setpoints.extend(said);
    }

    /// What it said, a line each. Setpoints that repeat the one before, but for what was refused meanwhile, are
    /// counted, not shown; the line then tells the last count of what was refused.
    pub(crate) fn told(&self) -> String {
        let mut lines: Vec<(String, String, String, usize)> = Vec::new();
        for setpoint in &self.setpoints {
            let (line, refused) = (line(&setpoint.body), refused(&setpoint.body));
            match lines.last_mut() {
                Some((_, last, count, times)) if *last == line => (*count, *times) = (refused, *times + 1),
                _ => lines.push((
                    format!("{:>6.0} ms", setpoint.header.sent.seconds() * 1e3),
                    line,
                    refused,
                    1,
                )),
            }
        }
        let shown = lines.iter().map(|(when, line, refused, times)| match times {
            1 => format!("{when}  {line}{refused}\n"),
            _ => format!("{when}  {line}{refused}  ×{times}\n"),
        });
        shown.collect()
    }
}

fn refused(setpoint: &Setpoint) -> String {
    let refused = setpoint.refused;
    refused
        .last
        .map_or(String::new(), |why| format!(", refused {}: {why}", refused.count))
}

fn line(setpoint: &Setpoint) -> String {
    let vector = |v: Vec3| format!("({:.3} {:.3} {:.3})", v.x, v.y, v.z);
    let motion = match setpoint.motion {
        Motion::Permitted { press } => format!("press {press}"),
        Motion::Held(reason) => format!("held: {reason}"),
    };
    let flags = [
        (setpoint.limited.speed, " speed"),
        (setpoint.limited.acceleration, " acceleration"),
        (setpoint.limited.workspace, " workspace"),
    ];
    let limited: String = flags.iter().filter(|(on, _)| *on).map(|(_, name)| *name).collect();
    let limited = if limited.is_empty() {
        limited
    } else {
        format!(", limited{limited}")
    };
    format!(
        "{} ω={:.2} {motion}{limited}",
        vector(setpoint.velocity),
        setpoint.weight.0
    )
}
