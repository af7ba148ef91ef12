//! Notes the git revision that the program is built from, and a hash of the wire's layout; recordings carry both.

use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=../.git/HEAD");
    println!("cargo::rerun-if-changed=../.git/refs/heads");
    println!("cargo::rerun-if-changed=../wire/tests/golden.txt");
    println!("cargo::rustc-env=TANDEM_WIRE={}", wire());
    let described = Command::new("git")
        .args(["describe", "--always", "--dirty", "--abbrev=12"])
        .output();
    let revision = described
        .ok()
        .filter(|output| output.status.success())
        .and_then(|output| String::from_utf8(output.stdout).ok());
    println!(
        "cargo::rustc-env=TANDEM_REVISION={}",
        revision.as_deref().map_or("unknown", str::trim)
    );
}

/// FNV-1a of the golden bytes, which change whenever a message's layout does: two programs with the same one understand
/// each other, whatever their versions.
fn wire() -> String {
    let golden = std::fs::read("../wire/tests/golden.txt").unwrap_or_default();
    let step = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    format!("{:08x}", golden.iter().fold(0xcbf2_9ce4_8422_2325, step) >> 32)
}
