//! The terminal's keys during a replay, if there is a terminal.

use std::io::{self, IsTerminal};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, bounded, never};
use crossterm::event::{
    self, DisableFocusChange, EnableFocusChange, Event as TerminalEvent, KeyCode, KeyEvent, KeyEventKind, KeyModifiers,
};
use crossterm::{execute, terminal};
use tandem_trials::drive::Wish;

use super::player::Event;

/// What the keys mean while a session is played, for the screen.
pub(super) const HELP: &str = "space pause · ←/→ 1 s · shift 10 s · ,/. step · +/− speed · home/end · q quit";
/// What they mean while a robot is driven.
pub(super) const DRIVE_HELP: &str = "enter: hold the deadman and drive · any other key: let go, stop · q: quit";
/// How often the thread looks whether it is still wanted.
const POLL: Duration = Duration::from_millis(100);
const SECOND: i64 = 1_000_000_000;

/// A key that means something while a session is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Key {
    Player(Event),
    Quit,
}

/// A key that means something while a robot is driven.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DriveKey {
    Wish(Wish),
    Quit,
}

/// Where keys come from.
trait Source {
    /// The next event, or nothing within `limit`.
    fn next(&mut self, limit: Duration) -> io::Result<Option<TerminalEvent>>;
}

struct Terminal;

impl Source for Terminal {
    fn next(&mut self, limit: Duration) -> io::Result<Option<TerminalEvent>> {
        if event::poll(limit)? {
            event::read().map(Some)
        } else {
            Ok(None)
        }
    }
}

/// The terminal in raw mode, and back to normal when this is dropped.
pub(super) struct Keyboard<K> {
    keys: Receiver<K>,
    is_open: Option<Arc<AtomicBool>>,
}

impl<K: Send + 'static> Keyboard<K> {
    /// Listens to the terminal; without one, to nothing.
    pub(super) fn open(meaning: fn(&TerminalEvent) -> Option<K>) -> Self {
        if !std::io::stdin().is_terminal() || !std::io::stderr().is_terminal() || terminal::enable_raw_mode().is_err() {
            return Self {
                keys: never(),
                is_open: None,
            };
        }
        // A terminal that cannot tell of its focus simply never does.
        let _ = execute!(io::stderr(), EnableFocusChange);
        let (sender, keys) = bounded(64);
        let is_open = Arc::new(AtomicBool::new(true));
        let wanted = Arc::clone(&is_open);
        std::thread::spawn(move || listen(&mut Terminal, meaning, &wanted, &sender));
        Self {
            keys,
            is_open: Some(is_open),
        }
    }
}

impl<K> Keyboard<K> {
    pub(super) const fn keys(&self) -> &Receiver<K> {
        &self.keys
    }

    pub(super) const fn is_there(&self) -> bool {
        self.is_open.is_some()
    }
}

/// Passes on what keys mean until nobody wants it any more, or the terminal is gone.
fn listen<K>(
    source: &mut impl Source,
    meaning: fn(&TerminalEvent) -> Option<K>,
    wanted: &AtomicBool,
    sender: &Sender<K>,
) {
    while wanted.load(Ordering::Relaxed) {
        let Ok(event) = source.next(POLL) else { return };
        if let Some(key) = event.as_ref().and_then(meaning) {
            // Nobody waits for keys that do not fit.
            let _ = sender.try_send(key);
        }
    }
}

impl<K> Drop for Keyboard<K> {
    fn drop(&mut self) {
        if let Some(is_open) = &self.is_open {
            is_open.store(false, Ordering::Relaxed);
            // A terminal that is gone needs no repair.
            let _ = execute!(io::stderr(), DisableFocusChange);
            let _ = terminal::disable_raw_mode();
        }
    }
}

/// A key that went down, or repeats.
fn down(event: &TerminalEvent) -> Option<&KeyEvent> {
    match event {
        TerminalEvent::Key(key) if key.kind != KeyEventKind::Release => Some(key),
        _ => None,
    }
}

fn is_quit(key: &KeyEvent) -> bool {
    match key.code {
        KeyCode::Char('c') => key.modifiers.contains(KeyModifiers::CONTROL),
        KeyCode::Char('q') | KeyCode::Esc => true,
        _ => false,
    }
}

