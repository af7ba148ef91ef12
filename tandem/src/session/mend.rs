//! `tandem session repair`: the files of a session, made whole beside themselves.

use std::fs::File;
use std::io::{BufReader, BufWriter};
use std::path::Path;

use anyhow::{Context as _, bail};
use tandem_recorder::{JournalPart, Repair, Repaired, part_path};

use super::{RepairFlags, family, kept};
use crate::Outcome;

pub(super) fn run(flags: &RepairFlags) -> anyhow::Result<Outcome> {
    let kept = flags.spool.as_deref().map(kept::read).transpose()?.unwrap_or_default();
    let to = flags
        .output
        .clone()
        .unwrap_or_else(|| flags.file.with_extension("repaired.mcap"));
    let parts = family::parts(&flags.file, &flags.more);
    let mut repair = Repair::default();
    let mut left_out = 0;
    // The first one last, which takes what all of them lack of the journals.
    let later: Vec<_> = parts.iter().zip(1..).skip(1).collect();
    for (path, number) in later.into_iter().rev() {
        if let Err(error) = part(&mut repair, path, &[], &part_path(&to, number)) {
            eprintln!("session: {} is left out: {error:#}", path.display());
            left_out += 1;
        }
    }
    let repaired = part(&mut repair, &flags.file, &kept, &to)?;
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
    Ok(if left_out == 0 { Outcome::Done } else { Outcome::Failed })
}

/// Makes one file whole. If that fails, there is no new file.
fn part(repair: &mut Repair, path: &Path, kept: &[JournalPart], to: &Path) -> anyhow::Result<Repaired> {
    let damaged = File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
    // A new file only: the damaged one may be all there is.
    let file = File::create_new(to).with_context(|| format!("cannot create {}", to.display()))?;
    let repaired = repair.part(BufReader::new(damaged), kept, BufWriter::new(file));
    if !repaired.as_ref().is_ok_and(|repaired| repaired.messages > 0) {
        // Nothing worth keeping; if even this fails, an empty file stays.
        let _ = std::fs::remove_file(to);
    }
    let repaired = repaired.with_context(|| format!("cannot repair {}", path.display()))?;
    if repaired.messages == 0 {
        bail!("{} holds no messages that could be read", path.display());
    }
    for damage in &repaired.damage {
        eprintln!("session: {}: {damage}", path.display());
    }
    println!("{}: {} messages", to.display(), repaired.messages);
    Ok(repaired)
}
