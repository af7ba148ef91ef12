//! What the recorder counted: what came and what was lost, and the bounds and hops it made of the stamps.

use std::collections::BTreeMap;

use tandem_wire as wire;

use super::super::schemas::{ChannelDrops, ClockOffset, Counts, Gap, Hop, JournalCount, StreamCount};
use crate::budget::HopBudget;
use crate::sinks::Drops;
use crate::tally;

impl Counts {
    pub(in crate::session_file) fn new(counts: &tally::Counts, drops: Drops) -> Self {
        let stream = |count: &tally::StreamCount| StreamCount {
            topic: count.topic.to_string(),
            received: count.received,
            missed: count.missed,
            late: count.late,
            repeated: count.repeated,
            unreadable: count.unreadable,
            sender_runs: count.runs,
        };
        let journal = |count: &tally::JournalCount| JournalCount {
            node: count.node.to_string(),
            entries: count.entries,
            lost_by_writer: count.lost,
            missed: count.missed,
        };
        Self {
            streams: counts.streams.iter().map(stream).collect(),
            journals: counts.journals.iter().map(journal).collect(),
            dropped_before_session_file: drops.session_file.total(),
            dropped_before_views: drops.views.total(),
            drops: channel_drops(drops),
            gaps: counts.gaps.iter().map(Into::into).collect(),
            gaps_forgotten: counts.gaps_forgotten,
            clocks: counts.clocks.iter().map(Into::into).collect(),
            hops: counts.hops.iter().map(Into::into).collect(),
        }
    }
}

fn channel_drops(drops: Drops) -> Vec<ChannelDrops> {
    let mut channels = BTreeMap::<String, (u64, u64)>::new();
    for (channel, number) in drops.session_file.by_channel() {
        channels.entry(channel).or_default().0 = number;
    }
    for (channel, number) in drops.views.by_channel() {
        channels.entry(channel).or_default().1 = number;
    }
    let row = |(channel, (session_file, views))| ChannelDrops {
        channel,
        session_file,
        views,
    };
    channels.into_iter().map(row).collect()
}

impl From<&tally::Gap> for Gap {
    fn from(gap: &tally::Gap) -> Self {
        Self {
            topic: gap.topic.to_string(),
            session: gap.session.0,
            first: gap.first,
            last: gap.last,
        }
    }
}

impl From<&tally::ClockOffset> for ClockOffset {
    fn from(clock: &tally::ClockOffset) -> Self {
        Self {
            node: clock.node.to_string(),
            session: clock.session.0,
            least_one_way_ns: clock.least,
            mean_one_way_ns: clock.mean,
            most_one_way_ns: clock.most,
            messages: clock.messages,
        }
    }
}

impl From<&HopBudget> for Hop {
    fn from(hop: &HopBudget) -> Self {
        let ms = |nanos: wire::Nanos| wire::seconds(nanos) * 1e3;
        Self {
            name: hop.hop.as_str().to_owned(),
            count: hop.count,
            p50_ms: ms(hop.all.p50),
            p95_ms: ms(hop.all.p95),
            p99_ms: ms(hop.all.p99),
            worst_ms: ms(hop.worst),
            recent_p50_ms: ms(hop.recent.p50),
            recent_p95_ms: ms(hop.recent.p95),
            recent_p99_ms: ms(hop.recent.p99),
            uncertainty_ms: ms(hop.uncertainty),
        }
    }
}
