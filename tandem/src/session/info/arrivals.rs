//! How setpoints arrived at a robot that expects one every millisecond, as its recorded states tell it.

use serde_json::{Value, json};
use tandem_recorder::Recording;
use tandem_wire::{Arrivals, State, Topic, decode};

/// While motion was permitted; held, a robot counts nothing.
pub(super) struct ArrivalsRead {
    /// The median of the share of the last hundred milliseconds in which a setpoint arrived, 0 to 1.
    success_rate: f64,
    /// The most milliseconds in a row without one.
    missed_longest: u32,
}

impl ArrivalsRead {
    /// Nothing of a robot that does not count them, or that never moved.
    pub(super) fn of(recording: &Recording) -> Option<Self> {
        let states = recording
            .messages
            .iter()
            .filter(|message| message.topic == Topic::State)
            .filter_map(|message| decode::<State>(&message.bytes).ok());
        let counted = states.filter_map(|state| state.body.arrivals.filter(|_| state.body.motion.is_permitted()));
        Self::summed(counted.collect())
    }

    fn summed(mut counted: Vec<Arrivals>) -> Option<Self> {
        counted.sort_by(|a, b| a.success_rate.0.total_cmp(&b.success_rate.0));
        Some(Self {
            success_rate: counted.get(counted.len() / 2)?.success_rate.0,
            missed_longest: counted.iter().map(|arrivals| arrivals.longest).max()?,
        })
    }

    pub(super) fn row(&self) -> String {
        format!(
            "{:.0} % arrived in their millisecond (median of the states in motion), {} missed in a row at most",
            self.success_rate * 100.0,
            self.missed_longest
        )
    }

    pub(super) fn json(&self) -> Value {
        json!({"success_rate_median": self.success_rate, "missed_longest": self.missed_longest})
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::Finite;

    #[test]
    fn the_middle_state_and_the_longest_row_are_told() {
        let arrivals = |rate, longest| Arrivals {
            success_rate: Finite(rate),
            missed: 0,
            longest,
        };
        let read = ArrivalsRead::summed(vec![arrivals(1.0, 2), arrivals(0.1, 7), arrivals(0.98, 3)]).expect("counted");
        assert_eq!(
            read.row(),
            "98 % arrived in their millisecond (median of the states in motion), 7 missed in a row at most"
        );
        assert!(ArrivalsRead::summed(Vec::new()).is_none());
    }
}
