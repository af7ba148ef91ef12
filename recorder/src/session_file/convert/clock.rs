//! What every node knows of its peers' clocks.

use tandem_wire as wire;

use super::super::schemas::{ClockReport, PeerClock};

impl ClockReport {
    pub(in crate::session_file) fn new(node: wire::NodeName, message: &wire::Envelope<wire::ClockReport>) -> Self {
        Self {
            header: (&message.header).into(),
            node: node.to_string(),
            peers: message.body.peers.iter().map(Into::into).collect(),
        }
    }
}

impl From<&wire::PeerClock> for PeerClock {
    fn from(peer: &wire::PeerClock) -> Self {
        Self {
            node: peer.node.to_string(),
            session: peer.session.0,
            offset_ns: peer.offset,
            uncertainty_ns: peer.uncertainty,
            round_trip_ns: peer.round_trip,
            round_trip_median_ns: peer.round_trip_median,
            round_trip_worst_ns: peer.round_trip_worst,
            samples: peer.samples,
            steps: peer.steps,
            skew_ns: peer.skew,
            is_skewed: peer.is_skewed,
        }
    }
}
