//! As much of protobuf as it takes to find a message's header, a peer's clock and a log line's words.

use tandem_wire::{Header, Nanos, Seq, Session, Stamp};

use crate::heard::Level;

enum Value<'a> {
    Number(u64),
    Bytes(&'a [u8]),
}

/// The fields of a message, up to the first that cannot be read.
fn fields(bytes: &[u8]) -> impl Iterator<Item = (u64, Value<'_>)> {
    let mut rest = bytes;
    std::iter::from_fn(move || {
        let tag = varint(&mut rest)?;
        let value = match tag & 7 {
            0 => Value::Number(varint(&mut rest)?),
            1 => Value::Bytes(take(&mut rest, 8)?),
            2 => {
                let length = usize::try_from(varint(&mut rest)?).ok()?;
                Value::Bytes(take(&mut rest, length)?)
            }
            5 => Value::Bytes(take(&mut rest, 4)?),
            _ => return None,
        };
        Some((tag >> 3, value))
    })
}

fn varint(rest: &mut &[u8]) -> Option<u64> {
    let mut value = 0_u64;
    for shift in (0..64).step_by(7) {
        let byte = *take(rest, 1)?.first()?;
        value |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Some(value);
        }
    }
    None
}

fn take<'a>(rest: &mut &'a [u8], count: usize) -> Option<&'a [u8]> {
    let (taken, left) = rest.split_at_checked(count)?;
    *rest = left;
    Some(taken)
}

/// The header of one of our messages: field 1 of all of them.
pub(crate) fn header(message: &[u8]) -> Option<Header> {
    let body = fields(message).find_map(|field| match field {
        (1, Value::Bytes(body)) => Some(body),
        _ => None,
    })?;
    let mut header = Header::default();
    for field in fields(body) {
        match field {
            (1, Value::Number(tick)) => header.tick = u32::try_from(tick).ok()?,
            (2, Value::Number(session)) => header.session = Session(session),
            (3, Value::Number(seq)) => header.seq = Seq(seq),
            (4, Value::Number(sent)) => header.sent = Stamp(sent),
            _ => {}
        }
    }
    Some(header)
}

/// A `ClockReport`: of each peer its run, its clock less the reporter's and how uncertain that is, in nanoseconds.
pub(super) fn clocks(message: &[u8]) -> impl Iterator<Item = (Session, i64, Nanos)> {
    let peers = fields(message).filter_map(|field| match field {
        (3, Value::Bytes(peer)) => Some(peer),
        _ => None,
    });
    peers.map(|peer| {
        let mut read = (Session::default(), 0, 0);
        for field in fields(peer) {
            match field {
                (2, Value::Number(session)) => read.0 = Session(session),
                (3, Value::Number(offset)) => read.1 = signed(offset),
                (4, Value::Number(uncertainty)) => read.2 = uncertainty,
                _ => {}
            }
        }
        read
    })
}

/// A `sint64`: numbers near zero are short on either side of it.
const fn signed(zigzag: u64) -> i64 {
    (zigzag >> 1).cast_signed() ^ -((zigzag & 1).cast_signed())
}

/// A `foxglove.Log`: how much it matters, who it is about, the words.
pub(super) fn log_line(message: &[u8]) -> (Level, String, String) {
    let (mut level, mut about, mut text) = (Level::Info, String::new(), String::new());
    for field in fields(message) {
        match field {
            (2, Value::Number(3)) => level = Level::Warning,
            (2, Value::Number(4..)) => level = Level::Error,
            (3, Value::Bytes(words)) => text = String::from_utf8_lossy(words).into_owned(),
            (4, Value::Bytes(name)) => about = String::from_utf8_lossy(name).into_owned(),
            _ => {}
        }
    }
    (level, about, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_is_read_and_nonsense_is_none() {
        let message = [0x0a, 7, 0x08, 0xac, 0x02, 0x10, 7, 0x18, 9];
        assert_eq!(header(&message[..8]), None, "cut short");
        let read = header(&message).unwrap();
        assert_eq!((read.tick, read.session, read.seq), (300, Session(7), Seq(9)));
        assert_eq!(header(&[0xff; 40]), None);
    }
}
