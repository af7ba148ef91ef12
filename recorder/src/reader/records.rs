//! An MCAP file's records, one after the other, however damaged the file is.
//!
//! The format's crate reads whole files; here every outer record is framed by hand, so that a chunk that cannot be
//! unpacked costs its own messages and no others, and of a chunk that was cut short what came before the cut is read.

use std::fmt;

use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

/// Opcode and length, in front of every record.
const FRAME: usize = 9;
/// No chunk of ours is larger by far; a damaged length must not reserve gigabytes.
const CHUNK_LIMIT: usize = 256 << 20;

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

/// Hands over every record of the data section, those in chunks included, in the order of the file.
pub(super) fn walk(file: &[u8], mut take: impl FnMut(Record<'_>)) -> Result<Vec<Damage>, ReadError> {
    let mut damage = Vec::new();
    frames(file, &mut damage, |at, frame, is_whole, in_data, damage| {
        let opcode = frame[0];
        if !in_data {
            return;
        }
        let read = match (opcode, is_whole) {
            (op::CHUNK, true) => unpack(frame, true, &mut take).err().map(|error| Damage::Chunk {
                at,
                why: error.to_string(),
            }),
            (opcode, false) => {
                if opcode == op::CHUNK {
                    // How it ends is known: it was cut. What came before the cut has been taken.
                    let _ = unpack(frame, false, &mut take);
                }
                Some(Damage::Truncated { at })
            }
            (_, true) => match parse(opcode, &frame[FRAME..]) {
                Some(record) => {
                    take(record);
                    None
                }
                None => Some(Damage::Record { at }),
            },
        };
        damage.extend(read);
    })?;
    Ok(damage)
}

/// The schemas and channels as the summary repeats them: for files whose first chunk is lost.
pub(super) fn summary(file: &[u8], mut take: impl FnMut(Record<'_>)) {
    // What is damaged is said by `walk`.
    let _ = frames(file, &mut Vec::new(), |_, frame, is_whole, in_data, _| {
        if is_whole && !in_data && matches!(frame[0], op::SCHEMA | op::CHANNEL) {
            parse(frame[0], &frame[FRAME..]).into_iter().for_each(&mut take);
        }
    });
}

/// Frames the outer records: where each begins, its bytes, whether it is whole, whether it lies in the data section.
fn frames(
    file: &[u8],
    damage: &mut Vec<Damage>,
    mut take: impl FnMut(usize, &[u8], bool, bool, &mut Vec<Damage>),
) -> Result<(), ReadError> {
    if file.is_empty() {
        return Err(ReadError::Empty);
    }
    if !file.starts_with(mcap::MAGIC) {
        return Err(ReadError::NotMcap);
    }
    let (mut at, mut in_data, mut footer) = (mcap::MAGIC.len(), true, false);
    while at < file.len() && !footer {
        let rest = &file[at..];
        if !is_known(rest[0]) {
            damage.push(Damage::Garbage { at });
            return Ok(());
        }
        let length = rest.get(1..FRAME).and_then(|bytes| bytes.try_into().ok());
        let length = length
            .map(u64::from_le_bytes)
            .and_then(|length| usize::try_from(length).ok());
        let end = length.and_then(|length| length.checked_add(FRAME));
        in_data &= rest[0] != op::DATA_END && rest[0] != op::FOOTER;
        match end.and_then(|end| rest.get(..end)) {
            Some(frame) => take(at, frame, true, in_data, damage),
            None => {
                take(at, rest, false, in_data, damage);
                if !in_data {
                    damage.push(Damage::NotClosed);
                }
                return Ok(());
            }
        }
        footer = rest[0] == op::FOOTER;
        at = at.saturating_add(end.unwrap_or(usize::MAX));
    }
    if !footer || file.get(at..) != Some(mcap::MAGIC) {
        damage.push(Damage::NotClosed);
    }
    Ok(())
}

/// The format's own opcodes, and those it leaves to others.
const fn is_known(opcode: u8) -> bool {
    matches!(opcode, op::HEADER..=op::DATA_END | 0x80..)
}

/// Unpacks a chunk. A whole one is checked first; of one cut short, everything before the cut is taken.
fn unpack(frame: &[u8], is_whole: bool, take: &mut impl FnMut(Record<'_>)) -> Result<(), McapError> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_record_length_limit(CHUNK_LIMIT)
        .with_prevalidate_chunk_crcs(is_whole);
    let mut reader = LinearReader::new_with_options(options);
    let mut rest = frame;
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(wanted) => {
                let (given, left) = rest.split_at(wanted.min(rest.len()));
                reader.insert(given.len()).copy_from_slice(given);
                reader.notify_read(given.len());
                rest = left;
            }
            LinearReadEvent::Record { data, opcode } => {
                parse(opcode, data).into_iter().for_each(&mut *take);
            }
        }
    }
    Ok(())
}

/// A record that matters to us; `None` if it does not follow the format.
fn parse(opcode: u8, body: &[u8]) -> Option<Record<'_>> {
    // The format's crate takes the checksum's four bytes for granted.
    if opcode == op::ATTACHMENT && attachment_head(body)?.checked_add(4)? > body.len() {
        return None;
    }
    mcap::parse_record(opcode, body).ok()
}

/// How long an attachment's head is: two times, name, kind, length.
fn attachment_head(body: &[u8]) -> Option<usize> {
    let text = |at: usize| -> Option<usize> {
        let length = u32::from_le_bytes(body.get(at..at.checked_add(4)?)?.try_into().ok()?);
        at.checked_add(4)?.checked_add(usize::try_from(length).ok()?)
    };
    text(text(16)?)?.checked_add(8)
}
