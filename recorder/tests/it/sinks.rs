//! Sinks that cannot be opened, are absent, or work.

use std::time::Duration;

use crate::script::{record, session};
use tandem_recorder::{Drops, Live, OpenError, Provenance, RecorderConfig, RecorderSettings, Sinks};
use tandem_wire::Timing;

fn open(settings: &RecorderSettings) -> Result<Sinks, OpenError> {
    let provenance = Provenance {
        robot: "panda".parse().expect("a valid name"),
        build: "test".into(),
        epoch_unix_nanos: 0,
    };
    Sinks::open(
        &RecorderConfig::new(settings).expect("settings that fit together"),
        Timing::default().lockstep(),
        &provenance,
    )
}

#[test]
fn a_path_that_cannot_be_written_is_an_error_that_names_it() {
    let path = "/nowhere/at/all.mcap".to_owned();
    let error = open(&RecorderSettings {
        path,
        ..RecorderSettings::default()
    })
    .err()
    .unwrap();
    assert_eq!(
        error.to_string(),
        "the session file \"/nowhere/at/all.mcap\" cannot be written"
    );
    assert!(std::error::Error::source(&error).is_some());
    let rrd = "/nowhere/at/all.rrd".to_owned();
    let error = open(&RecorderSettings {
        rrd,
        ..RecorderSettings::default()
    })
    .err()
    .unwrap();
    assert_eq!(
        error.to_string(),
        "the Rerun recording \"/nowhere/at/all.rrd\" cannot be written"
    );
}

#[test]
fn a_recording_that_is_there_is_left_alone_unless_it_shall_be_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let [mcap, rrd] = ["a.mcap", "a.rrd"].map(|name| folder.path().join(name));
    let mut settings = RecorderSettings {
        path: mcap.to_str().unwrap().into(),
        rrd: rrd.to_str().unwrap().into(),
        ..RecorderSettings::default()
    };
    for (there, other) in [(&mcap, &rrd), (&rrd, &mcap)] {
        std::fs::write(there, b"somebody's hour").unwrap();
        let error = open(&settings).err().unwrap().to_string();
        assert!(
            error.contains(there.to_str().unwrap()) && error.contains("--overwrite"),
            "{error}"
        );
        assert_eq!(std::fs::read(there).unwrap(), b"somebody's hour");
        assert!(!other.exists(), "and the other one is not begun");
        std::fs::remove_file(there).unwrap();
    }
    std::fs::write(&mcap, b"nobody's hour").unwrap();
    settings.overwrite = true;
    let closed = open(&settings).unwrap().close(Duration::from_secs(20));
    assert_eq!(closed.notices, []);
    assert!(std::fs::read(&mcap).unwrap().starts_with(b"\x89MCAP"));
}

#[test]
fn a_session_goes_into_both_files() {
    let folder = tempfile::tempdir().unwrap();
    let (mcap, rrd) = (folder.path().join("a.mcap"), folder.path().join("a.rrd"));
    let mut sinks = open(&RecorderSettings {
        path: mcap.to_str().unwrap().into(),
        rrd: rrd.to_str().unwrap().into(),
        ..RecorderSettings::default()
    })
    .unwrap();
    for output in record(&session(), Timing::default().lockstep()) {
        sinks.handle(output);
    }
    let closed = sinks.close(Duration::from_secs(20));
    assert_eq!(closed.notices, []);
    assert_eq!(closed.drops, Drops::default());
    assert_eq!(
        closed.sinks.iter().map(|sink| sink.path.clone()).collect::<Vec<_>>(),
        [Some(mcap.clone()), Some(rrd.clone())]
    );
    assert!(closed.sinks.iter().all(|sink| sink.messages > Some(300)), "{closed:?}");
    assert!(mcap::Summary::read(&std::fs::read(&mcap).unwrap()).unwrap().is_some());
    assert!(std::fs::read(&rrd).unwrap().starts_with(b"RRF2"));
}

#[test]
fn a_viewer_that_is_not_there_holds_nothing_up() {
    // A port that was free a moment ago: nobody answers there.
    let port = std::net::TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let folder = tempfile::tempdir().unwrap();
    let mcap = folder.path().join("a.mcap");
    let mut sinks = open(&RecorderSettings {
        path: mcap.to_str().unwrap().into(),
        live: Live::Connect,
        viewer: format!("rerun+http://127.0.0.1:{port}/proxy"),
        ..RecorderSettings::default()
    })
    .unwrap();
    for _ in 0..4 {
        for output in record(&session(), Timing::default().lockstep()) {
            sinks.handle(output);
        }
    }
    let closed = sinks.close(Duration::from_secs(20));
    assert_eq!(closed.sinks[0].dropped, 0, "{closed:?}");
    assert!(closed.sinks[0].messages.is_some(), "{closed:?}");
    assert_eq!(
        closed.sinks[1].dropped, 0,
        "what nobody looked at is no loss: {closed:?}"
    );
    assert!(closed.sinks[1].messages.is_some(), "{closed:?}");
}

#[cfg(unix)]
#[test]
fn a_stalled_disk_and_a_stalled_viewer_together_hold_up_the_end_no_longer_than_one_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("a.mcap");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    if !made.is_ok_and(|status| status.success()) {
        eprintln!("skipped: there is no mkfifo");
        return;
    }
    // Opened both ways it waits for nobody; it takes some kilobytes and then nothing more.
    let _held = std::fs::File::options().read(true).write(true).open(&pipe).unwrap();
    let viewer = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let mut sinks = open(&RecorderSettings {
        path: pipe.to_str().unwrap().into(),
        live: Live::Connect,
        viewer: format!("rerun+http://{}/proxy", viewer.local_addr().unwrap()),
        flush_ms: 20,
        ..RecorderSettings::default()
    })
    .unwrap();
    // That somebody listens there has been noticed.
    let _connection = viewer.accept().unwrap();
    for _ in 0..40 {
        for output in record(&session(), Timing::default().lockstep()) {
            sinks.handle(output);
        }
    }
    // This returns at all.
    let closed = sinks.close(Duration::from_millis(200));
    assert_eq!(closed.sinks[0].messages, None, "the pipe is full: {closed:?}");
}
