//! The terminal in raw mode, asked for key releases if it knows of them, and as it was when this is dropped.

use std::io::{self, IsTerminal, Write};

use crossterm::event::{
    DisableFocusChange, EnableFocusChange, KeyboardEnhancementFlags, PopKeyboardEnhancementFlags,
    PushKeyboardEnhancementFlags,
};
use crossterm::terminal;
use crossterm::{execute, queue};

use super::{KeyboardError, failed};

const WITH_RELEASES: &str = "keys count until they are released or this window loses the focus\r\n";
const WITHOUT_RELEASES: &str = "this terminal does not tell of key releases: a key counts only while it repeats,\r\n\
    one at a time, with a pause before it repeats (kitty, foot, WezTerm do better)\r\n";

/// A terminal in raw mode, of which `out` is the side that shows things.
#[derive(Debug)]
pub struct RawTerminal<W: Write + IsTerminal> {
    out: W,
    /// Whether it was asked for what holding a key needs.
    holds: bool,
    releases: bool,
}

impl<W: Write + IsTerminal> RawTerminal<W> {
    /// A terminal for keys that count when they are pressed.
    ///
    /// # Errors
    /// If standard input or `out` is none, or it fails.
    pub fn open(out: W) -> Result<Self, KeyboardError> {
        if !io::stdin().is_terminal() || !out.is_terminal() {
            return Err(KeyboardError::NotATerminal);
        }
        terminal::enable_raw_mode().map_err(failed("switch the terminal to raw mode"))?;
        Ok(Self {
            out,
            holds: false,
            releases: false,
        })
    }

    /// A terminal for keys that count while they are held: it also tells of releases, if it can, and of its focus.
    ///
    /// # Errors
    /// If standard input or `out` is none, or it fails.
    pub fn open_to_hold(out: W) -> Result<Self, KeyboardError> {
        let mut terminal = Self::open(out)?;
        // One that does not answer within two seconds has no such protocol. It is asked through standard output, where
        // the question must not get into a file.
        let is_asked = || io::stdout().is_terminal() && terminal::supports_keyboard_enhancement().unwrap_or(false);
        terminal.releases = cfg!(windows) || is_asked();
        terminal.holds = true;
        terminal.prepare().map_err(failed("prepare the terminal"))?;
        Ok(terminal)
    }

    fn prepare(&mut self) -> io::Result<()> {
        if self.releases && !cfg!(windows) {
            let flags = KeyboardEnhancementFlags::DISAMBIGUATE_ESCAPE_CODES
                | KeyboardEnhancementFlags::REPORT_EVENT_TYPES
                | KeyboardEnhancementFlags::REPORT_ALL_KEYS_AS_ESCAPE_CODES;
            queue!(self.out, PushKeyboardEnhancementFlags(flags))?;
        }
        execute!(self.out, EnableFocusChange)
    }

    /// Whether it tells of key releases.
    #[must_use]
    pub const fn tells_releases(&self) -> bool {
        self.releases
    }

    /// How long a key counts here, in words for the screen: lines that end as raw mode needs it.
    #[must_use]
    pub const fn how_keys_count(&self) -> &'static str {
        if self.releases { WITH_RELEASES } else { WITHOUT_RELEASES }
    }
}

impl<W: Write + IsTerminal> Drop for RawTerminal<W> {
    fn drop(&mut self) {
        // Each on its own, and nothing to be done if one fails: the terminal is gone then.
        if self.releases && !cfg!(windows) {
            let _ = execute!(self.out, PopKeyboardEnhancementFlags);
        }
        if self.holds {
            let _ = execute!(self.out, DisableFocusChange);
        }
        let _ = terminal::disable_raw_mode();
    }
}
