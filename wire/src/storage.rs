//! How well the session file is kept: the recorder's word for whoever should know that evidence is being lost.

use std::fmt;

use bincode::{Decode, Encode};

use crate::Topic;
use crate::codec::Message;

/// How the session file is doing. Nothing is decided by it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub struct Storage {
    /// What is the matter, if anything is.
    pub condition: Condition,
    /// Messages that never reached the session file, since the recorder began.
    pub dropped: u64,
}

/// What is the matter with the session file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub enum Condition {
    /// Nothing: what arrives is kept.
    #[default]
    Kept,
    /// The disk or the processor is too slow: some of what arrives is dropped.
    Behind,
    /// The disk is full: nothing is kept until there is room again.
    NoSpace,
    /// The file cannot be written for another reason: nothing is kept until it can.
    Failing,
}

impl fmt::Display for Condition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Kept => "the session is recorded",
            Self::Behind => "the recorder falls behind",
            Self::NoSpace => "NOT recorded, the recorder's disk is full",
            Self::Failing => "NOT recorded, the session file cannot be written",
        })
    }
}

impl fmt::Display for Storage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.dropped {
            0 => self.condition.fmt(f),
            1 => write!(f, "{}, 1 message lost", self.condition),
            dropped => write!(f, "{}, {dropped} messages lost", self.condition),
        }
    }
}

impl Message for Storage {
    const KIND: u8 = Topic::Storage.kind();
    const MAX_BYTES: usize = 64;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trouble_is_told_in_words_with_what_it_cost() {
        let storage = Storage {
            condition: Condition::NoSpace,
            dropped: 12,
        };
        assert_eq!(
            storage.to_string(),
            "NOT recorded, the recorder's disk is full, 12 messages lost"
        );
        assert_eq!(Storage::default().to_string(), "the session is recorded");
    }
}
