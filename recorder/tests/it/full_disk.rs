//! A real file system without room: a small one in memory, where the test may mount one.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use crate::script::{record, session};
use tandem_recorder::{Notice, Output, Provenance, RecorderConfig, RecorderSettings, Recording, Sinks};
use tandem_wire::{Condition, Timing};

/// A file system of 1 MiB, taken away at the end.
struct Small(tempfile::TempDir);

impl Small {
    fn mount() -> Option<Self> {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", "size=1m", "tmpfs"])
            .arg(folder.path())
            .output();
        mounted
            .is_ok_and(|output| output.status.success())
            .then_some(Self(folder))
    }

    fn path(&self) -> &Path {
        self.0.path()
    }
}

impl Drop for Small {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.0.path()).status();
    }
}

#[test]
fn a_full_file_system_is_told_and_recording_goes_on_when_there_is_room() {
    let Some(disk) = Small::mount() else {
        eprintln!("skipped: a file system of its own needs the right to mount one");
        return;
    };
    let path = disk.path().join("s.mcap");
    let ballast = disk.path().join("ballast");
    let settings = RecorderSettings {
        path: path.to_str().unwrap().into(),
        flush_ms: 20,
        ..RecorderSettings::default()
    };
    let provenance = Provenance {
        robot: "panda".parse().unwrap(),
        build: "test".into(),
        epoch_unix_nanos: 1,
    };
    let config = RecorderConfig::new(&settings).unwrap();
    let mut sinks = Sinks::open(&config, Timing::default(), &provenance).unwrap();
    // As much as fits: what is left is less than a block.
    let _ = std::fs::write(&ballast, vec![0; 1 << 20]);
    let outputs: Vec<Output> = record(&session(), Timing::default());
    let feed_until = |sinks: &mut Sinks, wanted: Condition| {
        for _ in 0..500 {
            outputs.iter().cloned().for_each(|output| sinks.handle(output));
            if sinks.storage().condition == wanted {
                return;
            }
            crossbeam_channel::after(Duration::from_millis(10)).recv().unwrap();
        }
        panic!("{wanted:?} does not come: {:?}", sinks.storage());
    };
    feed_until(&mut sinks, Condition::NoSpace);
    std::fs::remove_file(&ballast).unwrap();
    feed_until(&mut sinks, Condition::Kept);
    let dropped = sinks.drops().session_file;
    let said = sinks.notices();
    let closed = sinks.close(Duration::from_secs(20));
    assert!(dropped.total() > 0 && dropped.by_channel().any(|(channel, _)| channel == "state"));
    assert_eq!(
        closed.sinks[0].dropped,
        closed.drops.session_file.total(),
        "both counts agree"
    );
    assert!(
        said.iter().any(|notice| matches!(notice, Notice::Failed { .. })),
        "{said:?}"
    );
    assert!(
        said.iter().any(|notice| matches!(notice, Notice::Resumed { .. })),
        "{said:?}"
    );
    let second = std::fs::read(disk.path().join("s_0002.mcap")).unwrap();
    let second = Recording::read(&second).unwrap();
    assert_eq!(second.nodes.len(), 2, "the second part knows how the nodes are built");
}
