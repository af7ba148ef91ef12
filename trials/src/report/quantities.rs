//! What is compared: each figure of a trial with its name, its unit, and whether less of it is better.

use crate::Measures;

/// Which way is better.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Better {
    /// Less of it.
    Less,
    /// More of it.
    More,
    /// Neither.
    Neither,
}

/// A figure of a trial.
#[derive(Clone, Copy, Debug)]
pub struct Quantity {
    /// Its name in files.
    pub key: &'static str,
    /// Its name for people.
    pub label: &'static str,
    /// The unit in which people see it.
    pub unit: &'static str,
    /// From the measure's unit to that one.
    pub factor: f64,
    /// Decimals in which people see it.
    pub decimals: usize,
    /// Which way is better.
    pub better: Better,
    /// Whether conditions are tested for a difference in it.
    pub tested: bool,
    /// Where it is found.
    pub of: fn(&Measures) -> Option<f64>,
}

impl Quantity {
    /// A value in the measure's unit, as people see it.
    #[must_use]
    pub fn shown(&self, value: f64) -> String {
        rounded(value * self.factor, self.decimals)
    }

    /// The same with its unit.
    #[must_use]
    pub fn with_unit(&self, value: f64) -> String {
        let gap = if self.unit.is_empty() { "" } else { " " };
        format!("{}{gap}{}", self.shown(value), self.unit)
    }
}

/// A number as people read it: with a minus sign, where rounding leaves anything to be minus.
pub(super) fn rounded(value: f64, decimals: usize) -> String {
    let text = format!("{:.decimals$}", value.abs());
    if value < 0.0 && text.contains(|digit: char| ('1'..='9').contains(&digit)) {
        format!("−{text}")
    } else {
        text
    }
}

/// The paper's measure, on which its tests per step are made.
pub const EFFORT: &str = "human_effort_mean_m_s";

macro_rules! quantity {
    ($key:literal, $label:literal, $unit:literal, $factor:literal, $decimals:literal, $better:ident, $tested:literal, $of:expr) => {
        Quantity {
            key: $key,
            label: $label,
            unit: $unit,
            factor: $factor,
            decimals: $decimals,
            better: Better::$better,
            tested: $tested,
            of: $of,
        }
    };
}

/// All of them, in the order of tables.
#[rustfmt::skip]
pub const QUANTITIES: [Quantity; 15] = [
    quantity!("human_effort_mean_m_s", "human effort", "mm/s", 1e3, 1, Less, true, |m| m.human_effort_mean_m_s),
    quantity!("human_effort_integral_m", "effort, integrated", "mm", 1e3, 0, Less, false, |m| m.human_effort_integral_m),
    quantity!("weight_mean_after", "mean ω after the checkpoint", "", 1.0, 2, Neither, false, |m| m.weight_mean_after),
    quantity!("tracking_wish_after_mean_m", "distance from the human's wish", "mm", 1e3, 1, Less, true, |m| m.tracking_wish_after_mean_m),
    quantity!("tracking_forecast_mean_m", "distance from the forecast", "mm", 1e3, 1, Less, true, |m| m.tracking_forecast_mean_m),
    quantity!("min_clearance_m", "smallest clearance", "mm", 1e3, 1, More, true, |m| m.min_clearance_m),
    quantity!("disagreement_mean_m_s", "human − robot", "mm/s", 1e3, 1, Less, false, |m| m.disagreement_mean_m_s),
    quantity!("agreement_cosine_mean", "cosine human, robot", "", 1.0, 2, More, false, |m| m.agreement_cosine_mean),
    quantity!("duration_s", "duration", "s", 1.0, 2, Less, true, |m| m.duration_s),
    quantity!("path_length_m", "path length", "mm", 1e3, 0, Less, false, |m| m.path_length_m),
    quantity!("smoothness_sparc", "smoothness (SPARC)", "", 1.0, 3, More, true, |m| m.smoothness_sparc),
    quantity!("contacts", "contacts", "", 1.0, 2, Less, false, |m| Some(f64::from(m.contacts))),
    quantity!("stops", "stops", "", 1.0, 2, Less, false, |m| Some(m.stops.len() as f64)),
    quantity!("latency_p50_ms", "latency, median", "ms", 1.0, 2, Less, false, |m| m.latency_p50_ms),
    quantity!("drops", "messages dropped", "", 1.0, 2, Less, false, |m| Some(m.drops.total() as f64)),
];
