//! What a journal holds: everything a node saw, in the order it saw it, and everything it answered.

use bincode::{Decode, Encode};

use crate::codec::Message;
use crate::{Input, NodeName, Session, Stamp, Topic};

/// One entry of a journal.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
pub struct JournalEntry {
    /// The node's own time, which it was stepped with: virtual in lockstep.
    pub at: Stamp,
    /// The monotonic clock of the process.
    pub wall: Stamp,
    /// What happened.
    pub what: Happening,
}

/// What an entry is about.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
pub enum Happening {
    /// Bytes arrived.
    Sample {
        /// On which topic.
        topic: Topic,
        /// The bytes.
        bytes: Vec<u8>,
    },
    /// The node's deadline came.
    Wake,
    /// A peer appeared or vanished.
    Presence {
        /// Which peer.
        peer: NodeName,
        /// Whether it is there.
        alive: bool,
    },
    /// The process was asked to end.
    Stop,
    /// The node answered.
    Output {
        /// On which topic.
        topic: Topic,
        /// The bytes.
        bytes: Vec<u8>,
    },
    /// What the node carried between the entries before and behind this one: whoever lacks the entries before can
    /// execute from here on.
    Snapshot {
        /// See [`snapshot`](crate::snapshot()).
        bytes: Vec<u8>,
    },
    /// In lockstep: the sample of a tick did not come in time; see [`Input::Missed`].
    Missed {
        /// Whose sample.
        topic: Topic,
        /// Which tick's.
        tick: u32,
    },
}

impl Happening {
    /// What the node was stepped with; `None` for what it answered, and what it carried.
    #[must_use]
    pub fn input(&self) -> Option<Input<'_>> {
        Some(match self {
            Self::Sample { topic, bytes } => Input::Sample { topic: *topic, bytes },
            Self::Wake => Input::Wake,
            Self::Presence { peer, alive } => Input::Presence {
                peer: *peer,
                alive: *alive,
            },
            Self::Stop => Input::Stop,
            Self::Missed { topic, tick } => Input::Missed {
                topic: *topic,
                tick: *tick,
            },
            Self::Output { .. } | Self::Snapshot { .. } => return None,
        })
    }
}

impl From<Input<'_>> for Happening {
    fn from(input: Input<'_>) -> Self {
        match input {
            Input::Sample { topic, bytes } => Self::Sample {
                topic,
                bytes: bytes.to_vec(),
            },
            Input::Wake => Self::Wake,
            Input::Presence { peer, alive } => Self::Presence { peer, alive },
            Input::Stop => Self::Stop,
            Input::Missed { topic, tick } => Self::Missed { topic, tick },
        }
    }
}

/// Asks a node for entries of its journal. The answer is a [`JournalBatch`] with sequence number 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Question {
    /// Whose journal.
    pub node: NodeName,
    /// Which run of it.
    pub session: Session,
    /// The first entry wanted. Whoever asks from the end of a journal says so that everything before is there.
    pub first: u64,
    /// The last one; an answer may end before it, and whoever wants the rest asks again.
    pub last: u64,
}

/// Some consecutive entries of one node's journal.
///
/// In the node's own stream, which is numbered from 1, a batch without entries says how far the journal goes. In an
/// answer to a [`Question`], entries that are asked for and lie before `first` cannot be had any more.
#[derive(Clone, Debug, Default, PartialEq, Encode, Decode)]
pub struct JournalBatch {
    /// The index of the first entry, from 0.
    pub first: u64,
    /// Entries that were lost before this batch because the journal could not keep up.
    pub lost: u64,
    /// The entries.
    pub entries: Vec<JournalEntry>,
}

impl Message for JournalBatch {
    const KIND: u8 = Topic::Journal(NodeName::Operator).kind();
    const MAX_BYTES: usize = 1 << 22;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_input_comes_out_of_a_journal_as_it_went_in() {
        let (topic, bytes) = (Topic::State, &[7_u8, 8][..]);
        let inputs = [
            Input::Sample { topic, bytes },
            Input::Wake,
            Input::Presence {
                peer: NodeName::Arbiter,
                alive: true,
            },
            Input::Stop,
            Input::Missed { topic, tick: 3 },
        ];
        for input in inputs {
            assert_eq!(Happening::from(input).input(), Some(input));
        }
        let bytes = bytes.to_vec();
        assert_eq!(Happening::Snapshot { bytes: bytes.clone() }.input(), None);
        assert_eq!(Happening::Output { topic, bytes }.input(), None);
    }
}
