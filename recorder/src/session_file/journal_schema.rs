//! What stands in the file about the bytes of a journal, for whoever reads them without this program.

use tandem_wire::codec::{VERSION, to_bytes};
use tandem_wire::{JournalBatch, Message as _, NodeName, Topic};

/// Every topic; where a node belongs to it, the operator's.
const TOPICS: [Topic; 18] = [
    Topic::Command,
    Topic::Proposal,
    Topic::Forecast,
    Topic::Setpoint,
    Topic::State,
    Topic::Scene,
    Topic::Trial,
    Topic::Journal(NodeName::Operator),
    Topic::Info(NodeName::Operator),
    Topic::Alive(NodeName::Operator),
    Topic::Device,
    Topic::Lease,
    Topic::Emergency,
    Topic::Storage,
    Topic::Clock(NodeName::Operator),
    Topic::Ping(NodeName::Operator),
    Topic::TakeOver,
    Topic::AllClear,
];

/// The layout in words, with the version and the numbers that this build writes.
pub(super) fn text() -> String {
    let kind = JournalBatch::KIND;
    let nodes = NodeName::ALL.map(|node| format!("{} {node}", number(&to_bytes(&node))));
    format!(
        "One message of layout version {VERSION} as it travelled. Header of 32 bytes, little-endian: version u8 = \
         {VERSION}, kind u8 = {kind}, zero u16, tick u32, session u64, sequence u64, sent u64 in nanoseconds. Then the body \
         in bincode 2, fixed-width little-endian integers: first u64, lost u64, count u64, and that many entries of: at \
         u64, wall u64, both in nanoseconds, variant u32 with 0 sample (topic, length u64, bytes), 1 wake, 2 presence \
         (peer u32, alive u8), 3 stop, 4 output (topic, length u64, bytes), 5 snapshot (length u64, bytes). A topic is a \
         u32 ({}), followed for journal, node, alive, clock and ping by the node as a u32 ({}).",
        TOPICS.map(named).join(", "),
        nodes.join(", ")
    )
}

fn named(topic: Topic) -> String {
    let suffix = topic.suffix();
    let name = suffix.strip_suffix("/operator").unwrap_or(&suffix);
    format!("{} {name}", number(&to_bytes(&topic)))
}

/// The variant's number, which the layout puts first.
fn number(bytes: &[u8]) -> u32 {
    let first = bytes.first_chunk().copied().unwrap_or_default();
    u32::from_le_bytes(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_topic_and_no_node_is_left_out() {
        let numbers = TOPICS.map(|topic| number(&to_bytes(&topic)));
        let in_order = (0..).zip(numbers).all(|(place, number)| place == number);
        assert!(in_order, "a topic is missing in TOPICS: {numbers:?}");
        let text = text();
        for topic in TOPICS {
            assert!(text.contains(&named(topic)), "{topic}");
        }
        assert!(text.contains("3 robot-sim, 4 recorder"), "{text}");
    }

    #[test]
    fn the_layout_told_is_the_layout_written() {
        let text = text();
        assert!(text.contains(&format!("layout version {VERSION} ")), "{text}");
        assert!(text.contains(&format!("kind u8 = {},", JournalBatch::KIND)), "{text}");
    }
}
