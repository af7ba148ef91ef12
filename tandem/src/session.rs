//! `tandem session`: what a session file holds, made whole, and as tables.

mod export;
mod info;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use clap::{Args, Subcommand};
use tandem_link::LoopSettings;
use tandem_recorder::{Recording, repair};
use tandem_settings::Document;
use tandem_wire::{Timing, Topic};

use crate::Outcome;

/// What is played and exported.
pub(crate) const PLAYED: [Topic; 7] = [
    Topic::Command,
    Topic::Proposal,
    Topic::Forecast,
    Topic::Setpoint,
    Topic::State,
    Topic::Scene,
    Topic::Trial,
];

#[derive(Subcommand)]
pub(crate) enum SessionCommands {
    /// Prints what is in a session file, and what is missing from it.
    Info(InfoFlags),
    /// Writes what can be read of a damaged file into a whole one beside it.
    Repair(RepairFlags),
    /// Writes tables, one row per message, with units in the names of the columns.
    Export(ExportFlags),
}

#[derive(Args)]
pub(crate) struct InfoFlags {
    /// The session file.
    file: PathBuf,
    /// Prints one JSON object.
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
}

#[derive(Args)]
pub(crate) struct ExportFlags {
    /// The session file.
    file: PathBuf,
    /// The folder for state.csv, setpoint.csv, command.csv and proposal.csv; made if it is not there.
    #[arg(long, value_name = "DIR")]
    csv: PathBuf,
}

pub(crate) fn run(command: &SessionCommands) -> anyhow::Result<Outcome> {
    match command {
        SessionCommands::Info(flags) => {
            let recording = load(&flags.file)?;
            info::print(&recording, flags.json)?;
            Ok(Outcome::Done)
        }
        SessionCommands::Repair(flags) => mend(flags),
        SessionCommands::Export(flags) => {
            let recording = load(&flags.file)?;
            warn(&recording);
            export::write(&recording, &flags.csv)?;
            Ok(Outcome::Done)
        }
    }
}

/// Reads a session file, damaged or not.
pub(crate) fn load(path: &Path) -> anyhow::Result<Recording> {
    let bytes = read(path)?;
    Recording::read(&bytes).with_context(|| format!("cannot use {}", path.display()))
}

fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))
}

/// Says on the side what is missing.
pub(crate) fn warn(recording: &Recording) {
    for damage in &recording.damage {
        eprintln!("session: {damage}");
    }
}

/// The rates that the nodes ran at; the usual ones if the file does not say.
pub(crate) fn timing(recording: &Recording) -> Timing {
    let settings = recording.nodes.values().find_map(|node| {
        let document = Document::parse("the recorded configuration", &node.config).ok()?;
        document.section::<LoopSettings>().ok()
    });
    settings.unwrap_or_default().timing()
}

fn mend(flags: &RepairFlags) -> anyhow::Result<Outcome> {
    let bytes = read(&flags.file)?;
    let to = flags
        .output
        .clone()
        .unwrap_or_else(|| flags.file.with_extension("repaired.mcap"));
    // A new file only: the damaged one may be all there is.
    let file = std::fs::File::create_new(&to).with_context(|| format!("cannot create {}", to.display()))?;
    let repaired = match repair(&bytes, std::io::BufWriter::new(file)) {
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
    println!("{}: {} messages", to.display(), repaired.messages);
    Ok(Outcome::Done)
}
