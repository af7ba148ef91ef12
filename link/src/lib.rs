//! The shell around Tandem's nodes: the only crate that names Zenoh.
//!
//! A node is pure; somebody has to own the clock, the sockets and the threads. [`spawn`](spawn()) puts a node to work. Whatever
//! comes for it is written down, then the node is stepped, and what it answers is published and written down, too. What was
//! written down is the node's journal, which a thread of its own sends to whoever records.
//!
//! ```text
//!   Zenoh callbacks ──▶ queue ──▶ [ journal · step · publish · journal ] ──▶ Zenoh
//!                                        └──▶ journal thread ──▶ spool, Zenoh (bulk)
//!                                                               └──▶ answers to a recorder that lacks some (bulk)
//!   clock thread: pings, answers, offsets ──▶ Zenoh (background)
//! ```
//!
//! On which thread a step is taken is the node's choice ([`Turn`](tandem_wire::Turn)): operator, arbiter and robot are stepped
//! where a message arrives, so that a command becomes motion without a thread being woken in between.
//!
//! In real time `now` is the process's monotonic clock, streams go out express with real-time priority and may be
//! dropped, and the queue drops (and counts) rather than blocks. In lockstep `now` is the tick in a message's header
//! times the control period, and everything blocks, so that nothing is lost and time passes as fast as messages do.
//!
//! The shell refuses to know what a message means: it reads headers in lockstep and nothing else.
//!
//! Start reading at [`spawn`](mod@spawn), then `shell`; `real` and `lockstep` are its two loops. [`net`] opens sessions, [`config`] says where to, [`reach`] what Zenoh is told of it.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod answer;
mod arrival;
pub mod clock;
mod clocks;
pub mod config;
mod declared;
mod dropped;
mod entrance;
mod faults;
pub mod impairment;
mod journal;
mod lockstep;
pub mod net;
mod network;
mod observer;
mod player;
mod rank;
pub mod reach;
mod real;
pub mod refusals;
mod running;
mod shell;
pub mod spawn;
mod spool;
mod verdict;
pub mod yardstick;

pub use arrival::Arrival;
pub use clock::{Clock, fresh_session};
pub use clocks::{DRIFT_PPM, Estimate, Estimator, Exchange, Taken, WINDOW, measure_clocks};
pub use config::{ClockSettings, LinkSettings, LoopSettings, PaceName, TaskSettings};
pub use dropped::Dropped;
pub use faults::Faults;
pub use impairment::{Direction, Impairment, ImpairmentSettings, Impairments, LineSettings};
pub use journal::JournalReport;
pub use lockstep::lockstep_now;
pub use net::{Link, LinkError};
pub use network::{Network, Noticed};
pub use observer::{Observer, Sighting};
pub use player::Player;
pub use rank::stand_back;
pub use reach::Reach;
pub use running::{Device, Report, Running, ShellOptions};
pub use spawn::spawn;
pub use spool::SpoolOptions;
