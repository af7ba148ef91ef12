//! Writing a run: trial by trial, each one whole or not at all.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Write as _};
use std::path::Path;

use serde::Serialize;

use super::{
    INFO, LOG, PLAN, RUN_FORMAT, RunError, RunFolder, RunInfo, TRACES, TrialEntry, entries, io_error, read, read_info,
};
use crate::plan::{Participant, Plan, Slot};

/// A run's folder that trials are added to; nobody else adds to it meanwhile.
#[derive(Debug)]
pub struct RunLog {
    folder: RunFolder,
    log: File,
}

impl RunLog {
    /// Begins a run in `path`, or takes up the one that lies there.
    ///
    /// # Errors
    /// If another plan's run or anything else lies there, another process is at it, or the system refuses.
    pub fn open(path: &Path, plan: &Plan, build: &str) -> Result<Self, RunError> {
        match read_info(path)? {
            Some(info) if info.plan_sha256 != plan.hash() => {
                return Err(RunError::OtherPlan {
                    path: path.into(),
                    ours: plan.hash(),
                    theirs: info.plan_sha256,
                });
            }
            Some(_) => {}
            None => begin(path, plan, build)?,
        }
        let log_path = path.join(LOG);
        let mut options = OpenOptions::new();
        let log = options
            .append(true)
            .create(true)
            .open(&log_path)
            .map_err(io_error("open", &log_path))?;
        match log.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(RunError::Busy { path: path.into() }),
            Err(TryLockError::Error(source)) => return Err(io_error("lock", &log_path)(source)),
        }
        let text = read(&log_path)?;
        let (_, whole) = entries(&log_path, &text)?;
        if whole < text.len() {
            log.set_len(whole as u64).map_err(io_error("mend", &log_path))?;
        }
        let folder = RunFolder::open(path)?;
        Ok(Self { folder, log })
    }

    /// What the folder holds by now.
    #[must_use]
    pub const fn folder(&self) -> &RunFolder {
        &self.folder
    }

    /// The number of the next trial.
    #[must_use]
    pub fn next_number(&self) -> u32 {
        let last = self.folder.entries.last().map_or(0, |entry| entry.number);
        last.saturating_add(1)
    }

    /// The slots that a participant has not finished yet, and how often each was aborted.
    #[must_use]
    pub fn open_slots(&self, participant: &Participant, slots: &[Slot]) -> Vec<(Slot, u32)> {
        let tried = |slot: &Slot| {
            let mine = self.folder.entries.iter();
            mine.filter(|entry| entry.participant == *participant && entry.slot == slot.number)
                .fold((false, 0), |(done, aborted), entry| {
                    (done || entry.is_finished(), aborted + u32::from(!entry.is_finished()))
                })
        };
        let open = slots.iter().map(|slot| (slot, tried(slot)));
        open.filter(|(_, (done, _))| !done)
            .map(|(slot, (_, aborted))| (slot.clone(), aborted))
            .collect()
    }

    /// A name for the next session file, relative to the folder: one that is not there yet.
    #[must_use]
    pub fn next_session(&self) -> String {
        let mut part = 1_u32;
        loop {
            let name = format!("session-{part}.mcap");
            if part == u32::MAX || !self.folder.path.join(&name).exists() {
                return name;
            }
            part += 1;
        }
    }

    /// Writes a trial's trace, whole or not at all; says where, relative to the folder.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn write_trace<T: Serialize>(&self, number: u32, trace: &T) -> Result<String, RunError> {
        let name = format!("{TRACES}/{number:04}.json");
        let path = self.folder.path.join(&name);
        let bytes = serde_json::to_vec(trace).map_err(|source| RunError::Json {
            path: path.clone(),
            source,
        })?;
        write_whole(&path, &bytes)?;
        Ok(name)
    }

    /// Adds a trial: from here on it counts.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn append(&mut self, entry: TrialEntry) -> Result<(), RunError> {
        let path = self.folder.path.join(LOG);
        let mut line = serde_json::to_vec(&entry).map_err(|source| RunError::Json {
            path: path.clone(),
            source,
        })?;
        line.push(b'\n');
        let written = self.log.write_all(&line).and_then(|()| self.log.sync_data());
        written.map_err(io_error("write", &path))?;
        self.folder.entries.push(entry);
        Ok(())
    }
}

/// Lays out a new run in a folder that is empty or not there. `run.json` comes last: with it, it is a run.
fn begin(path: &Path, plan: &Plan, build: &str) -> Result<(), RunError> {
    let left_over = |name: &std::ffi::OsStr| {
        name == PLAN || name == LOG || name == TRACES || name.to_string_lossy().ends_with(".tmp")
    };
    match fs::read_dir(path) {
        Ok(entries) => {
            let strange = entries
                .filter_map(Result::ok)
                .any(|entry| !left_over(&entry.file_name()));
            if strange {
                return Err(RunError::Occupied { path: path.into() });
            }
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => {}
        Err(error) => return Err(io_error("read", path)(error)),
    }
    let traces = path.join(TRACES);
    fs::create_dir_all(&traces).map_err(io_error("make the folder", &traces))?;
    write_whole(&path.join(PLAN), plan.text().as_bytes())?;
    let info = RunInfo {
        format: RUN_FORMAT,
        plan_sha256: plan.hash(),
        build: build.to_owned(),
    };
    let info_path = path.join(INFO);
    let bytes = serde_json::to_vec_pretty(&info).map_err(|source| RunError::Json {
        path: info_path.clone(),
        source,
    })?;
    // Appending: a log that is there already is not ours to empty.
    let log = path.join(LOG);
    let made = OpenOptions::new().append(true).create(true).open(&log);
    made.map_err(io_error("make", &log))?;
    write_whole(&info_path, &bytes)
}

/// Writes a file beside its place and moves it there, so that nobody ever sees half of it.
fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), RunError> {
    let beside = path.with_extension("tmp");
    let written = File::create(&beside).and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_data()));
    written
        .and_then(|()| fs::rename(&beside, path))
        .map_err(io_error("write", path))
}
