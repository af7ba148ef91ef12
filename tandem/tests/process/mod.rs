//! Tandem's own processes, for tests that need several.

#![allow(dead_code, reason = "every test uses another part")]

pub(crate) mod goal;
#[cfg(unix)]
pub(crate) mod loops;
pub(crate) mod recorded;

use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A process of ours, killed if the test ends early.
pub(crate) struct Process(Child);

impl Process {
    pub(crate) fn start(arguments: &[&str]) -> Self {
        let child = Command::new(env!("CARGO_BIN_EXE_tandem"))
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn();
        Self(child.expect("tandem starts"))
    }

    /// Runs it to its end.
    pub(crate) fn output(arguments: &[&str]) -> std::process::Output {
        let run = Command::new(env!("CARGO_BIN_EXE_tandem"))
            .args(arguments)
            .stdin(Stdio::null())
            .output();
        run.expect("tandem starts")
    }

    /// One that was started in another way.
    pub(crate) const fn of(child: Child) -> Self {
        Self(child)
    }

    /// Asks it to end as Ctrl-C and a service manager do, and gives its exit code.
    pub(crate) fn end(mut self) -> Option<i32> {
        let asked = Command::new("kill")
            .args(["-s", "INT", &self.0.id().to_string()])
            .status()
            .expect("kill runs");
        assert!(asked.success());
        let limit = Instant::now() + Duration::from_secs(20);
        while Instant::now() < limit {
            if let Some(status) = self.0.try_wait().expect("our own child") {
                return status.code();
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        None
    }
}

impl Process {
    /// Kills it as a power cut would: no goodbye, nothing flushed.
    pub(crate) fn kill(mut self) {
        self.0.kill().expect("our own child");
        self.0.wait().expect("our own child");
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
