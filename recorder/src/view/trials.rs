//! When a new trial begins: the moment at which a view begins a new recording.

use tandem_wire::{Envelope, Session, State, Trial};

use crate::heard::{Entry, Heard, Sample};

/// Follows trials through their announcements and through the robot's own word, whichever comes first.
///
/// ```text
///            Begin, or a state of a trial             End
///   nothing ─────────────────────────────▶ running ────────▶ over
///                                            ▲                 │ Begin, or a state of a later trial
///                                            └─────────────────┘
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Trials {
    current: Option<Current>,
}

#[derive(Clone, Copy, Debug)]
struct Current {
    number: u32,
    /// Whose states these are, and the first tick.
    start: Option<(Session, u32)>,
    is_over: bool,
}

impl Trials {
    /// The number of the trial that begins with this, if one does.
    pub(crate) fn hear(&mut self, heard: &Heard) -> Option<u32> {
        match &heard.entry {
            Entry::Sample(Sample::Trial(message)) => self.hear_mark(&message.body),
            Entry::Sample(Sample::State(message)) => self.hear_state(message),
            _ => None,
        }
    }

    fn hear_mark(&mut self, trial: &Trial) -> Option<u32> {
        match (trial, &mut self.current) {
            (Trial::Begin { number, .. }, Some(current)) if current.number == *number && !current.is_over => None,
            (Trial::Begin { number, .. }, _) => self.begin(*number, None),
            (Trial::End { number, .. }, Some(current)) if current.number == *number => {
                current.is_over = true;
                None
            }
            (Trial::End { .. }, _) => None,
        }
    }

    fn hear_state(&mut self, message: &Envelope<State>) -> Option<u32> {
        let state = &message.body;
        if state.trial == 0 {
            return None;
        }
        let start = (message.header.session, state.trial_start);
        match &mut self.current {
            None => self.begin(state.trial, Some(start)),
            // Announced already; states of the trial before may still be under way.
            Some(current) if current.start.is_none() => {
                if current.number == state.trial {
                    current.start = Some(start);
                }
                None
            }
            Some(current) => {
                let is_later = current
                    .start
                    .is_some_and(|(session, tick)| session != start.0 || tick < start.1);
                if is_later {
                    self.begin(state.trial, Some(start))
                } else {
                    None
                }
            }
        }
    }

    #[expect(clippy::unnecessary_wraps, reason = "it is the answer of every way to begin")]
    fn begin(&mut self, number: u32, start: Option<(Session, u32)>) -> Option<u32> {
        self.current = Some(Current {
            number,
            start,
            is_over: false,
        });
        Some(number)
    }
}
