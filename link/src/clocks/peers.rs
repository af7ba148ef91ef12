//! The peers that answer, each with its estimate: exchanges come in, a report goes out. Pure.

use std::collections::BTreeMap;

use tandem_wire::{CLOCK_PEERS, ClockReport, Envelope, MILLISECOND, Nanos, NodeName, PeerClock, Pong, Session, Stamp};

use super::estimator::{Estimator, Exchange, Taken};

/// After so many exchanges a peer's clock is known.
const KNOWN: usize = 8;

/// Who answers, and what is known of their clocks.
#[derive(Clone, Debug)]
pub(super) struct Peers {
    known: BTreeMap<(NodeName, Session), Peer>,
    /// The setting.
    alarm: Nanos,
    /// A peer that is silent for so long is gone.
    patience: Nanos,
}

#[derive(Clone, Debug, Default)]
struct Peer {
    estimator: Estimator,
    /// Their wall clock less their own clock, in nanoseconds, when they last answered.
    wall: i128,
    heard: Stamp,
}

impl Peers {
    pub(super) const fn new(alarm_ms: u64, patience: Nanos) -> Self {
        Self {
            known: BTreeMap::new(),
            alarm: alarm_ms.saturating_mul(MILLISECOND),
            patience,
        }
    }

    /// Takes in the answer to a ping that left at `asked` and came back at `arrived`, by our clock.
    pub(super) fn hear(&mut self, node: NodeName, asked: Stamp, pong: &Envelope<Pong>, arrived: Stamp) {
        let key = (node, pong.header.session);
        if self.known.len() >= CLOCK_PEERS && !self.known.contains_key(&key) {
            return;
        }
        let exchange = Exchange {
            asked,
            heard: pong.body.heard,
            answered: pong.header.sent,
            arrived,
        };
        let peer = self.known.entry(key).or_default();
        if peer.estimator.hear(&exchange) != Taken::Impossible {
            peer.wall = i128::from(pong.body.unix_nanos) - i128::from(pong.header.sent.0);
            peer.heard = arrived;
        }
    }

    /// Whether nobody is there whose clock still has to be found out.
    pub(super) fn are_known(&self) -> bool {
        self.known.values().all(|peer| peer.estimator.samples() >= KNOWN)
    }

    /// What is known at `now`, when our wall clock shows `unix_nanos`. Who was silent for long is left out from then on.
    pub(super) fn report(&mut self, now: Stamp, unix_nanos: u64) -> ClockReport {
        let patience = self.patience;
        self.known.retain(|_, peer| now.since(peer.heard) <= patience);
        let wall = i128::from(unix_nanos) - i128::from(now.0);
        let clock = |(&(node, session), peer): (&(NodeName, Session), &Peer)| {
            let estimate = peer.estimator.estimate(now)?;
            let skew = saturated(peer.wall - wall + i128::from(estimate.offset));
            Some(PeerClock {
                node,
                session,
                offset: estimate.offset,
                uncertainty: estimate.uncertainty,
                round_trip: estimate.round_trip,
                round_trip_median: estimate.round_trip_median,
                round_trip_worst: estimate.round_trip_worst,
                samples: estimate.samples,
                steps: peer.estimator.steps(),
                skew,
                is_skewed: skew.unsigned_abs() > self.alarm.saturating_add(estimate.uncertainty),
            })
        };
        ClockReport {
            peers: self.known.iter().filter_map(clock).collect(),
        }
    }
}

fn saturated(value: i128) -> i64 {
    i64::try_from(value).unwrap_or(if value < 0 { i64::MIN } else { i64::MAX })
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::{Header, SECOND};

    const NOW: Stamp = Stamp(10 * SECOND);
    const UNIX: u64 = 1_700_000_000 * SECOND;

    /// An answer at once, over a line without length, from a peer whose own clock is a second ahead.
    fn pong(session: u64, wall_ahead: i64) -> Envelope<Pong> {
        let header = Header {
            session: Session(session),
            sent: Stamp(11 * SECOND),
            ..Header::default()
        };
        let body = Pong {
            heard: Stamp(11 * SECOND),
            unix_nanos: UNIX.checked_add_signed(wall_ahead).unwrap(),
        };
        Envelope { header, body }
    }

    fn peers() -> Peers {
        Peers::new(100, 5 * SECOND)
    }

    #[test]
    fn a_wall_clock_that_is_off_is_told_from_an_offset_of_starts() {
        let mut peers = peers();
        peers.hear(NodeName::Operator, NOW, &pong(1, 0), NOW);
        peers.hear(NodeName::RobotSim, NOW, &pong(2, -3_250_000_000), NOW);
        let report = peers.report(NOW, UNIX);
        let told = |peer: &PeerClock| (peer.node, peer.offset, peer.skew, peer.is_skewed);
        let told: Vec<_> = report.peers.iter().map(told).collect();
        assert_eq!(
            told,
            [
                (NodeName::Operator, 1_000_000_000, 0, false),
                (NodeName::RobotSim, 1_000_000_000, -3_250_000_000, true)
            ]
        );
    }

    #[test]
    fn a_peer_is_new_until_it_has_answered_a_few_times() {
        let mut peers = peers();
        assert!(peers.are_known(), "nobody is there");
        for _ in 1..KNOWN {
            peers.hear(NodeName::Operator, NOW, &pong(1, 0), NOW);
            assert!(!peers.are_known());
        }
        peers.hear(NodeName::Operator, NOW, &pong(1, 0), NOW);
        assert!(peers.are_known());
        peers.hear(NodeName::Arbiter, NOW, &pong(2, 0), NOW);
        assert!(!peers.are_known());
    }

    #[test]
    fn our_own_wall_clock_stepping_shows_as_everybodys_skew() {
        let mut peers = peers();
        peers.hear(NodeName::Operator, NOW, &pong(1, 0), NOW);
        let report = peers.report(NOW, UNIX + SECOND);
        assert_eq!(
            (report.peers[0].skew, report.peers[0].is_skewed),
            (-1_000_000_000, true)
        );
    }

    #[test]
    fn a_restarted_peer_is_another_clock_and_the_old_one_is_forgotten() {
        let mut peers = peers();
        peers.hear(NodeName::Operator, NOW, &pong(1, 0), NOW);
        let later = NOW.after(5 * SECOND);
        peers.hear(NodeName::Operator, later, &pong(2, 0), later);
        assert_eq!(peers.report(later, UNIX).peers.len(), 2);
        let sessions = |report: ClockReport| report.peers.iter().map(|peer| peer.session).collect::<Vec<_>>();
        assert_eq!(sessions(peers.report(later.after(1), UNIX)), [Session(2)]);
    }

    #[test]
    fn a_crowd_is_not_measured_beyond_what_a_report_may_name() {
        let mut peers = peers();
        for session in 0..1000 {
            peers.hear(NodeName::Operator, NOW, &pong(session, 0), NOW);
        }
        assert_eq!(peers.report(NOW, UNIX).peers.len(), CLOCK_PEERS);
    }
}
