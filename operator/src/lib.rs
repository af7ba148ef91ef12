//! The operator: somebody steers, and this node says so.
//!
//! It listens to the robot's `state`, which carries all that a human needs to see (the pose of the tool, whether the
//! robot moves and if not why, the setpoint it obeys with weight and guidance), and to the samples of a device in its
//! own process. It publishes `command`: a tool velocity, the deadman, and the newest state it has seen. From the
//! keyboard it also publishes `trial`, to begin a new one, and `estop`. With each press it says its name on `lease`, and on
//! leaving it gives the lease up; who holds it comes back with every state.
//!
//! | event | what follows |
//! | --- | --- |
//! | state | the source sees it; in lockstep the answer is one command of the same tick |
//! | device sample | keys count at once; a key asks for a new trial |
//! | sample of a recording | its velocity counts while the deadman is held; `tandem replay --drive` sends them |
//! | wake | in real time a command every stream period; a changed deadman does not wait for it |
//! | unreadable sample | counted |
//! | storage, presence of the recorder | the status line says whether the session is recorded |
//! | presence | nothing else: presence is not safety |
//! | stop | a last command with the deadman released, then silence |
//!
//! An emergency stop is called until a state acknowledges it, and again to a robot that was started anew without one
//! (`alarm.rs`).
//!
//! The first command is always released, and so is every command while there is no picture: a human who sees nothing
//! does not drive. After any stop, motion needs a fresh press, which has a number of its own.
//!
//! ```text
//!                        states arrive
//!            ┌─────────────────────────────────────┐
//!            │                                     ▼
//!  released: no picture                    the source decides:
//!            ▲                             simulated human (see `human.rs`), keys on a
//!            │                             device (`device.rs`), a recording (`played.rs`)
//!            └─────────────────────────────────────┘
//!                 silence of the stream timeout
//! ```
//!
//! It refuses to know how its command is weighed, which limits apply, and what the robot will make of it. It holds no
//! clock, no entropy, no I/O; the terminal behind feature `terminal` shares nothing with it but the samples' format.
//!
//! Start reading in `node.rs`; then `human.rs` and `policy.rs` for the simulated human, `family.rs` and `wish.rs` for
//! where it wants to go.

#![forbid(unsafe_code)]

mod alarm;
mod config;
mod device;
mod family;
mod hand;
mod human;
#[cfg(feature = "terminal")]
pub mod keyboard;
mod node;
mod played;
mod policy;
mod ports;
mod random;
mod sight;
mod source;
mod status;
mod wish;

pub use config::{HumanKind, HumanSettings, Label, OperatorSettings, SourceKind};
pub use device::{DeviceSample, Keys, SAMPLE_PERIOD};
pub use family::{CHECKPOINT_STEP, FamilyPath, LAST_STEP};
pub use hand::Handling;
pub use human::{Doing, Ended, Waiting};
pub use node::{Event, Operator, Output};
pub use played::PlayedSample;
pub use sight::Seen;
pub use status::{Activity, Recording, Status};
