//! The predictor: forecasts where the movement goes and how sure it is, and proposes the velocity that leads there.
//!
//! It hears states. It answers each with a proposal, and each new condition with a forecast.
//!
//! | event | what follows |
//! | --- | --- |
//! | state, first of a tick | the checkpoint is looked for, or the phase advances; a proposal |
//! | the same, the model takes conditions at any time | while motion is permitted, a forecast from here; a proposal |
//! | state, later in a tick | the same velocity again: decisions keep the control rate |
//! | state of a new trial | everything about the one before is forgotten; a proposal |
//! | state, late or repeated | dropped and counted |
//! | unreadable sample | counted |
//! | wake, presence, stop | nothing; whoever waits for proposals notices their absence |
//!
//! ```text
//!            plane crossed                      last step reached
//!   Waiting ───────────────▶ Guiding, phase < last ──────────▶ Guiding, phase = last: holds the last position
//!      ▲                           │                                   │
//!      └──────── new trial ────────┴───────────────────────────────────┘
//! ```
//!
//! A proposal without guidance still says that the predictor is there. A forecast does not age; its proposals do.
//!
//! It refuses to know the human's command, the weight, whether anybody follows its proposals, and how the model came
//! to be. Equations and intervals are `tandem-cesn`'s; the task's plane is the only geometry here.
//!
//! Start reading at [`Predictor`]; then `checkpoint.rs` for when, `forecast.rs` for what.

#![forbid(unsafe_code)]

mod checkpoint;
mod config;
mod forecast;
mod node;
mod ports;

pub use config::{PredictorSettings, UnfitModel};
pub use node::{Event, Output, Predictor};
