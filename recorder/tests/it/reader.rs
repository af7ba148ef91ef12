//! A session file is read back: whole, cut anywhere, with flipped bits, and when it is something else.

use std::io::Cursor;

use crate::script::{Sample, record, session};
use proptest::prelude::*;
use tandem_recorder::{
    Counts, Damage, Drops, JournalPart, OffsetRead, Output, PartsReader, Place, Provenance, ReadError, Recorded,
    Recording, Reel, ReelError, SessionFile, repair,
};
use tandem_wire::{
    ClockReport, Happening, JournalBatch, JournalEntry, NodeName, Numbering, PeerClock, Session, Stamp, Timing, Topic,
    codec, encode,
};

const EPOCH: u64 = 1_760_000_000_000_000_000;

/// The scripted session, and behind each message the journal that says how it travelled.
fn samples() -> Vec<Sample> {
    let mut samples = Vec::new();
    let mut numbering = Numbering::new(Session(900));
    for sample in session() {
        if matches!(sample.topic, Topic::Journal(_) | Topic::Info(_)) {
            samples.extend(matches!(sample.topic, Topic::Info(_)).then_some(sample));
            continue;
        }
        let entry = JournalEntry {
            at: sample.at,
            wall: sample.at,
            what: Happening::Output {
                topic: sample.topic,
                bytes: sample.bytes.clone(),
            },
        };
        let batch = JournalBatch {
            first: samples.len() as u64,
            lost: 0,
            entries: vec![entry],
        };
        let mut bytes = Vec::new();
        encode(&numbering.envelope(sample.at, 0, batch), &mut bytes);
        let (at, topic) = (sample.at, Topic::Journal(NodeName::Arbiter));
        samples.push(sample);
        samples.push(Sample { at, topic, bytes });
    }
    samples
}

fn written(samples: &[Sample]) -> Vec<u8> {
    let provenance = Provenance {
        robot: "panda".parse().expect("a valid name"),
        build: "test".into(),
        epoch_unix_nanos: EPOCH,
    };
    let mut file = SessionFile::begin(Cursor::new(Vec::new()), 64 << 10, provenance).expect("memory takes it");
    for (index, output) in record(samples, Timing::default()).iter().enumerate() {
        if let Output::Write(heard) = output {
            file.write(heard, Drops::default()).expect("memory takes it");
        }
        if index % 50 == 49 {
            file.flush().expect("memory takes it");
        }
    }
    let closed = file.close(&Counts::default(), Drops::default());
    closed.expect("memory takes it").1.into_inner()
}

fn played(samples: &[Sample]) -> Vec<&Sample> {
    let played = |sample: &&Sample| !matches!(sample.topic, Topic::Journal(_) | Topic::Info(_));
    samples.iter().filter(played).collect()
}

#[test]
fn what_the_recorder_said_of_its_peers_clocks_comes_back_with_when() {
    let mut samples = samples();
    let at = samples.last().expect("a script").at;
    let peer = |session, offset| PeerClock {
        node: NodeName::RobotSim,
        session: Session(session),
        offset,
        uncertainty: 150_000,
        round_trip: 300_000,
        round_trip_median: 310_000,
        round_trip_worst: 900_000,
        samples: 32,
        steps: 0,
        skew: -5,
        is_skewed: false,
    };
    let report = ClockReport {
        peers: vec![peer(u64::MAX, -1_500_000_000), peer(6, 7)],
    };
    for node in [NodeName::Recorder, NodeName::Arbiter] {
        let mut bytes = Vec::new();
        encode(
            &Numbering::new(Session(800)).envelope(at, 0, report.clone()),
            &mut bytes,
        );
        let topic = Topic::Clock(node);
        samples.push(Sample { at, topic, bytes });
    }
    let recording = Recording::read(&written(&samples)).unwrap();
    let read = |session, offset| OffsetRead {
        at,
        session: Session(session),
        offset,
        uncertainty: 150_000,
    };
    assert_eq!(
        recording.offsets,
        [read(u64::MAX, -1_500_000_000), read(6, 7)],
        "and not what others said of theirs"
    );
}

