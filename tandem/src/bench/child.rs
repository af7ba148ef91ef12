//! The other processes of a measurement, from outside.

use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{ChildStdout, Command, Stdio};

use anyhow::{Context as _, bail};
use clap::ValueEnum as _;

use super::part::{Part, Told};

/// Parameters of Zenoh's threads as it comes, for what shall not have ours.
const AS_ZENOH_COMES: &str = "()";

/// One side of a measurement, as a process. Dropping it ends it at once.
pub(super) struct Child {
    process: std::process::Child,
    said: BufReader<ChildStdout>,
    part: Part,
}

impl Child {
    /// Starts a part and waits until it is ready.
    pub(super) fn start(part: Part, endpoint: &str, hz: f64, robots: u32) -> anyhow::Result<Self> {
        Self::start_together(part, endpoint, hz, robots, 1)
    }

    /// The same, with so many robots to a session.
    pub(super) fn start_together(
        part: Part,
        endpoint: &str,
        hz: f64,
        robots: u32,
        together: u32,
    ) -> anyhow::Result<Self> {
        let name = part
            .to_possible_value()
            .context("a part has a name")?
            .get_name()
            .to_owned();
        let mut command = Command::new(std::env::current_exe().context("cannot find this program")?);
        command.args(["bench", "part", &name, "--endpoint", endpoint]);
        command.args(["--hz", &hz.to_string(), "--robots", &robots.to_string()]);
        command.args(["--together", &together.to_string()]);
        if matches!(part, Part::BareCommand | Part::BareObey) {
            command.env("ZENOH_RUNTIME", AS_ZENOH_COMES);
        }
        let mut process = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .with_context(|| format!("cannot start the part {name}"))?;
        let said = process.stdout.take().context("its output is a pipe")?;
        let mut child = Self {
            process,
            said: BufReader::new(said),
            part,
        };
        let mut line = String::new();
        child.said.read_line(&mut line).context("a part's first word")?;
        if line.trim() != "ready" {
            bail!("the part {name} could not begin");
        }
        Ok(child)
    }

    /// Asks it to end, and returns what it tells.
    pub(super) fn finish(mut self) -> anyhow::Result<Told> {
        // It ends when its input does.
        drop(self.process.stdin.take());
        let mut text = String::new();
        self.said.read_to_string(&mut text).context("what a part told")?;
        let status = self.process.wait().context("a part's end")?;
        if !status.success() {
            bail!("the part {:?} ended with {status}", self.part);
        }
        serde_json::from_str(&text).context("what a part told is not understood")
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        // One that has ended already is what we want.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
