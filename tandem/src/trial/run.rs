//! `tandem trial run`: the trials of a plan, one after the other, into a run's folder.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use crossbeam_channel::Receiver;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use tandem_operator::SourceKind;
use tandem_settings::Choice as _;
use tandem_trials::Measures;
use tandem_trials::plan::{Participant, Slot, SuccessSettings};
use tandem_trials::run::{JudgedBy, RunError, RunLog, TrialEntry, TrialOutcome};

use super::console::Verdict;
use super::person;
use super::prepare::{Begin, Prepared};
use super::stage::{Closed, Driven, End, Following, Stage, Task};
use crate::configuration::BadConfiguration;
use crate::{BUILD, Outcome, interrupt, table};

#[derive(Clone, Copy, Debug, ValueEnum)]
enum SourceFlag {
    /// Simulated humans, in lockstep.
    Simulated,
    /// A person at this terminal's keys, in real time.
    Keyboard,
}

#[derive(Args)]
pub(crate) struct RunFlags {
    /// The plan (TOML).
    #[arg(value_name = "PLAN")]
    plan: PathBuf,
    /// The run's folder: made, or taken up again where it was left.
    #[arg(long, value_name = "RUN")]
    out: PathBuf,
    /// Runs this participant's trials only; persons must be named.
    #[arg(long, value_name = "CODE")]
    participant: Option<String>,
    /// Who drives [default: as the plan says].
    #[arg(long, value_enum)]
    source: Option<SourceFlag>,
    /// Prints the summary as one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(flags: &RunFlags) -> anyhow::Result<Outcome> {
    let began = Instant::now();
    let mut prepared = Prepared::read(&flags.plan)?;
    match flags.source {
        Some(SourceFlag::Simulated) => prepared.plan.settings.source = SourceKind::Simulated,
        Some(SourceFlag::Keyboard) => prepared.plan.settings.source = SourceKind::Keyboard,
        None => {}
    }
    if !prepared.is_simulated() {
        person::check_terminal()?;
    }
    let participants = prepared.participants(flags.participant.as_deref())?;
    let log = RunLog::open(&flags.out, &prepared.plan, BUILD).map_err(bad_usage)?;
    let interrupted = interrupt::catch()?;
    let mut run = Run {
        prepared: &prepared,
        log,
        stage: None,
        interrupted,
        bar: ProgressBar::hidden(),
        ended: None,
    };
    let driven = run.all(&participants);
    // However it ended, the recorder is closed first: then the files are whole.
    let closed = run.stage.take().map(Stage::close).transpose();
    driven?;
    let closed = closed?.unwrap_or(Closed {
        messages_lost: 0,
        sessions: Vec::new(),
    });
    let summary = Summary {
        open: run.open(&participants),
        ended: run.ended,
        closed,
        wall: began.elapsed(),
    };
    summary.print(flags, run.log.folder().entries())?;
    Ok(summary.outcome())
}

/// What the user asked for cannot be, rather than what was tried went wrong.
fn bad_usage(error: RunError) -> anyhow::Error {
    match error {
        RunError::Occupied { .. } | RunError::OtherPlan { .. } | RunError::Busy { .. } => {
            BadConfiguration::Run(error).into()
        }
        other => other.into(),
    }
}

/// A run at work.
pub(super) struct Run<'a> {
    pub(super) prepared: &'a Prepared,
    pub(super) log: RunLog,
    stage: Option<Stage>,
    pub(super) interrupted: Receiver<()>,
    bar: ProgressBar,
    /// Why it ended before all trials were driven.
    ended: Option<&'static str>,
}

/// Whether to go on after a trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Next {
    /// With the next trial.
    Trial,
    /// With the same one.
    Again,
    /// Not at all.
    Stop(&'static str),
}

