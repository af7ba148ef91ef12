//! `tandem trial sweep`: the same simulated trials under many laws, on all cores.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context as _;
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use tandem_predictor::PredictorSettings;
use tandem_settings::Document;
use tandem_trials::sweep::{Grid, Store, Summary, svg, table, text, work_off};

use crate::configuration::BadConfiguration;
use crate::{Outcome, interrupt, shipped};

#[derive(Args)]
pub(crate) struct SweepFlags {
    /// What to sweep: a `[sweep]` section, and others that hold for every trial [default: the shipped grid].
    #[arg(long, value_name = "FILE")]
    plan: Option<PathBuf>,
    /// Where finished cells, table and figure are kept; a sweep that was cut short goes on there.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Overrides one key of the plan, as in --set sweep.seeds=5.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Threads [default: one for each core].
    #[arg(long, value_name = "N")]
    jobs: Option<NonZeroUsize>,
    /// Prints everything as one JSON object.
    #[arg(long)]
    json: bool,
}

/// The grid that ships.
const SHIPPED: &str = include_str!("../../examples/plans/sweep.toml");

pub(crate) fn run(flags: &SweepFlags) -> anyhow::Result<Outcome> {
    let began = Instant::now();
    let document = document(flags)?;
    let predictor: PredictorSettings = document.section().map_err(BadConfiguration::from)?;
    let grid = Grid::from_document(&document, shipped::model_or(&predictor.model)?)
        .map_err(|error| BadConfiguration::Conflict(error.to_string()))?;
    let interrupted = interrupt::catch()?;
    let store = Store::open(&flags.out, &grid)?;
    let threads = flags.jobs.or_else(|| std::thread::available_parallelism().ok());
    let bar = ProgressBar::new(0);
    let style = ProgressStyle::with_template("{elapsed:>4} {bar:40} {pos} of {len} cells, {eta} left");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let mut cut_short = false;
    let results = work_off(&grid, &store, threads.unwrap_or(NonZeroUsize::MIN), |done, all| {
        bar.set_length(all as u64);
        if bar.position() == 0 {
            // What was done before tells nothing about the time that is left.
            bar.set_position(done as u64);
            bar.reset_eta();
        }
        bar.set_position(done as u64);
        cut_short |= interrupted.try_recv().is_ok();
        !cut_short
    })?;
    bar.finish_and_clear();

    let summary = Summary::of(&grid, &results);
    let keep = |name: &str, words: String| {
        let path = flags.out.join(name);
        std::fs::write(&path, words).with_context(|| format!("cannot write {}", path.display()))
    };
    keep("table.md", table(&grid, &summary))?;
    keep("sweep.svg", svg(&grid, &summary))?;
    keep("summary.json", serde_json::to_string(&summary)?)?;
    if flags.json {
        println!("{}", serde_json::to_string(&summary)?);
    } else {
        println!("{}", text(&grid, &summary));
        println!(
            "{} trials, {:.0} s; every group in {}, the picture in {}",
            summary.trials,
            began.elapsed().as_secs_f64(),
            flags.out.join("table.md").display(),
            flags.out.join("sweep.svg").display(),
        );
    }
    if cut_short {
        eprintln!("tandem: interrupted; what is done is kept, the same command goes on from there");
        return Ok(Outcome::Incomplete);
    }
    Ok(Outcome::Done)
}

fn document(flags: &SweepFlags) -> Result<Document, BadConfiguration> {
    let (name, text) = match &flags.plan {
        None => ("the shipped plan".to_owned(), SHIPPED.to_owned()),
        Some(path) => {
            let text = std::fs::read_to_string(path).map_err(|source| BadConfiguration::Unreadable {
                path: path.clone(),
                source,
            })?;
            (path.display().to_string(), text)
        }
    };
    let mut document = Document::parse(&name, &text)?;
    for given in &flags.set {
        let Some((key, value)) = given.split_once('=') else {
            return Err(BadConfiguration::Override { given: given.clone() });
        };
        document.set(key.trim(), value.trim());
    }
    Ok(document)
}
