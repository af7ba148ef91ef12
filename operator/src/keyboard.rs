//! The keyboard's terminal: keys in, device samples out, one line of status.
//!
//! The one part of this crate that does input and output; it knows nothing of the node but the samples' format. Run it
//! on a thread of its own, with [`run`]. Whoever else needs keys that are held has [`RawTerminal`] and [`HeldKeys`].
//!
//! Where the terminal speaks the kitty keyboard protocol, keys are down until they are released, and all of them go up
//! when the window loses the focus. Elsewhere a terminal tells only of presses and repeats, so a key counts as down for
//! a moment after each: letting go or losing the focus stops within [`REPEAT_MAY_TAKE`], and the pause that keyboards
//! make before the first repeat lets the robot stop once, too. The screen says which of the two it is.

mod held;
mod terminal;

use std::io::{self, Stdout, Write};
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use crossterm::cursor::{Hide, MoveToColumn, Show};
use crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use crossterm::style::Print;
use crossterm::terminal::{Clear, ClearType, size};
use crossterm::{execute, queue};
use tandem_wire::Nanos;

use crate::device::{DeviceSample, Keys, SAMPLE_PERIOD};

pub use held::{HeldKeys, REPEAT_MAY_TAKE};
pub use terminal::RawTerminal;

/// Why the keyboard was left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leaving {
    /// Escape or Ctrl-C was pressed.
    Pressed,
    /// The caller asked for it.
    Asked,
}

/// Why there is no keyboard.
#[derive(Debug, thiserror::Error)]
pub enum KeyboardError {
    /// Input or output is a pipe or a file.
    #[error("the keyboard needs a terminal: standard input and output must not be redirected")]
    NotATerminal,
    /// The terminal failed.
    #[error("could not {doing}")]
    Terminal {
        /// What was tried.
        doing: &'static str,
        /// What the system says.
        source: io::Error,
    },
}

/// Reads keys until Escape, Ctrl-C, or until `send` breaks.
///
/// Hands a sample of [`DeviceSample`]'s format to `send` every 20 ms, the last one with all keys up, and shows what
/// `status` says. The terminal is restored on every way out of this function, so ask it to leave and join its thread
/// before the process ends.
///
/// # Errors
/// If this is not a terminal, or it fails.
pub fn run(
    mut send: impl FnMut(Vec<u8>) -> ControlFlow<()>,
    mut status: impl FnMut() -> String,
) -> Result<Leaving, KeyboardError> {
    let mut screen = Screen::open()?;
    let mut pressed = Pressed::new(screen.terminal.tells_releases());
    let left = read_keys(&mut screen, &mut pressed, &mut send, &mut status);
    pressed.let_go();
    // The caller may have broken off already; either way this is the last sample.
    let _ = send(pressed.sample().to_bytes().to_vec());
    left
}

fn read_keys(
    screen: &mut Screen,
    pressed: &mut Pressed,
    send: &mut impl FnMut(Vec<u8>) -> ControlFlow<()>,
    status: &mut impl FnMut() -> String,
) -> Result<Leaving, KeyboardError> {
    let clock = Clock::start();
    let mut due: Nanos = 0;
    loop {
        let wait = Duration::from_nanos(due.saturating_sub(clock.now()).min(SAMPLE_PERIOD));
        if event::poll(wait).map_err(failed("wait for a key"))? {
            let event = event::read().map_err(failed("read a key"))?;
            if pressed.take(clock.now(), &event).is_break() {
                return Ok(Leaving::Pressed);
            }
        }
        let now = clock.now();
        if now >= due {
            due = now + SAMPLE_PERIOD;
            pressed.expire(now);
            if send(pressed.sample().to_bytes().to_vec()).is_break() {
                return Ok(Leaving::Asked);
            }
            screen.show(&status())?;
        }
    }
}

fn failed(doing: &'static str) -> impl Fn(io::Error) -> KeyboardError {
    move |source| KeyboardError::Terminal { doing, source }
}

/// Monotonic time since the keyboard was opened.
struct Clock(Instant);

