//! A disk that is full, recovers, stalls; parts that can be read alone and together.

use std::collections::BTreeMap;
use std::io::{self, Cursor, Seek, SeekFrom, Write};
use std::sync::Mutex;
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, bounded, never};
use tandem_wire::{
    Envelope, Header, Input, Node as _, NodeInfo, NodeName, Numbering, Outbox, Ports as _, SECOND, Session, Timing,
    Topic, Trial, encode,
};

use super::super::feed::{Feed, Limits};
use super::super::shared::Kind;
use super::*;
use crate::RecorderSettings;
use crate::heard::Sample;
use crate::node::{Output, Recorder};
use crate::reader::{PartsReader, Recording};

/// What all files of the fake disk share.
#[derive(Default)]
struct Platter {
    files: BTreeMap<PathBuf, Vec<u8>>,
    room: Option<usize>,
    /// A write says that it has begun, and waits until the other end is gone.
    gate: Option<(Sender<()>, Receiver<()>)>,
}

#[derive(Clone, Default)]
struct Fake {
    platter: Arc<Mutex<Platter>>,
}

struct FakeFile {
    disk: Fake,
    path: PathBuf,
    file: Cursor<Vec<u8>>,
}

impl Fake {
    fn set_room(&self, room: Option<usize>) {
        self.platter.lock().unwrap().room = room;
    }

    fn files(&self) -> Vec<(PathBuf, Vec<u8>)> {
        self.platter.lock().unwrap().files.clone().into_iter().collect()
    }
}

impl Write for FakeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let gate = self.disk.platter.lock().unwrap().gate.clone();
        if let Some((entered, gate)) = gate {
            entered.try_send(()).ok();
            gate.recv().ok();
        }
        let mut platter = self.disk.platter.lock().unwrap();
        if let Some(room) = &mut platter.room {
            *room = room
                .checked_sub(bytes.len())
                .ok_or_else(|| io::Error::from(io::ErrorKind::StorageFull))?;
        }
        let written = self.file.write(bytes)?;
        platter.files.insert(self.path.clone(), self.file.get_ref().clone());
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for FakeFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

impl Disk for Fake {
    type File = FakeFile;

