//! What re-execution finds, in types and in words.

use std::fmt;

use tandem_recorder::Run;
use tandem_wire::{Nanos, Stamp, Topic, seconds};

use crate::fields::{EPSILON, FieldDifference};

/// Everything that was found in one session file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Findings {
    /// One for each run of each node, in the order of the loop.
    pub runs: Vec<RunFinding>,
    /// What in the file could not be read.
    pub faults: Vec<String>,
}

/// All verdicts taken together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overall {
    /// Every node answered as it had, byte for byte.
    Identical,
    /// Every node answered as it had, at least one of them only within ε.
    Close,
    /// At least one node answered otherwise.
    Diverged,
    /// Nothing diverged, but not everything could be executed.
    Incomplete,
}

/// What was found about one run of one node.
#[derive(Clone, Debug, PartialEq)]
pub struct RunFinding {
    /// Which run of which node.
    pub run: Run,
    /// Version and revision of the program that ran then, if it is known.
    pub build: Option<String>,
    /// How it came out.
    pub verdict: Verdict,
    /// Steps executed.
    pub steps: u64,
    /// Outputs compared, and the same.
    pub outputs: u64,
    /// Snapshots of the node's state compared, and the same.
    pub snapshots: u64,
    /// How much of the node's own time they cover, without what lies in gaps.
    pub span: Nanos,
    /// Whether the journal ends because the node was asked to end.
    pub stopped: bool,
    /// The journal entries, snapshots all, from which it was executed on because entries before them are missing.
    pub resumed: Vec<u64>,
}

/// How a run came out.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Every output is the same, byte for byte, up to the journal's last entry.
    Identical,
    /// Every output is the same up to numbers that differ by no more than [`EPSILON`].
    Close {
        /// The largest difference.
        largest: f64,
        /// The topic and field in which it occurred.
        field: String,
    },
    /// An output is another one.
    Diverged(Box<Divergence>),
    /// It could not be executed, or only to a point up to which it was the same.
    Incomplete(Missing),
}

/// The first place where a node answered otherwise.
#[derive(Clone, Debug, PartialEq)]
pub struct Divergence {
    /// The step, from 1.
    pub step: u64,
    /// The journal entry.
    pub entry: u64,
    /// The node's own time.
    pub at: Stamp,
    /// What the output was about.
    pub topic: Topic,
    /// What is different about it.
    pub difference: Difference,
}

/// What is different about an output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Difference {
    /// Fields have other values; there is at least one.
    Fields(Vec<FieldDifference>),
    /// The bytes are others, and at least one of the two is no message of this topic.
    Bytes,
    /// It is about another topic now.
    Topic(Topic),
    /// It was recorded and does not come out now.
    Absent,
    /// It comes out now and was not recorded.
    Additional,
    /// What the node carries on from step to step is something else, though no output has shown it yet.
    State {
        /// The first byte of the snapshot that differs.
        from: usize,
        /// The length of the snapshot that was recorded, in bytes.
        recorded: usize,
        /// The length of the one that comes out now.
        again: usize,
    },
}

/// What re-execution lacks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Missing {
    /// The node's configuration.
    Configuration,
    /// A configuration that this build can read, or settings that it can build a node from.
    Buildable {
        /// What is wrong with it.
        why: String,
    },
    /// The model's bytes.
    Model {
        /// Their SHA-256, if the node named one.
        sha256: Option<String>,
    },
    /// The whole journal.
    Journal,
    /// The beginning of the journal.
    Beginning {
        /// The first entry that is there.
        first: u64,
    },
    /// Entries in the middle of the journal.
    Gap {
        /// The first entry that is missing.
        from: u64,
        /// The last one.
        to: u64,
        /// How many of them the node itself could not keep.
        lost: u64,
    },
    /// The end of the journal, of which at least the node's answers to being asked to end are missing.
    End {
        /// The first entry that is missing.
        from: u64,
    },
}

impl Findings {
    /// All verdicts taken together. A file without any run is incomplete, and so is one that cannot be read to its end.
    #[must_use]
    pub fn overall(&self) -> Overall {
        let any = |found: fn(&Verdict) -> bool| self.runs.iter().any(|run| found(&run.verdict));
        if any(|verdict| matches!(verdict, Verdict::Diverged(_))) {
            Overall::Diverged
        } else if self.runs.is_empty()
            || !self.faults.is_empty()
            || any(|verdict| matches!(verdict, Verdict::Incomplete(_)))
        {
            Overall::Incomplete
        } else if any(|verdict| matches!(verdict, Verdict::Close { .. })) {
            Overall::Close
        } else {
            Overall::Identical
        }
    }

