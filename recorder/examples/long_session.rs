//! Writes a session file as long as wanted, to see what reading and playing it takes: the tests' scripted session, over and
//! over, each time later.
//!
//! `long_session PATH [PASSES=1000]`; a pass is some twelve seconds.

#[path = "../tests/it/script/mod.rs"]
mod script;

use std::fs::File;
use std::io::BufWriter;

use tandem_recorder::{Counts, Drops, Output, Provenance, Recorder, SessionFile};
use tandem_wire::{
    Happening, Input, JournalBatch, JournalEntry, Nanos, Node, NodeName, Numbering, Outbox, Ports, SECOND, Session,
    Stamp, Timing, Topic, encode,
};

/// The default of the recorder's settings.
const CHUNK_BYTES: u64 = 256 << 10;
/// Where a message's header has its number and its sender's stamp.
const SEQ: std::ops::Range<usize> = 16..24;
const SENT: std::ops::Range<usize> = 24..32;
/// No stream of the script has so many messages.
const PASS: u64 = 1 << 20;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("usage: long_session PATH [PASSES]")?;
    let passes: u64 = arguments.next().map_or(Ok(1000), |text| text.parse())?;
    let provenance = Provenance {
        robot: "panda".parse()?,
        build: env!("CARGO_PKG_VERSION").into(),
        epoch_unix_nanos: 1_760_000_000_000_000_000,
    };
    let mut file = SessionFile::begin(BufWriter::new(File::create(path)?), CHUNK_BYTES, provenance)?;
    let mut recorder = Recorder::new(Timing::default());
    let mut outbox = Outbox::default();
    let mut journal = Journal::default();
    let samples = script::session();
    let duration = samples.last().map_or(0, |last| last.at.0) + SECOND;
    for pass in 0..passes {
        for sample in &samples {
            if matches!(sample.topic, Topic::Journal(_)) || (pass > 0 && matches!(sample.topic, Topic::Info(_))) {
                continue;
            }
            let at = sample.at.after(pass * duration);
            let mut bytes = sample.bytes.clone();
            later(&mut bytes, pass, duration);
            let part = journal.part(at, sample.topic, &bytes);
            for (topic, bytes) in [(sample.topic, &bytes), (Topic::Journal(NodeName::Arbiter), &part)] {
                let input = Input::Sample { topic, bytes };
                recorder.step(at, Recorder::event(input), &mut outbox);
            }
            for output in outbox.drain() {
                if let Output::Write(heard) = output {
                    file.write(&heard, Drops::default())?;
                }
            }
        }
    }
    let (messages, _) = file.close(&Counts::default(), Drops::default())?;
    println!("{messages} messages over {} s", passes * duration / SECOND);
    Ok(())
}

/// Moves a message's number and stamp to where they are in this pass.
fn later(bytes: &mut [u8], pass: u64, duration: Nanos) {
    for (range, by) in [(SEQ, pass * PASS), (SENT, pass * duration)] {
        if let Some(word) = bytes.get_mut(range) {
            let number = word.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte));
            word.copy_from_slice(&(number + by).to_le_bytes());
        }
    }
}

/// The journal that says how everything travelled.
struct Journal {
    numbering: Numbering,
    next: u64,
}

impl Default for Journal {
    fn default() -> Self {
        Self {
            numbering: Numbering::new(Session(900)),
            next: 0,
        }
    }
}

impl Journal {
    fn part(&mut self, at: Stamp, topic: Topic, bytes: &[u8]) -> Vec<u8> {
        let entry = JournalEntry {
            at,
            wall: at,
            what: Happening::Output {
                topic,
                bytes: bytes.to_vec(),
            },
        };
        let batch = JournalBatch {
            first: self.next,
            lost: 0,
            entries: vec![entry],
        };
        self.next += 1;
        let mut part = Vec::new();
        encode(&self.numbering.envelope(at, 0, batch), &mut part);
        part
    }
}
