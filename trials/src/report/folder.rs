//! From a run's folder to the cases of a report.

use super::{Case, Identity, Setup};
use crate::Trace;
use crate::run::{RunFolder, TrialEntry, TrialOutcome};

impl From<&TrialEntry> for Identity {
    fn from(entry: &TrialEntry) -> Self {
        Self {
            number: entry.number,
            participant: entry.participant.to_string(),
            condition: entry.condition.clone(),
            context: entry.context.clone(),
            group: entry.group.clone(),
            repetition: entry.repetition,
            seed: entry.seed,
            success: entry.outcome == TrialOutcome::Success,
            reason: entry.reason.clone(),
            note: entry.note.clone(),
            session: entry.session.clone(),
            began_s: entry.began_s,
        }
    }
}

impl Setup {
    /// What a run's folder says of itself. A plan that is not the run's any more is no obstacle: it is said, and the
    /// conditions are those of the trials.
    #[must_use]
    pub fn of(folder: &RunFolder, reference: &str) -> Self {
        let name = folder.path().canonicalize().unwrap_or_else(|_| folder.path().into());
        let name = name.file_name().map(|name| name.to_string_lossy().into_owned());
        let mut setup = Self {
            title: name.unwrap_or_else(|| "run".to_owned()),
            build: folder.info().build.clone(),
            reference: reference.to_owned(),
            practice: count(folder, |entry| entry.is_finished() && entry.practice),
            aborted: count(folder, |entry| !entry.is_finished()),
            ..Self::default()
        };
        match folder.plan() {
            Ok(plan) => {
                setup.title.clone_from(&plan.settings.name);
                let conditions = plan.conditions.iter().map(|condition| {
                    let label = &condition.settings.label;
                    let label = if label.is_empty() { &condition.name } else { label };
                    (condition.name.clone(), label.clone())
                });
                setup.conditions = conditions.collect();
                setup.bad_lines = plan.bad_lines();
            }
            Err(error) => setup.unreadable.push(with_causes(&error)),
        }
        setup
    }
}

fn count(folder: &RunFolder, which: impl Fn(&TrialEntry) -> bool) -> usize {
    folder.entries().iter().filter(|entry| which(entry)).count()
}

/// Reads the trials that count, one after the other, so that only one trace is in memory at a time; `progress` hears
/// how many are done. What cannot be read is noted in `setup`.
pub fn read_cases(folder: &RunFolder, setup: &mut Setup, mut progress: impl FnMut(usize)) -> Vec<Case> {
    let mut cases = Vec::new();
    for (done, entry) in folder.entries().iter().enumerate() {
        if entry.counts() {
            match folder.trace::<Trace>(entry) {
                Ok(trace) => cases.push(Case::new(entry.into(), &trace)),
                Err(error) => setup
                    .unreadable
                    .push(format!("trial {}: {}", entry.number, with_causes(&error))),
            }
        }
        progress(done + 1);
    }
    cases
}

fn with_causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text = format!("{text}: {error}");
        cause = error.source();
    }
    text
}