impl Run<'_> {
    fn all(&mut self, participants: &[Participant]) -> anyhow::Result<()> {
        let total = self.open(participants);
        if self.prepared.is_simulated() && total > 0 {
            self.bar = progress_bar(total);
        }
        for participant in participants {
            let slots = self.prepared.plan.slots(participant);
            for (slot, aborted) in self.log.open_slots(participant, &slots) {
                if let Next::Stop(why) = self.slot(participant, &slot, aborted, slots.len())? {
                    self.ended = Some(why);
                    self.bar.finish_and_clear();
                    return Ok(());
                }
            }
        }
        self.bar.finish_and_clear();
        Ok(())
    }

    /// Offers a trial until it counts, or often enough.
    fn slot(&mut self, participant: &Participant, slot: &Slot, aborted: u32, of: usize) -> anyhow::Result<Next> {
        for _ in aborted..self.prepared.plan.settings.offers {
            let next = if self.prepared.is_simulated() {
                self.simulated(participant, slot)?
            } else {
                person::trial(self, participant, slot, of)?
            };
            match next {
                Next::Again => {}
                other => return Ok(other),
            }
        }
        let why = format!(
            "trial {} of {participant} was aborted {} times and is left out for now",
            slot.number, self.prepared.plan.settings.offers
        );
        self.bar.suspend(|| eprintln!("trial: {why}"));
        Ok(Next::Trial)
    }

    fn simulated(&mut self, participant: &Participant, slot: &Slot) -> anyhow::Result<Next> {
        let bar = self.bar.clone();
        let name = self.name(slot);
        bar.set_message(name);
        bar.tick();
        let driven = self.drive(participant, slot, |following| Ok(following.until_over(|_| bar.tick())))?;
        if driven.end == End::Interrupted {
            return Ok(Next::Stop("interrupted"));
        }
        let verdict = judge(&self.prepared.plan.success, &driven);
        self.record(participant, slot, &driven, verdict)
    }

    pub(super) fn name(&self, slot: &Slot) -> String {
        let plan = &self.prepared.plan;
        let practice = if slot.practice { "practice, " } else { "" };
        let (condition, context) = (&plan.conditions[slot.condition].name, &plan.contexts[slot.context].name);
        format!("{practice}{condition}, {context}")
    }

    /// Drives a slot once.
    pub(super) fn drive(
        &mut self,
        participant: &Participant,
        slot: &Slot,
        steer: impl FnOnce(&mut Following<'_>) -> anyhow::Result<End>,
    ) -> anyhow::Result<Driven> {
        let first_tick = self.stage.as_ref().map_or(0, Stage::next_tick);
        let mut blueprint = self.prepared.blueprint(slot, Begin { first_tick })?;
        let folder = self.log.folder().path().to_owned();
        let mut stage = match self.stage.take() {
            Some(stage) => stage,
            None => Stage::open(&blueprint, folder)?,
        };
        let recorded = stage.record(&blueprint, || self.log.next_session());
        // A new file counts its time from nought.
        let first_tick_now = stage.next_tick();
        let stage = self.stage.insert(stage);
        recorded?;
        if first_tick_now != first_tick {
            blueprint = self.prepared.blueprint(
                slot,
                Begin {
                    first_tick: first_tick_now,
                },
            )?;
        }
        let plan = &self.prepared.plan;
        let task = Task {
            number: self.log.next_number(),
            label: format!(
                "{participant} {} {} {}",
                slot.number, plan.conditions[slot.condition].name, plan.contexts[slot.context].name
            ),
            blueprint: &blueprint,
            limit_s: plan.settings.time_limit_s,
        };
        stage.drive(&task, &self.interrupted, steer)
    }

    /// Writes a trial down: from here on it counts, or is offered again.
    pub(super) fn record(
        &mut self,
        participant: &Participant,
        slot: &Slot,
        driven: &Driven,
        verdict: Verdict,
    ) -> anyhow::Result<Next> {
        let number = self.log.next_number();
        let plan = &self.prepared.plan;
        let context = &plan.contexts[slot.context];
        let trace = match driven.trace.ticks.is_empty() {
            true => None,
            false => Some(self.log.write_trace(number, &driven.trace)?),
        };
        let entry = TrialEntry {
            number,
            participant: participant.clone(),
            slot: slot.number,
            practice: slot.practice,
            condition: plan.conditions[slot.condition].name.clone(),
            context: context.name.clone(),
            group: context.settings.group.name().to_owned(),
            source: plan.settings.source.name().to_owned(),
            repetition: slot.repetition,
            seed: slot.seed,
            outcome: verdict.outcome,
            judged_by: verdict.judged_by,
            reason: verdict.reason,
            note: verdict.note,
            session: driven.session.clone(),
            began_s: driven.began_s,
            lasted_s: driven.lasted_s,
            trace,
        };
        let finished = entry.is_finished();
        // A person was told already, and not the condition's name.
        if let (false, true, Some(why)) = (finished, self.prepared.is_simulated(), &entry.reason) {
            let name = self.name(slot);
            self.bar.suspend(|| eprintln!("trial {number} ({name}) aborted: {why}"));
        }
        self.log.append(entry)?;
        if finished {
            self.bar.inc(1);
            Ok(Next::Trial)
        } else {
            Ok(Next::Again)
        }
    }

    /// How many trials are still to be driven.
    fn open(&self, participants: &[Participant]) -> usize {
        let of = |participant: &Participant| {
            let slots = self.prepared.plan.slots(participant);
            self.log.open_slots(participant, &slots).len()
        };
        participants.iter().map(of).sum()
    }
}

