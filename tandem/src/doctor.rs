//! `tandem doctor`: what keeps a session from working on this machine, and what to do about it.

mod check;
mod machine;
mod peers;

use clap::Args;
use serde_json::{Value, json};
use tandem_link::{LinkSettings, Reach};
use tandem_site::Role;

use crate::nodes::{self, NodeFlags};
use crate::{BUILD, Outcome};
use check::{Check, Verdict};

#[derive(Args)]
pub(crate) struct DoctorFlags {
    /// What shall run on this machine: operator, predictor, arbiter, robot-sim, recorder or router.
    #[arg(long, value_name = "ROLE")]
    role: Option<Role>,
    /// Prints one JSON object.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    node: NodeFlags,
}

/// What was looked into, told as it is found unless it shall be JSON.
struct Findings {
    checks: Vec<Check>,
    as_json: bool,
}

impl Findings {
    fn tell(&mut self, checks: impl IntoIterator<Item = Check>) {
        for check in checks {
            if !self.as_json {
                println!("{}", check.line());
            }
            self.checks.push(check);
        }
    }

    fn end(self) -> Outcome {
        let bad = self.checks.iter().filter(|check| check.verdict == Verdict::Bad).count();
        if self.as_json {
            let checks: Vec<Value> = self.checks.iter().map(Check::json).collect();
            println!("{}", json!({ "ok": bad == 0, "build": BUILD, "checks": checks }));
        } else if bad == 0 {
            println!("nothing stands in the way");
        } else {
            println!("{bad} to mend, marked BAD");
        }
        if bad == 0 { Outcome::Done } else { Outcome::Failed }
    }
}

pub(crate) fn run(flags: &DoctorFlags) -> anyhow::Result<Outcome> {
    let mut findings = Findings {
        checks: Vec::new(),
        as_json: flags.json,
    };
    findings.tell([Check::good("program", format!("tandem {BUILD}"))]);
    let configuration = match flags.node.configuration(&[]) {
        Ok(configuration) => configuration,
        Err(why) => {
            findings.tell([Check::bad(
                "settings",
                format!("{:#}", anyhow::Error::from(why)),
                "mend that first",
            )]);
            return Ok(findings.end());
        }
    };
    let settings = &configuration.link;
    findings.tell([Check::good(
        "settings",
        "they can be read, and every value is in its range",
    )]);
    findings.tell(machine::certificates(settings, flags.role));
    match Reach::new(settings, flags.role) {
        Err(why) => findings.tell([Check::bad(
            "endpoints",
            why.to_string(),
            "nothing can be reached before that",
        )]),
        Ok(reach) => {
            let ports = machine::ports(&reach);
            let is_running = ports.iter().any(|check| check.verdict == Verdict::Worth);
            findings.tell(ports);
            findings.tell(others(flags, settings, is_running));
        }
    }
    findings.tell([clock()]);
    findings.tell(machine::disk(&configuration));
    findings.tell([machine::viewer(&configuration.recorder)]);
    Ok(findings.end())
}

/// Who answers and who is there. A machine that only listens asks its own process, if that runs.
fn others(flags: &DoctorFlags, settings: &LinkSettings, is_running: bool) -> Vec<Check> {
    if settings.connect.is_empty() && !settings.listen.is_empty() && !is_running {
        let says = "this machine listens and dials nobody, and nothing runs here yet: look again once it does";
        return vec![Check::skipped("nodes", says)];
    }
    let tool = nodes::as_tool(settings);
    match Reach::new(&tool, flags.role) {
        Err(why) => vec![Check::bad("reach", why.to_string(), "nothing can be asked before that")],
        Ok(reach) => {
            let doors = peers::doors(&reach);
            [doors, peers::nodes(&tool, &reach, flags.node.robot())].concat()
        }
    }
}

/// Nothing that moves a robot goes by the wall clock; certificates and files do.
fn clock() -> Check {
    let kept = [
        "/run/systemd/timesync/synchronized",
        "/run/chrony/chronyd.pid",
        "/run/chronyd.pid",
        "/run/ntpd.pid",
    ];
    match kept.iter().find(|file| std::path::Path::new(file).exists()) {
        Some(sign) => Check::good("clock", format!("something keeps this machine's clock right ({sign})")),
        None => Check::worth(
            "clock",
            format!(
                "no sign that anything keeps this machine's clock right; it says {}",
                tandem_site::Day::today()
            ),
            "certificates and files go by it, motion does not; where it matters, run chrony or systemd-timesyncd",
        ),
    }
}
