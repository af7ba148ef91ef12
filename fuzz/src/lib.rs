//! Bad input, a lot of it: whatever reads bytes from outside is fed what no honest sender would send.
//!
//! | target | what is tried | what must hold, besides that nothing panics |
//! | --- | --- | --- |
//! | `decoders` | every message's bytes, damaged; keys; a keyboard's samples | what is read is written again the same |
//! | `loop` | five nodes that talk through a network which loses, repeats, delays and damages | what a node says can be read; no node asks to be woken in the past |
//! | `cuts` | a session file, cut after every byte in turn | what is missing is said; no message is invented |
//! | `bytes` | the same file with bytes changed | a repaired file holds what could be read of the damaged one |
//! | `records` | the same file with whole records lost, repeated, swapped, rewritten, in chunks or bare | the same |
//! | `models` | a model file, damaged, its hash made right again | a model that is read forecasts without falling over |
//! | `settings` | a configuration file, damaged | what is read is shown and read back |
//!
//! Every case follows from a number, its seed: the same seed tries the same. No coverage guides it: `cargo-fuzz` needs
//! a nightly compiler, which this project does not ask of anybody. What stands in for guidance is where the cases
//! start from: golden messages, a real session file taken apart into its records, and a loop of real nodes that gets
//! as far as sharing control before something breaks.
//!
//! `cargo test -p tandem-fuzz` tries some thousand cases; `cargo run --release -p tandem-fuzz -- --seconds 60` goes on
//! as long as told. This crate is imported by nobody and may import everything, as `trials` may.
//!
//! Start reading at [`Target`].

#![forbid(unsafe_code)]
#![warn(missing_docs)]

use std::collections::BTreeMap;

mod chance;
pub mod corpus;
mod decoders;
mod files;
mod loops;
mod mutate;
mod records;
mod seeds;
mod texts;

pub use files::every_cut;

/// How many inputs went into what: into each decoder, into each node, or into the one thing that a target is about.
pub type Tried = BTreeMap<&'static str, u64>;

fn count(tried: &mut Tried, what: &'static str) {
    *tried.entry(what).or_default() += 1;
}

/// Something that is fed bad input.
pub trait Target {
    /// What the command line calls it.
    fn name(&self) -> &'static str;

    /// Tries the case of this seed, and counts its inputs.
    ///
    /// # Panics
    /// When what must hold does not: that is what it is for.
    fn run(&mut self, seed: u64, tried: &mut Tried);
}

/// Every target, ready to run.
#[must_use]
pub fn targets() -> Vec<Box<dyn Target>> {
    vec![
        Box::new(decoders::Decoders::new()),
        Box::new(loops::Loops::new()),
        Box::new(files::Cuts::new()),
        Box::new(files::Bytes::new()),
        Box::new(files::Records::new()),
        Box::new(texts::Models::new()),
        Box::new(texts::Settings::new()),
    ]
}
