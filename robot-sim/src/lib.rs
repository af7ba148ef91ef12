//! The robot: a Franka Emika Panda, kinematic, with a tool that points down, among obstacles.
//!
//! It hears setpoints and trials, and publishes what the arm does and what stands around it. Between two events it
//! integrates its 1 kHz loop up to the present, so it needs no timer of its own and repeats exactly.
//!
//! | event | what follows |
//! | --- | --- |
//! | setpoint | checked for loop age, sender and order; taken up by the next plan, at most 10 ms later, if a press permits it |
//! | trial | begins: the arm is put at the start as soon as it stands; ends: motion is held |
//! | emergency | latched: the arm is brought to rest and held until it is cleared by its name, and pressed afresh |
//! | wake | state and scene are published when they are due |
//! | unreadable sample | counted |
//! | presence | nothing: a token may outlive the one it speaks of |
//! | stop | `Held(ShuttingDown)`, and the states of the ramp that brings the arm to rest |
//!
//! It is the last hop, so it trusts nobody before it. Motion needs a running trial and a fresh press, seen here; a stream of setpoints that
//! falls silent, the end of a trial or the wish to stop brings the tool to rest along its path, and then the joints:
//!
//! ```text
//!                     setpoint with a fresh press
//!   ┌─ Held(reason) ───────────────────────────────▶ Permitted(press) ─┐
//!   │    │       ▲                                       │             │ follows the
//!   │    ▼       └── silence, held setpoint, ────────────┘             │ setpoint
//!   │  ramps down, then stands    end of trial, stop                   │
//!   └──────────────────── stop ──────▶ Closed ◀─────── stop ───────────┘
//! ```
//!
//! In lockstep the robot owns the tick: the first trial makes it publish state 0, each setpoint of tick `k` moves the
//! arm by a whole control period and is answered with state `k + 1`, and a later trial begins at the next tick.
//!
//! It refuses to know who made a setpoint, why, and what time it is; forces, motors and gravity, for the arm follows
//! its joint speeds exactly; and what contact would do, which it reports and does not simulate.
//!
//! Start reading at [`RobotSim`]; the arm itself is in [`arm`], its numbers and their source in [`panda`].

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod arm;
mod cholesky;
mod config;
mod hearing;
mod inner;
pub mod kinematics;
mod node;
pub mod panda;
mod ports;
mod pulse;
mod report;
pub mod scene;
mod trials;

pub use config::{LinkName, RobotSimSettings, UnusableScene};
pub use node::{Event, Output, RobotSim};
