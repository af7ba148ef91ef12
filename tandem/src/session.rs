//! `tandem session`: what a session file holds, made whole, and as tables.

mod export;
mod family;
mod info;
mod kept;
mod stops;
mod verdict;

use std::fs::File;
use std::io::{BufReader, BufWriter};
use std::path::PathBuf;

use anyhow::{Context as _, bail};
use clap::{Args, Subcommand};
use tandem_link::LoopSettings;
use tandem_recorder::{Recording, repair};
use tandem_settings::Document;
use tandem_wire::{Timing, Topic};

use crate::{Outcome, verify};
use export::Format;
pub(crate) use family::{Part, load, open, parts};
pub(crate) use verdict::note;

/// What is played and exported.
pub(crate) const PLAYED: [Topic; 11] = [
    Topic::Command,
    Topic::Proposal,
    Topic::Forecast,
    Topic::Setpoint,
    Topic::State,
    Topic::Scene,
    Topic::Trial,
    Topic::Lease,
    Topic::TakeOver,
    Topic::Emergency,
    Topic::AllClear,
];

#[derive(Subcommand)]
pub(crate) enum SessionCommands {
    /// Prints what is in a session file, and what is missing from it.
    Info(InfoFlags),
    /// Writes what can be read of a damaged file into a whole one beside it.
    Repair(RepairFlags),
    /// Executes the robot again and says when it stopped and why: what it had heard last, when it braked, when it stood.
    Stops(StopsFlags),
    /// Writes tables, one row per message and one per tick, with units in the names of the columns.
    Export(ExportFlags),
}

#[derive(Args)]
pub(crate) struct InfoFlags {
    /// The session file; later parts of it beside it are read with it.
    file: PathBuf,
    /// Further parts of the same session, instead of those beside the first.
    more: Vec<PathBuf>,
    /// Prints one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
pub(crate) struct StopsFlags {
    /// The session file; later parts of it beside it are read with it.
    file: PathBuf,
    /// Further parts of the same session, instead of those beside the first.
    more: Vec<PathBuf>,
    /// Prints one JSON array, an object per run of the robot. Times in it count from `heard_ns`, the arrival of the last
    /// setpoint that let the arm move, on the robot's clock.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
pub(crate) struct RepairFlags {
    /// The session file; it is left as it is.
    file: PathBuf,
    /// The whole file [default: FILE with .repaired.mcap at the end].
    #[arg(short, long, value_name = "PATH")]
    output: Option<PathBuf>,
    /// Merges what nodes kept of their journals in this folder (`link.spool`, or tandem-journals-… among the system's
    /// temporary files), where the file lacks it.
    #[arg(long, value_name = "DIR")]
    spool: Option<PathBuf>,
}

#[derive(Args)]
pub(crate) struct ExportFlags {
    /// The session file; later parts of it beside it are read with it.
    file: PathBuf,
    /// Further parts of the same session, instead of those beside the first.
    more: Vec<PathBuf>,
    /// The folder for state.csv, setpoint.csv, command.csv, proposal.csv and ticks.csv, and lease.csv and estop.csv where
    /// there was any; made if it is not there.
    #[arg(long, value_name = "DIR", required_unless_present = "parquet")]
    csv: Option<PathBuf>,
    /// The folder for the same tables as Parquet files.
    #[arg(long, value_name = "DIR")]
    parquet: Option<PathBuf>,
}

pub(crate) fn run(command: &SessionCommands) -> anyhow::Result<Outcome> {
    match command {
        SessionCommands::Info(flags) => {
            let recording = family::load(&flags.file, &flags.more)?;
            let verdict = verdict::find(&flags.file, &flags.more);
            info::print(&recording, &verdict, flags.json)?;
            Ok(Outcome::Done)
        }
        SessionCommands::Stops(flags) => {
            let evidence = verify::read(&flags.file, &flags.more)?;
            let whole = stops::print(&evidence, flags.json)?;
            Ok(if whole { Outcome::Done } else { Outcome::Incomplete })
        }
        SessionCommands::Repair(flags) => mend(flags),
        SessionCommands::Export(flags) => {
            let recording = family::load(&flags.file, &flags.more)?;
            warn(&recording);
            for (format, folder) in [(Format::Csv, &flags.csv), (Format::Parquet, &flags.parquet)] {
                if let Some(folder) = folder {
                    export::write(&recording, format, folder)?;
                }
            }
            Ok(Outcome::Done)
        }
    }
}

/// Says on the side what is missing.
pub(crate) fn warn<B>(recording: &Recording<B>) {
    for damage in &recording.damage {
        eprintln!("session: {damage}");
    }
}

/// The rates that the nodes ran at; the usual ones if the file does not say.
pub(crate) fn timing<B>(recording: &Recording<B>) -> Timing {
    let settings = recording.nodes.values().find_map(|node| {
        let document = Document::parse("the recorded configuration", &node.config).ok()?;
        document.section::<LoopSettings>().ok()
    });
    settings.unwrap_or_default().timing()
}

fn mend(flags: &RepairFlags) -> anyhow::Result<Outcome> {
    let damaged = File::open(&flags.file).with_context(|| format!("cannot read {}", flags.file.display()))?;
    let kept = flags.spool.as_deref().map(kept::read).transpose()?.unwrap_or_default();
    let to = flags
        .output
        .clone()
        .unwrap_or_else(|| flags.file.with_extension("repaired.mcap"));
    // A new file only: the damaged one may be all there is.
    let file = File::create_new(&to).with_context(|| format!("cannot create {}", to.display()))?;
    let repaired = match repair(BufReader::new(damaged), &kept, BufWriter::new(file)) {
        Ok(repaired) => repaired,
        Err(error) => {
            // Nothing worth keeping; if even this fails, an empty file stays.
            let _ = std::fs::remove_file(&to);
            return Err(error).with_context(|| format!("cannot repair {}", flags.file.display()));
        }
    };
    if repaired.messages == 0 {
        let _ = std::fs::remove_file(&to);
        bail!("{} holds no messages that could be read", flags.file.display());
    }
    for damage in &repaired.damage {
        eprintln!("session: {damage}");
    }
    if let Some(folder) = &flags.spool {
        eprintln!(
            "session: {} entries of journals were lacking and come from {}",
            repaired.merged,
            folder.display()
        );
    }
    if repaired.strange > 0 {
        eprintln!(
            "session: {} kept parts belong to other sessions; they are left out",
            repaired.strange
        );
    }
    println!("{}: {} messages", to.display(), repaired.messages);
    Ok(Outcome::Done)
}
