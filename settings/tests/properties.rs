//! Whatever the settings, their print reads back; whatever the text, nothing panics.

mod arbiter;

use proptest::prelude::*;

use tandem_settings::{Document, show};

use crate::arbiter::{ArbiterSettings, KNOWN, Law, read};

prop_compose! {
    fn any_settings()(
        (timeout_ms, leak, offset) in (20.0..=2000.0, f64::MIN_POSITIVE..=1.0, prop::num::f64::ANY),
        (law, record, label) in (any_law(), any::<bool>(), any::<String>()),
        (start_m, seed, units) in (prop::array::uniform3(-2.0..=2.0), 0..=i64::MAX.unsigned_abs(), 1..usize::MAX / 2),
        (port, listen, laws) in (any::<u16>(), any::<Vec<String>>(), prop::collection::vec(any_law(), 0..4)),
    ) -> ArbiterSettings {
        let offset = if offset.is_finite() { offset } else { 0.0 };
        ArbiterSettings { timeout_ms, leak, offset, law, record, label, start_m, seed, units, port, listen, laws }
    }
}

fn any_law() -> impl Strategy<Value = Law> {
    prop_oneof![Just(Law::Adaptive), Just(Law::Fixed)]
}

/// Text that is nearly right, so that it gets past the parser.
fn near_toml() -> impl Strategy<Value = String> {
    let header = one_of("# [arbiter] [link] [link.tls] [[arbiter]] [arbiter.law]");
    let line = (any_name(), any_word()).prop_map(|(name, word)| format!("{name} = {word}\n"));
    let lines = prop::collection::vec(line, 0..3).prop_map(|lines| lines.concat());
    let table = (header, lines).prop_map(|(header, lines)| format!("{header}\n{lines}"));
    prop::collection::vec(table, 0..3).prop_map(|tables| tables.concat())
}

fn any_key() -> impl Strategy<Value = String> {
    let declared = one_of("arbiter.start_m arbiter.seed arbiter.law arbiter link.tls.authority");
    prop_oneof![any::<String>(), declared.prop_map(str::to_owned)]
}

fn any_name() -> impl Strategy<Value = &'static str> {
    one_of("arbiter tls law start_m seed label tls.authority 'é.' ''")
}

fn any_word() -> impl Strategy<Value = String> {
    let scalar = one_of("nan -inf 1 0xF 1e999 99999999999999999999 'fixed' true 1979-05-27 # \"\\u0000\"");
    scalar.prop_map(str::to_owned).prop_recursive(3, 9, 3, |word| {
        prop_oneof![
            prop::collection::vec(word.clone(), 0..4).prop_map(|words| format!("[{}]", words.join(", "))),
            (any_name(), word).prop_map(|(name, word)| format!("{{ {name} = {word} }}")),
        ]
    })
}

fn one_of(words: &'static str) -> impl Strategy<Value = &'static str> {
    prop::sample::select(words.split(' ').collect::<Vec<_>>())
}

proptest! {
    #[test]
    fn what_show_prints_reads_back_bit_for_bit(settings in any_settings()) {
        let printed = show(&settings);
        let again = read(&printed);
        // Comparing the prints too tells -0.0 from 0.0.
        prop_assert_eq!(again.as_ref().map(show), Ok(printed));
        prop_assert_eq!(again, Ok(settings));
    }

    #[test]
    fn no_text_panics(text in prop_oneof![any::<String>(), near_toml()]) {
        if let Err(error) = read(&text) {
            prop_assert!(error.to_string().starts_with("tandem.toml:"));
        }
    }

    #[test]
    fn no_word_panics(key in any_key(), word in prop_oneof![any::<String>(), any_word()]) {
        let mut document = Document::default();
        document.set(&key, &word);
        if let Err(error) = document.section::<ArbiterSettings>().and(document.finish(KNOWN)) {
            prop_assert!(error.to_string().starts_with("command line: "));
        }
    }
}

#[test]
fn deep_nesting_is_refused_without_exhausting_the_stack() {
    for (open, close) in [("[", "]"), ("{a=", "}"), ("{a.a.a.a.a.a.a.a=", "}")] {
        for depth in [10, 79, 10_000] {
            let text = format!("a = {}1{}", open.repeat(depth), close.repeat(depth));
            assert!(read(&text).is_err());
        }
    }
    assert!(read(&format!("{}a = 1", "a.".repeat(10_000))).is_err());
}
