//! The crate seen from outside, a story per module: one program, since each links everything below it.

mod drive;
mod filling;
mod plan;
mod reexecute;
mod report;
mod run;
mod snapshots;
mod statistics;
mod stops;
mod support;
mod sweep;
mod trace;
mod world;
