//! What a node knows of its peers' clocks, and the answer to a ping. For measuring and warning, never for safety.

use bincode::{Decode, Encode};

use crate::codec::Message;
use crate::{Nanos, NodeName, Session, Stamp, Topic};

/// Peers that one report may name; later ones are not measured.
pub const CLOCK_PEERS: usize = 32;

/// The answer to a ping. The header's stamp is when it left, by the answerer's clock; its session is the answerer's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub struct Pong {
    /// When the ping arrived, by the answerer's clock.
    pub heard: Stamp,
    /// What the answerer's wall clock showed at the header's stamp, in nanoseconds since 1970.
    pub unix_nanos: u64,
}

/// What a node knows of its peers' clocks, once a second.
#[derive(Clone, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub struct ClockReport {
    /// Every peer that answers, in order of name and session; at most [`CLOCK_PEERS`].
    pub peers: Vec<PeerClock>,
}

/// One peer's clock as one node sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub struct PeerClock {
    /// Which peer.
    pub node: NodeName,
    /// Which run of it.
    pub session: Session,
    /// The peer's clock less the reporter's, in nanoseconds. Each counts from its own process's start.
    pub offset: i64,
    /// The offset is off by at most this much, whatever the line does: half the best round trip and what the clocks may
    /// have drifted since.
    pub uncertainty: Nanos,
    /// The shortest round trip of those that count, without the time that the peer took to answer.
    pub round_trip: Nanos,
    /// Half of them were shorter than this.
    pub round_trip_median: Nanos,
    /// The longest of them.
    pub round_trip_worst: Nanos,
    /// How many count.
    pub samples: u32,
    /// How often the peer's clock has jumped against the reporter's.
    pub steps: u32,
    /// The peer's wall clock less the reporter's, in nanoseconds, as uncertain as the offset.
    pub skew: i64,
    /// Whether the wall clocks are further apart than the reporter's setting allows.
    pub is_skewed: bool,
}

impl Message for Pong {
    const KIND: u8 = Topic::Ping(NodeName::Operator).kind();
    const MAX_BYTES: usize = 64;
}

impl Message for ClockReport {
    const KIND: u8 = Topic::Clock(NodeName::Operator).kind();
    const MAX_BYTES: usize = 4096;
}
