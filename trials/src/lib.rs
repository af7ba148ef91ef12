//! What is done with whole sessions, and what it takes to build the nodes of one.
//!
//! [`Configuration`] is everything that can be set; a [`Blueprint`] makes nodes of it. Commands that run nodes and
//! commands that execute a recorded session again build them here, so that both build the same.
//!
//! The crate refuses to know flags, terminals and exit codes: those belong to the command line. It reads no clock.
//!
//! Start reading at [`Blueprint`].

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod blueprint;
mod configuration;

pub use blueprint::{Blueprint, Unbuildable};
pub use configuration::Configuration;
