//! A session file is read back with the format's own reader, whole and cut short.

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{Cursor, Seek, SeekFrom, Write};
use std::rc::Rc;

use crate::script::{record, session};
use mcap::MessageStream;
use mcap::read::Options;
use tandem_recorder::{Counts, Drops, JOURNAL_ENCODING, Output, Provenance, SessionFile};
use tandem_wire::{JournalBatch, Timing, decode};

const EPOCH: u64 = 1_760_000_000_000_000_000;

fn provenance() -> Provenance {
    Provenance {
        robot: "panda".parse().expect("a valid name"),
        build: "test".into(),
        epoch_unix_nanos: EPOCH,
    }
}

/// A file in memory whose length can be seen while it is written.
struct Watched {
    file: Cursor<Vec<u8>>,
    length: Rc<Cell<usize>>,
}

impl Write for Watched {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.file.write(bytes);
        self.length.set(self.file.get_ref().len());
        written
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

impl Seek for Watched {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.file.seek(to)
    }
}

/// The scripted session as a file, flushed every 50 entries, and after each flush its messages and its length.
fn written() -> (Vec<u8>, Vec<(u64, usize)>) {
    let length = Rc::new(Cell::new(0));
    let watched = Watched {
        file: Cursor::new(Vec::new()),
        length: Rc::clone(&length),
    };
    let mut file = SessionFile::begin(watched, 64 << 10, provenance()).expect("memory takes it");
    let mut flushes = Vec::new();
    for (index, output) in record(&session(), Timing::default().lockstep()).iter().enumerate() {
        if let Output::Write(heard) = output {
            file.write(heard, Drops::default()).expect("memory takes it");
        }
        if index % 50 == 49 {
            file.flush().expect("memory takes it");
            flushes.push((file.messages(), length.get()));
        }
    }
    let (_, watched) = file
        .close(&Counts::default(), Drops::default())
        .expect("memory takes it");
    (watched.file.into_inner(), flushes)
}

#[test]
fn every_channel_is_there_and_describes_itself() {
    let (bytes, _) = written();
    let mut channels = BTreeMap::new();
    for message in MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.as_ref().unwrap();
        assert!(!schema.data.is_empty());
        assert!(message.log_time >= EPOCH);
        let name = message.channel.topic.strip_prefix("tandem/panda/").unwrap().to_owned();
        let entry = (message.channel.message_encoding.clone(), schema.name.clone());
        channels.insert(name, entry);
    }
    let names: Vec<_> = channels
        .iter()
        .map(|(name, (_, schema))| format!("{name} {schema}"))
        .collect();
    assert_eq!(
        names,
        [
            "arm_points foxglove.PointCloud",
            "command command.Command",
            "counts counts.Counts",
            "forecast forecast.Forecast",
            "forecast_path foxglove.PosesInFrame",
            "forecast_points foxglove.PointCloud",
            "frames foxglove.FrameTransforms",
            "journal/arbiter tandem.JournalBatch",
            "log foxglove.Log",
            "proposal proposal.Proposal",
            "scene scene.Scene",
            "scene_points foxglove.PointCloud",
            "setpoint setpoint.Setpoint",
            "shapes foxglove.SceneUpdate",
            "state state.State",
            "tool_pose foxglove.PoseInFrame",
            "trial trial.Trial",
        ]
    );
    let encodings: BTreeSet<_> = channels.into_values().map(|(encoding, _)| encoding).collect();
    assert_eq!(
        encodings,
        BTreeSet::from(["protobuf".to_owned(), JOURNAL_ENCODING.to_owned()])
    );
}

#[test]
fn journals_are_the_bytes_that_travelled() {
    let (bytes, _) = written();
    let messages = MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    let journals = messages.filter(|message| message.channel.topic.contains("/journal/"));
    let batches: Vec<_> = journals
        .map(|message| decode::<JournalBatch>(&message.data).unwrap().body)
        .collect();
    assert_eq!(batches.len(), 8);
    assert!(
        batches
            .iter()
            .enumerate()
            .all(|(index, batch)| batch.first == 10 * index as u64)
    );
}

#[test]
fn what_it_takes_to_build_a_node_again_is_inside() {
    let (bytes, _) = written();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let metadata: BTreeMap<_, _> = summary
        .metadata_indexes
        .iter()
        .map(|index| mcap::read::metadata(&bytes, index).unwrap())
        .map(|metadata| (metadata.name, metadata.metadata))
        .collect();
    assert_eq!(metadata["tandem.session"]["robot"], "panda");
    assert_eq!(metadata["tandem.node.predictor"]["seed"], "7");
    assert_eq!(metadata["tandem.node.arbiter"]["config"], "[arbiter]\nseed = 7\n");
    assert_eq!(metadata["tandem.counts"]["dropped.session_file"], "0");
    let model = &summary.attachment_indexes[0];
    assert!(metadata["tandem.node.predictor"]["model_sha256"].starts_with(&model.name[6..22]));
    assert_eq!(mcap::read::attachment(&bytes, model).unwrap().data.as_ref(), [7; 3000]);
}

#[test]
fn a_file_cut_anywhere_reads_up_to_its_last_flush() {
    let (bytes, flushes) = written();
    assert!(flushes.len() > 5);
    for (messages, length) in flushes {
        for cut in [length, length + 1, length + 40] {
            let part = &bytes[..cut.min(bytes.len())];
            let stream = MessageStream::new_with_options(part, Options::IgnoreEndMagic.into()).unwrap();
            let read = stream.take_while(Result::is_ok).count() as u64;
            assert!(
                read >= messages,
                "{read} of {messages} messages in the first {cut} bytes"
            );
        }
    }
}

#[test]
fn sequence_and_sender_stamp_are_kept() {
    let (bytes, _) = written();
    let messages = MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    let states: Vec<_> = messages
        .filter(|message| message.channel.topic.ends_with("/state"))
        .collect();
    assert_eq!(states.len(), 84);
    for (index, state) in (0_u32..).zip(&states) {
        assert_eq!(state.sequence, index + 1);
        assert_eq!(state.publish_time, EPOCH + u64::from(index) * crate::script::PERIOD);
        assert_eq!(state.log_time, state.publish_time + 2_000_000);
    }
}
