//! The same trials under many laws: human × departure × law × seed × context, under virtual time.
//!
//! A [`Grid`] says which; a [`Cell`] is one human, departure, law and seed with all contexts of the grid, and the unit
//! in which work is done, kept and resumed. Every law meets the same humans: wish and tremor depend on seed and context
//! alone. [`Summary`] says what came of it, all of it, in a table and a figure.
//!
//! Three things are measured, all after the checkpoint: the human's *effort*, the *tracking error* of the tool, and the
//! smallest *clearance* from the obstacles. Where the human's wish differs from the forecast, tracking is two things,
//! and both are stated: the distance to the human's own wish, which is what the human came for, and the distance to
//! the forecast.

mod cell;
mod figure;
mod grid;
mod store;
mod summary;
mod words;

pub use cell::{Cell, CellResult, Run};
pub use figure::svg;
pub use grid::{BadGrid, Grid, LawEntry, SweepSettings};
pub use store::{Store, StoreError, work_off};
pub use summary::{Contest, Figure, Group, Region, Ruling, Summary, Verdict};
pub use words::{table, text};