/// What a key means while a session is played.
pub(super) fn playing(event: &TerminalEvent) -> Option<Key> {
    let key = down(event)?;
    if is_quit(key) {
        return Some(Key::Quit);
    }
    let far = if key.modifiers.contains(KeyModifiers::SHIFT) {
        10
    } else {
        1
    };
    Some(Key::Player(match key.code {
        KeyCode::Char(' ') => Event::Toggle,
        KeyCode::Right => Event::SeekBy(far * SECOND),
        KeyCode::Left => Event::SeekBy(-far * SECOND),
        KeyCode::Char('.') => Event::Step,
        KeyCode::Char(',') => Event::StepBack,
        KeyCode::Char('+' | '=') | KeyCode::Up => Event::Faster,
        KeyCode::Char('-') | KeyCode::Down => Event::Slower,
        KeyCode::Home => Event::Home,
        KeyCode::End => Event::End,
        _ => return None,
    }))
}

/// What a key means while a robot is driven: only one holds the deadman, and whatever else happens lets go of it.
pub(super) fn driving(event: &TerminalEvent) -> Option<DriveKey> {
    if *event == TerminalEvent::FocusLost {
        return Some(DriveKey::Wish(Wish::Stop));
    }
    let key = down(event)?;
    Some(match key.code {
        _ if is_quit(key) => DriveKey::Quit,
        // A key that repeats was not pressed anew.
        KeyCode::Enter if key.kind == KeyEventKind::Press => DriveKey::Wish(Wish::Go),
        KeyCode::Enter => return None,
        _ => DriveKey::Wish(Wish::Stop),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A terminal that tells what is written here, and is then gone.
    struct Script(std::vec::IntoIter<TerminalEvent>);

    impl Source for Script {
        fn next(&mut self, _: Duration) -> io::Result<Option<TerminalEvent>> {
            self.0
                .next()
                .map(Some)
                .ok_or_else(|| io::ErrorKind::UnexpectedEof.into())
        }
    }

    fn press(code: KeyCode, modifiers: KeyModifiers) -> TerminalEvent {
        TerminalEvent::Key(KeyEvent::new(code, modifiers))
    }

    fn plain(code: KeyCode) -> TerminalEvent {
        press(code, KeyModifiers::NONE)
    }

    fn of_kind(code: KeyCode, kind: KeyEventKind) -> TerminalEvent {
        TerminalEvent::Key(KeyEvent::new_with_kind(code, KeyModifiers::NONE, kind))
    }

    fn heard<K>(script: Vec<TerminalEvent>, meaning: fn(&TerminalEvent) -> Option<K>) -> Vec<K> {
        let (sender, keys) = bounded(64);
        listen(
            &mut Script(script.into_iter()),
            meaning,
            &AtomicBool::new(true),
            &sender,
        );
        keys.try_iter().collect()
    }

    #[test]
    fn every_key_of_the_help_plays_its_part() {
        let script = vec![
            plain(KeyCode::Char(' ')),
            plain(KeyCode::Left),
            press(KeyCode::Left, KeyModifiers::SHIFT),
            plain(KeyCode::Char('.')),
            plain(KeyCode::Char(',')),
            plain(KeyCode::Char('+')),
            plain(KeyCode::Char('-')),
            plain(KeyCode::Home),
            plain(KeyCode::End),
            plain(KeyCode::Char('x')),
            of_kind(KeyCode::Char(' '), KeyEventKind::Release),
            TerminalEvent::FocusLost,
            plain(KeyCode::Char('q')),
        ];
        let mut wanted: Vec<Key> = [
            Event::Toggle,
            Event::SeekBy(-SECOND),
            Event::SeekBy(-10 * SECOND),
            Event::Step,
            Event::StepBack,
            Event::Faster,
            Event::Slower,
            Event::Home,
            Event::End,
        ]
        .map(Key::Player)
        .to_vec();
        wanted.push(Key::Quit);
        assert_eq!(heard(script, playing), wanted);
    }

    #[test]
    fn ctrl_c_ends_it_although_the_terminal_is_raw() {
        let script = || {
            vec![
                press(KeyCode::Char('c'), KeyModifiers::CONTROL),
                plain(KeyCode::Char('c')),
            ]
        };
        assert_eq!(heard(script(), playing), [Key::Quit]);
        assert_eq!(heard(script(), driving), [DriveKey::Quit, DriveKey::Wish(Wish::Stop)]);
    }

    #[test]
    fn one_key_holds_the_deadman_and_every_other_lets_go() {
        let script = vec![
            plain(KeyCode::Enter),
            of_kind(KeyCode::Enter, KeyEventKind::Repeat),
            of_kind(KeyCode::Enter, KeyEventKind::Release),
            plain(KeyCode::Char(' ')),
            plain(KeyCode::Char('x')),
            TerminalEvent::FocusLost,
            TerminalEvent::FocusGained,
            plain(KeyCode::Esc),
        ];
        let stop = DriveKey::Wish(Wish::Stop);
        let wanted = [DriveKey::Wish(Wish::Go), stop, stop, stop, DriveKey::Quit];
        assert_eq!(heard(script, driving), wanted);
    }
}
