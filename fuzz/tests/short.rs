//! A few thousand cases of every target, the same each time. The program goes on as long as it is told.

use std::path::Path;

use tandem_fuzz::{Tried, corpus, every_cut, targets};

/// Tries `cases` seeds of one target.
fn try_out(name: &str, cases: u64) {
    let mut targets = targets();
    let target = targets
        .iter_mut()
        .find(|target| target.name() == name)
        .expect("a target");
    let mut tried = Tried::new();
    for seed in 0..cases {
        target.run(seed, &mut tried);
    }
    assert!(tried.values().sum::<u64>() >= cases);
}

#[test]
fn damaged_messages_are_refused_or_written_again_the_same() {
    try_out("decoders", 60_000);
}

#[test]
fn five_nodes_survive_a_network_that_does_everything_wrong() {
    try_out("loop", 24);
}

#[test]
fn a_session_file_cut_anywhere_says_so() {
    assert!(every_cut(997) > 20);
}

#[test]
fn a_session_file_with_changed_bytes_is_repaired_into_what_can_be_read_of_it() {
    try_out("bytes", 150);
}

#[test]
fn a_session_file_with_changed_records_is_repaired_into_what_can_be_read_of_it() {
    try_out("records", 150);
}

#[test]
fn damaged_models_are_refused_or_forecast() {
    try_out("models", 2_000);
}

#[test]
fn damaged_settings_are_refused_or_shown_again_the_same() {
    try_out("settings", 300);
}

#[test]
fn every_message_of_the_corpus_ends_as_it_did_when_it_was_found() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let files = std::fs::read_dir(&folder).expect("the corpus");
    let mut tried = 0;
    for file in files.map(|file| file.expect("a file").path()) {
        let name = file.file_name().expect("a name").to_string_lossy().into_owned();
        let bytes = std::fs::read(&file).expect("readable");
        let anew = "if the layout has changed: cargo run --release -p tandem-fuzz -- --keep fuzz/corpus";
        assert_eq!(corpus::again(&name, &bytes), name, "{anew}");
        tried += 1;
    }
    assert!(tried > 60, "only {tried} messages in {}", folder.display());
}
