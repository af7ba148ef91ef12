//! How far each sender's clock is from the recorder's, as far as one way of travel can tell.
//!
//! A message's arrival by the recorder's clock less its stamp by the sender's is `offset + latency`. The latency is
//! never negative, so the smallest difference of many is an upper bound of the offset, and the better the quicker the
//! quickest message was; how much the differences scatter says how far the bound may be off. Only a measurement both
//! ways could tell offset from latency. Every clock counts from its own process's start, so the offset is mostly the
//! time between two starts.

use std::collections::BTreeMap;

use tandem_wire::{Header, NodeName, Session, Stamp, Topic};

/// Runs of senders that are told apart; later ones are not measured.
const SENDERS: usize = 32;

/// What is known of one sender's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockOffset {
    /// Who sends.
    pub node: NodeName,
    /// Which run of it.
    pub session: Session,
    /// The smallest arrival − stamp, in nanoseconds: an upper bound of the sender's offset.
    pub least: i64,
    /// The largest one.
    pub most: i64,
    /// The mean of all.
    pub mean: i64,
    /// Of how many messages.
    pub messages: u64,
}

/// Keeps the bounds.
#[derive(Clone, Debug, Default)]
pub(super) struct Clocks {
    senders: BTreeMap<(NodeName, Session), Differences>,
}

#[derive(Clone, Copy, Debug)]
struct Differences {
    least: i64,
    most: i64,
    sum: i128,
    count: u64,
}

impl Clocks {
    /// Takes in a message that is the next of its stream: late and repeated ones say little about the clock.
    pub(super) fn hear(&mut self, now: Stamp, topic: Topic, header: &Header) {
        let Some(node) = maker(topic) else { return };
        let key = (node, header.session);
        if self.senders.len() >= SENDERS && !self.senders.contains_key(&key) {
            return;
        }
        let difference = saturated(i128::from(now.0) - i128::from(header.sent.0));
        let kept = self.senders.entry(key).or_insert(Differences {
            least: difference,
            most: difference,
            sum: 0,
            count: 0,
        });
        kept.least = kept.least.min(difference);
        kept.most = kept.most.max(difference);
        kept.sum = kept.sum.saturating_add(i128::from(difference));
        kept.count += 1;
    }

    pub(super) fn offsets(&self) -> Vec<ClockOffset> {
        let offset = |(&(node, session), kept): (&(NodeName, Session), &Differences)| ClockOffset {
            node,
            session,
            least: kept.least,
            most: kept.most,
            mean: saturated(kept.sum / i128::from(kept.count.max(1))),
            messages: kept.count,
        };
        self.senders.iter().map(offset).collect()
    }
}

/// Whose clock stamps a topic, where the stamp is that of sending. Trials are announced by whoever runs them.
const fn maker(topic: Topic) -> Option<NodeName> {
    match topic {
        Topic::Command => Some(NodeName::Operator),
        Topic::Proposal | Topic::Forecast => Some(NodeName::Predictor),
        Topic::Setpoint => Some(NodeName::Arbiter),
        Topic::State | Topic::Scene => Some(NodeName::RobotSim),
        _ => None,
    }
}

fn saturated(value: i128) -> i64 {
    i64::try_from(value).unwrap_or(if value < 0 { i64::MIN } else { i64::MAX })
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::Seq;

    #[test]
    fn the_quickest_message_bounds_the_offset_and_the_slowest_says_how_well() {
        let mut clocks = Clocks::default();
        // The sender's clock is a second ahead; messages take 2, 5 and 3 ms.
        for (sent, now) in [
            (2_000_000_000, 1_002_000_000),
            (2_100_000_000, 1_105_000_000),
            (2_200_000_000, 1_203_000_000),
        ] {
            let header = Header {
                sent: Stamp(sent),
                seq: Seq(1),
                ..Header::default()
            };
            clocks.hear(Stamp(now), Topic::State, &header);
            clocks.hear(Stamp(now), Topic::Trial, &header);
        }
        let offsets = clocks.offsets();
        assert_eq!(offsets.len(), 1, "a trial's mark has no sender of its own");
        let ClockOffset {
            least,
            most,
            messages,
            mean,
            ..
        } = offsets[0];
        assert_eq!((least, most, messages), (-998_000_000, -995_000_000, 3));
        assert_eq!(mean, -996_666_666);
    }

    #[test]
    fn any_stamp_is_taken() {
        let mut clocks = Clocks::default();
        for (now, sent) in [(0, u64::MAX), (u64::MAX, 0), (u64::MAX, 0)] {
            let header = Header {
                sent: Stamp(sent),
                ..Header::default()
            };
            clocks.hear(Stamp(now), Topic::State, &header);
        }
        let offset = clocks.offsets()[0];
        assert_eq!((offset.least, offset.most), (i64::MIN, i64::MAX));
    }
}
