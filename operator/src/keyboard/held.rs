//! Which keys are down, from what a terminal tells of them.

use crossterm::event::KeyEventKind;
use tandem_wire::{MILLISECOND, Nanos};

/// Without key releases a key counts as down for this long after its last repeat. Keyboards repeat ten to thirty times
/// a second; the longest usual gap and a half.
pub const REPEAT_MAY_TAKE: Nanos = 150 * MILLISECOND;

/// Some keys, told apart by their index, and which of them are down.
#[derive(Clone, Debug)]
pub struct HeldKeys<const N: usize> {
    /// Whether the terminal tells of releases.
    releases: bool,
    /// When each key was last heard of, while it is down.
    down: [Option<Nanos>; N],
}

impl<const N: usize> HeldKeys<N> {
    /// All of them up. `releases` is what [`RawTerminal::tells_releases`](super::RawTerminal::tells_releases) says.
    #[must_use]
    pub const fn new(releases: bool) -> Self {
        Self {
            releases,
            down: [None; N],
        }
    }

    /// Takes in what happened to a key, and says whether it is a fresh press: none was down before.
    pub fn take(&mut self, now: Nanos, key: usize, kind: KeyEventKind) -> bool {
        let none_down = self.down.iter().all(Option::is_none);
        let Some(heard) = self.down.get_mut(key) else {
            return false;
        };
        match kind {
            KeyEventKind::Release => *heard = None,
            // A repeat of a key that is up: it was down when the focus came back, and that is no press.
            KeyEventKind::Repeat if self.releases && heard.is_none() => {}
            KeyEventKind::Press | KeyEventKind::Repeat => {
                *heard = Some(now);
                return none_down;
            }
        }
        false
    }

    /// Where releases are not told of, silence is one.
    pub fn expire(&mut self, now: Nanos) {
        if !self.releases {
            for heard in &mut self.down {
                *heard = heard.filter(|heard| now.saturating_sub(*heard) <= REPEAT_MAY_TAKE);
            }
        }
    }

    /// Lets go of all of them.
    pub const fn let_go(&mut self) {
        self.down = [None; N];
    }

    /// Which of them are down.
    #[must_use]
    pub fn down(&self) -> [bool; N] {
        self.down.map(|heard| heard.is_some())
    }
}
