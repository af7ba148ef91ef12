//! Every command that reads a session, on files that are none, or damaged ones: a sentence and an exit code, never a
//! panic; and what can be read is read.

mod process;

use std::path::{Path, PathBuf};
use std::process::Output;

use process::Process;
use process::recorded::{self, text};

fn said(output: &Output) -> String {
    [&output.stdout, &output.stderr]
        .map(|bytes| String::from_utf8_lossy(bytes).into_owned())
        .concat()
}

/// The bytes of one demo.
fn session() -> Vec<u8> {
    std::fs::read(recorded::session()).expect("it was written")
}

/// Every reader with the file, and where it may write.
fn readers<'a>(file: &'a str, rrd: &'a str, tables: &'a str, repaired: &'a str) -> [Vec<&'a str>; 5] {
    [
        vec!["session", "info", file],
        vec!["session", "export", file, "--csv", tables],
        vec!["session", "repair", file, "-o", repaired],
        vec!["replay", file, "--rrd", rrd],
        vec!["replay", "--verify", file],
    ]
}

/// Runs every reader on `file` and hands over what each said.
fn each_reader(file: &Path, mut look: impl FnMut(&str, Option<i32>, &str)) {
    let folder = tempfile::tempdir().expect("a folder");
    let place = |name: &str| folder.path().join(name).display().to_string();
    let (rrd, tables, repaired) = (place("a.rrd"), place("tables"), place("repaired.mcap"));
    for arguments in readers(text(file), &rrd, &tables, &repaired) {
        let output = Process::output(&arguments);
        let said = said(&output);
        assert!(!said.contains("panicked"), "{arguments:?}: {said}");
        assert!(!said.trim().is_empty(), "{arguments:?} says nothing");
        look(&arguments[..2].join(" "), output.status.code(), &said);
    }
}

fn written(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("a file");
    path
}

#[test]
fn what_is_no_session_is_refused_by_every_reader_with_its_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let magic = b"\x89MCAP0\r\n";
    let files = [
        written(folder.path(), "empty.mcap", b""),
        written(folder.path(), "picture.mcap", b"\x89PNG\r\n\x1a\n and so on"),
        written(folder.path(), "magic.mcap", magic),
        written(folder.path(), "half-a-header.mcap", &session()[..12]),
        folder.path().join("nowhere.mcap"),
        folder.path().to_owned(),
    ];
    for file in files {
        each_reader(&file, |reader, code, said| {
            assert!(
                matches!(code, Some(1..=3)),
                "{reader} {}: exit code {code:?}, {said}",
                file.display()
            );
            let name = file.file_name().expect("a name").to_string_lossy().into_owned();
            assert!(
                said.contains(&name) || said.contains("no journal"),
                "{reader} does not say of which file: {said}"
            );
        });
    }
}

#[test]
fn a_file_cut_anywhere_is_used_as_far_as_it_goes() {
    let folder = tempfile::tempdir().expect("a folder");
    let whole = session();
    for part in [3, 6, 9] {
        let file = written(folder.path(), "cut.mcap", &whole[..whole.len() * part / 10]);
        each_reader(&file, |reader, code, said| {
            let expected: &[i32] = match reader {
                "replay --verify" => &[3],
                // The beginning holds model and configuration; in a short piece there may be nothing to play yet.
                _ => &[0, 1],
            };
            assert!(
                code.is_some_and(|code| expected.contains(&code)),
                "{reader}: {code:?}, {said}"
            );
            assert!(
                [
                    "ends in the middle",
                    "not closed",
                    "cannot be read",
                    "no session",
                    "nothing to play",
                    "no messages"
                ]
                .iter()
                .any(|words| said.contains(words)),
                "{reader} says nothing of the cut: {said}"
            );
        });
    }
}

/// Where the chunks of a whole file are.
fn chunks(file: &[u8]) -> Vec<(usize, usize)> {
    const CHUNK: u8 = 6;
    let (mut at, mut found) = (8, Vec::new());
    while let Some(length) = file.get(at + 1..at + 9) {
        let length = u64::from_le_bytes(length.try_into().expect("eight bytes"));
        let end = at + 9 + usize::try_from(length).expect("it fits in memory");
        if file[at] == CHUNK {
            found.push((at, end));
        }
        at = end;
        if at + 8 >= file.len() {
            break;
        }
    }
    found
}

#[test]
fn a_corrupt_chunk_costs_what_is_in_it_and_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut bytes = session();
    let (from, to) = *chunks(&bytes).get(1).expect("a session has several chunks");
    bytes[(from + to) / 2] ^= 0x5a;
    let file = written(folder.path(), "corrupt.mcap", &bytes);
    each_reader(&file, |reader, code, said| match reader {
        "replay --verify" => assert!(matches!(code, Some(1 | 3)), "{code:?} {said}"),
        _ => {
            assert_eq!(code, Some(0), "{reader}: {said}");
            assert!(said.contains("chunk at byte"), "{reader}: {said}");
        }
    });
}

#[test]
fn seeking_beyond_the_end_is_said_and_writes_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = written(folder.path(), "whole.mcap", &session());
    let rrd = folder.path().join("x.rrd");
    let replay = |place: [&str; 2]| {
        let output = Process::output(&["replay", text(&file), "--rrd", text(&rrd), place[0], place[1]]);
        let said = said(&output);
        assert!(!said.contains("panicked"), "{place:?}: {said}");
        (output.status.code(), said)
    };
    for place in [["--from", "1e9"], ["--from", "inf"]] {
        let (code, said) = replay(place);
        assert_eq!(code, Some(1), "{place:?}: {said}");
        assert!(said.contains("nothing to play"), "{place:?}: {said}");
        assert!(!rrd.exists(), "{place:?} writes a file");
    }
    for place in [["--until", "0"], ["--from", "-5"], ["--from", "NaN"]] {
        let (code, said) = replay(place);
        assert!(matches!(code, Some(0..=2)), "{place:?}: {said}");
    }
}

#[test]
fn an_arms_description_that_cannot_be_read_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let record = folder.path().join("a.mcap");
    let urdf = folder.path().join("nowhere.urdf");
    let arguments = [
        "demo",
        "--pace",
        "max",
        "--record",
        text(&record),
        "--urdf",
        text(&urdf),
    ];
    let output = Process::output(&arguments);
    assert!(matches!(output.status.code(), Some(1 | 2)), "{}", said(&output));
    assert!(said(&output).contains("nowhere.urdf"), "{}", said(&output));
}
