//! The vocabulary that Tandem's nodes share: keys, messages, their bytes, and what a node is.
//!
//! Pure: nothing here knows Zenoh, a clock, a thread or a file. A node ([`Node`]) is a step machine; its [`Ports`]
//! turn bytes into events and outputs into bytes; the shell in `tandem-link` carries the bytes. Everything that
//! crosses a process border is spelled here once: the keys in [`keys`], the messages in [`messages`], the byte
//! layout in [`codec`].
//!
//! What travels is not trusted. Decoding refuses other versions, wrong lengths, trailing bytes and numbers that are
//! not finite; [`guard`] holds what every receiver that moves something checks besides: who sent it, in which order,
//! how fresh it is by the receiver's own clock, and whether the human has pressed the deadman anew after a stop.
//!
//! Start reading at [`messages`].

mod clock;
pub mod codec;
mod emergency;
mod frame;
mod geometry;
pub mod guard;
mod journal;
pub mod keys;
mod label;
mod lease;
mod memory;
pub mod messages;
mod node;
mod reason;
mod stamp;
mod storage;
mod timing;

pub use clock::{CLOCK_PEERS, ClockReport, PeerClock, Pong};
pub use codec::{Envelope, Header, Malformed, Message, decode, encode};
pub use emergency::{Emergency, Latch};
pub use frame::TaskFrame;
pub use geometry::{Aabb, Finite, Pose, Vec3};
pub use guard::{Echoes, Guard, Rearm, Refusal, Refusals, StateGuard, stream_timeout};
pub use journal::{Happening, JournalBatch, JournalEntry, Question};
pub use keys::{Delivery, NodeName, RobotName, Topic};
pub use label::{LABEL_BYTES, Label};
pub use lease::{Claim, Lease, Wish};
pub use memory::{Memory, Remember, restore, snapshot};
pub use messages::{
    Arrivals, Body, Clearance, Command, Cylinder, Deadman, Forecast, ForecastPoint, Guidance, JOINTS, LINKS, Law,
    Limited, NodeInfo, Numbering, Obeyed, Proposal, Scene, Setpoint, State, Trial, Used,
};
pub use node::{Input, Node, Outbox, Ports, Turn, Unreadable};
pub use reason::{Motion, Reason};
pub use stamp::{MILLISECOND, MessageId, Nanos, SECOND, Seq, Session, Stamp, seconds};
pub use storage::{Condition, Storage};
pub use timing::{Pace, Timing};
