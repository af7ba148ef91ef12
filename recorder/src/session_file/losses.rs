//! What was received and lost, as the fields of a metadata record.

use std::collections::BTreeMap;

use crate::sinks::Drops;
use crate::tally::Counts;

/// The record of what was received and lost.
pub(crate) const COUNTS: &str = "tandem.counts";

/// What makes a new record worth writing: that nothing more was lost is no news.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Losses {
    missed: u64,
    drops: Drops,
}

impl Losses {
    pub(super) fn new(counts: &Counts, drops: Drops) -> Self {
        let of_streams = counts.streams.iter().map(|count| count.missed);
        let of_journals = counts
            .journals
            .iter()
            .map(|count| count.missed.saturating_add(count.lost));
        Self {
            missed: of_streams.chain(of_journals).fold(0, u64::saturating_add),
            drops,
        }
    }
}

/// Every count under a name of its own; `closed` is false in what is written before the end.
pub(super) fn fields(counts: &Counts, drops: Drops, is_closed: bool) -> BTreeMap<String, String> {
    let mut fields = BTreeMap::new();
    let mut put = |name: String, value: String| fields.insert(name, value);
    put("closed".to_owned(), is_closed.to_string());
    for (sink, lost) in [("session_file", drops.session_file), ("views", drops.views)] {
        put(format!("dropped.{sink}"), lost.total().to_string());
        for (channel, number) in lost.by_channel() {
            put(format!("dropped.{sink}.{channel}"), number.to_string());
        }
    }
    for count in &counts.streams {
        let topic = count.topic;
        put(format!("{topic}.received"), count.received.to_string());
        put(format!("{topic}.missed"), count.missed.to_string());
        put(format!("{topic}.unreadable"), count.unreadable.to_string());
        put(format!("{topic}.repeated"), count.repeated.to_string());
    }
    for count in &counts.journals {
        let missing = count.lost.saturating_add(count.missed);
        put(format!("journal/{}.entries_missing", count.node), missing.to_string());
    }
    for (index, gap) in counts.gaps.iter().enumerate() {
        let text = format!("{} {:016x} {}-{}", gap.topic, gap.session.0, gap.first, gap.last);
        put(format!("gap.{index:04}"), text);
    }
    put("gaps_forgotten".to_owned(), counts.gaps_forgotten.to_string());
    for clock in &counts.clocks {
        let name = format!("clock.{}.{:016x}", clock.node, clock.session.0);
        put(format!("{name}.least_ns"), clock.least.to_string());
        put(format!("{name}.mean_ns"), clock.mean.to_string());
        put(format!("{name}.most_ns"), clock.most.to_string());
        put(format!("{name}.messages"), clock.messages.to_string());
    }
    for offset in &counts.offsets {
        let peer = &offset.peer;
        let name = format!("offset.{}.{}.{:016x}", offset.observer, peer.node, peer.session.0);
        put(format!("{name}.offset_ns"), peer.offset.to_string());
        put(format!("{name}.uncertainty_ns"), peer.uncertainty.to_string());
        put(format!("{name}.round_trip_ns"), peer.round_trip.to_string());
        put(format!("{name}.skew_ns"), peer.skew.to_string());
        put(format!("{name}.steps"), peer.steps.to_string());
    }
    for hop in &counts.hops {
        let name = format!("hop.{}", hop.hop.as_str());
        put(format!("{name}.count"), hop.count.to_string());
        put(format!("{name}.p50_ns"), hop.all.p50.to_string());
        put(format!("{name}.p95_ns"), hop.all.p95.to_string());
        put(format!("{name}.p99_ns"), hop.all.p99.to_string());
        put(format!("{name}.worst_ns"), hop.worst.to_string());
        put(format!("{name}.uncertainty_ns"), hop.uncertainty.to_string());
    }
    fields
}
