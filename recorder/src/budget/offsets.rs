//! What the nodes say of each other's clocks, looked up for a pair of stamps.

use std::collections::BTreeMap;

use tandem_wire::{ClockReport, Nanos, NodeName, PeerClock, Session, Stamp};

use super::clamped;
use super::hop::Measured;

/// Pairs of runs that are remembered; later ones are not.
const PAIRS: usize = 256;

/// What one node last said of another's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Offset {
    /// Who says so.
    pub observer: NodeName,
    /// In which run.
    pub session: Session,
    /// Of whom, and what.
    pub peer: PeerClock,
}

/// The newest words, by who said them of whom.
#[derive(Clone, Debug, Default)]
pub(super) struct Offsets(BTreeMap<(NodeName, Session, NodeName, Session), PeerClock>);

impl Offsets {
    pub(super) fn hear(&mut self, observer: NodeName, session: Session, report: &ClockReport) {
        // Whoever it names no longer is gone, and a run does not come back.
        self.0.retain(|&(by, run, ..), _| (by, run) != (observer, session));
        for peer in &report.peers {
            if self.0.len() < PAIRS {
                self.0.insert((observer, session, peer.node, peer.session), *peer);
            }
        }
    }

    pub(super) fn all(&self) -> Vec<Offset> {
        let offset = |(&(observer, session, ..), peer): (&(NodeName, Session, NodeName, Session), &PeerClock)| Offset {
            observer,
            session,
            peer: *peer,
        };
        self.0.iter().map(offset).collect()
    }

    /// How long something was on its way that left at one clock's stamp and arrived at another's. `None` if nobody knows
    /// how far they are apart.
    pub(super) fn travelled(&self, left: (Session, Stamp), arrived: (Session, Stamp)) -> Option<Measured> {
        let (offset, uncertainty) = self.between(left.0, arrived.0)?;
        let nanos = i128::from(arrived.1.0) - i128::from(left.1.0) - i128::from(offset);
        Some(Measured {
            nanos: clamped(nanos),
            uncertainty,
        })
    }

    /// The second run's clock less the first's, and how uncertain that is: the surer of what either says of the other.
    fn between(&self, from: Session, to: Session) -> Option<(i64, Nanos)> {
        if from == to {
            // One process, one clock.
            return Some((0, 0));
        }
        let said = self.0.iter().filter_map(|(&(_, observer, _, peer), clock)| {
            if (observer, peer) == (from, to) {
                Some((clock.offset, clock.uncertainty))
            } else if (observer, peer) == (to, from) {
                Some((clock.offset.saturating_neg(), clock.uncertainty))
            } else {
                None
            }
        });
        said.min_by_key(|(_, uncertainty)| *uncertainty)
    }
}
