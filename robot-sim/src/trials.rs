//! Which trial runs, and whose marks begin and end it.

use bincode::{Decode, Encode};
use tandem_wire::{Envelope, Session, Trial};

/// Which trial runs.
#[derive(Clone, Copy, Debug, Default, Encode, Decode)]
pub(crate) struct Running {
    /// 0 if none runs.
    pub(crate) number: u32,
    /// The tick at which it began.
    pub(crate) start: u32,
    /// Who began trials, last one first, and the number of each one's newest, so that a straggler begins nothing.
    begun: [Option<(Session, u32)>; BEGINNERS],
    /// Begins as soon as the arm stands.
    pub(crate) pending: Option<u32>,
}

/// So many senders of trials are remembered. Two that repeat their marks, each for those who come late, must not begin
/// their trials over and over in turn.
const BEGINNERS: usize = 8;

impl Running {
    /// Takes in a mark. Says whether the trial that runs is over.
    pub(crate) fn take(&mut self, mark: &Envelope<Trial>) -> bool {
        let session = mark.header.session;
        match mark.body {
            Trial::Begin { number, .. } if number > 0 && self.is_new(session, number) => {
                self.note(session, number);
                self.pending = Some(number);
                true
            }
            Trial::End { number, .. } if self.begun[0] == Some((session, number)) => {
                self.pending = None;
                true
            }
            // A repetition for late joiners, or a straggler.
            Trial::Begin { .. } | Trial::End { .. } => false,
        }
    }

    fn is_new(&self, session: Session, number: u32) -> bool {
        let mut begun = self.begun.iter().flatten();
        begun.all(|&(known, newest)| session != known || number > newest)
    }

    fn note(&mut self, session: Session, number: u32) {
        let known = self
            .begun
            .iter()
            .position(|at| at.is_some_and(|(known, _)| known == session));
        self.begun[..=known.unwrap_or(BEGINNERS - 1)].rotate_right(1);
        self.begun[0] = Some((session, number));
    }
}
