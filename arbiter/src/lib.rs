//! The arbiter: blends the human's command with the robot's proposal by how sure the forecast is.
//!
//! It hears commands, proposals and states, and publishes setpoints. A setpoint is one arbitration and the whole
//! record of why it came out so: `velocity = limits(ω·human + (1 − ω)·robot)`, with `ω` the human's weight.
//!
//! | event | what follows |
//! | --- | --- |
//! | command | checked for loop age, sender and order; then the deadman is looked at, and a setpoint answers at once |
//! | claim | an operator gives the lease up, or a supervisor takes it over |
//! | emergency | latched: motion is held until it is cleared by its name |
//! | proposal | the same checks; then it serves until the next one, or until the stream is lost |
//! | state | tells the tool's place for the workspace, the tick for decisions, and the trial |
//! | wake | a stream fell silent, or it is time to repeat that motion is held |
//! | unreadable sample | counted |
//! | presence | nothing: a token may outlive the one it speaks of |
//! | stop | one last setpoint, `Held(ShuttingDown)` |
//!
//! Who is in charge is a state machine, [`Authority`]:
//!
//! ```text
//!             fresh press             a forecast's guidance
//!   Held(why) ───────────▶ Human(press) ──────────────────▶ Shared(press)
//!       ▲                   │     ▲                           │   │
//!       └─ release or loss ─┘     └─ proposals lost ──────────┘   │
//!       └──────────────────────── release or loss ────────────────┘
//!   any of them ── stop ──▶ Closed
//! ```
//!
//! Of several operators one holds the lease (`lease.rs`): the first to press while nobody does. The others are refused and
//! counted when they press, and see in every state who drives.
//!
//! In lockstep it waits until state, command and proposal of one tick are there, in whichever order they came, and
//! answers once; nothing is lost by the clock, because time stands still while it waits.
//!
//! It refuses to know where proposals come from, what a forecast is made of, how the arm moves, and what time it is.
//! Whether the robot truly stops is checked again by the robot itself.
//!
//! Start reading at [`Arbiter`]; the laws are in `weight.rs`, the limits in `limits.rs`.

#![forbid(unsafe_code)]

mod authority;
mod barrier;
mod config;
mod hearing;
mod lease;
mod limits;
mod node;
mod ports;
mod weight;

pub use authority::Authority;
pub use config::{ArbiterSettings, LawName, WorkspaceTurnedOver};
pub use node::{Arbiter, Event, Output};
