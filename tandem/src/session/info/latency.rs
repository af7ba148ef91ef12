//! The hops of the loop and the clocks, as the file's counts tell them.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use tandem_recorder::{Basis, Hop};

/// A hop as written at the end.
pub(super) struct HopRead {
    hop: Hop,
    numbers: BTreeMap<String, i64>,
}

/// What one node said of another's clock.
pub(super) struct OffsetRead {
    pub(super) observer: String,
    pub(super) node: String,
    session: String,
    numbers: BTreeMap<String, i64>,
}

/// The hops in the loop's order. None if nothing was measured, or the counts were never written.
pub(super) fn hops(closing: &BTreeMap<String, String>) -> Vec<HopRead> {
    let read = |hop: Hop| {
        let numbers = numbers(closing, &format!("hop.{}.", hop.as_str()));
        (!numbers.is_empty()).then_some(HopRead { hop, numbers })
    };
    Hop::ALL.into_iter().filter_map(read).collect()
}

/// Every pair of clocks that was measured both ways.
pub(super) fn offsets(closing: &BTreeMap<String, String>) -> Vec<OffsetRead> {
    let names = closing.keys().filter_map(|key| {
        let name = key.strip_suffix(".offset_ns")?;
        name.starts_with("offset.").then_some(name)
    });
    let read = |name: &str| {
        let mut parts = name.split('.').skip(1).map(str::to_owned);
        Some(OffsetRead {
            observer: parts.next()?,
            node: parts.next()?,
            session: parts.next()?,
            numbers: numbers(closing, &format!("{name}.")),
        })
    };
    names.filter_map(read).collect()
}

fn numbers(closing: &BTreeMap<String, String>, prefix: &str) -> BTreeMap<String, i64> {
    let of = |(key, value): (&String, &String)| {
        let name = key.strip_prefix(prefix)?;
        Some((name.to_owned(), value.parse().ok()?))
    };
    closing.iter().filter_map(of).collect()
}

impl HopRead {
    fn ms(&self, name: &str) -> f64 {
        self.numbers.get(name).copied().unwrap_or(0) as f64 * 1e-6
    }

    pub(super) fn json(&self) -> Value {
        let basis = match self.hop.basis() {
            Basis::OneClock => "one clock",
            Basis::Corrected => "corrected",
        };
        json!({"hop": self.hop.as_str(), "basis": basis, "count": self.numbers.get("count"),
            "p50_ms": self.ms("p50_ns"), "p95_ms": self.ms("p95_ns"), "p99_ms": self.ms("p99_ns"),
            "worst_ms": self.ms("worst_ns"), "uncertainty_ms": self.ms("uncertainty_ns")})
    }

    pub(super) fn row(&self) -> String {
        let by = match self.hop.basis() {
            Basis::OneClock => "by one clock".to_owned(),
            Basis::Corrected if self.ms("uncertainty_ns") == 0.0 => "within one process".to_owned(),
            Basis::Corrected => format!("± {:.3} ms", self.ms("uncertainty_ns")),
        };
        let name = self.hop.words();
        format!(
            "{name:<25} p50 {:>7.3}  p95 {:>7.3}  p99 {:>7.3}  worst {:>7.3} ms  {by}",
            self.ms("p50_ns"),
            self.ms("p95_ns"),
            self.ms("p99_ns"),
            self.ms("worst_ns"),
        )
    }
}

impl OffsetRead {
    fn number(&self, name: &str) -> i64 {
        self.numbers.get(name).copied().unwrap_or(0)
    }

    pub(super) fn json(&self) -> Value {
        json!({"observer": self.observer, "node": self.node, "session": self.session,
            "offset_ns": self.number("offset_ns"), "uncertainty_ns": self.number("uncertainty_ns"),
            "round_trip_ns": self.number("round_trip_ns"), "skew_ns": self.number("skew_ns"),
            "steps": self.number("steps")})
    }

    pub(super) fn row(&self) -> String {
        let ms = |name: &str| self.number(name) as f64 * 1e-6;
        let jumps = match self.number("steps") {
            0 => String::new(),
            1 => ", jumped once".to_owned(),
            steps => format!(", jumped {steps} times"),
        };
        format!(
            "{} {:+.3} ± {:.3} ms to the {}'s, round trip {:.3} ms, wall clocks {:+.3} ms apart{jumps}",
            self.node,
            ms("offset_ns"),
            ms("uncertainty_ns"),
            self.observer,
            ms("round_trip_ns"),
            ms("skew_ns"),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn closing() -> BTreeMap<String, String> {
        let pairs = [
            ("closed", "true"),
            ("hop.loop.count", "40"),
            ("hop.loop.p50_ns", "21000000"),
            ("hop.command.p50_ns", "310000"),
            ("hop.command.uncertainty_ns", "50000"),
            ("hop.later.p50_ns", "1"),
            ("offset.recorder.robot-sim.00000000000000ff.offset_ns", "-1500000000"),
            ("offset.recorder.robot-sim.00000000000000ff.uncertainty_ns", "150000"),
            ("offset.recorder.robot-sim.00000000000000ff.steps", "2"),
            ("offset.offset_ns", "1"),
        ];
        pairs.map(|(key, value)| (key.to_owned(), value.to_owned())).into()
    }

    #[test]
    fn hops_are_told_in_the_loops_order_and_say_whose_clock_it_was() {
        let rows: Vec<String> = hops(&closing()).iter().map(HopRead::row).collect();
        assert_eq!(rows.len(), 2, "{rows:?}");
        assert!(
            rows[0].starts_with("operator → arbiter") && rows[0].ends_with("± 0.050 ms"),
            "{rows:?}"
        );
        assert!(
            rows[1].contains("p50  21.000") && rows[1].ends_with("by one clock"),
            "{rows:?}"
        );
    }

    #[test]
    fn a_clock_that_was_measured_both_ways_is_told_with_its_uncertainty() {
        let offsets = offsets(&closing());
        assert_eq!(offsets.len(), 1);
        let row = offsets[0].row();
        assert!(
            row.starts_with("robot-sim -1500.000 ± 0.150 ms to the recorder's"),
            "{row}"
        );
        assert!(row.ends_with("jumped 2 times"), "{row}");
    }
}
