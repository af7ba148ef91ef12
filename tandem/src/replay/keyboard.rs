//! The terminal's keys during a replay, if there is a terminal.

use std::io::{self, Stderr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender, bounded};
use crossterm::event::{self, Event as TerminalEvent, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use tandem_operator::keyboard::RawTerminal;
use tandem_wire::Nanos;

use super::player::Event;

/// What the keys mean while a session is played, for the screen.
pub(super) const HELP: &str = "space pause · ←/→ 1 s · shift 10 s · 0–9 tenths · home/end · ,/. step · +/− speed\r\n\
    l loop · [ from here · ] until here · backspace the whole again · q quit";
/// How often the thread looks whether it is still wanted, and a meaning whether time has changed it.
const POLL: Duration = Duration::from_millis(20);
const SECOND: i64 = 1_000_000_000;

/// A key that means something while a session is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Key {
    Player(Event),
    Quit,
}

/// What becomes of events.
pub(super) trait Meaning<K> {
    /// What an event means, or that there is none at this moment.
    fn hear(&mut self, now: Nanos, event: Option<&TerminalEvent>) -> Option<K>;
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

/// The keys of a terminal in raw mode; it is back to normal when this is dropped.
pub(super) struct Keyboard<K> {
    keys: Receiver<K>,
    is_wanted: Arc<AtomicBool>,
    _terminal: RawTerminal<Stderr>,
}

impl<K: Send + 'static> Keyboard<K> {
    /// Listens to the terminal.
    pub(super) fn listen(terminal: RawTerminal<Stderr>, meaning: impl Meaning<K> + Send + 'static) -> Self {
        let (sender, keys) = bounded(64);
        let is_wanted = Arc::new(AtomicBool::new(true));
        let wanted = Arc::clone(&is_wanted);
        std::thread::spawn(move || listen(&mut Terminal, meaning, &wanted, &sender));
        Self {
            keys,
            is_wanted,
            _terminal: terminal,
        }
    }
}

impl<K> Keyboard<K> {
    /// What keys meant. It is disconnected when the terminal is gone.
    pub(super) const fn keys(&self) -> &Receiver<K> {
        &self.keys
    }
}

/// Passes on what keys mean until nobody wants it any more, or the terminal is gone. It waits for whoever is slow to take
/// them: none is lost, least of all one that lets go.
fn listen<K>(source: &mut impl Source, mut meaning: impl Meaning<K>, wanted: &AtomicBool, sender: &Sender<K>) {
    let began = Instant::now();
    while wanted.load(Ordering::Relaxed) {
        let Ok(event) = source.next(POLL) else { return };
        let now = Nanos::try_from(began.elapsed().as_nanos()).unwrap_or(Nanos::MAX);
        if let Some(key) = meaning.hear(now, event.as_ref())
            && sender.send(key).is_err()
        {
            return;
        }
    }
}

impl<K> Drop for Keyboard<K> {
    fn drop(&mut self) {
        self.is_wanted.store(false, Ordering::Relaxed);
    }
}

/// A key that went down, or repeats.
fn down(event: &TerminalEvent) -> Option<&KeyEvent> {
    match event {
        TerminalEvent::Key(key) if key.kind != KeyEventKind::Release => Some(key),
        _ => None,
    }
}

pub(super) fn is_quit(key: &KeyEvent) -> bool {
    match key.code {
        KeyCode::Char('c') => key.modifiers.contains(KeyModifiers::CONTROL),
        KeyCode::Char('q') | KeyCode::Esc => true,
        _ => false,
    }
}

/// Each key for itself, while a session is played.
pub(super) struct Playing;

impl Meaning<Key> for Playing {
    fn hear(&mut self, _: Nanos, event: Option<&TerminalEvent>) -> Option<Key> {
        event.and_then(playing)
    }
}

fn playing(event: &TerminalEvent) -> Option<Key> {
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
        KeyCode::Char('l') => Event::ToggleLoop,
        KeyCode::Char('[') => Event::FromHere,
        KeyCode::Char(']') => Event::UntilHere,
        KeyCode::Backspace => Event::Whole,
        KeyCode::Char(letter) => Event::Tenth(u8::try_from(letter.to_digit(10)?).ok()?),
        KeyCode::Home => Event::Home,
        KeyCode::End => Event::End,
        _ => return None,
    }))
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

    fn heard(script: Vec<TerminalEvent>) -> Vec<Key> {
        let (sender, keys) = bounded(64);
        listen(
            &mut Script(script.into_iter()),
            Playing,
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
            plain(KeyCode::Char('l')),
            plain(KeyCode::Char('[')),
            plain(KeyCode::Char(']')),
            plain(KeyCode::Backspace),
            plain(KeyCode::Char('0')),
            plain(KeyCode::Char('9')),
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
            Event::ToggleLoop,
            Event::FromHere,
            Event::UntilHere,
            Event::Whole,
            Event::Tenth(0),
            Event::Tenth(9),
            Event::Home,
            Event::End,
        ]
        .map(Key::Player)
        .to_vec();
        wanted.push(Key::Quit);
        assert_eq!(heard(script), wanted);
    }

    #[test]
    fn ctrl_c_ends_it_although_the_terminal_is_raw() {
        let script = vec![
            press(KeyCode::Char('c'), KeyModifiers::CONTROL),
            plain(KeyCode::Char('c')),
        ];
        assert_eq!(heard(script), [Key::Quit]);
    }
}
