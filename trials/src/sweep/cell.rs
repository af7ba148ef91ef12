//! One cell of the grid: a human, a departure, a law and a seed, with every context.

use serde::{Deserialize, Serialize};
use tandem_settings::Choice;
use tandem_wire::SECOND;

use crate::sweep::grid::Grid;
use crate::{Measures, Unbuildable, World};

/// The place of a cell in its grid: indices into its axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Cell {
    /// Into `sweep.humans`.
    pub human: usize,
    /// Into `sweep.departures_mm`.
    pub departure: usize,
    /// Into `sweep.laws`.
    pub law: usize,
    /// From 0 to `sweep.seeds` − 1.
    pub seed: u32,
}

/// What came of a cell: its trials in the order of the contexts, those inside first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellResult {
    /// Which cell.
    pub cell: Cell,
    /// One for each context.
    pub runs: Vec<Run>,
}

/// One trial in short.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Amplitude of the wished path.
    pub amplitude_m: f64,
    /// Whether it lies between the demonstrations.
    pub inside: bool,
    /// Whether the tool came to rest at the goal.
    pub reached_goal: bool,
    /// Mean norm of the commanded human velocity after the checkpoint; absent if it was never crossed.
    pub effort_m_s: Option<f64>,
    /// Its integral over time.
    pub effort_m: Option<f64>,
    /// Mean distance of the tool from the human's own wish after the checkpoint.
    pub wish_error_m: Option<f64>,
    /// Mean distance of the tool from the forecast.
    pub forecast_error_m: Option<f64>,
    /// Smallest distance of arm or tool to an obstacle; negative inside.
    pub clearance_m: Option<f64>,
    /// How often an obstacle was touched.
    pub contacts: u32,
    /// Mean weight of the human after the checkpoint.
    pub weight: Option<f64>,
    /// From the first to the last motion.
    pub duration_s: Option<f64>,
}

/// Longer than any simulated human keeps trying, its settings allow an hour.
const LIMIT: u64 = 3700 * SECOND;

impl Grid {
    /// All cells. Those that differ in the law alone lie side by side, so that a sweep that was cut short compares
    /// all laws on what it has.
    pub fn cells(&self) -> impl Iterator<Item = Cell> + '_ {
        let settings = &self.settings;
        let humans = move || 0..settings.humans.len();
        let departures = move || 0..settings.departures_mm.len();
        let laws = move || 0..self.laws.len();
        (0..settings.seeds).flat_map(move |seed| {
            humans().flat_map(move |human| {
                departures().flat_map(move |departure| {
                    laws().map(move |law| Cell {
                        human,
                        departure,
                        law,
                        seed,
                    })
                })
            })
        })
    }

    /// A cell's name, as its file is called.
    #[must_use]
    pub fn name(&self, cell: Cell) -> String {
        let human = self.settings.humans.get(cell.human).map_or("", |human| human.name());
        let departure = self
            .settings
            .departures_mm
            .get(cell.departure)
            .copied()
            .unwrap_or_default();
        let seed = self.settings.first_seed.wrapping_add(u64::from(cell.seed));
        format!("{human}-d{departure}-law{}-seed{seed}", cell.law)
    }

    /// Runs a cell: every context once, nodes built anew for each.
    ///
    /// # Errors
    /// If nodes cannot be built; [`Grid::from_document`] has tried that.
    pub fn run(&self, cell: Cell) -> Result<CellResult, Unbuildable> {
        let settings = &self.settings;
        let mut configuration = self.laws[cell.law].configuration.clone();
        configuration.rates.seed = settings.first_seed.wrapping_add(u64::from(cell.seed));
        configuration.human.kind = settings.humans[cell.human];
        configuration.human.departure_mm = settings.departures_mm[cell.departure];
        let contexts = [(true, &settings.inside_m), (false, &settings.outside_m)];
        let contexts = contexts
            .into_iter()
            .flat_map(|(inside, list)| list.iter().map(move |&a| (inside, a)));
        let mut runs = Vec::with_capacity(self.contexts());
        for (number, (inside, amplitude_m)) in (1_u32..).zip(contexts) {
            configuration.human.amplitude_m = amplitude_m;
            let blueprint = self.base.with_configuration(configuration.clone())?;
            // The trial's number is what the human draws its wish from.
            let (trace, _) = World::new(&blueprint)?.trial(number, "", LIMIT);
            runs.push(Run::new(amplitude_m, inside, &Measures::of(&trace)));
        }
        Ok(CellResult { cell, runs })
    }
}

impl Run {
    fn new(amplitude_m: f64, inside: bool, measures: &Measures) -> Self {
        Self {
            amplitude_m,
            inside,
            reached_goal: measures.reached_goal,
            effort_m_s: measures.human_effort_mean_m_s,
            effort_m: measures.human_effort_integral_m,
            wish_error_m: measures.tracking_wish_after_mean_m,
            forecast_error_m: measures.tracking_forecast_mean_m,
            clearance_m: measures.min_clearance_m,
            contacts: measures.contacts,
            weight: measures.weight_mean_after,
            duration_s: measures.duration_s,
        }
    }
}
