//! The keyboard's terminal: keys in, device samples out, one line of status.
//!
//! The one part of this crate that does input and output; it knows nothing of the node but the samples' format. Run it
//! on a thread of its own, with [`run`].
//!
//! Where the terminal speaks the kitty keyboard protocol, keys are down until they are released, and all of them go up
//! when the window loses the focus. Elsewhere a terminal tells only of presses and repeats, so a key counts as down for
//! a moment after each: letting go or losing the focus stops within [`REPEAT_MAY_TAKE`], and the pause that keyboards
//! make before the first repeat lets the robot stop once, too. The screen says which of the two it is.

use std::io::{self, IsTerminal, Write};
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use crossterm::cursor::{Hide, MoveToColumn, Show};
use crossterm::event::{
    self, DisableFocusChange, EnableFocusChange, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers,
    KeyboardEnhancementFlags, PopKeyboardEnhancementFlags, PushKeyboardEnhancementFlags,
};
use crossterm::style::Print;
use crossterm::terminal::{self, Clear, ClearType};
use crossterm::{execute, queue};
use tandem_wire::{MILLISECOND, Nanos};

use crate::device::{DeviceSample, Keys, SAMPLE_PERIOD};

/// Without key releases a key counts as down for this long after its last repeat. Keyboards repeat ten to thirty times
/// a second; the longest usual gap and a half.
pub const REPEAT_MAY_TAKE: Nanos = 150 * MILLISECOND;

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
    let mut pressed = Pressed::new(screen.releases);
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

/// Which keys are down, from what a terminal tells.
struct Pressed {
    /// Whether the terminal tells of releases.
    releases: bool,
    /// When each key of [`BINDINGS`] was last heard of, while it is down.
    down: [Option<Nanos>; BINDINGS.len()],
    presses: u8,
    requests: u8,
    stops: u8,
    given_up: u8,
    take_overs: u8,
}

impl Pressed {
    const fn new(releases: bool) -> Self {
        Self {
            releases,
            down: [None; BINDINGS.len()],
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
        if let Some(slot) = BINDINGS.iter().position(|(bound, _)| *bound == code) {
            self.touch(now, slot, key.kind);
        }
        ControlFlow::Continue(())
    }

    fn touch(&mut self, now: Nanos, slot: usize, kind: KeyEventKind) {
        let none_down = self.down.iter().all(Option::is_none);
        match kind {
            KeyEventKind::Release => self.down[slot] = None,
            // A repeat of a key that is up: it was down when the focus came back, and that is no press.
            KeyEventKind::Repeat if self.releases && self.down[slot].is_none() => {}
            KeyEventKind::Press | KeyEventKind::Repeat => {
                self.down[slot] = Some(now);
                if none_down {
                    self.presses = self.presses.wrapping_add(1);
                }
            }
        }
    }

    /// Where releases are not told of, silence is one.
    fn expire(&mut self, now: Nanos) {
        if !self.releases {
            for heard in &mut self.down {
                *heard = heard.filter(|heard| now.saturating_sub(*heard) <= REPEAT_MAY_TAKE);
            }
        }
    }

    fn let_go(&mut self) {
        self.down = [None; BINDINGS.len()];
    }

    fn sample(&self) -> DeviceSample {
        let down = self.down.iter().zip(BINDINGS).filter(|(heard, _)| heard.is_some());
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

/// The terminal in raw mode; restored when dropped.
struct Screen {
    releases: bool,
    shown: String,
}

const HELP: &str = "arrows or WASD move, Q/E up/down, space: robot leads, R: new trial, Esc quits\r\n\
    X: EMERGENCY STOP (cleared with: tandem estop --clear), L: give the lease up, T: take it over (supervisor)\r\n";
const WITH_RELEASES: &str = "keys count until they are released or this window loses the focus\r\n";
const WITHOUT_RELEASES: &str = "this terminal does not tell of key releases: a key counts only while it repeats,\r\n\
    one at a time, with a pause before it repeats (kitty, foot, WezTerm do better)\r\n";

impl Screen {
    fn open() -> Result<Self, KeyboardError> {
        if !io::stdin().is_terminal() || !io::stdout().is_terminal() {
            return Err(KeyboardError::NotATerminal);
        }
        terminal::enable_raw_mode().map_err(failed("switch the terminal to raw mode"))?;
        // From here on dropping it restores the terminal, also if what follows fails.
        let mut screen = Self {
            releases: false,
            shown: String::new(),
        };
        // A terminal that does not answer within two seconds has no such protocol.
        screen.releases = cfg!(windows) || terminal::supports_keyboard_enhancement().unwrap_or(false);
        screen.prepare().map_err(failed("prepare the terminal"))?;
        Ok(screen)
    }

    fn prepare(&self) -> io::Result<()> {
        let mut out = io::stdout();
        if self.releases && !cfg!(windows) {
            let flags = KeyboardEnhancementFlags::DISAMBIGUATE_ESCAPE_CODES
                | KeyboardEnhancementFlags::REPORT_EVENT_TYPES
                | KeyboardEnhancementFlags::REPORT_ALL_KEYS_AS_ESCAPE_CODES;
            queue!(out, PushKeyboardEnhancementFlags(flags))?;
        }
        let how = if self.releases { WITH_RELEASES } else { WITHOUT_RELEASES };
        execute!(out, EnableFocusChange, Hide, Print(HELP), Print(how))
    }

    /// Shows one line of status, cut to the terminal's width.
    fn show(&mut self, status: &str) -> Result<(), KeyboardError> {
        // Some terminals say that they are zero columns wide when they do not know.
        let width = terminal::size().map_or(0, |(columns, _)| usize::from(columns));
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
        let mut out = io::stdout();
        // Each on its own, and nothing to be done if one fails: the terminal is gone then.
        if self.releases && !cfg!(windows) {
            let _ = execute!(out, PopKeyboardEnhancementFlags);
        }
        let _ = execute!(out, DisableFocusChange, Show, Print("\r\n"));
        let _ = terminal::disable_raw_mode();
    }
}

#[cfg(test)]
mod tests {
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
