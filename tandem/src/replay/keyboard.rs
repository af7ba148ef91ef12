//! The keyboard of `tandem replay`, if there is a terminal.

use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crossbeam_channel::{Receiver, bounded, never};
use crossterm::event::{self, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use crossterm::terminal;

use super::player::Event;

/// What the keys mean, for the screen.
pub(super) const HELP: &str = "space pause · ←/→ 1 s · shift 10 s · ,/. step · +/− speed · home/end · q quit";
/// How often the thread looks whether it is still wanted.
const POLL: Duration = Duration::from_millis(100);
const SECOND: i64 = 1_000_000_000;

/// A key that means something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Key {
    Player(Event),
    Quit,
}

/// The terminal in raw mode, and back to normal when this is dropped.
pub(super) struct Keyboard {
    keys: Receiver<Key>,
    is_open: Option<Arc<AtomicBool>>,
}

impl Keyboard {
    /// Listens to the terminal; without one, to nothing.
    pub(super) fn open() -> Self {
        let nothing = Self {
            keys: never(),
            is_open: None,
        };
        if !std::io::stdin().is_terminal() || !std::io::stderr().is_terminal() || terminal::enable_raw_mode().is_err() {
            return nothing;
        }
        let (sender, keys) = bounded(64);
        let is_open = Arc::new(AtomicBool::new(true));
        let wanted = Arc::clone(&is_open);
        std::thread::spawn(move || {
            while wanted.load(Ordering::Relaxed) {
                let key = match event::poll(POLL) {
                    Ok(true) => event::read()
                        .ok()
                        .and_then(|event| event.as_key_press_event().and_then(meaning)),
                    Ok(false) => None,
                    Err(_) => return,
                };
                // Nobody waits for keys that do not fit.
                key.map(|key| sender.try_send(key));
            }
        });
        Self {
            keys,
            is_open: Some(is_open),
        }
    }

    pub(super) const fn keys(&self) -> &Receiver<Key> {
        &self.keys
    }

    pub(super) const fn is_there(&self) -> bool {
        self.is_open.is_some()
    }
}

impl Drop for Keyboard {
    fn drop(&mut self) {
        if let Some(is_open) = &self.is_open {
            is_open.store(false, Ordering::Relaxed);
            // A terminal that is gone needs no repair.
            let _ = terminal::disable_raw_mode();
        }
    }
}

fn meaning(key: KeyEvent) -> Option<Key> {
    if key.kind == KeyEventKind::Release {
        return None;
    }
    let far = if key.modifiers.contains(KeyModifiers::SHIFT) {
        10
    } else {
        1
    };
    Some(match key.code {
        KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => Key::Quit,
        KeyCode::Char('q') | KeyCode::Esc => Key::Quit,
        KeyCode::Char(' ') => Key::Player(Event::Toggle),
        KeyCode::Right => Key::Player(Event::SeekBy(far * SECOND)),
        KeyCode::Left => Key::Player(Event::SeekBy(-far * SECOND)),
        KeyCode::Char('.') => Key::Player(Event::Step),
        KeyCode::Char(',') => Key::Player(Event::StepBack),
        KeyCode::Char('+' | '=') | KeyCode::Up => Key::Player(Event::Faster),
        KeyCode::Char('-') | KeyCode::Down => Key::Player(Event::Slower),
        KeyCode::Home => Key::Player(Event::Home),
        KeyCode::End => Key::Player(Event::End),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ctrl_c_ends_it_although_the_terminal_is_raw() {
        let key = |code, modifiers| meaning(KeyEvent::new(code, modifiers));
        assert_eq!(key(KeyCode::Char('c'), KeyModifiers::CONTROL), Some(Key::Quit));
        assert_eq!(key(KeyCode::Char('c'), KeyModifiers::NONE), None);
        let far = Some(Key::Player(Event::SeekBy(-10 * SECOND)));
        assert_eq!(key(KeyCode::Left, KeyModifiers::SHIFT), far);
    }
}
