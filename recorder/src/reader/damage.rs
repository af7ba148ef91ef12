//! What can be wrong with a session file, in words.

use std::fmt;
use std::io::{self, ErrorKind};

/// Why a file is no session at all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReadError {
    /// Nothing in it.
    #[error("the file is empty")]
    Empty,
    /// It does not begin as MCAP files do.
    #[error("this is no MCAP file")]
    NotMcap,
    /// An MCAP file that no recorder of ours began, or one cut before anything was written.
    #[error("this MCAP file holds no session: it has no record \"tandem.session\" and no channel tandem/<robot>/…")]
    NoSession,
    /// The system would not read it to the end.
    #[error("the system cannot read it: {0}")]
    System(ErrorKind),
}

impl From<io::Error> for ReadError {
    fn from(error: io::Error) -> Self {
        Self::System(error.kind())
    }
}

/// Something that is missing or cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Damage {
    /// The file ends in the middle of a record.
    Truncated {
        /// Where that record begins, in bytes.
        at: usize,
    },
    /// The file ends without its closing records: it was not closed.
    NotClosed,
    /// A chunk cannot be unpacked; its messages are lost.
    Chunk {
        /// Where it begins, in bytes.
        at: usize,
        /// What is wrong with it.
        why: String,
    },
    /// A record does not follow the format.
    Record {
        /// Where it begins, in bytes.
        at: usize,
    },
    /// Something that is no record: what follows cannot be told apart.
    Garbage {
        /// From here on, in bytes.
        at: usize,
    },
    /// Messages on a channel that was never introduced, because its introduction is lost.
    UnknownChannel {
        /// How many.
        messages: u64,
    },
    /// The messages inside follow another layout than this build reads.
    OtherLayout {
        /// Which one.
        version: String,
    },
    /// Messages that were heard, but are in no journal, so that their bytes are lost.
    WithoutBody {
        /// How many.
        messages: u64,
    },
    /// A file that belongs to another session than the first one; it is left out.
    OtherSession,
    /// Something in one of several files.
    InPart {
        /// Which of them, from 1.
        part: usize,
        /// What.
        what: Box<Damage>,
    },
    /// Parts of journals that cannot be decoded.
    Journal {
        /// How many.
        parts: u64,
    },
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Truncated { at } => write!(f, "the file ends in the middle of the record at byte {at}"),
            Self::NotClosed => f.write_str("the file was not closed: it has no index and no closing counts"),
            Self::Chunk { at, why } => write!(f, "the chunk at byte {at} cannot be unpacked ({why}); it is left out"),
            Self::Record { at } => write!(f, "the record at byte {at} cannot be read; it is left out"),
            Self::Garbage { at } => write!(f, "from byte {at} on there are no records"),
            Self::UnknownChannel { messages } => {
                write!(
                    f,
                    "{messages} messages are on channels that the file does not introduce"
                )
            }
            Self::OtherLayout { version } => write!(
                f,
                "its messages have layout version {version}, and this build reads version {}",
                tandem_wire::codec::VERSION
            ),
            Self::WithoutBody { messages } => {
                write!(
                    f,
                    "{messages} messages were heard but stand in no journal, so they cannot be played"
                )
            }
            Self::OtherSession => f.write_str("this is part of another session; it is left out"),
            Self::InPart { part, what } => write!(f, "part {part}: {what}"),
            Self::Journal { parts } => write!(f, "{parts} parts of journals cannot be decoded"),
        }
    }
}
