//! `tandem train`: demonstrations in, model file out.

use std::fs;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context as _;
use clap::Args;
use serde_json::json;
use tandem_cesn::settings::Ridge;
use tandem_cesn::{Demonstration, Model, Settings};

use crate::Outcome;
use crate::configuration::BadConfiguration;
use crate::table::{self, hex};

#[derive(Args)]
pub(crate) struct TrainFlags {
    /// Demonstrations: CSV, one row per step. Columns named context_… are the condition, time_s and step are checked,
    /// every other column is an output.
    #[arg(required = true, value_name = "DEMOS.csv")]
    demonstrations: Vec<PathBuf>,
    /// Where the model goes.
    #[arg(short, long, value_name = "MODEL.cesn")]
    output: PathBuf,
    /// Ridge: "evidence", "ols" (λ = 0, the paper's formula) or a number.
    #[arg(long, default_value = "evidence")]
    ridge: String,
    /// Seed of the weights and the jitter.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The step at which the condition is known.
    #[arg(long, default_value_t = Settings::default().checkpoint_step)]
    checkpoint_step: usize,
    /// A model that is conditioned anew on every tick after the checkpoint: its context is a time and a position. Other
    /// defaults: 16 jittered copies, 15 mm off. The demonstrations' own context columns do not count.
    #[arg(long)]
    replan: bool,
    /// Any other hyper-parameter as TOML, as in --set units=300 or --set 'feedback={gain=0.01}'.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Prints one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(flags: &TrainFlags) -> anyhow::Result<Outcome> {
    let settings = settings(flags)?;
    let demonstrations = flags
        .demonstrations
        .iter()
        .map(read)
        .collect::<anyhow::Result<Vec<_>>>()?;
    let began = Instant::now();
    let model = if flags.replan {
        Model::train_replanning(&demonstrations, &settings)?
    } else {
        Model::train(&demonstrations, &settings)?
    };
    let millis = began.elapsed().as_secs_f64() * 1e3;
    let bytes = model.to_bytes();
    fs::write(&flags.output, &bytes).with_context(|| format!("cannot write {}", flags.output.display()))?;
    for warning in model.warnings() {
        eprintln!("warning: {warning}");
    }
    report(flags, &model, bytes.len(), millis)?;
    Ok(Outcome::Done)
}

fn read(path: &PathBuf) -> anyhow::Result<Demonstration> {
    let name = path.display().to_string();
    let text = fs::read_to_string(path).with_context(|| format!("cannot read {name}"))?;
    Ok(Demonstration::from_csv(&name, &text)?)
}

fn settings(flags: &TrainFlags) -> anyhow::Result<Settings> {
    let wrong = |what: String| BadConfiguration::Conflict(what);
    let unreadable = |error: toml::de::Error| wrong(format!("--set: {}", error.message()));
    let mut given: toml::Table = toml::from_str(&flags.set.join("\n")).map_err(unreadable)?;
    if flags.replan {
        let defaults = toml::Table::try_from(Settings::replanning())?;
        for key in ["context_gain", "jitter"] {
            if let Some(value) = defaults.get(key).filter(|_| !given.contains_key(key)) {
                given.insert(key.to_owned(), value.clone());
            }
        }
    }
    let mut settings: Settings = given.try_into().map_err(unreadable)?;
    settings.ridge = match flags.ridge.as_str() {
        "evidence" => settings.ridge,
        "ols" => Ridge::None,
        number => match number.parse() {
            Ok(lambda) => Ridge::Fixed { lambda },
            Err(_) => return Err(wrong(format!("--ridge {number:?}: write evidence, ols or a number")).into()),
        },
    };
    settings.seed = flags.seed;
    settings.checkpoint_step = flags.checkpoint_step;
    Ok(settings)
}

fn report(flags: &TrainFlags, model: &Model, bytes: usize, millis: f64) -> anyhow::Result<()> {
    let (rows, edf) = model.rows_and_edf();
    let calibration = model.calibration();
    if flags.json {
        let object = json!({
            "model": flags.output,
            "sha256": hex(&model.hash()),
            "bytes": bytes,
            "train_ms": millis,
            "units": model.settings().units,
            "seed": model.settings().seed,
            "lambda": model.lambda(),
            "effective_rows": rows,
            "effective_degrees_of_freedom": edf,
            "s": calibration.s,
            "s_lodo": calibration.s_lodo,
            "ratio_high": calibration.rho_hi,
            "steps": model.steps(),
            "checkpoint_step": model.checkpoint_step(),
            "last_condition_step": model.last_condition_step(),
            "context_columns": model.context_columns(),
            "output_columns": model.output_columns(),
            "warnings": model.warnings().iter().map(ToString::to_string).collect::<Vec<_>>(),
        });
        println!("{}", serde_json::to_string(&object)?);
        return Ok(());
    }
    let list = |values: &[f64]| {
        values
            .iter()
            .map(|value| format!("{value:.3e}"))
            .collect::<Vec<_>>()
            .join(", ")
    };
    println!(
        "{}",
        table::rows(&[
            (
                "model",
                format!("{} ({:.1} MB)", flags.output.display(), bytes as f64 / 1e6)
            ),
            (
                "trained in",
                format!("{millis:.1} ms on {} demonstrations", flags.demonstrations.len())
            ),
            ("context", model.context_columns().join(", ")),
            ("outputs", model.output_columns().join(", ")),
            (
                "steps",
                format!("{}, forecast from step {}", model.steps(), model.checkpoint_step())
            ),
            ("ridge λ", format!("{:.3e}", model.lambda())),
            ("degrees of freedom", format!("{:.1} used of {rows:.0}", edf)),
            ("spread s", list(&calibration.s)),
            (
                "… leaving one out",
                calibration
                    .s_lodo
                    .as_deref()
                    .map_or("one demonstration only".into(), list)
            ),
            ("hash", hex(&model.hash())),
        ])
    );
    Ok(())
}