    fn create(&mut self, path: &Path) -> io::Result<FakeFile> {
        if self.platter.lock().unwrap().files.contains_key(path) {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        Ok(FakeFile {
            disk: self.clone(),
            path: path.to_owned(),
            file: Cursor::default(),
        })
    }

    fn finish(_: FakeFile) -> io::Result<()> {
        Ok(())
    }

    fn abandon(_: FakeFile) {}

    fn remove(&mut self, path: &Path) {
        self.platter.lock().unwrap().files.remove(path);
    }
}

/// Everything that a recorder would write of a trial that begins, and of states of which there is one a second.
fn session(states: u64) -> Vec<Arc<Heard>> {
    let mut recorder = Recorder::new(Timing::default());
    let (mut outbox, mut written) = (Outbox::default(), Vec::new());
    let mut take = |at: u64, topic: Topic, bytes: &[u8]| {
        recorder.step(Stamp(at), Recorder::event(Input::Sample { topic, bytes }), &mut outbox);
        written.extend(outbox.drain().filter_map(|output| match output {
            Output::Write(heard) => Some(heard),
            _ => None,
        }));
    };
    let mut bytes = Vec::new();
    let info = NodeInfo {
        session: Session(1),
        config: "[loop]\n".into(),
        seed: 7,
        build: "test".into(),
        model: vec![9; 2000],
    };
    let mut numbering = Numbering::new(Session(1));
    encode(&numbering.envelope(Stamp(0), 0, info), &mut bytes);
    take(1, Topic::Info(NodeName::Predictor), &bytes);
    let mut trials = Numbering::new(Session(2));
    let begin = Trial::Begin {
        number: 1,
        label: "parts".into(),
    };
    let mut journals = Numbering::new(Session(3));
    encode(&trials.envelope(Stamp(2), 0, begin), &mut bytes);
    take(2, Topic::Trial, &bytes);
    let mut travelled = vec![(Topic::Trial, bytes.clone())];
    let mut commands = Numbering::new(Session(3));
    for index in 0..states {
        let at = (index + 1) * SECOND;
        encode(
            &commands.envelope(Stamp(at), 0, tandem_wire::Command::default()),
            &mut bytes,
        );
        take(at, Topic::Command, &bytes);
        travelled.push((Topic::Command, bytes.clone()));
        let entries: Vec<_> = travelled
            .drain(..)
            .map(|(topic, bytes)| tandem_wire::JournalEntry {
                at: Stamp(at),
                wall: Stamp(at),
                what: tandem_wire::Happening::Output { topic, bytes },
            })
            .collect();
        let first = if index == 0 { 0 } else { index + 1 };
        let batch = tandem_wire::JournalBatch {
            first,
            lost: 0,
            entries,
        };
        encode(&journals.envelope(Stamp(at), 0, batch), &mut bytes);
        take(at, Topic::Journal(NodeName::Operator), &bytes);
    }
    written
}

struct Setup {
    sink: FileSink<Fake>,
    disk: Fake,
    shared: Arc<Shared>,
    told: Receiver<Notice>,
}

fn setup(disk: Fake, settings: RecorderSettings) -> Setup {
    let (tell, told) = bounded(64);
    let shared = Arc::new(Shared::new(tell));
    let provenance = Provenance {
        robot: "panda".parse().unwrap(),
        build: "test".into(),
        epoch_unix_nanos: 1_760_000_000_000_000_000,
    };
    let config = RecorderConfig::new(&settings).unwrap();
    let path = Path::new("s.mcap");
    let sink = FileSink::on(disk.clone(), path, &config, &provenance, Arc::clone(&shared)).unwrap();
    Setup {
        sink,
        disk,
        shared,
        told,
    }
}

fn words(told: &Receiver<Notice>) -> Vec<String> {
    told.try_iter().map(|notice| notice.to_string()).collect()
}

#[test]
fn a_full_disk_costs_what_comes_until_there_is_room_and_a_new_part_goes_on() {
    let Setup {
        mut sink,
        disk,
        shared,
        told,
    } = setup(Fake::default(), RecorderSettings::default());
    let heards = session(30);
    let (mut kept, mut refused) = (0, 0);
    let mut take = |sink: &mut FileSink<Fake>, heard| match sink.take(heard).unwrap() {
        true => kept += 1,
        false => refused += 1,
    };
    heards[..20].iter().for_each(|heard| take(&mut sink, heard));
    sink.flush().unwrap();
    disk.set_room(Some(100));
    heards[20..24].iter().for_each(|heard| take(&mut sink, heard));
    sink.flush().unwrap();
    assert_eq!(shared.condition(), Condition::NoSpace);
    assert_eq!(
        sink.lost_later(),
        4,
        "what was taken since the last flush is not on the disk"
    );
    heards[24..30].iter().for_each(|heard| take(&mut sink, heard));
    for _ in 0..2 * RETRY_FLUSHES {
        sink.flush().unwrap();
    }
    assert_eq!(disk.files().len(), 1, "what could not be begun leaves nothing behind");
    disk.set_room(None);
    for _ in 0..RETRY_FLUSHES {
        sink.flush().unwrap();
    }
    assert_eq!(shared.condition(), Condition::Kept);
    heards[30..].iter().for_each(|heard| take(&mut sink, heard));
    sink.close().unwrap();
    assert_eq!((kept, refused), (heards.len() - 6, 6));
    assert_eq!(shared.drops().session_file.total(), 4, "the feed counts the others");
    let said = words(&told);
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(
        said[0].contains("cannot go on") && said[1].ends_with("s_0002.mcap"),
        "{said:?}"
    );

    let files = disk.files();
    assert_eq!(
        files.iter().map(|(path, _)| path.to_str().unwrap()).collect::<Vec<_>>(),
        ["s.mcap", "s_0002.mcap"]
    );
    let second = Recording::read(&files[1].1).unwrap();
    assert_eq!(second.damage, [], "it stands alone");
    assert_eq!(second.first_part.as_deref(), Some("2"));
    assert_eq!(
        (second.nodes.len(), second.models.len()),
        (1, 1),
        "with what builds the nodes"
    );
    assert_eq!(second.messages[0].topic, Topic::Trial, "and the trial that runs");
}

#[test]
fn a_later_part_makes_way_for_a_file_of_its_name() {
    let disk = Fake::default();
    let (theirs, name) = (b"another session".to_vec(), PathBuf::from("s_0002.mcap"));
    disk.platter.lock().unwrap().files.insert(name.clone(), theirs.clone());
    let settings = RecorderSettings {
        split_s: 10,
        ..RecorderSettings::default()
    };
    let Setup { mut sink, disk, .. } = setup(disk, settings);
    for heard in session(15) {
        assert!(sink.take(&heard).unwrap());
    }
    sink.close().unwrap();
    let files: BTreeMap<_, _> = disk.files().into_iter().collect();
    assert_eq!(files[&name], theirs);
    assert_eq!(files.len(), 3, "{:?}", files.keys());
    let next = Recording::read(&files[Path::new("s_0003.mcap")]).unwrap();
    assert_eq!(next.damage, []);
}

#[test]
fn parts_read_alone_and_together_they_are_the_session() {
    let settings = RecorderSettings {
        split_s: 10,
        ..RecorderSettings::default()
    };
    let heards = session(35);
    let mut whole = setup(Fake::default(), RecorderSettings::default());
    let mut split = setup(Fake::default(), settings);
    for Setup { sink, .. } in [&mut whole, &mut split] {
        for heard in &heards {
            assert!(sink.take(heard).unwrap());
        }
        sink.close().unwrap();
    }
    let whole = Recording::read(&whole.disk.files()[0].1).unwrap();
    let files = split.disk.files();
    assert_eq!(files.len(), 4, "35 s in parts of 10 s");
    let mut together: PartsReader = PartsReader::default();
    for (path, file) in &files {
        let alone = Recording::read(file).unwrap();
        assert_eq!(alone.damage, [], "{path:?}");
        assert_eq!((alone.nodes.len(), alone.models.len()), (1, 1), "{path:?}");
        assert!(
            alone.messages.iter().any(|message| message.topic == Topic::Trial),
            "{path:?}"
        );
        together.add(std::io::Cursor::new(file)).unwrap();
    }
    let together = together.finish().unwrap();
    assert_eq!(together.damage, []);
    assert_eq!(together.messages, whole.messages);
    assert_eq!(together.counts.streams, whole.counts.streams);
    assert_eq!(together.notes, whole.notes);
}

#[test]
fn a_part_is_ended_at_its_size_and_a_stranger_among_parts_is_left_out() {
    let settings = RecorderSettings {
        split_mb: 1,
        chunk_kib: 16,
        ..RecorderSettings::default()
    };
    let mut small = setup(Fake::default(), settings);
    // Half a megabyte that does not compress, five times: the limit is passed with every second.
    let noise = |seed: u64| {
        let mut noise = seed | 1;
        let bytes = (0..500_000).map(|_| {
            noise ^= noise << 13;
            noise ^= noise >> 7;
            noise ^= noise << 17;
            noise.to_le_bytes()[3]
        });
        let part = crate::heard::JournalPart {
            node: NodeName::Arbiter,
            header: Header::default(),
            first: 0,
            entries: 0,
            lost: 0,
            bytes: bytes.collect(),
        };
        Arc::new(Heard {
            at: Stamp(seed),
            session_time: Stamp(seed),
            tick: 0,
            entry: Entry::Sample(Sample::Journal(part)),
        })
    };
    for seed in 1..=5 {
        small.sink.take(&noise(seed)).unwrap();
        small.sink.flush().unwrap();
    }
    small.sink.close().unwrap();
    let files = small.disk.files();
    assert_eq!(
        files.len(),
        3,
        "{:?}",
        files.iter().map(|(path, file)| (path, file.len())).collect::<Vec<_>>()
    );

    let mut other = setup(Fake::default(), RecorderSettings::default());
    other.sink.provenance.epoch_unix_nanos += 1;
    other.sink.parts = 0;
    other.disk.platter.lock().unwrap().files.clear();
    other.sink.begin_part().unwrap();
    other.sink.close().unwrap();
    let mut parts: PartsReader = PartsReader::default();
    parts.add(std::io::Cursor::new(&files[0].1)).unwrap();
    parts.add(std::io::Cursor::new(&other.disk.files()[0].1)).unwrap();
    let damage = parts.finish().unwrap().damage;
    assert!(
        damage
            .iter()
            .any(|damage| damage.to_string() == "part 2: this is part of another session; it is left out"),
        "{damage:?}"
    );
}

#[test]
fn a_stalled_disk_holds_nobody_up_and_its_drops_are_told_by_channel() {
    let (allow, gate) = bounded(0);
    let (enter, entered) = bounded(1);
    let Setup { sink, disk, shared, .. } = setup(Fake::default(), RecorderSettings::default());
    disk.platter.lock().unwrap().gate = Some((enter, gate));
    let limits = Limits {
        messages: 8,
        bytes: 1 << 20,
        flush: Duration::from_millis(20),
    };
    let mut feed = Feed::start(NAME, None, Kind::SessionFile, limits, &shared, sink).unwrap();
    let heards = session(50);
    feed.offer(Arc::clone(&heards[0]));
    entered.recv().unwrap();
    // This loop ends at all: nobody lets the disk go on before it has.
    for heard in &heards[1..] {
        feed.offer(Arc::clone(heard));
    }
    let lost = shared.drops().session_file;
    assert_eq!(
        lost.total(),
        heards.len() as u64 - 1 - 8,
        "one is being written, eight wait"
    );
    let channels: BTreeMap<_, _> = lost.by_channel().collect();
    assert!(
        channels["command"] > 30 && channels["journal/operator"] > 30,
        "{channels:?}"
    );
    drop::<Sender<()>>(allow);
    let (ended, _) = feed.end().wait(&never());
    assert_eq!(ended.messages.unwrap() + ended.dropped, heards.len() as u64);
}

#[test]
fn what_lasts_travels_again_byte_for_byte() {
    let trial = Trial::Begin {
        number: 3,
        label: "again".into(),
    };
    let message = Envelope {
        header: Header::default(),
        body: trial,
    };
    let mut bytes = Vec::new();
    encode(&message, &mut bytes);
    assert_eq!(Sample::Trial(message).travelled(), Some((Topic::Trial, bytes)));
}
