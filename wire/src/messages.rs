//! Every message, field by field. Positions in metres, velocities in metres per second, angles in radians, all in
//! the robot's base frame unless a field says otherwise.

use bincode::{Decode, Encode};

use crate::codec::{Envelope, Message};
use crate::guard::Refusals;
use crate::{
    Aabb, Claim, Emergency, Finite, Label, Lease, Malformed, Memory, MessageId, Motion, Nanos, Pose, Remember, Seq,
    Session, Stamp, Topic, Vec3,
};

/// Joints of the arm.
pub const JOINTS: usize = 7;
/// Frames of the arm that a state carries: link 1 to 7 and the flange.
pub const LINKS: usize = 8;

/// Whether the human holds the switch without which nothing moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub enum Deadman {
    /// Let go.
    #[default]
    Released,
    /// Held; presses are numbered from 1 within a session.
    Held {
        /// Which press.
        press: u32,
    },
}

/// What the human wants.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode, Decode)]
pub struct Command {
    /// Velocity of the tool.
    pub velocity: Vec3,
    /// The deadman switch.
    pub deadman: Deadman,
    /// The newest state that the operator had seen.
    pub seen: Option<MessageId>,
}

/// What the robot would do: one for every state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode, Decode)]
pub struct Proposal {
    /// The state it answers.
    pub seen: Option<MessageId>,
    /// Nothing before the first checkpoint.
    pub guidance: Option<Guidance>,
}

/// One instant of a forecast, turned into a velocity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode, Decode)]
pub struct Guidance {
    /// Which forecast: counts from 1 within the predictor's session.
    pub forecast: u32,
    /// Where on the demonstrations' time axis the movement is, in steps.
    pub phase: Finite,
    /// The last step of the forecast.
    pub last_step: u32,
    /// The velocity that leads to the forecast's next step.
    pub velocity: Vec3,
    /// The forecast position at `phase`.
    pub position: Vec3,
    /// Half the width of the prediction interval around it, per axis, in metres.
    pub half_width: Vec3,
    /// The interval's width relative to that of the training data at the same step; 1 is as sure as can be.
    pub ratio: Finite,
    /// The ratio at which the human gets all of the weight; a property of the model.
    pub ratio_high: Finite,
}

/// A whole forecast, published when a new condition is known.
#[derive(Clone, Debug, Default, PartialEq, Encode, Decode)]
pub struct Forecast {
    /// Counts from 1 within the predictor's session.
    pub number: u32,
    /// The condition in the model's own frame and order, in metres.
    pub context: Vec<Finite>,
    /// SHA-256 of the model file.
    pub model: [u8; 32],
    /// The step of the first point.
    pub first_step: u32,
    /// Time between steps.
    pub period: Nanos,
    /// Forecast position and half-width of its interval per axis, step by step.
    pub points: Vec<ForecastPoint>,
}

/// One step of a forecast.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode, Decode)]
pub struct ForecastPoint {
    /// Where the tool is expected.
    pub position: Vec3,
    /// Half the width of the prediction interval, per axis.
    pub half_width: Vec3,
    /// The width relative to that of the training data at this step.
    pub ratio: Finite,
}

/// How human and robot share the command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode, Decode)]
pub enum Law {
    /// The human's weight follows the interval's ratio to training.
    #[default]
    Adaptive,
    /// Half and half, as the paper's baseline.
    Fixed,
    /// The human alone.
    Human,
    /// The robot alone, once there is a forecast.
    Robot,
    /// A constant weight of the human.
    Constant(Finite),
    /// The human's weight follows what the hand says: how far it pushes across the robot's way.
    Attentive,
}

/// Which limits changed the command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub struct Limited {
    /// The tool would have left the workspace.
    pub workspace: bool,
    /// Faster than the tool may go.
    pub speed: bool,
    /// A harder change of speed than allowed.
    pub acceleration: bool,
}

/// A message that went into a decision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub struct Used {
    /// Which message.
    pub id: MessageId,
    /// When it was sent, by its sender's clock.
    pub sent: Stamp,
    /// How long before the decision it had arrived, by the decider's clock.
    pub age: Nanos,
    /// The newest state that its sender had seen.
    pub seen: Option<MessageId>,
}

/// What shall be done, and the whole record of why: one arbitration.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct Setpoint {
    /// Velocity of the tool: blended, then limited. Zero while motion is held.
    pub velocity: Vec3,
    /// Whether the robot may move, and if not, why.
    pub motion: Motion,
    /// Who may drive.
    pub lease: Option<Lease>,
    /// Who last pressed in vain while another held it, for as long as that is news.
    pub asks: Option<Label>,
    /// The law in force.
    pub law: Law,
    /// The human's weight ω: `blended = ω·human + (1 − ω)·robot`.
    pub weight: Finite,
    /// The human's velocity as commanded.
    pub human: Vec3,
    /// The robot's guidance, if there is a forecast and the predictor is there.
    pub guidance: Option<Guidance>,
    /// The velocity before limits.
    pub blended: Vec3,
    /// What the limits changed.
    pub limited: Limited,
    /// The command that was used.
    pub command: Option<Used>,
    /// The proposal that was used.
    pub proposal: Option<Used>,
    /// The newest state that the arbiter had seen.
    pub seen: Option<MessageId>,
    /// Messages that the arbiter dropped so far.
    pub refused: Refusals,
}

/// The setpoint that a robot obeys, as it says itself.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct Obeyed {
    /// Which setpoint.
    pub id: MessageId,
    /// When it arrived, by the robot's clock.
    pub arrived: Stamp,
    /// When the first inner tick under it began, by the robot's clock.
    pub moved: Stamp,
    /// The setpoint whole, so that an operator needs no other message.
    pub setpoint: Setpoint,
}

