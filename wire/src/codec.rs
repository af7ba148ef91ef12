//! Versioned bytes ⇄ message.
//!
//! Every message is a header of 32 bytes, little-endian, and a body in bincode 2's format with fixed-width
//! little-endian integers:
//!
//! | bytes | field |
//! | --- | --- |
//! | 0 | version of this layout, [`VERSION`] |
//! | 1 | kind of message, [`Topic::kind`](crate::Topic::kind) |
//! | 2–3 | zero |
//! | 4–7 | tick: control periods since the robot started |
//! | 8–15 | session of the sender |
//! | 16–23 | sequence number in this stream |
//! | 24–31 | when it was sent, nanoseconds on the sender's clock |

use bincode::error::DecodeError;
use bincode::{Decode, Encode};

use crate::geometry::NOT_FINITE;
use crate::{MessageId, Seq, Session, Stamp};

/// The version of the byte layout. Changes with any change of a message.
pub const VERSION: u8 = 4;
/// The length of the header.
pub const HEADER_BYTES: usize = 32;

/// No message is longer than this, so no claim inside one can make us reserve more.
const BODY_LIMIT: usize = 16 * 1024 * 1024;

/// What stands in front of every message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub struct Header {
    /// Control periods since the robot started; ticks never restart within a session of the robot.
    pub tick: u32,
    /// The sender's run.
    pub session: Session,
    /// The place in this stream, from 1.
    pub seq: Seq,
    /// When it was sent, by the sender's clock: for measuring, never for safety.
    pub sent: Stamp,
}

impl Header {
    /// The message's exact name.
    #[must_use]
    pub const fn id(&self) -> MessageId {
        MessageId {
            session: self.session,
            seq: self.seq,
        }
    }
}

/// A message with its header.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct Envelope<M> {
    /// Who, which and when.
    pub header: Header,
    /// What.
    pub body: M,
}

/// A kind of message: what it is called and how long it may be.
pub trait Message: Encode + Decode<()> {
    /// The header's kind byte.
    const KIND: u8;
    /// The longest that an honest sender makes it, header included.
    const MAX_BYTES: usize;
}

/// Why bytes are not a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Malformed {
    /// Shorter than its header or than its body claims.
    #[error("truncated after {0} bytes")]
    Truncated(usize),
    /// Longer than this kind of message can be.
    #[error("{0} bytes are too many for this kind of message")]
    Oversized(usize),
    /// Another version of the layout.
    #[error("layout version {0}, this build speaks version {VERSION}")]
    Version(u8),
    /// Another kind of message than the key says.
    #[error("message of kind {found} under the key of kind {expected}")]
    Kind {
        /// What the key promises.
        expected: u8,
        /// What the header says.
        found: u8,
    },
    /// NaN or infinity where a number belongs.
    #[error("{NOT_FINITE}")]
    NotFinite,
    /// A body that does not follow the layout.
    #[error("a body that does not follow the layout")]
    Body,
    /// Bytes left over behind the body.
    #[error("{0} bytes too many behind the body")]
    Trailing(usize),
    /// A word that has no force under the key that it came on.
    #[error("a word that has no force under this key")]
    Key,
    /// A topic that this node does not listen to.
    #[error("not a topic of this node")]
    Topic,
}

fn configuration() -> impl bincode::config::Config {
    bincode::config::standard()
        .with_little_endian()
        .with_fixed_int_encoding()
        .with_limit::<BODY_LIMIT>()
}

/// Writes a message into `bytes`, clearing them first. Allocates only while `bytes` still grows.
pub fn encode<M: Message>(message: &Envelope<M>, bytes: &mut Vec<u8>) {
    bytes.clear();
    let header = &message.header;
    bytes.extend_from_slice(&[VERSION, M::KIND, 0, 0]);
    bytes.extend_from_slice(&header.tick.to_le_bytes());
    bytes.extend_from_slice(&header.session.0.to_le_bytes());
    bytes.extend_from_slice(&header.seq.0.to_le_bytes());
    bytes.extend_from_slice(&header.sent.0.to_le_bytes());
    append(&message.body, bytes);
}