#[test]
fn every_message_comes_back_as_it_travelled_and_when_it_arrived() {
    let samples = samples();
    let recording = Recording::read(&written(&samples)).unwrap();
    assert_eq!(recording.damage, []);
    let sent = played(&samples);
    assert_eq!(recording.messages.len(), sent.len());
    for (read, sent) in recording.messages.iter().zip(sent) {
        assert_eq!((read.at, read.topic, &read.bytes), (sent.at, sent.topic, &sent.bytes));
    }
    assert_eq!(recording.robot.unwrap().as_str(), "panda");
    assert_eq!(recording.epoch_unix_nanos, EPOCH);
    assert!(recording.nodes[&NodeName::Predictor].model_sha256.is_some());
    assert!(recording.notes.iter().any(|note| note.text.starts_with("stop: ")));
    assert_eq!(recording.models.len(), 1);
}

/// The messages that were read without their bytes, and what fetches them.
fn places(file: &[u8]) -> (Vec<Recorded<Place>>, Reel<Cursor<&[u8]>>) {
    let mut reader = PartsReader::default();
    reader.add(Cursor::new(file)).expect("a whole file");
    (
        reader.finish().expect("a session").messages,
        Reel::new(vec![Cursor::new(file)]),
    )
}

#[test]
fn every_message_is_fetched_from_its_place_in_any_order_and_from_a_file_that_was_cut() {
    let file = written(&samples());
    for file in [file.as_slice(), &file[..file.len() / 2]] {
        let held = Recording::read(file).unwrap().messages;
        let (messages, mut reel) = places(file);
        assert_eq!(messages.len(), held.len());
        let fetched: Vec<_> = messages
            .iter()
            .rev()
            .map(|message| reel.fetch(message).unwrap())
            .collect();
        assert!(fetched.iter().rev().eq(&held));
    }
}

#[test]
fn a_file_that_changed_after_it_was_read_is_noticed() {
    let file = written(&samples());
    let (messages, _) = places(&file);
    let mut other = file.clone();
    let middle = other.len() / 2;
    other[middle..].fill(0);
    let mut reel = Reel::new(vec![Cursor::new(other)]);
    let last = messages.last().unwrap();
    assert!(matches!(reel.fetch(last), Err(ReelError::Changed)));
    assert!(reel.fetch(&messages[0]).is_ok(), "what is still there is");
}

#[test]
fn a_message_that_the_recorder_missed_is_found_in_the_journal() {
    let mut samples = samples();
    let (topic, tick) = (Topic::State, 40);
    let is_lost = |sample: &Sample| sample.topic == topic && codec::peek(&sample.bytes).unwrap().1.tick == tick;
    let lost = samples.remove(samples.iter().position(is_lost).unwrap());
    let recording = Recording::read(&written(&samples)).unwrap();
    let found = recording.messages.iter().find(|read| read.bytes == lost.bytes).unwrap();
    assert_eq!(found.at, lost.at, "states take equally long in this script");
    let count = recording
        .counts
        .streams
        .iter()
        .find(|count| count.topic == topic)
        .unwrap();
    assert_eq!(count.missed, 1, "and the gap is counted all the same");
}

#[test]
fn what_a_node_kept_of_its_journal_is_merged_where_the_file_lacks_it() {
    let all = samples();
    let is_kept =
        |index: usize, sample: &Sample| matches!(sample.topic, Topic::Journal(_)) && (100..300).contains(&index);
    let part = |(_, sample): (usize, &Sample)| {
        let length = u32::try_from(sample.bytes.len()).expect("short");
        [&length.to_le_bytes()[..], &sample.bytes].concat()
    };
    let kept: Vec<u8> = all
        .iter()
        .enumerate()
        .filter(|(index, sample)| is_kept(*index, sample))
        .flat_map(part)
        .collect();
    let (parts, is_whole) = JournalPart::read_kept(NodeName::Arbiter, kept.as_slice()).unwrap();
    assert!(is_whole && parts.len() > 50);
    let lacking: Vec<Sample> = all
        .iter()
        .enumerate()
        .filter(|(index, sample)| !is_kept(*index, sample))
        .map(|(_, sample)| sample.clone())
        .collect();
    let mut merged = Cursor::new(Vec::new());
    let report = repair(Cursor::new(written(&lacking)), &parts, &mut merged).unwrap();
    assert_eq!((report.merged, report.strange), (parts.len() as u64, 0));
    let whole = Recording::read(&written(&all)).unwrap();
    assert_eq!(Recording::read(merged.get_ref()).unwrap().messages, whole.messages);
    let again = repair(merged, &parts, Cursor::new(Vec::new())).unwrap();
    assert_eq!(again.merged, 0, "what is there is not merged twice");
}