impl Clock {
    #[expect(
        clippy::disallowed_methods,
        reason = "this is the shell's side: no node runs on this clock"
    )]
    fn start() -> Self {
        Self(Instant::now())
    }

    fn now(&self) -> Nanos {
        u64::try_from(self.0.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }
}

/// The keys and what they mean.
const BINDINGS: [(KeyCode, Keys); 11] = [
    (KeyCode::Right, Keys::RIGHT),
    (KeyCode::Char('d'), Keys::RIGHT),
    (KeyCode::Left, Keys::LEFT),
    (KeyCode::Char('a'), Keys::LEFT),
    (KeyCode::Up, Keys::FORWARD),
    (KeyCode::Char('w'), Keys::FORWARD),
    (KeyCode::Down, Keys::BACK),
    (KeyCode::Char('s'), Keys::BACK),
    (KeyCode::Char('q'), Keys::UP),
    (KeyCode::Char('e'), Keys::DOWN),
    (KeyCode::Char(' '), Keys::HOLD),
];

/// Which keys are down, and how often the others were pressed.
struct Pressed {
    /// Those of [`BINDINGS`].
    held: HeldKeys<{ BINDINGS.len() }>,
    presses: u8,
    requests: u8,
    stops: u8,
    given_up: u8,
    take_overs: u8,
}

impl Pressed {
    const fn new(releases: bool) -> Self {
        Self {
            held: HeldKeys::new(releases),
            presses: 0,
            requests: 0,
            stops: 0,
            given_up: 0,
            take_overs: 0,
        }
    }

    /// Takes in an event; breaks when it asks to leave.
    fn take(&mut self, now: Nanos, event: &Event) -> ControlFlow<()> {
        match event {
            Event::Key(key) => return self.key(now, key),
            Event::FocusLost => self.let_go(),
            _ => {}
        }
        ControlFlow::Continue(())
    }

    fn key(&mut self, now: Nanos, key: &KeyEvent) -> ControlFlow<()> {
        let code = match key.code {
            KeyCode::Char(letter) => KeyCode::Char(letter.to_ascii_lowercase()),
            other => other,
        };
        let fresh = key.kind == KeyEventKind::Press;
        let control = key.modifiers.contains(KeyModifiers::CONTROL);
        match code {
            KeyCode::Esc => return ControlFlow::Break(()),
            KeyCode::Char('c') if control => return ControlFlow::Break(()),
            KeyCode::Char('r') if fresh && !control => self.requests = self.requests.wrapping_add(1),
            // With whatever else is held: nobody looks at modifiers in an emergency.
            KeyCode::Char('x') if fresh => self.stops = self.stops.wrapping_add(1),
            KeyCode::Char('l') if fresh && !control => self.given_up = self.given_up.wrapping_add(1),
            KeyCode::Char('t') if fresh && !control => self.take_overs = self.take_overs.wrapping_add(1),
            _ => {}
        }
        let slot = BINDINGS.iter().position(|(bound, _)| *bound == code);
        if slot.is_some_and(|slot| self.held.take(now, slot, key.kind)) {
            self.presses = self.presses.wrapping_add(1);
        }
        ControlFlow::Continue(())
    }

    fn expire(&mut self, now: Nanos) {
        self.held.expire(now);
    }

    const fn let_go(&mut self) {
        self.held.let_go();
    }

    fn sample(&self) -> DeviceSample {
        let down = self.held.down().into_iter().zip(BINDINGS).filter(|(down, _)| *down);
        DeviceSample {
            keys: down.fold(Keys::default(), |keys, (_, (_, key))| keys.and(key)),
            presses: self.presses,
            requests: self.requests,
            stops: self.stops,
            releases: self.given_up,
            take_overs: self.take_overs,
        }
    }
}

/// The terminal with its one line of status; as it was when this is dropped.
struct Screen {
    terminal: RawTerminal<Stdout>,
    shown: String,
}

const HELP: &str = "arrows or WASD move, Q/E up/down, space: robot leads, R: new trial, Esc quits\r\n\
    X: EMERGENCY STOP (cleared with: tandem estop --clear), L: give the lease up, T: take it over (supervisor)\r\n";

