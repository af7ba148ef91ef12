//! A sink that stalls, fails or never ends, and what its feed makes of that.

use crossbeam_channel::never;
use tandem_wire::{NodeName, Stamp};

use super::*;
use crate::heard::{Level, Note};

/// A sink that takes nothing until it is allowed to, and fails if it is told to.
struct Stalled {
    go: Receiver<()>,
    fails: bool,
}

impl Sink for Stalled {
    fn take(&mut self, _: &Arc<Heard>) -> Result<bool, Notice> {
        self.go.recv().ok();
        let sink = "the fake".to_owned();
        let why = "it was told to".to_owned();
        if self.fails {
            Err(Notice::Failed { sink, why })
        } else {
            Ok(true)
        }
    }

    fn flush(&mut self) -> Result<(), Notice> {
        Ok(())
    }

    fn close(&mut self) -> Result<(), Notice> {
        Ok(())
    }
}

fn heard() -> Arc<Heard> {
    let note = Note {
        level: Level::Info,
        about: NodeName::Recorder,
        is_routine: false,
        text: String::new(),
    };
    Arc::new(Heard {
        at: Stamp(0),
        session_time: Stamp(0),
        tick: 0,
        entry: Entry::Note(note),
    })
}

fn start(fails: bool) -> (Feed, Sender<()>, Arc<Shared>, Receiver<Notice>) {
    let (allow, go) = bounded(1000);
    let (tell, told) = bounded(8);
    let shared = Arc::new(Shared::new(tell));
    let limits = Limits {
        messages: 4,
        bytes: 1 << 20,
        flush: Duration::from_secs(1),
    };
    let feed = Feed::start("the fake", None, Kind::View, limits, &shared, Stalled { go, fails }).unwrap();
    (feed, allow, shared, told)
}

#[test]
fn a_stalled_sink_costs_drops_and_no_time() {
    let (mut feed, allow, shared, told) = start(false);
    // This returns at all: the sink waits for a word that comes only below.
    for _ in 0..100 {
        feed.offer(heard());
    }
    let drops = shared.drops().views.total();
    assert!(feed.room() <= 1, "the thread may take its first one this late");
    assert!(
        (95..=96).contains(&drops),
        "four wait, one may be in its hands, {drops} were dropped"
    );
    let said: Vec<_> = told.try_iter().collect();
    assert_eq!(
        said,
        [Notice::Behind {
            sink: "the fake".into()
        }],
        "once"
    );
    drop(allow);
    let (ended, _) = feed.end().wait(&never());
    assert_eq!(ended.messages, Some(100 - drops));
    assert_eq!(ended.dropped, drops);
}

#[test]
fn a_sink_that_never_ends_is_left_behind() {
    let (mut feed, _allow, _, _told) = start(false);
    feed.offer(heard());
    let now = crossbeam_channel::after(Duration::ZERO);
    let (ended, is_time_up) = feed.end().wait(&now);
    assert_eq!((ended.messages, is_time_up), (None, true));
}

#[test]
fn a_sink_that_fails_says_so_once_and_counts_the_rest() {
    let (mut feed, allow, shared, told) = start(true);
    for _ in 0..3 {
        allow.send(()).unwrap();
        feed.offer(heard());
    }
    let (ended, _) = feed.end().wait(&never());
    assert_eq!(
        (ended.messages, ended.dropped, shared.drops().views.total()),
        (Some(0), 3, 3)
    );
    assert_eq!(told.try_iter().count(), 1);
}

#[test]
fn memory_bounds_the_queue_as_well() {
    let (mut feed, _allow, shared, _told) = start(false);
    feed.limits.bytes = 1;
    feed.line.waiting_bytes.store(1, Ordering::Relaxed);
    feed.offer(heard());
    assert_eq!(
        shared.drops().views.by_channel().collect::<Vec<_>>(),
        [("log".to_owned(), 1)]
    );
}