#[test]
fn messages_without_a_journal_are_counted() {
    let samples: Vec<_> = samples()
        .into_iter()
        .filter(|sample| !matches!(sample.topic, Topic::Journal(_)))
        .collect();
    let recording = Recording::read(&written(&samples)).unwrap();
    let messages = played(&samples).len() as u64;
    assert_eq!(recording.damage, [Damage::WithoutBody { messages }]);
}

#[test]
fn what_is_no_session_is_refused_in_words() {
    assert_eq!(Recording::read(b"").unwrap_err(), ReadError::Empty);
    assert_eq!(Recording::read(b"PNG and so on").unwrap_err(), ReadError::NotMcap);
    assert_eq!(Recording::read(mcap::MAGIC).unwrap_err(), ReadError::NoSession);
}

/// The outer records of a whole file: opcode, from, to.
fn outer(file: &[u8]) -> Vec<(u8, usize, usize)> {
    let mut at = mcap::MAGIC.len();
    let mut found = Vec::new();
    while at + mcap::MAGIC.len() < file.len() {
        let length = u64::from_le_bytes(file[at + 1..at + 9].try_into().expect("eight bytes"));
        let end = at + 9 + usize::try_from(length).expect("it fits in memory");
        found.push((file[at], at, end));
        at = end;
    }
    found
}

#[test]
fn a_corrupt_chunk_costs_its_own_messages_and_no_others() {
    let whole = written(&samples());
    let chunks: Vec<_> = outer(&whole).into_iter().filter(|(opcode, ..)| *opcode == 6).collect();
    assert!(chunks.len() > 5, "{} chunks", chunks.len());
    let all = Recording::read(&whole).unwrap().messages.len();
    let (_, from, to) = chunks[2];
    let mut damaged = whole.clone();
    damaged[(from + to) / 2] ^= 0x40;
    let recording = Recording::read(&damaged).unwrap();
    assert!(
        matches!(recording.damage[0], Damage::Chunk { at, .. } if at == from),
        "{:?}",
        recording.damage
    );
    assert!(
        recording.messages.len() > all * 3 / 4,
        "{} of {all}",
        recording.messages.len()
    );

    // The first chunk introduces most channels: the summary stands in for it.
    let (_, from, to) = chunks[0];
    let mut damaged = whole;
    damaged[(from + to) / 2] ^= 0x40;
    assert!(Recording::read(&damaged).unwrap().messages.len() > all * 3 / 4);
}

#[test]
fn a_file_that_was_cut_short_is_read_up_to_the_cut_and_repaired() {
    let whole = written(&samples());
    let last = outer(&whole).into_iter().rfind(|(opcode, ..)| *opcode == 6).unwrap();
    let cut = &whole[..last.2 - 20];
    let recording = Recording::read(cut).unwrap();
    assert_eq!(recording.damage[0], Damage::Truncated { at: last.1 });
    assert!(!recording.messages.is_empty());

    let mut repaired = Cursor::new(Vec::new());
    let report = repair(Cursor::new(cut), &[], &mut repaired).unwrap();
    assert!(report.messages > 300 && report.left_out == 0, "{report:?}");
    let again = Recording::read(repaired.get_ref()).unwrap();
    // The cut may have taken the journal of a message that was heard; nothing else is wrong any more.
    assert!(
        again
            .damage
            .iter()
            .all(|what| matches!(what, Damage::WithoutBody { .. }))
    );
    assert_eq!(again.messages, recording.messages);
    assert_eq!(again.nodes, recording.nodes);
    let foreign = mcap::Summary::read(repaired.get_ref()).unwrap().unwrap();
    assert_eq!(foreign.stats.unwrap().message_count, report.messages);
}

