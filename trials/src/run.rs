//! A run's folder: the plan, what became of every trial, and what each one left.
//!
//! ```text
//! RUN/run.json          what made it: format, plan's hash, program
//! RUN/plan.toml         the plan, byte for byte
//! RUN/trials.jsonl      one line for every trial that was driven or aborted, only ever appended to
//! RUN/trials/0001.json  the trace of that trial
//! RUN/session-1.mcap    the session file; one more each time the run was taken up again
//! ```
//!
//! A trial counts from the moment its line is in `trials.jsonl`: the line is written last, in one write, and brought to
//! the disk before the next trial begins. What a crash leaves behind a last whole line is no trial and is removed when
//! the run is taken up again. The folder is locked while a run goes on.

mod log;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

pub use self::log::RunLog;
use crate::plan::{BadPlan, Participant, Plan};

/// The format of the folder; another one is not read.
pub const RUN_FORMAT: u32 = 1;

const INFO: &str = "run.json";
const PLAN: &str = "plan.toml";
const LOG: &str = "trials.jsonl";
const TRACES: &str = "trials";

/// What made a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunInfo {
    /// The format of the folder.
    pub format: u32,
    /// SHA-256 of the plan, in hexadecimal digits.
    pub plan_sha256: String,
    /// Version and revision of the program that began it.
    pub build: String,
}

/// How a trial ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrialOutcome {
    /// It ended as the plan, or the person, calls a success.
    Success,
    /// It ended, and not so.
    Failure,
    /// It did not end by itself, or shall be repeated: it counts in no result and is offered again.
    Aborted,
}

/// Who said how it ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JudgedBy {
    /// The plan's rule.
    Rule,
    /// The person at the console.
    Person,
}

/// One trial that was driven or aborted: a line of `trials.jsonl`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialEntry {
    /// Counts the lines from 1; the trial's number in the session file, too.
    pub number: u32,
    /// Who drove.
    pub participant: Participant,
    /// Its place in the participant's order, from 1.
    pub slot: u32,
    /// Whether it was only practice.
    pub practice: bool,
    /// The condition's name in the plan.
    pub condition: String,
    /// The context's name in the plan.
    pub context: String,
    /// How the context lies to the demonstrations: "demonstrated", "interpolated", "extrapolated".
    pub group: String,
    /// Who drove it: "simulated" or "keyboard".
    pub source: String,
    /// Which repetition, from 1; 0 for practice.
    pub repetition: u32,
    /// The seed of its human; the same for every condition.
    pub seed: u64,
    /// How it ended.
    pub outcome: TrialOutcome,
    /// Who said so.
    pub judged_by: JudgedBy,
    /// Why, in words; always there if it was aborted.
    pub reason: Option<String>,
    /// What the person wrote down.
    pub note: String,
    /// The session file, relative to the folder.
    pub session: String,
    /// Where in the session the trial begins, in seconds of the session's own time.
    pub began_s: f64,
    /// How long it took, in seconds of the session's own time.
    pub lasted_s: f64,
    /// The trace, relative to the folder, if the trial got far enough to have one.
    pub trace: Option<String>,
}

impl TrialEntry {
    /// Whether the slot is done with it: an aborted trial is offered again.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.outcome != TrialOutcome::Aborted
    }

    /// Whether it counts in results.
    #[must_use]
    pub fn counts(&self) -> bool {
        self.is_finished() && !self.practice
    }
}

