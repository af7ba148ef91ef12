//! An MCAP file as a list of records, and back: so that what is damaged is the content and not the checksum around it.

use mcap::records::op;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader};

use crate::chance::Chance;
use crate::mutate;

/// A record: what it is, and its content.
pub(crate) type Record = (u8, Vec<u8>);

/// Every record of the data section, those in chunks among them.
pub(crate) fn apart(file: &[u8]) -> Vec<Record> {
    let mut reader = LinearReader::new();
    let (mut rest, mut records) = (file, Vec::new());
    while let Some(Ok(event)) = reader.next_event() {
        match event {
            LinearReadEvent::ReadRequest(wanted) => {
                let (given, left) = rest.split_at(wanted.min(rest.len()));
                reader.insert(given.len()).copy_from_slice(given);
                reader.notify_read(given.len());
                rest = left;
            }
            LinearReadEvent::Record { opcode, data } => {
                if opcode == op::DATA_END {
                    break;
                }
                if opcode != op::MESSAGE_INDEX {
                    records.push((opcode, data.to_vec()));
                }
            }
        }
    }
    records
}

/// A file of these records: bare, or in chunks of `per_chunk`, neither compressed nor with a checksum.
pub(crate) fn together(records: &[Record], per_chunk: Option<usize>, is_closed: bool) -> Vec<u8> {
    let mut file = mcap::MAGIC.to_vec();
    let mut chunk = Vec::new();
    let mut held = 0;
    for (opcode, content) in records {
        let is_chunked = matches!(*opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE);
        let Some(most) = per_chunk.filter(|_| is_chunked) else {
            push(&mut file, *opcode, content);
            continue;
        };
        push(&mut chunk, *opcode, content);
        held += 1;
        if held >= most {
            close_chunk(&mut file, &mut chunk);
            held = 0;
        }
    }
    close_chunk(&mut file, &mut chunk);
    if is_closed {
        push(&mut file, op::DATA_END, &[0; 4]);
        push(&mut file, op::FOOTER, &[0; 20]);
        file.extend(mcap::MAGIC);
    }
    file
}

fn push(to: &mut Vec<u8>, opcode: u8, content: &[u8]) {
    to.push(opcode);
    to.extend((content.len() as u64).to_le_bytes());
    to.extend(content);
}

fn close_chunk(file: &mut Vec<u8>, chunk: &mut Vec<u8>) {
    if chunk.is_empty() {
        return;
    }
    let mut content = vec![0; 16];
    content.extend((chunk.len() as u64).to_le_bytes());
    content.extend([0; 4]);
    content.extend([0; 4]);
    content.extend((chunk.len() as u64).to_le_bytes());
    content.append(chunk);
    push(file, op::CHUNK, &content);
}

/// Loses, repeats, swaps, rewrites and relabels a few records.
pub(crate) fn damage(records: &mut Vec<Record>, chance: &mut Chance) {
    for _ in 0..=chance.below(6) {
        let at = chance.below(records.len());
        match chance.below(8) {
            0 if records.len() > 1 => {
                records.remove(at);
            }
            1 => records.insert(at, records[at].clone()),
            2 => {
                let other = chance.below(records.len());
                records.swap(at, other);
            }
            3 => records[at].0 = chance.byte() % 18,
            4 => {
                let content = (0..chance.below(80)).map(|_| chance.byte()).collect();
                records.insert(at, (chance.byte() % 18, content));
            }
            _ => mutate::damage(&mut records[at].1, 4, chance),
        }
    }
}
