//! `tandem trial`: experiments, from a plan to a run's folder; and the marks of a trial, for whoever runs one.

mod check;
mod console;
mod person;
mod prepare;
mod run;
mod stage;

use clap::Subcommand;
use tandem_link::{Clock, Link, fresh_session};
use tandem_wire::{Numbering, Topic, Trial, encode};

use crate::{Outcome, sweep, trial_report};

#[derive(Subcommand)]
pub(crate) enum TrialCommands {
    /// Checks a plan and prints its trials in their order.
    Check(check::CheckFlags),
    /// Runs a plan's trials, with simulated humans or a person, into a folder; goes on where it was left.
    Run(run::RunFlags),
    /// Evaluates a run: figures per condition, tests between them, and a page with every trial.
    Report(trial_report::ReportFlags),
    /// Runs simulated trials under virtual time: humans × departures × laws × seeds × contexts.
    Sweep(sweep::SweepFlags),
}

pub(crate) fn run(command: &TrialCommands) -> anyhow::Result<Outcome> {
    match command {
        TrialCommands::Check(flags) => check::run(flags),
        TrialCommands::Run(flags) => run::run(flags),
        TrialCommands::Report(flags) => trial_report::run(flags),
        TrialCommands::Sweep(flags) => sweep::run(flags),
    }
}

/// Publishes a trial's marks as one sender.
pub(crate) struct TrialMarks {
    numbering: Numbering,
    link: Link,
}

impl TrialMarks {
    pub(crate) fn new(link: Link) -> Self {
        Self {
            numbering: Numbering::new(fresh_session()),
            link,
        }
    }

    pub(crate) fn mark(&mut self, trial: Trial) -> anyhow::Result<()> {
        self.mark_at(0, trial)
    }

    /// Marks at a control period: in lockstep it says when that is.
    pub(crate) fn mark_at(&mut self, tick: u32, trial: Trial) -> anyhow::Result<()> {
        let mut bytes = Vec::new();
        encode(
            &self.numbering.envelope(Clock::of_process().now(), tick, trial),
            &mut bytes,
        );
        Ok(self.link.publish(Topic::Trial, bytes)?)
    }
}
