//! `tandem trial report`: a run's folder as a table, a page, and tables for other programs.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use tandem_trials::report::{Report, Setup, read_cases};
use tandem_trials::run::{RunError, RunFolder};

use crate::Outcome;

#[derive(Args)]
pub(crate) struct ReportFlags {
    /// The run's folder, as `tandem trial run` makes it.
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// Where the page goes [default: RUN/report.html].
    #[arg(long, value_name = "PATH")]
    html: Option<PathBuf>,
    /// Writes trials.csv, steps.csv, conditions.csv and comparisons.csv into this folder.
    #[arg(long, value_name = "DIR")]
    csv: Option<PathBuf>,
    /// The condition that is compared with each of the others [default: adaptive, or else the plan's first].
    #[arg(long, value_name = "CONDITION")]
    reference: Option<String>,
    /// Prints everything as one JSON object instead of the table.
    #[arg(long)]
    json: bool,
}

/// What is wrong with the words of the command.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BadRequest {
    /// The folder is none of a run.
    #[error(transparent)]
    NoRun(RunError),
    /// No trial was driven under the reference.
    #[error("there is no condition {name:?} in this run; choose from {}", .known.join(", "))]
    Reference { name: String, known: Vec<String> },
}

pub(crate) fn run(flags: &ReportFlags) -> anyhow::Result<Outcome> {
    let folder = RunFolder::open(&flags.run).map_err(|error| match error {
        RunError::NotARun { .. } => BadRequest::NoRun(error).into(),
        other => anyhow::Error::from(other),
    })?;
    let mut setup = Setup::of(&folder, flags.reference.as_deref().unwrap_or_default());
    let bar = ProgressBar::new(folder.entries().len() as u64);
    let style = ProgressStyle::with_template("{elapsed:>4} {bar:40} trial {pos} of {len}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let cases = read_cases(&folder, &mut setup, |done| bar.set_position(done as u64));
    bar.finish_and_clear();
    let report = Report::new(setup, cases);
    if let Some(name) = flags.reference.as_ref().filter(|name| **name != report.setup.reference) {
        let known = report.setup.conditions.iter().map(|(name, _)| name.clone()).collect();
        return Err(BadRequest::Reference {
            name: name.clone(),
            known,
        }
        .into());
    }

    let page = flags.html.clone().unwrap_or_else(|| flags.run.join("report.html"));
    write(&page, &report.html())?;
    if let Some(tables) = &flags.csv {
        fs::create_dir_all(tables).with_context(|| format!("cannot make the folder {}", tables.display()))?;
        for table in report.csv() {
            write(&tables.join(table.name), &table.text)?;
        }
    }
    if flags.json {
        let object = json!({ "page": page, "report": report });
        println!("{object}");
    } else {
        println!("{}\n\npage: {}", report.text(), page.display());
    }
    Ok(if report.trials.is_empty() {
        Outcome::Failed
    } else if report.setup.unreadable.is_empty() {
        Outcome::Done
    } else {
        Outcome::Incomplete
    })
}

/// Writes a file beside its place and moves it there: a page that is open in a browser is never half a page.
fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".tmp");
    fs::write(&beside, text)
        .and_then(|()| fs::rename(&beside, path))
        .with_context(|| format!("cannot write {}", path.display()))
}
