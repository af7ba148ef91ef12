//! One thing that was looked into, and what to do about it.

use serde_json::{Value, json};

/// How it stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// As it should be.
    Good,
    /// Not wrong, but worth knowing.
    Worth,
    /// It will not work so.
    Bad,
    /// It could not be looked into.
    Skipped,
}

/// One thing that was looked into.
#[derive(Clone, Debug)]
pub(super) struct Check {
    pub(super) name: &'static str,
    pub(super) verdict: Verdict,
    pub(super) says: String,
    /// What to do, if anything.
    pub(super) todo: Option<String>,
}

impl Check {
    pub(super) fn good(name: &'static str, says: impl Into<String>) -> Self {
        Self::of(name, Verdict::Good, says.into(), None)
    }

    pub(super) fn worth(name: &'static str, says: impl Into<String>, todo: impl Into<String>) -> Self {
        Self::of(name, Verdict::Worth, says.into(), Some(todo.into()))
    }

    pub(super) fn bad(name: &'static str, says: impl Into<String>, todo: impl Into<String>) -> Self {
        Self::of(name, Verdict::Bad, says.into(), Some(todo.into()))
    }

    pub(super) fn skipped(name: &'static str, says: impl Into<String>) -> Self {
        Self::of(name, Verdict::Skipped, says.into(), None)
    }

    const fn of(name: &'static str, verdict: Verdict, says: String, todo: Option<String>) -> Self {
        Self {
            name,
            verdict,
            says,
            todo,
        }
    }

    pub(super) fn line(&self) -> String {
        let mark = match self.verdict {
            Verdict::Good => "ok  ",
            Verdict::Worth => "note",
            Verdict::Bad => "BAD ",
            Verdict::Skipped => "?   ",
        };
        let todo = self.todo.as_ref().map(|todo| format!("\n{:20}→ {todo}", ""));
        format!("{mark}  {:12}  {}{}", self.name, self.says, todo.unwrap_or_default())
    }

    pub(super) fn json(&self) -> Value {
        let verdict = match self.verdict {
            Verdict::Good => "good",
            Verdict::Worth => "note",
            Verdict::Bad => "bad",
            Verdict::Skipped => "skipped",
        };
        json!({ "name": self.name, "verdict": verdict, "says": self.says, "todo": self.todo })
    }
}
