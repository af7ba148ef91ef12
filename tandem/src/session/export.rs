//! Tables of a session: true times, units in the names of the columns, as CSV or Parquet.
//!
//! `state`, `setpoint`, `command` and `proposal` have one row per message; `ticks` has one row per control period with
//! the last message of each kind in it. `lease` and `estop` have a row for each press, where there was one. `captured_s`
//! is the sender's own stamp, on the sender's clock (in lockstep `tick · period`); `captured_session_s` is the same moment
//! on the recorder's clock, as `received_s`, the arrival, is. What does not exist in a row, such as guidance before the
//! first forecast, is left empty, never zero.

mod columns;
mod context;
mod parquet;
mod row;

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use indicatif::{ProgressBar, ProgressDrawTarget};
use tandem_recorder::{Recorded, Recording};
use tandem_wire::{Session, Topic};

use super::timing;
use context::Context;
use row::{Cell, Row};

/// The messages that have tables, in the order of the columns of `ticks`.
const TABLES: [Topic; 4] = [Topic::State, Topic::Setpoint, Topic::Command, Topic::Proposal];

/// What people did; tables only where they did it.
const PRESSES: [Topic; 4] = [Topic::Lease, Topic::TakeOver, Topic::Emergency, Topic::AllClear];

/// How tables are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Csv,
    Parquet,
}

/// Writes all tables into `folder`, which is made if it is not there.
pub(super) fn write(recording: &Recording, format: Format, folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let bar = ProgressBar::with_draw_target(Some(TABLES.len() as u64 + 1), ProgressDrawTarget::stderr());
    let presses = PRESSES.into_iter().filter(|topic| {
        let mut messages = recording.messages.iter();
        messages.any(|message| message.topic == *topic)
    });
    let context = Context::of(recording, timing(recording).pace);
    for topic in TABLES.into_iter().chain(presses) {
        let of_topic = recording.messages.iter().filter(|message| message.topic == topic);
        // What was heard was decodable; a journal that says otherwise has nothing for a table.
        let rows = of_topic.filter_map(|message| columns::row(message, &context));
        table(format, folder, &topic.suffix().replace('/', "_"), rows, &bar)?;
    }
    table(format, folder, "ticks", ticks(recording, &context), &bar)?;
    bar.finish_and_clear();
    Ok(())
}

fn table(
    format: Format,
    folder: &Path,
    name: &str,
    rows: impl Iterator<Item = Row>,
    bar: &ProgressBar,
) -> anyhow::Result<()> {
    let (path, written) = match format {
        Format::Csv => {
            let path = folder.join(format!("{name}.csv"));
            let written = csv(&path, rows).map_err(anyhow::Error::from);
            (path, written)
        }
        Format::Parquet => {
            let path = folder.join(format!("{name}.parquet"));
            let written = parquet::write(&path, rows);
            (path, written)
        }
    };
    let rows = written.with_context(|| format!("cannot write {}", path.display()))?;
    bar.inc(1);
    bar.suspend(|| println!("{}: {rows} rows", path.display()));
    Ok(())
}

fn csv(path: &PathBuf, rows: impl Iterator<Item = Row>) -> std::io::Result<u64> {
    let mut file = BufWriter::new(File::create(path)?);
    let mut count = 0;
    for row in rows {
        if count == 0 {
            writeln!(file, "{}", line(row.names.iter().map(String::as_str)))?;
        }
        let words: Vec<String> = row.cells.iter().map(Cell::words).collect();
        writeln!(file, "{}", line(words.iter().map(String::as_str)))?;
        count += 1;
    }
    file.flush()?;
    Ok(count)
}

fn line<'a>(cells: impl Iterator<Item = &'a str>) -> String {
    cells.map(quoted).collect::<Vec<_>>().join(",")
}

/// A cell as RFC 4180 writes it.
fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", cell.replace('"', "\"\""))
    } else {
        cell.to_owned()
    }
}

/// One row per control period: the last message of each kind that belongs to it.
fn ticks<'a>(recording: &'a Recording, context: &'a Context) -> impl Iterator<Item = Row> + 'a {
    let by_tick = by_tick(&recording.messages);
    // A kind that is missing in a period still has its columns.
    let mut empty = BTreeMap::new();
    for messages in by_tick.values() {
        for message in messages.values() {
            if let std::collections::btree_map::Entry::Vacant(slot) = empty.entry(message.topic)
                && let Some(row) = columns::row(message, context)
            {
                slot.insert(row.emptied());
            }
        }
    }
    by_tick.into_iter().map(move |((_, tick), messages)| {
        let mut row = Row::default();
        row.count("tick", u64::from(tick));
        for topic in TABLES {
            let Some(empty) = empty.get(&topic) else { continue };
            let of_message = messages.get(&topic).and_then(|message| columns::row(message, context));
            row.append(&topic.suffix(), of_message.unwrap_or_else(|| empty.clone()));
        }
        row
    })
}

/// By the robot's run, which begins its ticks anew, and the tick.
fn by_tick(messages: &[Recorded]) -> BTreeMap<(usize, u32), BTreeMap<Topic, &Recorded>> {
    let mut by_tick = BTreeMap::<_, BTreeMap<Topic, &Recorded>>::new();
    let mut runs = BTreeSet::<Session>::new();
    for message in messages.iter().filter(|message| TABLES.contains(&message.topic)) {
        if message.topic == Topic::State {
            runs.insert(message.header.session);
        }
        let period = by_tick.entry((runs.len(), message.header.tick)).or_default();
        period.insert(message.topic, message);
    }
    by_tick
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_with_a_comma_or_a_quote_is_quoted() {
        assert_eq!(line(["1.5", "a, \"b\"", ""].into_iter()), "1.5,\"a, \"\"b\"\"\",");
    }
}
