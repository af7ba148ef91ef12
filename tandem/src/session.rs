//! `tandem session`: what a session file holds, made whole, and as tables.

mod export;
mod family;
mod info;
mod kept;
mod mend;
mod stops;
mod verdict;

use std::path::PathBuf;

use clap::{Args, Subcommand};
use tandem_link::LoopSettings;
use tandem_recorder::Recording;
use tandem_settings::Document;
use tandem_wire::Timing;

use crate::{Outcome, verify};
use export::Format;
pub(crate) use family::{Part, load, open, parts};
pub(crate) use verdict::note;

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
    /// The session file; later parts of it beside it are repaired with it. All are left as they are.
    file: PathBuf,
    /// Further parts of the same session, instead of those beside the first.
    more: Vec<PathBuf>,
    /// The whole file, and its later parts beside it as PATH_0002.mcap and so on [default: FILE with .repaired.mcap at the
    /// end].
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
        SessionCommands::Repair(flags) => mend::run(flags),
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
