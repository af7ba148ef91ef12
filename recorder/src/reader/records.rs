//! An MCAP file's records, one after the other, however damaged the file is.
//!
//! The format's crate trusts the file it reads; here every outer record is framed by hand, so that a chunk that cannot be
//! unpacked costs its own messages and no others, and of a chunk that was cut short what came before the cut is read. One
//! outer record is held in memory at a time.

use std::io::{self, Read, Seek, SeekFrom};

use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::damage::{Damage, ReadError};

/// Opcode and length, in front of every record.
const FRAME: usize = 9;
/// No chunk of ours is larger by far; a damaged length must not reserve gigabytes.
const CHUNK_LIMIT: usize = 256 << 20;

/// Where a record stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Spot {
    /// Where the outer record begins, in bytes: the chunk, for a record inside one.
    pub(super) at: u64,
    /// Which record inside the chunk.
    pub(super) nth: u32,
}

/// Hands over every record of the data section, those in chunks included, in the order of the file.
pub(super) fn walk(
    file: &mut (impl Read + Seek),
    mut take: impl FnMut(Spot, Record<'_>),
) -> Result<Vec<Damage>, ReadError> {
    let mut damage = Vec::new();
    frames(
        file,
        &mut damage,
        |frame| frame.in_data,
        |frame, damage| {
            let read = match (frame.opcode(), frame.is_whole) {
                (op::CHUNK, true) => unpack(frame, &mut take).err().map(|error| Damage::Chunk {
                    at: frame.place(),
                    why: error.to_string(),
                }),
                (opcode, false) => {
                    if opcode == op::CHUNK {
                        // How it ends is known: it was cut. What came before the cut has been taken.
                        let _ = unpack(frame, &mut take);
                    }
                    Some(Damage::Truncated { at: frame.place() })
                }
                (opcode, true) => match parse(opcode, frame.body()) {
                    Some(record) => {
                        take(frame.spot(0), record);
                        None
                    }
                    None => Some(Damage::Record { at: frame.place() }),
                },
            };
            damage.extend(read);
        },
    )?;
    Ok(damage)
}

/// The schemas and channels as the summary repeats them: for files whose first chunk is lost.
pub(super) fn summary(file: &mut (impl Read + Seek), mut take: impl FnMut(Record<'_>)) {
    let is_wanted = |frame: &Frame| !frame.in_data && matches!(frame.opcode(), op::SCHEMA | op::CHANNEL);
    // What is damaged is said by `walk`.
    let _ = frames(file, &mut Vec::new(), is_wanted, |frame, _| {
        if frame.is_whole {
            parse(frame.opcode(), frame.body()).into_iter().for_each(&mut take);
        }
    });
}

/// Hands over the records of the one outer record that begins at `at`, as [`walk`] did.
pub(super) fn at(file: &mut (impl Read + Seek), at: u64, mut take: impl FnMut(Spot, Record<'_>)) -> io::Result<()> {
    let mut frame = Frame::default();
    let length = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(at))?;
    frame.read_head(file, at, length)?;
    frame.read_body(file)?;
    match frame.opcode() {
        // What is broken in it was said when it was walked through.
        op::CHUNK => unpack(&frame, &mut take).unwrap_or_default(),
        opcode => parse(opcode, frame.body())
            .into_iter()
            .for_each(|record| take(frame.spot(0), record)),
    }
    Ok(())
}

/// One outer record, as far as it was read.
#[derive(Default)]
struct Frame {
    at: u64,
    /// Opcode and length, and then the body if it is wanted.
    bytes: Vec<u8>,
    /// How long the body is, as far as the file goes.
    body: u64,
    is_whole: bool,
    in_data: bool,
}

impl Frame {
    fn opcode(&self) -> u8 {
        self.bytes.first().copied().unwrap_or_default()
    }

    fn body(&self) -> &[u8] {
        self.bytes.get(FRAME..).unwrap_or_default()
    }

    fn place(&self) -> usize {
        usize::try_from(self.at).unwrap_or(usize::MAX)
    }

    const fn spot(&self, nth: u32) -> Spot {
        Spot { at: self.at, nth }
    }

    /// Reads opcode and length at `at` in a file of `length` bytes.
    fn read_head(&mut self, file: &mut impl Read, at: u64, length: u64) -> io::Result<()> {
        self.at = at;
        self.bytes.clear();
        file.take(FRAME as u64).read_to_end(&mut self.bytes)?;
        let said = self.bytes.get(1..FRAME).and_then(|bytes| bytes.try_into().ok());
        let said = said.map(u64::from_le_bytes);
        let left = length.saturating_sub(at).saturating_sub(self.bytes.len() as u64);
        self.is_whole = said.is_some_and(|said| said <= left);
        self.body = said.unwrap_or(u64::MAX).min(left);
        Ok(())
    }

    fn read_body(&mut self, file: &mut impl Read) -> io::Result<()> {
        let limit = if self.is_whole { u64::MAX } else { CHUNK_LIMIT as u64 };
        let read = file.take(self.body.min(limit)).read_to_end(&mut self.bytes)?;
        // Somebody has just cut it.
        self.is_whole &= read as u64 == self.body;
        Ok(())
    }
}

/// Frames the outer records, and reads the bodies of those that are wanted.
fn frames(
    file: &mut (impl Read + Seek),
    damage: &mut Vec<Damage>,
    is_wanted: impl Fn(&Frame) -> bool,
    mut take: impl FnMut(&Frame, &mut Vec<Damage>),
) -> Result<(), ReadError> {
    let length = begin(file)?;
    let (mut at, mut in_data, mut footer) = (mcap::MAGIC.len() as u64, true, false);
    let mut frame = Frame::default();
    while at < length && !footer {
        frame.read_head(file, at, length)?;
        let opcode = frame.opcode();
        if !is_known(opcode) {
            damage.push(Damage::Garbage { at: frame.place() });
            return Ok(());
        }
        in_data &= opcode != op::DATA_END && opcode != op::FOOTER;
        frame.in_data = in_data;
        if is_wanted(&frame) {
            frame.read_body(file)?;
            take(&frame, damage);
        } else if frame.is_whole {
            file.seek_relative(i64::try_from(frame.body).unwrap_or(i64::MAX))?;
        }
        if !frame.is_whole {
            if !in_data {
                damage.push(Damage::NotClosed);
            }
            return Ok(());
        }
        footer = opcode == op::FOOTER;
        at = at.saturating_add(FRAME as u64).saturating_add(frame.body);
    }
    let mut rest = Vec::new();
    file.take(mcap::MAGIC.len() as u64 + 1).read_to_end(&mut rest)?;
    if !footer || rest != mcap::MAGIC {
        damage.push(Damage::NotClosed);
    }
    Ok(())
}

/// Goes behind the magic bytes, and says how long the file is.
fn begin(file: &mut (impl Read + Seek)) -> Result<u64, ReadError> {
    let length = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(0))?;
    let mut magic = Vec::new();
    file.take(mcap::MAGIC.len() as u64).read_to_end(&mut magic)?;
    match magic.as_slice() {
        [] => Err(ReadError::Empty),
        magic if magic != mcap::MAGIC => Err(ReadError::NotMcap),
        _ => Ok(length),
    }
}

/// The format's own opcodes, and those it leaves to others.
const fn is_known(opcode: u8) -> bool {
    matches!(opcode, op::HEADER..=op::DATA_END | 0x80..)
}

/// Unpacks a chunk. A whole one is checked first; of one cut short, everything before the cut is taken.
fn unpack(frame: &Frame, take: &mut impl FnMut(Spot, Record<'_>)) -> Result<(), McapError> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_record_length_limit(CHUNK_LIMIT)
        .with_prevalidate_chunk_crcs(frame.is_whole);
    let mut reader = LinearReader::new_with_options(options);
    let mut rest = frame.bytes.as_slice();
    let mut nth = 0;
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(wanted) => {
                let (given, left) = rest.split_at(wanted.min(rest.len()));
                reader.insert(given.len()).copy_from_slice(given);
                reader.notify_read(given.len());
                rest = left;
            }
            LinearReadEvent::Record { data, opcode } => {
                if let Some(record) = parse(opcode, data) {
                    take(frame.spot(nth), record);
                }
                nth += 1;
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
