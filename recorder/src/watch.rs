//! Wall clocks that disagree, and clocks that jump: what a person is told of them, once.

use std::collections::BTreeMap;

use tandem_wire::{ClockReport, NodeName, PeerClock, Session};

use crate::heard::{Level, Note};

/// What was said of each peer so far. The recorder's own measurements are looked at, so that one wrong clock is one note.
#[derive(Clone, Debug, Default)]
pub(crate) struct ClockWatch {
    known: BTreeMap<(NodeName, Session), (bool, u32)>,
}

impl ClockWatch {
    /// What is new in the recorder's report.
    pub(crate) fn hear(&mut self, report: &ClockReport) -> Vec<Note> {
        let before = std::mem::take(&mut self.known);
        let mut notes = Vec::new();
        for peer in &report.peers {
            let key = (peer.node, peer.session);
            let (was_skewed, steps) = before.get(&key).copied().unwrap_or_default();
            if peer.is_skewed != was_skewed {
                notes.push(skew_note(peer));
            }
            if peer.steps > steps {
                notes.push(Note {
                    level: Level::Warning,
                    about: peer.node,
                    is_routine: false,
                    text: "its clock has jumped: measured latencies around this moment are wrong".to_owned(),
                });
            }
            self.known.insert(key, (peer.is_skewed, peer.steps));
        }
        notes
    }
}

fn skew_note(peer: &PeerClock) -> Note {
    if !peer.is_skewed {
        return Note {
            level: Level::Info,
            about: peer.node,
            is_routine: false,
            text: "its wall clock agrees with the recorder's again".to_owned(),
        };
    }
    let seconds = peer.skew.unsigned_abs() as f64 * 1e-9;
    let side = if peer.skew > 0 { "ahead of" } else { "behind" };
    Note {
        level: Level::Warning,
        about: peer.node,
        is_routine: false,
        text: format!(
            "its wall clock is {seconds:.3} s {side} the recorder's: set both by NTP (no decision rests on it, but times in \
             files and logs do)"
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(skew: i64, is_skewed: bool, steps: u32) -> ClockReport {
        let peer = PeerClock {
            node: NodeName::Operator,
            session: Session(4),
            offset: 0,
            uncertainty: 100_000,
            round_trip: 200_000,
            round_trip_median: 200_000,
            round_trip_worst: 200_000,
            samples: 3,
            steps,
            skew,
            is_skewed,
        };
        ClockReport { peers: vec![peer] }
    }

    #[test]
    fn a_wrong_wall_clock_is_told_once_and_so_is_its_end() {
        let mut watch = ClockWatch::default();
        let mut told = |skew, is_skewed, steps| {
            let notes = watch.hear(&report(skew, is_skewed, steps));
            notes.into_iter().map(|note| note.text).collect::<Vec<_>>()
        };
        assert!(told(0, false, 0).is_empty());
        let first = told(-3_250_000_000, true, 0);
        assert!(
            first[0].starts_with("its wall clock is 3.250 s behind the recorder's"),
            "{first:?}"
        );
        assert!(told(-3_250_000_100, true, 0).is_empty());
        assert_eq!(told(0, false, 1).len(), 2, "right again, and it jumped");
        assert!(told(0, false, 1).is_empty());
    }
}
