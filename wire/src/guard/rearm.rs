//! A fresh press after any stop.

use bincode::{Decode, Encode};

use crate::Deadman;

/// Makes motion wait for a fresh press of the deadman after any stop, and at the very start.
///
/// Presses are numbered, so a lost "released" cannot hide that the human let go and pressed again.
///
/// ```text
///            held p         another press
///   Fresh ──────────▶ Spent ─────────────▶ Armed ── stop ──▶ Fresh
///     └── released ──▶ Open ──── press ──────┘
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub enum Rearm {
    /// Nothing seen since the start or the last stop: a press that is already held when we first look does not count.
    #[default]
    Fresh,
    /// This press was held when we first looked.
    Spent(u32),
    /// Seen released: the next press counts.
    Open,
    /// This press permits motion.
    Armed(u32),
}

impl Rearm {
    /// Takes in the deadman's position; says which press permits motion, if one does.
    pub fn see(&mut self, deadman: Deadman) -> Option<u32> {
        *self = match (*self, deadman) {
            (_, Deadman::Released) => Self::Open,
            (Self::Open, Deadman::Held { press }) => Self::Armed(press),
            (Self::Fresh, Deadman::Held { press }) => Self::Spent(press),
            (Self::Armed(old) | Self::Spent(old), Deadman::Held { press }) if old != press => Self::Armed(press),
            (same, Deadman::Held { .. }) => same,
        };
        match *self {
            Self::Armed(press) => Some(press),
            _ => None,
        }
    }

    /// Motion was stopped, or another sender is being listened to: whatever is held by now does not count.
    pub const fn spend(&mut self) {
        *self = Self::Fresh;
    }

    /// The press at hand was in vain, or has served: only another one counts, with or without a release in between.
    pub const fn exhaust(&mut self) {
        if let Self::Armed(press) = *self {
            *self = Self::Spent(press);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_press_held_since_before_we_looked_does_not_count() {
        let mut rearm = Rearm::default();
        assert_eq!(rearm.see(Deadman::Held { press: 1 }), None);
        assert_eq!(rearm.see(Deadman::Held { press: 2 }), Some(2));
    }

    #[test]
    fn after_a_stop_the_same_press_does_not_count() {
        let mut rearm = Rearm::default();
        rearm.see(Deadman::Released);
        assert_eq!(rearm.see(Deadman::Held { press: 1 }), Some(1));
        rearm.spend();
        assert_eq!(rearm.see(Deadman::Held { press: 1 }), None);
        assert_eq!(rearm.see(Deadman::Held { press: 2 }), Some(2));
        rearm.spend();
        rearm.see(Deadman::Released);
        assert_eq!(rearm.see(Deadman::Held { press: 2 }), Some(2));
    }
}
