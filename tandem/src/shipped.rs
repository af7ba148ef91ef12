//! What ships inside the program: the three demonstrations of the planar task.

use std::path::Path;

use anyhow::Context as _;
use tandem_cesn::{Demonstration, Model, Settings};

const DEMONSTRATIONS: [(&str, &str); 3] = [
    (
        "planar_a08.csv",
        include_str!("../../examples/demonstrations/planar_a08.csv"),
    ),
    (
        "planar_a11.csv",
        include_str!("../../examples/demonstrations/planar_a11.csv"),
    ),
    (
        "planar_a14.csv",
        include_str!("../../examples/demonstrations/planar_a14.csv"),
    ),
];

/// The model that `predictor.model` names; if it names none, the one of the shipped task.
pub(crate) fn model_or(file: &str) -> anyhow::Result<Model> {
    match file {
        "" => model(),
        path => crate::forecast::load(Path::new(path)),
    }
}

/// Trains the model of the shipped task; takes some tens of milliseconds.
pub(crate) fn model() -> anyhow::Result<Model> {
    let demonstrations: Vec<Demonstration> = DEMONSTRATIONS
        .iter()
        .map(|(name, text)| Demonstration::from_csv(name, text))
        .collect::<Result<_, _>>()?;
    Model::train(&demonstrations, &Settings::default()).context("cannot train on the shipped demonstrations")
}