/// Reads a message, refusing whatever its layout does not promise.
///
/// # Errors
/// Says the first thing that is wrong; see [`Malformed`].
pub fn decode<M: Message>(bytes: &[u8]) -> Result<Envelope<M>, Malformed> {
    if bytes.len() > M::MAX_BYTES {
        return Err(Malformed::Oversized(bytes.len()));
    }
    let (kind, header) = peek(bytes)?;
    if kind != M::KIND {
        return Err(Malformed::Kind {
            expected: M::KIND,
            found: kind,
        });
    }
    let body = &bytes[HEADER_BYTES..];
    let (value, used) =
        bincode::decode_from_slice(body, configuration()).map_err(|error| malformed(&error, bytes.len()))?;
    if used == body.len() {
        Ok(Envelope { header, body: value })
    } else {
        Err(Malformed::Trailing(body.len() - used))
    }
}

/// Reads the kind and the header alone.
///
/// # Errors
/// If the bytes are too short, of another version, or the reserved bytes are not zero.
pub fn peek(bytes: &[u8]) -> Result<(u8, Header), Malformed> {
    let Some(head) = bytes.first_chunk::<HEADER_BYTES>() else {
        return Err(Malformed::Truncated(bytes.len()));
    };
    if head[0] != VERSION {
        return Err(Malformed::Version(head[0]));
    }
    if head[2] != 0 || head[3] != 0 {
        return Err(Malformed::Body);
    }
    let word = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| head[at + i]));
    let header = Header {
        tick: u32::from_le_bytes(std::array::from_fn(|i| head[4 + i])),
        session: Session(word(8)),
        seq: Seq(word(16)),
        sent: Stamp(word(24)),
    };
    Ok((head[1], header))
}

fn malformed(error: &DecodeError, length: usize) -> Malformed {
    match error {
        DecodeError::UnexpectedEnd { .. } => Malformed::Truncated(length),
        DecodeError::Other(NOT_FINITE) => Malformed::NotFinite,
        DecodeError::LimitExceeded => Malformed::Oversized(length),
        _ => Malformed::Body,
    }
}

/// Writes a value in the body's format behind what is there.
pub(crate) fn append<T: Encode>(value: &T, bytes: &mut Vec<u8>) {
    bincode::encode_into_std_write(value, bytes, configuration())
        .expect("our types hold no borrowed cells or locks, and a Vec takes every byte");
}

/// Reads a value in the body's format from the front of `bytes`, which moves on behind it.
pub(crate) fn take<T: Decode<()>>(bytes: &mut &[u8]) -> Result<T, Malformed> {
    let (value, used) =
        bincode::decode_from_slice(bytes, configuration()).map_err(|error| malformed(&error, bytes.len()))?;
    *bytes = bytes.get(used..).unwrap_or_default();
    Ok(value)
}

/// Writes a value in the body's format, for what is stored rather than sent.
///
/// # Panics
/// Never for the types of this crate, which hold no borrowed cells or locks.
#[must_use]
pub fn to_bytes<T: Encode>(value: &T) -> Vec<u8> {
    bincode::encode_to_vec(value, configuration()).expect("our types hold no borrowed cells or locks")
}

/// Reads a value written by [`to_bytes`].
///
/// # Errors
/// If the bytes do not follow the layout or do not end with it.
pub fn from_bytes<T: Decode<()>>(bytes: &[u8]) -> Result<T, Malformed> {
    let (value, used) =
        bincode::decode_from_slice(bytes, configuration()).map_err(|error| malformed(&error, bytes.len()))?;
    if used == bytes.len() {
        Ok(value)
    } else {
        Err(Malformed::Trailing(bytes.len() - used))
    }
}