impl Screen {
    fn open() -> Result<Self, KeyboardError> {
        let terminal = RawTerminal::open_to_hold(io::stdout())?;
        // From here on dropping it shows the cursor again, also if what follows fails.
        let screen = Self {
            terminal,
            shown: String::new(),
        };
        let how = screen.terminal.how_keys_count();
        execute!(io::stdout(), Hide, Print(HELP), Print(how)).map_err(failed("prepare the terminal"))?;
        Ok(screen)
    }

    /// Shows one line of status, cut to the terminal's width.
    fn show(&mut self, status: &str) -> Result<(), KeyboardError> {
        // Some terminals say that they are zero columns wide when they do not know.
        let width = size().map_or(0, |(columns, _)| usize::from(columns));
        let width = if width == 0 { 80 } else { width };
        let line: String = status
            .chars()
            .map(|letter| if letter.is_control() { ' ' } else { letter })
            .take(width.saturating_sub(1))
            .collect();
        if line != self.shown {
            let mut out = io::stdout();
            queue!(out, MoveToColumn(0), Clear(ClearType::CurrentLine), Print(&line))
                .and_then(|()| out.flush())
                .map_err(failed("write to the terminal"))?;
            self.shown = line;
        }
        Ok(())
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        // Nothing to be done if it fails: the terminal is gone then.
        let _ = execute!(io::stdout(), Show, Print("\r\n"));
    }
}

#[cfg(test)]
mod tests {
    use tandem_wire::MILLISECOND;

    use super::*;

    fn event(code: KeyCode, kind: KeyEventKind) -> Event {
        Event::Key(KeyEvent::new_with_kind(code, KeyModifiers::NONE, kind))
    }

    fn pressed(releases: bool, events: &[(u64, KeyCode, KeyEventKind)]) -> Pressed {
        let mut pressed = Pressed::new(releases);
        for (millis, code, kind) in events {
            assert!(pressed.take(millis * MILLISECOND, &event(*code, *kind)).is_continue());
        }
        pressed
    }

    use KeyEventKind::{Press, Release, Repeat};

    #[test]
    fn with_releases_a_key_is_down_until_released() {
        let mut keys = pressed(true, &[(0, KeyCode::Up, Press), (5, KeyCode::Char('D'), Press)]);
        keys.expire(10_000 * MILLISECOND);
        assert_eq!(keys.sample().keys, Keys::FORWARD.and(Keys::RIGHT));
        let _ = keys.take(0, &event(KeyCode::Up, Release));
        assert_eq!((keys.sample().keys, keys.sample().presses), (Keys::RIGHT, 1));
    }

    #[test]
    fn without_releases_a_key_is_down_only_while_it_repeats() {
        let repeats: Vec<_> = (0..20).map(|i| (i * 100, KeyCode::Left, Press)).collect();
        let mut keys = pressed(false, &repeats);
        assert_eq!(keys.sample().presses, 1);
        keys.expire(2050 * MILLISECOND);
        assert_eq!(keys.sample().keys, Keys::LEFT);
        keys.expire(2051 * MILLISECOND);
        assert!(keys.sample().keys.is_empty());
    }

    #[test]
    fn losing_the_focus_lets_go_and_a_repeat_does_not_press_again() {
        let mut keys = pressed(true, &[(0, KeyCode::Char(' '), Press)]);
        let _ = keys.take(0, &Event::FocusLost);
        let _ = keys.take(0, &event(KeyCode::Char(' '), Repeat));
        assert!(keys.sample().keys.is_empty());
        let _ = keys.take(0, &event(KeyCode::Char(' '), Press));
        assert_eq!((keys.sample().keys, keys.sample().presses), (Keys::HOLD, 2));
    }

    #[test]
    fn r_asks_for_a_trial_and_escape_leaves() {
        let mut keys = pressed(true, &[(0, KeyCode::Char('r'), Press), (1, KeyCode::Char('r'), Repeat)]);
        assert_eq!((keys.sample().requests, keys.sample().keys), (1, Keys::default()));
        assert!(keys.take(2, &event(KeyCode::Esc, Press)).is_break());
        let control_c = KeyEvent::new(KeyCode::Char('c'), KeyModifiers::CONTROL);
        assert!(keys.take(2, &Event::Key(control_c)).is_break());
    }
}
