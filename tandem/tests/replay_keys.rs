//! A replay's keys on a real terminal: every one is pressed on a pseudo terminal, and the line on the screen must say what it
//! did. Plain Python opens it; skipped where there is none.

#![cfg(unix)]

mod process;

use std::path::Path;
use std::process::Command;

use process::recorded::session;

#[test]
fn every_key_does_what_the_screen_says() {
    let python = std::env::var("TANDEM_PYTHON").unwrap_or_else(|_| "python3".into());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/replay_keys.py");
    let pressed = Command::new(&python)
        .arg(script)
        .arg(env!("CARGO_BIN_EXE_tandem"))
        .arg(session())
        .output();
    let Ok(pressed) = pressed else {
        eprintln!("SKIPPED: {python} is not there");
        return;
    };
    assert!(pressed.status.success(), "{}", String::from_utf8_lossy(&pressed.stderr));
}
