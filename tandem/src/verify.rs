//! `tandem replay --verify`: every node of a recording is executed again and must answer what it answered then.

use std::fs::File;
use std::io::{BufReader, IsTerminal as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use tandem_recorder::Evidence;
use tandem_trials::{Difference, Divergence, EPSILON, Findings, Overall, RunFinding, Verdict, reexecute};
use tandem_wire::{NodeName, seconds};

use crate::configuration::BadConfiguration;
use crate::{BUILD, Outcome, session, table};

/// What takes longer shows how far it is.
const PATIENCE: Duration = Duration::from_secs(1);

/// Verifies the session file at `path` and prints what was found.
pub(crate) fn run(path: &Path, more: &[PathBuf], json: bool, note: bool) -> anyhow::Result<Outcome> {
    let began = Instant::now();
    let evidence = read(path, more)?;
    let mut bar = None;
    let findings = reexecute(&evidence, |done, total| {
        if began.elapsed() > PATIENCE && std::io::stderr().is_terminal() {
            bar.get_or_insert_with(|| progress_bar(total)).set_position(done);
        }
    });
    if let Some(bar) = bar {
        bar.finish_and_clear();
    }
    let report = Report {
        findings,
        took: began.elapsed(),
    };
    if note {
        let noted = session::note(path, more, &report.as_json())?;
        eprintln!("verify: noted in {}", noted.display());
    }
    if json {
        println!("{}", serde_json::to_string(&report.as_json())?);
    } else {
        println!("{}", report.as_table());
    }
    Ok(match report.findings.overall() {
        Overall::Identical | Overall::Close => Outcome::Done,
        Overall::Diverged => Outcome::Failed,
        Overall::Incomplete => Outcome::Incomplete,
    })
}

/// Reads what a session's files hold for executing its nodes again.
pub(crate) fn read(path: &Path, more: &[PathBuf]) -> Result<Evidence, BadConfiguration> {
    let refused = |source| BadConfiguration::Session {
        path: path.to_owned(),
        source,
    };
    let open = |path: &PathBuf| Ok(BufReader::with_capacity(1 << 18, File::open(path)?));
    let parts: Result<Vec<_>, std::io::Error> = session::parts(path, more).iter().map(open).collect();
    Evidence::read_parts(parts.map_err(|error| refused(error.into()))?).map_err(refused)
}

fn progress_bar(total: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{elapsed:>4} {bar:40} {percent:>3} % of the journals");
    let bar = ProgressBar::new(total);
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

struct Report {
    findings: Findings,
    took: Duration,
}

impl Report {
    /// How much faster than when it happened.
    fn factor(&self) -> f64 {
        seconds(self.findings.span()) / self.took.as_secs_f64().max(1e-9)
    }

    fn as_table(&self) -> String {
        let findings = &self.findings;
        let names: Vec<String> = findings.runs.iter().map(|run| self.name(run)).collect();
        let mut lines: Vec<(&str, String)> = Vec::new();
        for (run, name) in findings.runs.iter().zip(&names) {
            lines.push((name, run.to_string()));
            if let Verdict::Diverged(divergence) = &run.verdict {
                lines.extend(details(run, divergence).into_iter().map(|line| ("", line)));
            }
        }
        lines.extend(findings.faults.iter().map(|fault| ("the file", fault.clone())));
        if findings.runs.is_empty() {
            lines.push(("the file", "it holds no journal of any node".to_owned()));
        }
        let verdict = findings.overall().as_str();
        let speed = format!(
            "{:.1} s executed again in {:.0} ms, {:.0} times as fast",
            seconds(findings.span()),
            self.took.as_secs_f64() * 1e3,
            self.factor()
        );
        format!("{}\n{verdict}: {speed}", table::rows(&lines))
    }

    /// The node's name, and which run of it if there are several.
    fn name(&self, run: &RunFinding) -> String {
        let node: NodeName = run.run.node;
        let runs = self.findings.runs.iter().filter(|other| other.run.node == node);
        match runs.count() {
            1 => node.to_string(),
            _ => format!("{node} {:016x}", run.run.session.0),
        }
    }

    fn as_json(&self) -> Value {
        json!({
            "verdict": self.findings.overall().as_str(),
            "nodes": self.findings.runs.iter().map(run_json).collect::<Vec<_>>(),
            "faults": self.findings.faults,
            "session_s": seconds(self.findings.span()),
            "wall_s": self.took.as_secs_f64(),
            "times_real_time": self.factor(),
        })
    }
}

/// So many differing fields are spelled out for people; the others are counted.
const FIELDS_SHOWN: usize = 8;

/// What follows below a diverged node: field by field, and whether it was another program.
fn details(run: &RunFinding, divergence: &Divergence) -> Vec<String> {
    let (topic, fields) = (divergence.topic, divergence.fields());
    let shown = fields.iter().take(FIELDS_SHOWN);
    let mut lines: Vec<String> = shown.map(|field| format!("  {topic}.{field}")).collect();
    if fields.len() > FIELDS_SHOWN {
        lines.push(format!(
            "  and {} more (--json names them all)",
            fields.len() - FIELDS_SHOWN
        ));
    }
    if let Some(build) = run.build.as_ref().filter(|build| *build != BUILD) {
        lines.push(format!("  it was recorded by {build}; this is {BUILD}"));
    }
    lines
}

fn run_json(run: &RunFinding) -> Value {
    let mut object = json!({
        "node": run.run.node.as_str(),
        "session": format!("{:016x}", run.run.session.0),
        "build": run.build,
        "verdict": run.verdict.as_str(),
        "steps": run.steps,
        "outputs": run.outputs,
        "snapshots": run.snapshots,
        "resumed_at": run.resumed,
        "span_s": seconds(run.span),
        "stopped": run.stopped,
    });
    match &run.verdict {
        Verdict::Identical => {}
        Verdict::Close { largest, field } => {
            object["close"] = json!({"epsilon": EPSILON, "largest": largest, "field": field});
        }
        Verdict::Diverged(divergence) => object["divergence"] = divergence_json(divergence),
        Verdict::Incomplete(missing) => object["missing"] = missing.to_string().into(),
    }
    object
}

fn divergence_json(divergence: &Divergence) -> Value {
    let fields: Vec<Value> = divergence
        .fields()
        .iter()
        .map(|field| json!({"path": field.path, "recorded": field.recorded, "now": field.again}))
        .collect();
    json!({
        "step": divergence.step,
        "entry": divergence.entry,
        "at_ns": divergence.at.0,
        "topic": divergence.topic.to_string(),
        "what": match divergence.difference {
            Difference::State { .. } => "state",
            _ => "output",
        },
        "fields": fields,
        "text": divergence.to_string(),
    })
}