    /// The longest span that a node's journal covers.
    #[must_use]
    pub fn span(&self) -> Nanos {
        self.runs.iter().map(|run| run.span).max().unwrap_or(0)
    }
}

impl Overall {
    /// A word or three.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Identical => "identical",
            Self::Close => CLOSE,
            Self::Diverged => "diverged",
            Self::Incomplete => "incomplete",
        }
    }
}

/// What a run and a session are called that are the same but for numbers that hardly differ.
const CLOSE: &str = "equal within ε";

impl Divergence {
    /// The fields that differ, in the order of the message; none if the difference is none of fields.
    #[must_use]
    pub fn fields(&self) -> &[FieldDifference] {
        match &self.difference {
            Difference::Fields(fields) => fields,
            _ => &[],
        }
    }
}

impl fmt::Display for FieldDifference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { path, recorded, again } = self;
        write!(f, "{path}: recorded {recorded}, now {again}")
    }
}

impl Verdict {
    /// One word.
    #[must_use]
    pub const fn as_str(&self) -> &'static str {
        match self {
            Self::Identical => "identical",
            Self::Close { .. } => CLOSE,
            Self::Diverged(_) => "diverged",
            Self::Incomplete(_) => "incomplete",
        }
    }
}

impl fmt::Display for RunFinding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.verdict.as_str())?;
        match &self.verdict {
            Verdict::Identical => {}
            Verdict::Close { largest, field } => {
                write!(
                    f,
                    ": at most {largest:e} apart, in {field}; ε = {EPSILON:e}, relative above 1"
                )?;
            }
            Verdict::Diverged(divergence) => return write!(f, " at {divergence}"),
            Verdict::Incomplete(missing) => {
                write!(f, ": {missing}")?;
                for entry in &self.resumed {
                    write!(f, "; the same from the snapshot at entry {entry} on")?;
                }
            }
        }
        if self.steps > 0 {
            let counted = (self.steps, self.outputs, seconds(self.span));
            write!(f, "; {} steps, {} outputs, {:.1} s", counted.0, counted.1, counted.2)?;
        }
        if matches!(self.verdict, Verdict::Identical | Verdict::Close { .. }) && !self.stopped {
            f.write_str("; up to its last entry: it was killed, or outlived the recording")?;
        }
        Ok(())
    }
}

impl fmt::Display for Divergence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            step, entry, at, topic, ..
        } = self;
        write!(f, "step {step} (journal entry {entry}, {:.6} s), {topic}", at.seconds())?;
        match &self.difference {
            Difference::Fields(fields) if fields.len() == 1 => f.write_str(": one field differs"),
            Difference::Fields(fields) => write!(f, ": {} fields differ", fields.len()),
            Difference::Bytes => f.write_str(": other bytes, which are no message"),
            Difference::Topic(now) => write!(f, ": an output on {now} instead"),
            Difference::Absent => f.write_str(": recorded, but does not come out again"),
            Difference::Additional => f.write_str(": comes out, but was not recorded"),
            Difference::State { from, recorded, again } => write!(
                f,
                ": the node's state differs from byte {from} of its snapshot on ({recorded} bytes recorded, {again} now), \
                 though no output has shown it yet"
            ),
        }
    }
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Configuration => f.write_str("its configuration is not in the file"),
            Self::Buildable { why } => write!(f, "this build cannot make it from its configuration: {why}"),
            Self::Model { sha256: Some(sha256) } => {
                write!(f, "its model, SHA-256 {sha256}, is not in the file, or damaged")
            }
            Self::Model { sha256: None } => f.write_str("its model is not in the file"),
            Self::Journal => f.write_str("its journal is not in the file"),
            Self::Beginning { first } => write!(
                f,
                "its journal begins with entry {first}; the recorder came later, or missed entries 0 to {}",
                first.saturating_sub(1)
            ),
            Self::Gap { from, to, lost } => {
                write!(f, "entries {from} to {to} of its journal are missing")?;
                match lost {
                    0 => Ok(()),
                    lost => write!(f, " ({lost} of them it could not keep itself)"),
                }
            }
            Self::End { from } => write!(f, "the end of its journal is missing, from entry {from} on"),
        }
    }
}