/// How a trial ended, by the plan's rule.
pub(super) fn judge(rule: &SuccessSettings, driven: &Driven) -> Verdict {
    let figures = Measures::of(&driven.trace);
    let fault = match &driven.end {
        End::TimeUp => Some("time is up".to_owned()),
        End::Aborted(why) => return verdict(TrialOutcome::Aborted, Some(why.clone())),
        End::Left { .. } | End::Interrupted => return verdict(TrialOutcome::Aborted, Some(driven.end.to_string())),
        End::Over => None,
    };
    let away = || match figures.goal_distance_m {
        Some(distance) => format!("not at rest at the goal, but {:.0} mm away", distance * 1e3),
        None => "it did not move".to_owned(),
    };
    let fault = fault
        .or_else(|| (!figures.reached_goal).then(away))
        .or_else(|| (rule.no_contact && figures.contacts > 0).then(|| "an obstacle was touched".to_owned()))
        .or_else(|| {
            let stop = figures.stops.first().filter(|_| rule.no_stop)?;
            Some(format!("{} stopped: {}", stop.by, stop.reason))
        });
    match fault {
        None => verdict(TrialOutcome::Success, None),
        fault => verdict(TrialOutcome::Failure, fault),
    }
}

fn verdict(outcome: TrialOutcome, reason: Option<String>) -> Verdict {
    Verdict {
        outcome,
        judged_by: JudgedBy::Rule,
        reason,
        note: String::new(),
    }
}

fn progress_bar(total: usize) -> ProgressBar {
    let bar = ProgressBar::new(total as u64);
    let style = ProgressStyle::with_template("{elapsed:>4} {bar:30} {pos}/{len} trials, {eta} left  {msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

struct Summary {
    open: usize,
    ended: Option<&'static str>,
    closed: Closed,
    wall: Duration,
}

impl Summary {
    fn outcome(&self) -> Outcome {
        if self.open > 0 {
            Outcome::Incomplete
        } else if self.closed.messages_lost > 0 {
            Outcome::SamplesLost
        } else {
            Outcome::Done
        }
    }

    fn print(&self, flags: &RunFlags, entries: &[TrialEntry]) -> anyhow::Result<()> {
        let count = |outcome| entries.iter().filter(|entry| entry.outcome == outcome).count();
        let (successes, failures) = (count(TrialOutcome::Success), count(TrialOutcome::Failure));
        let aborted = count(TrialOutcome::Aborted);
        if flags.json {
            let object = json!({
                "run": flags.out,
                "finished": successes + failures,
                "successes": successes,
                "failures": failures,
                "aborted": aborted,
                "open": self.open,
                "ended": self.ended,
                "sessions": self.closed.sessions,
                "messages_lost": self.closed.messages_lost,
                "wall_s": self.wall.as_secs_f64(),
            });
            println!("{}", serde_json::to_string(&object)?);
            return Ok(());
        }
        let run = flags.out.display();
        let open = match (self.open, self.ended) {
            (0, _) => "none".to_owned(),
            (open, why) => format!(
                "{open}{}; the same command goes on with them",
                why.map_or_else(String::new, |why| format!(" ({why})"))
            ),
        };
        let sessions: Vec<String> = self
            .closed
            .sessions
            .iter()
            .map(|name| format!("{run}/{name}"))
            .collect();
        let finished = format!("{}: {successes} successes, {failures} failures", successes + failures);
        println!(
            "{}",
            table::rows(&[
                ("trials finished", finished),
                ("aborted on the way", aborted.to_string()),
                ("still open", open),
                ("messages lost", self.closed.messages_lost.to_string()),
                ("run", format!("{run}/trials.jsonl, {run}/trials/")),
                (
                    "session",
                    if sessions.is_empty() {
                        "none".to_owned()
                    } else {
                        sessions.join(", ")
                    }
                ),
                ("took", format!("{:.1} s", self.wall.as_secs_f64())),
            ])
        );
        Ok(())
    }
}
