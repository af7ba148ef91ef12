//! Where the time goes: the hops of the newest ten seconds, as lines and as a table, and what is known of the clocks.

use std::fmt::Write as _;

use rerun::Color;
use tandem_wire::{Nanos, NodeName, seconds};

use super::{Drawing, Sheet, colours, fixed};
use crate::budget::{Basis, Hop, HopBudget, Offset};
use crate::tally::Counts;

/// Names and colours of the lines: the human's side, the robot's side, what is between them, the sums.
pub(super) fn styles() -> Vec<Drawing> {
    let style = |hop: Hop| {
        let (colour, width) = look(hop);
        let style = rerun::SeriesLines::new().with_names([hop.words()]);
        fixed(&path(hop), &style.with_colors([colour]).with_widths([width]))
    };
    Hop::ALL.into_iter().map(style).collect()
}

const fn look(hop: Hop) -> (Color, f32) {
    match hop {
        Hop::Device | Hop::Command => (colours::HUMAN, 1.5),
        Hop::Decision => (colours::SHARED, 1.5),
        Hop::Setpoint | Hop::Uptake => (colours::ROBOT, 1.5),
        Hop::Report | Hop::State => (colours::GOAL, 1.0),
        Hop::CommandToMotion => (colours::RESULT, 2.5),
        Hop::Loop => (colours::OBSTACLE, 1.0),
    }
}

fn path(hop: Hop) -> String {
    format!("plots/hops/{}", hop.as_str())
}

pub(super) fn draw(counts: &Counts, sheet: &mut Sheet<'_>) {
    if counts.hops.is_empty() {
        return;
    }
    for hop in &counts.hops {
        sheet.plot(&path(hop.hop), ms(hop.recent.p95));
    }
    let text = table(&counts.hops) + &clocks(&counts.offsets);
    sheet.draw("budget", &rerun::TextDocument::from_markdown(text));
}

fn table(hops: &[HopBudget]) -> String {
    let mut text = String::from("| the newest 512, in ms | p50 | p95 | p99 | |\n| :-- | --: | --: | --: | :-- |\n");
    for hop in hops {
        let recent = hop.recent;
        let by = match hop.hop.basis() {
            Basis::OneClock => "by one clock".to_owned(),
            Basis::Corrected if hop.uncertainty == 0 => "one process".to_owned(),
            Basis::Corrected => format!("± {:.3}", ms(hop.uncertainty)),
        };
        let (p50, p95, p99) = (ms(recent.p50), ms(recent.p95), ms(recent.p99));
        // Writing to a text cannot fail.
        let _ = writeln!(text, "| {} | {p50:.2} | {p95:.2} | {p99:.2} | {by} |", hop.hop.words());
    }
    text
}

/// The recorder's own measurements: one row for each peer.
fn clocks(offsets: &[Offset]) -> String {
    let mut text = String::from("\n| clock | round trip, ms | wall clock off by, ms |\n| :-- | --: | --: |\n");
    for offset in offsets.iter().filter(|offset| offset.observer == NodeName::Recorder) {
        let peer = &offset.peer;
        let mark = if peer.is_skewed { "**" } else { "" };
        let (trip, skew, off) = (
            ms(peer.round_trip_median),
            peer.skew as f64 * 1e-6,
            ms(peer.uncertainty),
        );
        // Writing to a text cannot fail.
        let _ = writeln!(text, "| {} | {trip:.2} | {mark}{skew:.2} ± {off:.2}{mark} |", peer.node);
    }
    text
}

fn ms(nanos: Nanos) -> f64 {
    seconds(nanos) * 1e3
}
