//! `tandem trial check`: what a plan comes to, before anybody drives.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use tandem_operator::LAST_STEP;
use tandem_settings::Choice as _;
use tandem_trials::plan::{Blocks, Group, Participant, Plan, Slot};

use super::prepare::Prepared;
use crate::{Outcome, table};

#[derive(Args)]
pub(crate) struct CheckFlags {
    /// The plan (TOML).
    #[arg(value_name = "PLAN")]
    plan: PathBuf,
    /// Prints this participant's order only.
    #[arg(long, value_name = "CODE")]
    participant: Option<String>,
    /// Prints one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(flags: &CheckFlags) -> anyhow::Result<Outcome> {
    let prepared = Prepared::read(&flags.plan)?;
    let participants = match &flags.participant {
        None if !prepared.is_simulated() => prepared.plan.participants().to_vec(),
        named => prepared.participants(named.as_deref())?,
    };
    let plan = &prepared.plan;
    if flags.json {
        println!("{}", serde_json::to_string(&as_json(plan, &participants))?);
        return Ok(Outcome::Done);
    }
    println!("{}", overview(plan, &participants));
    let lines = plan.bad_lines();
    if !lines.is_empty() {
        println!("\nbad lines");
    }
    for (trials, line) in lines {
        println!("  {trials}: {line}");
    }
    for participant in &participants {
        println!("\norder of {participant}");
        for line in order(plan, &plan.slots(participant)) {
            println!("  {line}");
        }
    }
    Ok(Outcome::Done)
}

fn as_json(plan: &Plan, participants: &[Participant]) -> serde_json::Value {
    let slots = |participant: &Participant| -> Vec<_> {
        let one = |slot: &Slot| {
            json!({
                "slot": slot.number,
                "practice": slot.practice,
                "condition": plan.conditions[slot.condition].name,
                "context": plan.contexts[slot.context].name,
                "repetition": slot.repetition,
                "seed": slot.seed,
            })
        };
        plan.slots(participant).iter().map(one).collect()
    };
    let (expected, most) = seconds(plan);
    json!({
        "name": plan.settings.name,
        "sha256": plan.hash(),
        "source": plan.settings.source.name(),
        "trials_each": plan.trials(),
        "expected_s_each": expected,
        "at_most_s_each": most,
        "bad_lines": plan.bad_lines()
            .iter()
            .map(|(trials, line)| json!({ "trials": trials, "line": line }))
            .collect::<Vec<_>>(),
        "participants": participants
            .iter()
            .map(|participant| json!({ "code": participant, "order": slots(participant) }))
            .collect::<Vec<_>>(),
    })
}

fn overview(plan: &Plan, participants: &[Participant]) -> String {
    let names = |names: Vec<&str>| names.join(", ");
    let group = |group: Group| {
        let of = plan.contexts.iter().filter(|context| context.settings.group == group);
        let count = of.count();
        (count > 0).then(|| format!("{count} {}", group.name()))
    };
    let groups: Vec<String> = Group::ALL.iter().filter_map(|one| group(*one)).collect();
    let trials = plan.trials();
    let total = trials * participants.len() as u64;
    let practice = match plan.settings.practice {
        0 => String::new(),
        some => format!(", of which {some} practice"),
    };
    let (expected, most) = seconds(plan);
    let duration = match plan.settings.source {
        tandem_operator::SourceKind::Simulated => format!(
            "{} of the robot's time for each participant, {} at most; it takes as long as the messages do",
            minutes(expected),
            minutes(most)
        ),
        _ => format!(
            "{} for each participant without the time between prompts, {} at most",
            minutes(expected),
            minutes(most)
        ),
    };
    table::rows(&[
        (
            "plan",
            format!("{} (SHA-256 {}…)", plan.settings.name, &plan.hash()[..12]),
        ),
        (
            "driven by",
            format!("{}: {}", plan.settings.source.name(), people(participants)),
        ),
        (
            "conditions",
            names(plan.conditions.iter().map(|one| one.name.as_str()).collect()),
        ),
        ("contexts", groups.join(", ")),
        (
            "trials",
            format!("{trials} for each participant{practice}, {total} in all"),
        ),
        (
            "ticks",
            format!(
                "{:.0} as wished, {:.0} a trial",
                total as f64 * (LAST_STEP + 1.0),
                LAST_STEP + 1.0
            ),
        ),
        ("duration", duration),
    ])
}

fn people(participants: &[Participant]) -> String {
    if participants.is_empty() {
        return "whoever is named with --participant".to_owned();
    }
    participants
        .iter()
        .map(Participant::as_str)
        .collect::<Vec<_>>()
        .join(", ")
}

/// How long a participant's trials and pauses take, and at most.
fn seconds(plan: &Plan) -> (f64, f64) {
    let Some(participant) = plan.participants().first().cloned().or_else(|| "P1".parse().ok()) else {
        return (0.0, 0.0);
    };
    let one = |slot: &Slot| plan.trial_seconds(&plan.conditions[slot.condition], &plan.contexts[slot.context]);
    let slots = plan.slots(&participant);
    let trials = slots.iter().map(one);
    let (expected, most) = trials.fold((0.0, 0.0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
    (expected + plan.pause_seconds(), most + plan.pause_seconds())
}

fn minutes(seconds: f64) -> String {
    if seconds < 60.0 {
        format!("{seconds:.0} s")
    } else {
        format!(
            "{:.0} min {:02.0} s",
            (seconds / 60.0).floor(),
            (seconds % 60.0).floor()
        )
    }
}

/// The order in lines, a block each.
fn order(plan: &Plan, slots: &[Slot]) -> Vec<String> {
    let head = |slot: &Slot| match (slot.practice, plan.order.blocks) {
        (true, _) => (0, 0),
        (false, Blocks::Conditions) => (slot.repetition, slot.condition),
        (false, Blocks::Contexts) => (slot.repetition, slot.context),
    };
    let condition = |slot: &Slot| plan.conditions[slot.condition].name.as_str();
    let context = |slot: &Slot| plan.contexts[slot.context].name.as_str();
    let blocks = slots.chunk_by(|one, next| head(one) == head(next));
    let line = |block: &[Slot]| {
        let (first, last) = (block.first()?, block.last()?);
        let (title, items): (&str, Vec<String>) = match (first.practice, plan.order.blocks) {
            (true, _) => {
                let both = |slot: &Slot| format!("{} {}", condition(slot), context(slot));
                ("practice", block.iter().map(both).collect())
            }
            (false, Blocks::Conditions) => (
                condition(first),
                block.iter().map(|slot| context(slot).to_owned()).collect(),
            ),
            (false, Blocks::Contexts) => (
                context(first),
                block.iter().map(|slot| condition(slot).to_owned()).collect(),
            ),
        };
        let places = format!("{}–{}", first.number, last.number);
        Some(format!("{places:>9}  {title}: {}", items.join(", ")))
    };
    blocks.filter_map(line).collect()
}
