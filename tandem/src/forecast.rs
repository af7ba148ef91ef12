//! `tandem forecast`: what a model expects for a context.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::Args;
use serde_json::json;
use tandem_cesn::{Forecast, Model};

use crate::Outcome;
use crate::table::hex;

#[derive(Args)]
pub(crate) struct ForecastFlags {
    /// The model file.
    #[arg(long, value_name = "MODEL.cesn")]
    model: PathBuf,
    /// The context, its numbers separated by commas.
    #[arg(
        long,
        value_name = "X,Y",
        value_delimiter = ',',
        required = true,
        allow_hyphen_values = true
    )]
    context: Vec<f64>,
    /// The first step to print [default: the model's checkpoint; where the context holds a time, the step then].
    #[arg(long)]
    from: Option<usize>,
    /// Prints one JSON object.
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// Prints comma-separated values.
    #[arg(long)]
    csv: bool,
}

pub(crate) fn run(flags: &ForecastFlags) -> anyhow::Result<Outcome> {
    let model = load(&flags.model)?;
    let first = flags.from.unwrap_or_else(|| model.first_step(&flags.context));
    let forecast = model.forecast(&flags.context, first)?;
    if flags.json {
        println!(
            "{}",
            serde_json::to_string(&as_json(&model, &flags.context, &forecast))?
        );
    } else if flags.csv {
        print!("{}", as_csv(&model, &forecast));
    } else {
        print!("{}", as_table(&model, &forecast));
    }
    Ok(Outcome::Done)
}

/// Reads a model file.
pub(crate) fn load(path: &Path) -> anyhow::Result<Model> {
    let bytes = fs::read(path).with_context(|| format!("cannot read the model {}", path.display()))?;
    Model::from_bytes(&bytes).with_context(|| format!("{} is not a model that can be used", path.display()))
}

struct Row<'a> {
    step: usize,
    mean: &'a [f64],
    half_width: &'a [f64],
    ratio: f64,
}

fn rows(forecast: &Forecast) -> impl Iterator<Item = Row<'_>> {
    forecast.steps().filter_map(|step| {
        let (mean, half_width) = (forecast.mean(step)?, forecast.half_width(step)?);
        Some(Row {
            step,
            mean,
            half_width,
            ratio: forecast.ratio(step)?,
        })
    })
}

fn as_json(model: &Model, context: &[f64], forecast: &Forecast) -> serde_json::Value {
    let steps: Vec<_> = rows(forecast)
        .map(|row| json!({ "step": row.step, "mean": row.mean, "half_width": row.half_width, "ratio": row.ratio }))
        .collect();
    json!({
        "model_sha256": hex(&model.hash()),
        "frame": model.frame(),
        "period_s": model.period_s(),
        "confidence": model.settings().confidence,
        "context_columns": model.context_columns(),
        "context": context,
        "output_columns": model.output_columns(),
        "steps": steps,
    })
}

fn as_csv(model: &Model, forecast: &Forecast) -> String {
    let outputs = model.output_columns();
    let widths: Vec<String> = outputs.iter().map(|name| format!("half_width_{name}")).collect();
    let mut text = format!("step,{},{},ratio\n", outputs.join(","), widths.join(","));
    for row in rows(forecast) {
        let numbers: Vec<String> = row.mean.iter().chain(row.half_width).map(ToString::to_string).collect();
        text.push_str(&format!("{},{},{}\n", row.step, numbers.join(","), row.ratio));
    }
    text
}

fn as_table(model: &Model, forecast: &Forecast) -> String {
    let mut text = format!("{:>5}", "step");
    for name in model.output_columns() {
        text.push_str(&format!("  {name:>22}"));
    }
    text.push_str("   ratio\n");
    for row in rows(forecast) {
        text.push_str(&format!("{:>5}", row.step));
        for (mean, half_width) in row.mean.iter().zip(row.half_width) {
            text.push_str(&format!("  {:>22}", format!("{mean:.5} ± {half_width:.5}")));
        }
        text.push_str(&format!("  {:>6.3}\n", row.ratio));
    }
    text
}