#[test]
fn a_file_of_another_layout_says_so() {
    let whole = written(&samples());
    let mut other = Vec::new();
    for message in mcap::read::LinearReader::new(&whole).unwrap() {
        if let mcap::records::Record::Metadata(mut metadata) = message.unwrap()
            && metadata.name == "tandem.session"
        {
            metadata.metadata.insert("layout_version".into(), "9".into());
            let mut writer = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
            writer.write_metadata(&metadata).unwrap();
            writer.finish().unwrap();
            other = writer.into_inner().into_inner();
        }
    }
    let damage = Recording::read(&other).unwrap().damage;
    assert_eq!(damage, [Damage::OtherLayout { version: "9".into() }]);
}

fn fixture() -> &'static (Vec<u8>, usize) {
    static FIXTURE: std::sync::OnceLock<(Vec<u8>, usize)> = std::sync::OnceLock::new();
    FIXTURE.get_or_init(|| {
        let file = written(&samples());
        let messages = Recording::read(&file).expect("it is whole").messages.len();
        (file, messages)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn a_file_cut_anywhere_says_that_something_is_missing(cut in 0_usize..1_000_000) {
        let (whole, all) = fixture();
        let cut = cut % whole.len();
        if let Ok(recording) = Recording::read(&whole[..cut]) {
            prop_assert!(!recording.damage.is_empty());
            prop_assert!(recording.messages.len() <= *all);
        }
        let _ = repair(Cursor::new(&whole[..cut]), &[], Cursor::new(Vec::new()));
    }

    #[test]
    fn flipped_bits_never_panic_and_never_invent_messages(
        flips in prop::collection::vec((0_usize..1_000_000, 0_u8..8), 1..12),
    ) {
        let (whole, all) = fixture();
        let mut damaged = whole.clone();
        for (at, bit) in flips {
            let at = at % damaged.len();
            damaged[at] ^= 1 << bit;
        }
        if let Ok(recording) = Recording::read(&damaged) {
            prop_assert!(recording.messages.len() <= *all);
        }
        let _ = repair(Cursor::new(&damaged), &[], Cursor::new(Vec::new()));
    }

    #[test]
    fn bytes_behind_the_magic_are_read_as_far_as_they_go(
        opcode in 0_u8..0x20,
        body in prop::collection::vec(any::<u8>(), 0..200),
    ) {
        let mut file = mcap::MAGIC.to_vec();
        file.push(opcode);
        file.extend((body.len() as u64).to_le_bytes());
        file.extend(&body);
        let _ = Recording::read(&file);
        let _ = repair(Cursor::new(&file), &[], Cursor::new(Vec::new()));
    }
}

#[test]
fn arrivals_keep_their_order_when_equal() {
    let mut samples = samples();
    for sample in &mut samples {
        sample.at = Stamp(5);
    }
    let recording = Recording::read(&written(&samples)).unwrap();
    let order: Vec<_> = recording.messages.iter().map(|read| &read.bytes).collect();
    assert_eq!(
        order,
        played(&samples).iter().map(|sent| &sent.bytes).collect::<Vec<_>>()
    );
}

#[test]
fn a_cut_at_or_beside_the_border_of_any_record_is_noticed() {
    let (whole, all) = fixture();
    let borders = outer(whole)
        .into_iter()
        .flat_map(|(_, from, to)| [from, from + 1, from + 9, to]);
    for cut in borders
        .chain(whole.len() - 9..whole.len())
        .filter(|cut| *cut < whole.len())
    {
        if let Ok(recording) = Recording::read(&whole[..cut]) {
            assert!(!recording.damage.is_empty(), "cut at {cut} of {}", whole.len());
            assert!(recording.messages.len() <= *all, "cut at {cut} of {}", whole.len());
        }
    }
}