/// The place where the arm is closest to an obstacle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode, Decode)]
pub struct Clearance {
    /// Smallest distance from the arm's surface to an obstacle; negative inside, in metres.
    pub distance: Finite,
    /// Which body of the arm: an index into [`Scene::bodies`].
    pub body: u8,
    /// Which obstacle: an index into [`Scene::obstacles`].
    pub obstacle: u8,
}

/// How setpoints arrive at a robot that expects one every millisecond, as Franka's control interface counts them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode, Decode)]
pub struct Arrivals {
    /// The share of the last hundred milliseconds in which one arrived, 0 to 1; 0 while motion is held.
    pub success_rate: Finite,
    /// Milliseconds in a row without one, now.
    pub missed: u32,
    /// The longest such row since motion was last permitted.
    pub longest: u32,
}

/// What the arm does.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct State {
    /// The running trial, from 1; 0 if none runs.
    pub trial: u32,
    /// The tick at which this trial began.
    pub trial_start: u32,
    /// Joint angles, in radians.
    pub joints: [Finite; JOINTS],
    /// Joint velocities, in radians per second.
    pub joint_velocities: [Finite; JOINTS],
    /// Where the links' frames are.
    pub links: [Pose; LINKS],
    /// Where the tool's tip is.
    pub tool: Pose,
    /// How fast the tool's tip moves.
    pub tool_velocity: Vec3,
    /// The distance to the obstacles now; `None` in a scene without obstacles.
    pub clearance: Option<Clearance>,
    /// The smallest distance since the state before this one.
    pub closest: Option<Clearance>,
    /// Whether the robot lets itself move, and if not, why.
    pub motion: Motion,
    /// Whether it has come to rest.
    pub at_rest: bool,
    /// The setpoint in force.
    pub obeys: Option<Obeyed>,
    /// How setpoints arrive; `None` unless one is expected every millisecond.
    pub arrivals: Option<Arrivals>,
    /// Messages that the robot dropped so far.
    pub refused: Refusals,
}

/// An upright cylinder that must not be touched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode, Decode)]
pub struct Cylinder {
    /// Centre of its foot.
    pub foot: Vec3,
    /// Radius, in metres.
    pub radius: Finite,
    /// Height, in metres.
    pub height: Finite,
}

/// A part of the arm as its collision shape: a capsule fixed to a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode, Decode)]
pub struct Body {
    /// The frame it is fixed to: an index into [`State::links`], [`LINKS`] for the tool, [`Body::BASE`] for the base.
    pub frame: u8,
    /// One end of its axis, in that frame.
    pub from: Vec3,
    /// The other end.
    pub to: Vec3,
    /// Radius, in metres.
    pub radius: Finite,
}

impl Body {
    /// The frame number of the base.
    pub const BASE: u8 = u8::MAX;
}

/// The surroundings, published at the start, at every trial's start and every second.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
pub struct Scene {
    /// What must not be touched.
    pub obstacles: Vec<Cylinder>,
    /// The arm's collision shapes.
    pub bodies: Vec<Body>,
    /// Where the tool starts.
    pub start: Vec3,
    /// Where it shall go.
    pub goal: Vec3,
    /// Within this distance of the goal it has arrived, in metres.
    pub goal_tolerance: Finite,
    /// Where the tool may be.
    pub workspace: Aabb,
    /// The length of a control period.
    pub period: Nanos,
}

/// A trial begins or ends.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
pub enum Trial {
    /// The robot goes to the start and the trial runs. Repeated while it runs, for those who come late.
    Begin {
        /// Counts from 1.
        number: u32,
        /// What the trial is called.
        label: String,
    },
    /// The trial is over.
    End {
        /// Which one.
        number: u32,
        /// How it went, in words.
        outcome: String,
    },
}

/// A node's answer to "who are you": what it takes to build it again.
#[derive(Clone, Debug, Default, PartialEq, Encode, Decode)]
pub struct NodeInfo {
    /// The run it speaks of.
    pub session: Session,
    /// Its effective configuration, as TOML.
    pub config: String,
    /// The seed of its random numbers.
    pub seed: u64,
    /// Version and git revision of the program.
    pub build: String,
    /// The model file, for a predictor.
    pub model: Vec<u8>,
}

macro_rules! message {
    ($type:ty, $topic:expr, $max:expr) => {
        impl Message for $type {
            const KIND: u8 = $topic.kind();
            const MAX_BYTES: usize = $max;
        }
    };
}

message!(Command, Topic::Command, 128);
message!(Proposal, Topic::Proposal, 512);
message!(Forecast, Topic::Forecast, 1 << 20);
message!(Setpoint, Topic::Setpoint, 1024);
message!(State, Topic::State, 4096);
message!(Scene, Topic::Scene, 1 << 16);
message!(Trial, Topic::Trial, 1 << 12);
message!(Claim, Topic::Lease, 128);
message!(Emergency, Topic::Emergency, 128);
message!(NodeInfo, Topic::Info(crate::NodeName::Operator), 1 << 24);

/// Numbers the messages of one stream.
#[derive(Clone, Debug, PartialEq)]
pub struct Numbering {
    session: Session,
    seq: Seq,
}

impl Numbering {
    /// Numbers from 1 in `session`.
    #[must_use]
    pub const fn new(session: Session) -> Self {
        Self { session, seq: Seq(0) }
    }

    /// Wraps `body` as the stream's next message.
    pub fn envelope<M>(&mut self, now: Stamp, tick: u32, body: M) -> Envelope<M> {
        let seq = self.seq.advance();
        Envelope {
            header: crate::Header {
                tick,
                session: self.session,
                seq,
                sent: now,
            },
            body,
        }
    }
}

impl Remember for Numbering {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self { session: _, seq } = self;
        memory.part(seq)
    }
}