/// Why a folder is no run, or cannot go on as one.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// There is no run in it.
    #[error("{} is no run's folder: it has no {INFO}; `tandem trial run PLAN --out {0}` makes one", .path.display())]
    NotARun {
        /// The folder.
        path: PathBuf,
    },
    /// There is something else in it.
    #[error("{} is not empty and no run's folder; choose another one", .path.display())]
    Occupied {
        /// The folder.
        path: PathBuf,
    },
    /// Its format is another.
    #[error("{}: the run has format {found}; this program reads {RUN_FORMAT}", .path.display())]
    Format {
        /// The folder.
        path: PathBuf,
        /// Its format.
        found: u32,
    },
    /// It was made by another plan.
    #[error(
        "{} belongs to another plan (SHA-256 {}…, not {}…): use another folder, or the {PLAN} in it",
        .path.display(), .theirs.get(..12).unwrap_or(.theirs), .ours.get(..12).unwrap_or(.ours)
    )]
    OtherPlan {
        /// The folder.
        path: PathBuf,
        /// The hash of the plan given.
        ours: String,
        /// The hash of the plan that made the folder.
        theirs: String,
    },
    /// Its plan was changed since.
    #[error("{}: {PLAN} was changed after the run began (its SHA-256 is not the one in {INFO})", .path.display())]
    PlanChanged {
        /// The folder.
        path: PathBuf,
    },
    /// Its plan cannot be read.
    #[error("the run's plan")]
    Plan(#[from] BadPlan),
    /// Another process is at it.
    #[error("{}: another `tandem trial run` is at work in this folder", .path.display())]
    Busy {
        /// The folder.
        path: PathBuf,
    },
    /// A line of the log is none.
    #[error("{}:{line}: not a trial", .path.display())]
    Line {
        /// The log.
        path: PathBuf,
        /// Which line, from 1.
        line: usize,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// A file does not hold what its name says.
    #[error("{} cannot be understood", .path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// A trial has no trace.
    #[error("trial {number} has no trace: {}", .reason.as_deref().unwrap_or("it was aborted"))]
    NoTrace {
        /// The trial.
        number: u32,
        /// Why it was aborted.
        reason: Option<String>,
    },
    /// A log names a file elsewhere.
    #[error("trial {number} names the file {name:?}, which does not lie in the run's folder")]
    Elsewhere {
        /// The trial.
        number: u32,
        /// The file.
        name: String,
    },
    /// The system refuses.
    #[error("cannot {doing} {}", .path.display())]
    Io {
        /// What was tried.
        doing: &'static str,
        /// With what.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
}

/// A run's folder, for reading.
#[derive(Clone, Debug)]
pub struct RunFolder {
    path: PathBuf,
    info: RunInfo,
    entries: Vec<TrialEntry>,
}

impl RunFolder {
    /// Opens a run's folder for reading, also while a run goes on in it. What a crash left half-written is passed over.
    ///
    /// # Errors
    /// If there is none, or it is another format's or broken.
    pub fn open(path: &Path) -> Result<Self, RunError> {
        let info = read_info(path)?.ok_or_else(|| RunError::NotARun { path: path.into() })?;
        let log = path.join(LOG);
        let text = read(&log)?;
        let (entries, _) = entries(&log, &text)?;
        Ok(Self {
            path: path.into(),
            info,
            entries,
        })
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What made the run.
    #[must_use]
    pub const fn info(&self) -> &RunInfo {
        &self.info
    }

    /// Every trial that was driven or aborted, in the order in which they were.
    #[must_use]
    pub fn entries(&self) -> &[TrialEntry] {
        &self.entries
    }

    /// The plan that the run followed.
    ///
    /// # Errors
    /// If it is not the one that the run began with.
    pub fn plan(&self) -> Result<Plan, RunError> {
        let path = self.path.join(PLAN);
        let bytes = read(&path)?;
        let text = String::from_utf8_lossy(&bytes);
        let plan = Plan::parse(&path.display().to_string(), &text)?;
        if plan.hash() == self.info.plan_sha256 {
            Ok(plan)
        } else {
            let path = self.path.clone();
            Err(RunError::PlanChanged { path })
        }
    }

    /// The session file of a trial.
    ///
    /// # Errors
    /// If the log names a file outside of the folder.
    pub fn session(&self, entry: &TrialEntry) -> Result<PathBuf, RunError> {
        self.inside(entry.number, &entry.session)
    }

    /// The trace of a trial.
    ///
    /// # Errors
    /// If there is none, or it cannot be read.
    pub fn trace<T: DeserializeOwned>(&self, entry: &TrialEntry) -> Result<T, RunError> {
        let name = entry.trace.as_ref().ok_or_else(|| RunError::NoTrace {
            number: entry.number,
            reason: entry.reason.clone(),
        })?;
        let path = self.inside(entry.number, name)?;
        let bytes = read(&path)?;
        serde_json::from_slice(&bytes).map_err(|source| RunError::Json { path, source })
    }

    /// A log from elsewhere leads nobody out of the folder.
    fn inside(&self, number: u32, name: &str) -> Result<PathBuf, RunError> {
        let plain = Path::new(name)
            .components()
            .all(|part| matches!(part, std::path::Component::Normal(_)));
        if plain && !name.is_empty() {
            Ok(self.path.join(name))
        } else {
            let name = name.to_owned();
            Err(RunError::Elsewhere { number, name })
        }
    }
}

fn read_info(path: &Path) -> Result<Option<RunInfo>, RunError> {
    let info = path.join(INFO);
    let bytes = match fs::read(&info) {
        Ok(bytes) => bytes,
        Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {
            return Ok(None);
        }
        Err(error) => return Err(io_error("read", &info)(error)),
    };
    let found: RunInfo = serde_json::from_slice(&bytes).map_err(|source| RunError::Json { path: info, source })?;
    if found.format == RUN_FORMAT {
        Ok(Some(found))
    } else {
        Err(RunError::Format {
            path: path.into(),
            found: found.format,
        })
    }
}

/// The trials of a log, and how many of its bytes are whole lines.
fn entries(path: &Path, text: &[u8]) -> Result<(Vec<TrialEntry>, usize), RunError> {
    let whole = text.iter().rposition(|byte| *byte == b'\n').map_or(0, |last| last + 1);
    let lines = text[..whole].split(|byte| *byte == b'\n').enumerate();
    let read = lines.filter(|(_, line)| !line.is_empty()).map(|(index, line)| {
        serde_json::from_slice(line).map_err(|source| RunError::Line {
            path: path.into(),
            line: index + 1,
            source,
        })
    });
    Ok((read.collect::<Result<_, _>>()?, whole))
}

fn read(path: &Path) -> Result<Vec<u8>, RunError> {
    fs::read(path).map_err(io_error("read", path))
}

fn io_error(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> RunError {
    let path = path.to_owned();
    move |source| RunError::Io { doing, path, source }
}
