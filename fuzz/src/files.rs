//! Session files: cut, with bytes changed, with records changed.

use std::io::Cursor;

use tandem_recorder::{Evidence, ReadError, Recording, repair};
use tandem_trials::reexecute;

use crate::chance::Chance;
use crate::records::{Record, apart, together};
use crate::{Target, mutate, seeds};

/// A case in so many is executed again as well, which costs as much as a hundred readings.
const EXECUTED: usize = 64;

/// Cut after every byte in turn.
pub(crate) struct Cuts {
    messages: usize,
}

/// Bytes changed.
pub(crate) struct Bytes;

/// Records changed.
pub(crate) struct Records {
    records: Vec<Record>,
}

impl Cuts {
    pub(crate) fn new() -> Self {
        let whole = Recording::read(seeds::session()).expect("it is whole");
        assert_eq!(whole.damage, [], "what the recorder writes has nothing wrong");
        Self {
            messages: whole.messages.len(),
        }
    }
}

impl Target for Cuts {
    fn name(&self) -> &'static str {
        "cuts"
    }

    fn run(&mut self, seed: u64) -> u64 {
        let file = seeds::session();
        let cut = usize::try_from(seed % file.len() as u64).unwrap_or(0);
        let cut = &file[..cut];
        if let Ok(recording) = Recording::read(cut) {
            assert_ne!(
                recording.damage,
                [],
                "nothing is said of the cut after {} bytes",
                cut.len()
            );
            assert!(
                recording.messages.len() <= self.messages,
                "messages out of nothing, cut after {} bytes",
                cut.len()
            );
        }
        if let Ok(evidence) = Evidence::read(cut) {
            assert_ne!(
                evidence.faults,
                [],
                "nothing is said of the cut after {} bytes",
                cut.len()
            );
        }
        check(cut, false);
        1
    }
}

/// Reads the session file cut after every `stride`-th byte, and says how many cuts that were.
///
/// # Panics
/// When a cut goes unnoticed.
pub fn every_cut(stride: usize) -> u64 {
    let mut cuts = Cuts::new();
    (0..seeds::session().len() as u64)
        .step_by(stride.max(1))
        .map(|seed| cuts.run(seed))
        .sum()
}

impl Bytes {
    pub(crate) const fn new() -> Self {
        Self
    }
}

impl Target for Bytes {
    fn name(&self) -> &'static str {
        "bytes"
    }

    fn run(&mut self, seed: u64) -> u64 {
        let mut chance = Chance::new(seed);
        let mut file = seeds::session().to_vec();
        mutate::damage(&mut file, 8, &mut chance);
        check(&file, chance.once_in(EXECUTED));
        1
    }
}

impl Records {
    pub(crate) fn new() -> Self {
        Self {
            records: apart(seeds::session()),
        }
    }
}

impl Target for Records {
    fn name(&self) -> &'static str {
        "records"
    }

    fn run(&mut self, seed: u64) -> u64 {
        let mut chance = Chance::new(seed);
        let mut records = self.records.clone();
        crate::records::damage(&mut records, &mut chance);
        let per_chunk = [None, Some(1 + chance.below(40))][chance.below(2)];
        let mut file = together(&records, per_chunk, !chance.once_in(4));
        if chance.once_in(4) {
            mutate::damage(&mut file, 2, &mut chance);
        }
        check(&file, chance.once_in(EXECUTED));
        1
    }
}

/// What holds of any file: it is read or refused by all readers, and repairing it changes nothing that can be read.
fn check(file: &[u8], is_executed: bool) {
    let read = Recording::read(file);
    let mut repaired = Cursor::new(Vec::new());
    let report = repair(Cursor::new(file), &[], &mut repaired);
    match (&read, &report) {
        (Err(ReadError::Empty | ReadError::NotMcap), repaired) => assert!(repaired.is_err(), "repaired from nothing"),
        (Ok(recording), Ok(_)) if !recording.messages.is_empty() => {
            let again = Recording::read(repaired.get_ref()).expect("what was repaired can be read");
            assert_eq!(
                again.messages, recording.messages,
                "the repair changed what can be played"
            );
        }
        _ => {}
    }
    if let Ok(evidence) = Evidence::read(file)
        && is_executed
    {
        reexecute(&evidence, |_, _| {});
    }
}
