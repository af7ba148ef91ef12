//! What a row needs besides its message: the session's time for the sender's stamp, and what a trial was called.

use std::collections::BTreeMap;

use tandem_link::DRIFT_PPM;
use tandem_recorder::{OffsetRead, Recorded, Recording};
use tandem_wire::{Nanos, NodeName, Pace, Session, Stamp, Topic, Trial, decode};

/// Where a message stands in its session.
pub(super) struct Context {
    /// The recorder's zero, in nanoseconds since 1970.
    pub(super) epoch: u64,
    pace: Pace,
    /// The recorder's own run. Nodes of its process share it, and its clock.
    own: Option<Session>,
    /// How far each run's clock was from the recorder's, in the order of time.
    offsets: BTreeMap<Session, Vec<OffsetRead>>,
    /// When each trial began, by its number, and what it was called.
    trials: BTreeMap<u32, Vec<(Stamp, String)>>,
}

/// A sender's stamp on the recorder's clock, in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SessionTime {
    /// Below zero for what was sent before the recorder's clock began.
    pub(super) nanos: i128,
    /// At most how far off that is.
    pub(super) uncertainty: Nanos,
}

impl Context {
    pub(super) fn of(recording: &Recording, pace: Pace) -> Self {
        let mut offsets = BTreeMap::<_, Vec<_>>::new();
        for offset in &recording.offsets {
            offsets.entry(offset.session).or_default().push(*offset);
        }
        let mut trials = BTreeMap::<_, Vec<_>>::new();
        let marks = recording
            .messages
            .iter()
            .filter(|message| message.topic == Topic::Trial);
        for message in marks {
            if let Ok(Trial::Begin { number, label }) = decode(&message.bytes).map(|mark| mark.body) {
                trials.entry(number).or_default().push((message.at, label));
            }
        }
        let own = recording.nodes.get(&NodeName::Recorder);
        Self {
            epoch: recording.epoch_unix_nanos,
            pace,
            own: own.and_then(|node| node.session.parse().ok()).map(Session),
            offsets,
            trials,
        }
    }

    /// The sender's stamp on the recorder's clock, by what was measured of its clock nearest in time. `None` if nothing
    /// was. In lockstep every stamp is the session's time, and so it is within the recorder's process.
    pub(super) fn session_time(&self, message: &Recorded) -> Option<SessionTime> {
        let sent = i128::from(message.header.sent.0);
        if self.pace == Pace::Lockstep || self.own == Some(message.header.session) {
            let (nanos, uncertainty) = (sent, 0);
            return Some(SessionTime { nanos, uncertainty });
        }
        let measured = self.offsets.get(&message.header.session)?;
        let away = |offset: &&OffsetRead| offset.at.0.abs_diff(message.at.0);
        // Nodes of one process share a run, and each of them was measured: the surest counts.
        let nearest = measured
            .iter()
            .min_by_key(|offset| (away(offset), offset.uncertainty))?;
        // The clocks may have drifted apart since, or may have been drifting until then.
        let drift = away(&nearest) / (1_000_000 / DRIFT_PPM);
        Some(SessionTime {
            nanos: sent - i128::from(nearest.offset),
            uncertainty: nearest.uncertainty.saturating_add(drift),
        })
    }

    /// What the trial of this number was called that ran at this moment. A number may come again in a later run; a mark
    /// may come a little after the first message of its trial.
    pub(super) fn label(&self, trial: u32, at: Stamp) -> Option<String> {
        let begun = self.trials.get(&trial)?;
        let last = begun.iter().rfind(|(began, _)| *began <= at).or(begun.first());
        last.map(|(_, label)| label.clone())
    }
}

#[cfg(test)]
mod tests {
    use tandem_recorder::NodeRecord;
    use tandem_wire::{Header, MILLISECOND, Numbering, SECOND, Seq, encode};

    use super::*;

    fn message(session: u64, sent: Nanos, at: Nanos) -> Recorded {
        Recorded {
            at: Stamp(at),
            topic: Topic::Command,
            header: Header {
                tick: 0,
                session: Session(session),
                seq: Seq(1),
                sent: Stamp(sent),
            },
            bytes: Vec::new(),
        }
    }

