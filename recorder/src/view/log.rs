//! The notes that a person reads beside the picture.

use tandem_wire::{Stamp, Trial};

use super::Sheet;
use crate::heard::{Level, Note};

/// Which notes are worth a line now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Log {
    /// No trial runs: that the arm stands, and that nodes come and go, is the course of things. The session file has
    /// these notes all the same. That a clock is wrong or a disk is full is news at any time.
    #[default]
    Quiet,
    /// A trial runs: everything counts.
    Open,
    /// The trial ended at this time; what is said of its end comes at the same.
    Closing(Stamp),
}

impl Log {
    pub(super) const fn hear(&mut self, at: Stamp, trial: &Trial) {
        *self = match trial {
            Trial::Begin { .. } => Self::Open,
            Trial::End { .. } => Self::Closing(at),
        };
    }

    pub(super) fn draw(&mut self, at: Stamp, note: &Note, sheet: &mut Sheet<'_>) {
        if let Self::Closing(ended) = *self
            && at > ended
        {
            *self = Self::Quiet;
        }
        if *self == Self::Quiet && note.is_routine && note.level != Level::Error {
            return;
        }
        let level = match note.level {
            Level::Info => rerun::TextLogLevel::INFO,
            Level::Warning => rerun::TextLogLevel::WARN,
            Level::Error => rerun::TextLogLevel::ERROR,
        };
        sheet.draw("log", &rerun::TextLog::new(note.to_string()).with_level(level));
    }
}
