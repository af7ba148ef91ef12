//! A run's folder of any size, to look at a report of it and to measure how long that takes:
//!
//! ```text
//! cargo run --release -p tandem-trials --example synthetic_run -- examples/plans/paper.toml runs/large 1000
//! ```
//!
//! The trials are the plan's, driven by its simulated humans under virtual time, with a new seed in every repetition.
//! There is no session file beside them. Conditions that need models of their own are driven with the shipped one.

use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

use tandem_cesn::{Demonstration, Model, Settings};
use tandem_link::config::PaceName;
use tandem_trials::plan::{Participant, Plan, Slot};
use tandem_trials::run::{JudgedBy, RunLog, TrialEntry, TrialOutcome};
use tandem_trials::{Blueprint, Measures, Trace, World};
use tandem_wire::{SECOND, Session};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [plan, out, count] = arguments.as_slice() else {
        eprintln!("usage: synthetic_run PLAN OUT TRIALS");
        return ExitCode::from(2);
    };
    match count
        .parse()
        .map_err(Into::into)
        .and_then(|count| make(plan, Path::new(out), count))
    {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("synthetic_run: {error}");
            ExitCode::FAILURE
        }
    }
}

fn make(plan: &str, out: &Path, count: usize) -> Result<(), Box<dyn Error>> {
    let text = std::fs::read_to_string(plan).map_err(|error| format!("{plan}: {error}"))?;
    let plan = Plan::parse(plan, &text)?;
    let model = model()?;
    let mut log = RunLog::open(out, &plan, "synthetic")?;
    let participant = plan.participants().first().cloned().map_or_else(|| "S1".parse(), Ok)?;
    let slots: Vec<Slot> = plan
        .slots(&participant)
        .into_iter()
        .filter(|slot| !slot.practice)
        .collect();
    let mut began_s = 0.0;
    for (index, slot) in slots.iter().cycle().take(count).enumerate() {
        let round = u32::try_from(index / slots.len())?;
        let seed = slot.seed.wrapping_add(u64::from(round) << 20);
        let trace = drive(&plan, slot, seed, &model)?;
        let lasted_s = f64::from(Measures::of(&trace).ticks) * trace.period_s().unwrap_or(0.1);
        let number = log.next_number();
        let name = log.write_trace(number, &trace)?;
        let entry = entry(&plan, &participant, slot, round, &trace);
        log.append(TrialEntry {
            number,
            seed,
            began_s,
            lasted_s,
            trace: Some(name),
            ..entry
        })?;
        began_s += lasted_s + 1.0;
    }
    println!("{count} trials in {}", out.display());
    Ok(())
}

fn model() -> Result<Model, Box<dyn Error>> {
    let demonstrations = [
        include_str!("../../examples/demonstrations/planar_a08.csv"),
        include_str!("../../examples/demonstrations/planar_a11.csv"),
        include_str!("../../examples/demonstrations/planar_a14.csv"),
    ]
    .map(|text| Demonstration::from_csv("shipped", text));
    let demonstrations = demonstrations.into_iter().collect::<Result<Vec<_>, _>>()?;
    Ok(Model::train(&demonstrations, &Settings::default())?)
}

fn drive(plan: &Plan, slot: &Slot, seed: u64, model: &Model) -> Result<Trace, Box<dyn Error>> {
    let (condition, context) = (&plan.conditions[slot.condition], &plan.contexts[slot.context]);
    let mut configuration = plan.configuration(condition, context)?;
    configuration.rates.pace = PaceName::Max;
    configuration.rates.seed = seed;
    let blueprint = Blueprint::new(configuration, Session(1), Some(model.clone()))?;
    let label = format!("{}, {}", condition.name, context.name);
    let (trace, _) = World::new(&blueprint)?.trial(1, &label, 30 * SECOND);
    Ok(trace)
}

fn entry(plan: &Plan, participant: &Participant, slot: &Slot, round: u32, trace: &Trace) -> TrialEntry {
    let (condition, context) = (&plan.conditions[slot.condition], &plan.contexts[slot.context]);
    let reached = Measures::of(trace).reached_goal;
    TrialEntry {
        number: 0,
        participant: participant.clone(),
        slot: slot.number,
        practice: false,
        condition: condition.name.clone(),
        context: context.name.clone(),
        group: format!("{:?}", context.settings.group).to_lowercase(),
        source: "simulated".into(),
        repetition: slot.repetition + round,
        seed: 0,
        outcome: if reached {
            TrialOutcome::Success
        } else {
            TrialOutcome::Failure
        },
        judged_by: JudgedBy::Rule,
        reason: None,
        note: String::new(),
        session: "session-1.mcap".to_owned(),
        began_s: 0.0,
        lasted_s: 0.0,
        trace: None,
    }
}
