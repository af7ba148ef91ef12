//! A session file is read back for executing it again: whole, cut short, and with bytes that were changed.

use std::collections::BTreeSet;
use std::io::Cursor;

use crate::script::{record, session};
use tandem_recorder::{Counts, Drops, Evidence, Fault, NoEvidence, Output, Provenance, Run, SessionFile};
use tandem_wire::{NodeName, Session, Timing, Topic, codec};

fn written() -> Vec<u8> {
    let provenance = Provenance {
        robot: "panda".parse().expect("a valid name"),
        build: "test".into(),
        epoch_unix_nanos: 1_760_000_000_000_000_000,
    };
    let mut file = SessionFile::begin(Cursor::new(Vec::new()), 16 << 10, provenance).expect("memory takes it");
    for output in record(&session(), Timing::default().lockstep()) {
        if let Output::Write(heard) = output {
            file.write(&heard, Drops::default()).expect("memory takes it");
        }
    }
    let closed = file.close(&Counts::default(), Drops::default());
    closed.expect("memory takes it").1.into_inner()
}

/// Who sends messages of this topic in the script.
fn samples_of(topic: Topic) -> impl Iterator<Item = (Topic, Session)> {
    let samples = session().into_iter().filter(move |sample| sample.topic == topic);
    samples.map(move |sample| (topic, codec::peek(&sample.bytes).expect("a header").1.session))
}

fn entries(evidence: &Evidence) -> usize {
    evidence
        .journals
        .values()
        .flatten()
        .map(|part| part.entries.len())
        .sum()
}

#[test]
fn what_was_written_is_found_again() {
    let evidence = Evidence::read(written().as_slice()).expect("a session file");
    assert_eq!(evidence.faults, []);
    let run = |node| Run {
        node,
        session: Session(101),
    };
    let predictor = &evidence.nodes[&run(NodeName::Predictor)];
    assert_eq!((predictor.seed, predictor.build.as_str()), (7, "0.1.0 (test)"));
    assert_eq!(predictor.config, "[predictor]\nseed = 7\n");
    let model = evidence
        .model(predictor.model.as_ref().expect("a model"))
        .expect("its bytes");
    assert_eq!(model, [7; 3000]);
    assert_eq!(evidence.nodes[&run(NodeName::Arbiter)].model, None);
    let journal: Vec<_> = evidence.journals.values().flatten().map(|part| part.first).collect();
    assert_eq!(journal, [0, 10, 20, 30, 40, 50, 60, 70]);
    let loop_only = evidence
        .heard
        .into_iter()
        .filter(|(topic, _)| matches!(topic, Topic::Command | Topic::State));
    let senders = samples_of(Topic::Command).chain(samples_of(Topic::State));
    assert_eq!(loop_only.collect::<BTreeSet<_>>(), senders.collect(), "who said it");
}

#[test]
fn a_file_cut_at_any_byte_gives_what_it_still_holds_and_says_so() {
    let bytes = written();
    let mut most = 0;
    for length in (0..bytes.len()).step_by(211) {
        match Evidence::read(&bytes[..length]) {
            Ok(evidence) => {
                assert!(
                    matches!(evidence.faults[..], [Fault::Ends { .. }]),
                    "cut after {length} bytes"
                );
                assert!(entries(&evidence) >= most, "a longer piece holds no less");
                most = entries(&evidence);
            }
            Err(error) => assert!(
                matches!(error, NoEvidence::NotMcap) && length < 200,
                "{length}: {error}"
            ),
        }
    }
    assert_eq!(most, 80);
}

#[test]
fn changed_bytes_are_noticed_or_harmless_and_never_a_panic() {
    let bytes = written();
    let whole = Evidence::read(bytes.as_slice()).expect("a session file");
    for at in (0..bytes.len()).step_by(389) {
        let mut changed = bytes.clone();
        changed[at] ^= 0x55;
        if let Ok(evidence) = Evidence::read(changed.as_slice())
            && evidence.faults.is_empty()
        {
            assert_eq!(evidence.journals, whole.journals, "byte {at}");
            assert_eq!(evidence.nodes, whole.nodes, "byte {at}");
        }
    }
}
