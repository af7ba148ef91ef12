//! What is done with whole sessions, and what it takes to build the nodes of one.
//!
//! [`Configuration`] is everything that can be set; a [`Blueprint`] makes nodes of it. Commands that run nodes and
//! commands that execute a recorded session again build them here, so that both build the same.
//!
//! [`reexecute`](fn@reexecute) does the second: it feeds every node of a recording its own journal and says whether
//! the same came out.
//!
//! [`stops`] says how a recorded robot stopped, to the millisecond.
//!
//! [`drive`] leads a live robot along a recorded path, as an operator's hand would.
//!
//! A [`Tracer`] follows one trial and makes a [`Trace`] of it; [`Measures`] are its figures.
//!
//! [`World`] runs a trial of these nodes under virtual time, in one thread and without a network.
//!
//! [`what_if`](fn@what_if) lets a recorded human meet another law or model in such a world.
//!
//! [`sweep`] runs the same trials under many laws, on all cores.
//!
//! [`Plan`](plan::Plan) is an experiment as it was written down, [`run`] the folder that holds what became of it.
//!
//! The crate refuses to know flags, terminals and exit codes: those belong to the command line. It reads no clock.
//!
//! Start reading at [`Blueprint`], then `reexecute.rs`.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod again;
mod blueprint;
mod configuration;
pub mod drive;
mod fields;
mod latency;
mod measures;
pub mod plan;
mod reexecute;
pub mod report;
pub mod run;
mod smoothness;
pub mod statistics;
pub mod stops;
pub mod sweep;
pub mod trace;
mod tracer;
mod verdict;
pub mod what_if;
pub mod world;

pub use blueprint::{Blueprint, Unbuildable};
pub use configuration::Configuration;
pub use fields::{EPSILON, FieldDifference};
pub use latency::Quantiles;
pub use measures::Measures;
pub use reexecute::reexecute;
pub use smoothness::sparc;
pub use trace::Trace;
pub use tracer::Tracer;
pub use verdict::{Difference, Divergence, Findings, Missing, Overall, RunFinding, Verdict};
pub use what_if::what_if;
pub use world::{Halt, Player, Seat, World};
