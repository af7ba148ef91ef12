//! Words on standard output and standard error: `println!` and its kin, as all of this program means them.
//!
//! The ones that come with Rust panic when nobody reads on (`tandem trial report RUN | head`). The other custom, to let
//! the signal of the broken pipe end the program, would leave a robot without its nodes and a session file without its
//! end because a pager was closed. Here the work goes on and its words go nowhere; the exit code says how the work went.
//! A full disk under the output is another matter: then what was asked for is not there, and [`kept`] says so.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether words were lost that somebody waits for.
static LOST: AtomicBool = AtomicBool::new(false);

/// Prints to standard output.
macro_rules! print {
    ($($words:tt)*) => { $crate::speaking::say(&mut ::std::io::stdout(), ::core::format_args!($($words)*)) };
}

/// Prints a line to standard output.
macro_rules! println {
    () => { print!("\n") };
    ($($words:tt)*) => { print!("{}\n", ::core::format_args!($($words)*)) };
}

/// Prints a line to standard error.
macro_rules! eprintln {
    ($($words:tt)*) => {
        $crate::speaking::say(
            &mut ::std::io::stderr(),
            ::core::format_args!("{}\n", ::core::format_args!($($words)*)),
        )
    };
}

/// Writes the words; if nobody reads them, they are gone.
pub(crate) fn say(to: &mut dyn Write, words: Arguments<'_>) {
    if to.write_fmt(words).is_err_and(|error| is_loss(&error)) {
        LOST.store(true, Ordering::Relaxed);
    }
}

/// Whether everything that somebody waits for was said.
pub(crate) fn kept() -> bool {
    if io::stdout().flush().is_err_and(|error| is_loss(&error)) {
        LOST.store(true, Ordering::Relaxed);
    }
    !LOST.load(Ordering::Relaxed)
}

fn is_loss(error: &io::Error) -> bool {
    error.kind() != ErrorKind::BrokenPipe
}