    fn offset(at: Nanos, session: u64, offset: i64) -> OffsetRead {
        OffsetRead {
            at: Stamp(at),
            session: Session(session),
            offset,
            uncertainty: MILLISECOND,
        }
    }

    fn context(offsets: Vec<OffsetRead>, pace: Pace) -> Context {
        let recording = Recording {
            offsets,
            ..Recording::default()
        };
        Context::of(&recording, pace)
    }

    #[test]
    fn what_two_clocks_stamped_at_one_moment_has_one_session_time() {
        const AHEAD: i64 = 5_000_000_000;
        let context = context(
            vec![offset(20 * SECOND, 1, AHEAD), offset(20 * SECOND, 2, -AHEAD)],
            Pace::Real,
        );
        let moment = 20 * SECOND;
        let times = [message(1, 25 * SECOND, moment), message(2, 15 * SECOND, moment)]
            .map(|message| context.session_time(&message).expect("both were measured"));
        assert_eq!(times[0], times[1]);
        assert_eq!(
            (times[0].nanos, times[0].uncertainty),
            (i128::from(moment), MILLISECOND)
        );
        let early = context
            .session_time(&message(1, SECOND, moment))
            .expect("it was measured");
        assert_eq!(early.nanos, -4 * i128::from(SECOND), "before the recorder began");
        assert_eq!(context.session_time(&message(3, SECOND, moment)), None, "nobody knows");
    }

    #[test]
    fn the_measurement_nearest_in_time_counts_and_is_less_sure_the_farther_it_is() {
        let context = context(vec![offset(SECOND, 1, 0), offset(61 * SECOND, 1, 7)], Pace::Real);
        let near = context
            .session_time(&message(1, 70 * SECOND, 71 * SECOND))
            .expect("measured");
        assert_eq!(near.nanos, 70 * i128::from(SECOND) - 7);
        assert_eq!(near.uncertainty, MILLISECOND + MILLISECOND, "ten seconds away");
    }

    #[test]
    fn within_the_recorders_process_nothing_is_corrected() {
        let record = NodeRecord {
            session: "7".to_owned(),
            ..NodeRecord::default()
        };
        let recording = Recording {
            nodes: [(NodeName::Recorder, record)].into(),
            offsets: vec![offset(0, 7, 99)],
            ..Recording::default()
        };
        let context = Context::of(&recording, Pace::Real);
        let time = context.session_time(&message(7, SECOND, SECOND)).expect("one clock");
        assert_eq!((time.nanos, time.uncertainty), (i128::from(SECOND), 0));
    }

    #[test]
    fn in_lockstep_a_stamp_is_the_sessions_time() {
        let time = context(Vec::new(), Pace::Lockstep).session_time(&message(1, SECOND, 3));
        assert_eq!(
            time,
            Some(SessionTime {
                nanos: i128::from(SECOND),
                uncertainty: 0
            })
        );
    }

    #[test]
    fn a_trials_number_that_comes_again_has_the_label_of_its_own_run() {
        let mut numbering = Numbering::new(Session(9));
        let mut mark = |at: Nanos, label: &str| {
            let mut bytes = Vec::new();
            let begin = Trial::Begin {
                number: 1,
                label: label.to_owned(),
            };
            encode(&numbering.envelope(Stamp(at), 0, begin), &mut bytes);
            Recorded {
                topic: Topic::Trial,
                bytes,
                ..message(9, at, at)
            }
        };
        let recording = Recording {
            messages: vec![mark(5, "first"), mark(50, "again")],
            ..Recording::default()
        };
        let context = Context::of(&recording, Pace::Real);
        let labels = [4, 5, 49, 50].map(|at| context.label(1, Stamp(at)).expect("a label"));
        assert_eq!(labels, ["first", "first", "first", "again"]);
        assert_eq!(context.label(2, Stamp(5)), None);
    }
}
