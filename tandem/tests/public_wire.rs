//! The wire as others read it: the Python codec, docs/wire.md and the golden bytes agree, and the Python robot keeps the
//! rules. Plain Python; skipped where there is none.

use std::path::Path;
use std::process::Command;

/// Runs a check of the repository's with whatever Python there is.
fn python_agrees(script: &str) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let python = std::env::var("TANDEM_PYTHON").unwrap_or_else(|_| "python3".into());
    let Ok(done) = Command::new(&python).arg(root.join(script)).output() else {
        eprintln!("SKIPPED {script}: {python} is not there");
        return;
    };
    let said = String::from_utf8_lossy(&done.stdout);
    let errors = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{script}: {said}{errors}");
}

#[test]
fn the_python_codec_the_page_and_the_golden_bytes_agree() {
    python_agrees("checks/wire.py");
}

#[test]
fn the_python_robot_keeps_every_safety_rule() {
    python_agrees("checks/point_robot.py");
}
