//! The grip on the deadman: one key of this terminal, which counts while it is held.
//!
//! Not `enter`: the one that began the command may still be down, or repeat, when there is something to press for.

use crossterm::event::{Event, KeyCode, KeyEvent, KeyEventKind};
use tandem_operator::keyboard::HeldKeys;
use tandem_trials::drive::Wish;
use tandem_wire::Nanos;

use crate::replay::keyboard::{Meaning, is_quit};

/// What the keys mean while a robot is driven, for the screen.
pub(super) const HELP: &str = "hold space: the deadman, drives · let go or press any other key: stop · q: quit";
/// The key that holds the deadman.
const DEADMAN: KeyCode = KeyCode::Char(' ');

/// A key that means something while a robot is driven.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DriveKey {
    Wish(Wish),
    Quit,
}

const LET_GO: DriveKey = DriveKey::Wish(Wish::Stop);

/// Whether somebody holds the deadman, from what a terminal tells.
pub(super) struct Grip(HeldKeys<1>);

impl Grip {
    pub(super) const fn new(releases: bool) -> Self {
        Self(HeldKeys::new(releases))
    }

    const fn let_go(&mut self) -> DriveKey {
        self.0.let_go();
        LET_GO
    }

    fn key(&mut self, now: Nanos, key: &KeyEvent) -> Option<DriveKey> {
        let is_release = key.kind == KeyEventKind::Release;
        if key.code == DEADMAN {
            let is_pressed = self.0.take(now, 0, key.kind);
            return is_pressed
                .then_some(DriveKey::Wish(Wish::Go))
                .or(is_release.then_some(LET_GO));
        }
        match key {
            _ if is_release => None,
            key if is_quit(key) => Some(DriveKey::Quit),
            _ => Some(self.let_go()),
        }
    }

    /// Where the terminal does not tell of releases, a key that no longer repeats was let go of.
    fn expire(&mut self, now: Nanos) -> Option<DriveKey> {
        let was_held = self.0.down() == [true];
        self.0.expire(now);
        (was_held && self.0.down() == [false]).then_some(LET_GO)
    }
}

impl Meaning<DriveKey> for Grip {
    fn hear(&mut self, now: Nanos, event: Option<&Event>) -> Option<DriveKey> {
        let key = match event {
            Some(Event::FocusLost) => Some(self.let_go()),
            Some(Event::Key(key)) => self.key(now, key),
            _ => None,
        };
        key.or_else(|| self.expire(now))
    }
}

#[cfg(test)]
mod tests {
    use crossterm::event::KeyModifiers;
    use tandem_operator::keyboard::REPEAT_MAY_TAKE;
    use tandem_wire::{MILLISECOND, SECOND};

    use super::*;

    const GO: DriveKey = DriveKey::Wish(Wish::Go);

    fn event(code: KeyCode, kind: KeyEventKind) -> Event {
        Event::Key(KeyEvent::new_with_kind(code, KeyModifiers::NONE, kind))
    }

    use KeyEventKind::{Press, Release, Repeat};

    #[test]
    fn the_deadman_is_held_until_the_key_is_released() {
        let mut grip = Grip::new(true);
        assert_eq!(grip.hear(0, Some(&event(DEADMAN, Press))), Some(GO));
        assert_eq!(grip.hear(SECOND, Some(&event(DEADMAN, Repeat))), None);
        assert_eq!(grip.hear(90 * SECOND, None), None, "it is still held");
        assert_eq!(grip.hear(91 * SECOND, Some(&event(DEADMAN, Release))), Some(LET_GO));
    }

    #[test]
    fn where_releases_are_not_told_a_key_that_no_longer_repeats_lets_go() {
        let mut grip = Grip::new(false);
        assert_eq!(grip.hear(0, Some(&event(DEADMAN, Press))), Some(GO));
        for repeat in 1..20 {
            let now = repeat * 100 * MILLISECOND;
            assert_eq!(
                grip.hear(now, Some(&event(DEADMAN, Press))),
                None,
                "a repeat is no press"
            );
        }
        let last = 1900 * MILLISECOND;
        assert_eq!(grip.hear(last + REPEAT_MAY_TAKE, None), None);
        assert_eq!(grip.hear(last + REPEAT_MAY_TAKE + 1, None), Some(LET_GO));
        assert_eq!(grip.hear(last + SECOND, None), None, "and says so once");
    }

    #[test]
    fn any_other_key_and_the_loss_of_the_focus_let_go_until_it_is_pressed_anew() {
        let anything = [
            event(KeyCode::Char('x'), Press),
            event(KeyCode::Enter, Press),
            Event::FocusLost,
        ];
        for stop in anything {
            let mut grip = Grip::new(true);
            assert_eq!(grip.hear(0, Some(&event(DEADMAN, Press))), Some(GO));
            assert_eq!(grip.hear(1, Some(&stop)), Some(LET_GO), "{stop:?}");
            assert_eq!(grip.hear(2, Some(&event(DEADMAN, Repeat))), None, "{stop:?}");
            assert_eq!(grip.hear(3, Some(&event(DEADMAN, Press))), Some(GO), "{stop:?}");
        }
    }

    #[test]
    fn enter_drives_nothing_and_q_escape_and_ctrl_c_quit() {
        let mut grip = Grip::new(true);
        assert_eq!(grip.hear(0, Some(&event(KeyCode::Enter, Press))), Some(LET_GO));
        assert_eq!(grip.hear(0, Some(&event(KeyCode::Enter, Release))), None);
        for code in [KeyCode::Char('q'), KeyCode::Esc] {
            assert_eq!(grip.hear(0, Some(&event(code, Press))), Some(DriveKey::Quit));
        }
        let control_c = Event::Key(KeyEvent::new(KeyCode::Char('c'), KeyModifiers::CONTROL));
        assert_eq!(grip.hear(0, Some(&control_c)), Some(DriveKey::Quit));
    }
}
