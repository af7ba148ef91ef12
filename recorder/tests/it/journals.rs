//! When a node that ends is told that everything of its journal is there, and when it is not.

use tandem_recorder::{Entry, Event, Output, Recorder, Sample};
use tandem_wire::{
    Condition, Envelope, Happening, Header, Input, JournalBatch, JournalEntry, Node, NodeName, Outbox, Ports, Seq,
    Session, Stamp, Storage, Timing, Topic, encode,
};

const SECOND: u64 = 1_000_000_000;

/// A recorder that hears one node's journal.
struct Hearing {
    recorder: Recorder,
    seq: u64,
}

/// What came of a step: what was asked for, how many parts of journals were written, and how often the counts were.
#[derive(Debug, PartialEq)]
struct Came {
    asked: Vec<(u64, u64)>,
    parts: usize,
    counts: usize,
}

impl Hearing {
    fn new() -> Self {
        let recorder = Recorder::new(Timing::default());
        Self { recorder, seq: 0 }
    }

    fn step(&mut self, at: u64, event: Event) -> Came {
        let mut outbox = Outbox::default();
        self.recorder.step(Stamp(at), event, &mut outbox);
        let (mut asked, mut parts, mut counts) = (Vec::new(), 0, 0);
        for output in outbox.drain() {
            match output {
                Output::Ask(question) => asked.push((question.first, question.last)),
                Output::Write(heard) => match &heard.entry {
                    Entry::Sample(Sample::Journal(_)) => parts += 1,
                    Entry::Counts(_) => counts += 1,
                    _ => {}
                },
                Output::Show(_) | Output::Say(_) => {}
            }
        }
        Came { asked, parts, counts }
    }

    /// Part of the node's journal; without entries it says how far the journal goes.
    fn part(&mut self, at: u64, first: u64, entries: usize) -> Came {
        self.seq += 1;
        let entry = JournalEntry {
            at: Stamp(0),
            wall: Stamp(0),
            what: Happening::Wake,
        };
        let body = JournalBatch {
            first,
            lost: 0,
            entries: vec![entry; entries],
        };
        let header = Header {
            session: Session(5),
            seq: Seq(self.seq),
            ..Header::default()
        };
        let mut bytes = Vec::new();
        encode(&Envelope { header, body }, &mut bytes);
        let topic = Topic::Journal(NodeName::Arbiter);
        self.step(at, Recorder::event(Input::Sample { topic, bytes: &bytes }))
    }

    /// The shell looks how the session file is doing.
    fn look(&mut self, at: u64, condition: Condition, dropped: u64) -> Vec<(u64, u64)> {
        self.step(at, Event::Storage(Storage { condition, dropped })).asked
    }
}

#[test]
fn a_node_that_ends_is_told_that_everything_is_there_once_the_file_was_looked_at() {
    let mut hearing = Hearing::new();
    hearing.part(0, 0, 10);
    let ended = hearing.part(1, 10, 0);
    assert_eq!(
        (ended.asked, ended.counts),
        (vec![], 1),
        "the counts have the shell look"
    );
    assert_eq!(hearing.look(2, Condition::Kept, 0), [(10, 10)]);
}

#[test]
fn a_look_from_before_a_journals_end_says_nothing_about_it() {
    let mut hearing = Hearing::new();
    hearing.part(0, 0, 10);
    assert_eq!(hearing.step(SECOND, Event::Wake).counts, 1);
    hearing.part(SECOND, 10, 10);
    hearing.part(SECOND, 20, 0);
    assert_eq!(
        hearing.look(SECOND, Condition::Kept, 0),
        [],
        "asked for by the counts a second in"
    );
    assert_eq!(hearing.look(SECOND, Condition::Kept, 0), [(20, 20)]);
}

#[test]
fn nodes_keep_their_journals_where_the_session_file_lost_something() {
    for (condition, dropped) in [(Condition::Kept, 1), (Condition::NoSpace, 0)] {
        let mut hearing = Hearing::new();
        hearing.part(0, 0, 10);
        hearing.part(1, 10, 0);
        assert_eq!(hearing.look(2, condition, dropped), []);
        assert_eq!(hearing.part(3, 10, 0).asked, []);
        assert_eq!(hearing.look(4, condition, dropped), []);
        // The end that is asked for when the recording ends must not sound as if everything were there.
        assert_eq!(hearing.step(5, Event::Stop).asked, [(9, u64::MAX)]);
    }
}

#[test]
fn how_far_a_journal_goes_is_written_once_and_what_is_missing_before_it_is_asked_for() {
    let mut hearing = Hearing::new();
    hearing.part(0, 0, 10);
    let ended = hearing.part(1, 20, 0);
    assert_eq!((ended.parts, ended.asked), (1, vec![(10, 19)]));
    assert_eq!(hearing.part(2, 20, 0).parts, 0);
}
