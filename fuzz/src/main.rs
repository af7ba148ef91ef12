//! Runs targets for as long as told, and says how many inputs a second that were.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Parser;
use tandem_fuzz::{Target, Tried, corpus, targets};

/// How often it says how far it is.
const SAY_EVERY: Duration = Duration::from_secs(5);

/// Feeds bad input to everything that reads from outside.
#[derive(Parser)]
#[command(name = "tandem-fuzz", version)]
struct Flags {
    /// Which targets: decoders, loop, cuts, bytes, records, models, settings [default: all].
    targets: Vec<String>,
    /// How long each runs.
    #[arg(long, default_value_t = 10)]
    seconds: u64,
    /// The first case's seed; the next ones follow it.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Ends a target after so many cases, if its time has not come before.
    #[arg(long)]
    cases: Option<u64>,
    /// Goes on, however long, until each decoder and each node has had so many inputs.
    #[arg(long)]
    at_least: Option<u64>,
    /// Tries nothing, but writes for every way in which a decoder ends the shortest message found into this folder.
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
}

fn main() -> ExitCode {
    let flags = Flags::parse();
    if let Some(folder) = &flags.keep {
        return keep(folder);
    }
    let mut known = targets();
    for name in &flags.targets {
        if !known.iter().any(|target| target.name() == name) {
            let names: Vec<_> = known.iter().map(|target| target.name()).collect();
            eprintln!(
                "tandem-fuzz: there is no target {name:?}; choose from {}",
                names.join(", ")
            );
            return ExitCode::from(2);
        }
    }
    known.retain(|target| flags.targets.is_empty() || flags.targets.iter().any(|name| name == target.name()));
    let held = known.iter_mut().map(|target| run(target.as_mut(), &flags));
    // Every target has its turn, whatever became of the one before.
    if held.fold(true, |all, held| all & held) {
        ExitCode::SUCCESS
    } else {
        ExitCode::from(1)
    }
}

/// Whether everything held.
fn run(target: &mut dyn Target, flags: &Flags) -> bool {
    let began = Instant::now();
    let limit = Duration::from_secs(flags.seconds);
    let (mut cases, mut tried, mut said) = (0_u64, Tried::new(), began);
    let is_enough = |tried: &Tried, cases: u64| match flags.at_least {
        // After so many cases everything has had its turn and is counted.
        Some(least) => cases > 1000 && tried.values().all(|inputs| *inputs >= least),
        None => began.elapsed() >= limit,
    };
    while !is_enough(&tried, cases) && flags.cases.is_none_or(|most| cases < most) {
        let seed = flags.seed.wrapping_add(cases);
        // A target begins every case anew, so one that panicked leaves nothing half done that matters.
        if catch_unwind(AssertUnwindSafe(|| target.run(seed, &mut tried))).is_err() {
            let name = target.name();
            eprintln!("{name}: the case of seed {seed} failed; again: tandem-fuzz {name} --seed {seed} --cases 1");
            return false;
        }
        cases += 1;
        if said.elapsed() > SAY_EVERY {
            said = Instant::now();
            eprintln!("{:9} {} inputs so far", target.name(), tried.values().sum::<u64>());
        }
    }
    let inputs: u64 = tried.values().sum();
    let seconds = began.elapsed().as_secs_f64();
    println!(
        "{:9} {inputs:>10} inputs in {seconds:>6.1} s, {:>9.0} a second; all held",
        target.name(),
        inputs as f64 / seconds.max(1e-9)
    );
    if tried.len() > 1 {
        for (what, inputs) in &tried {
            println!("  {what:9} {inputs:>10}");
        }
    }
    true
}

fn keep(folder: &Path) -> ExitCode {
    const CASES: u64 = 5_000_000;
    eprintln!("trying {CASES} cases");
    for (name, bytes) in corpus::gather(CASES) {
        let path = folder.join(name);
        if let Err(error) = std::fs::write(&path, bytes) {
            eprintln!("tandem-fuzz: {} cannot be written: {error}", path.display());
            return ExitCode::from(1);
        }
    }
    ExitCode::SUCCESS
}
