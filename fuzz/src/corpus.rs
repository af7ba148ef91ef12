//! The corpus: for every way in which a decoder can end, the shortest message found that ends so.
//!
//! `fuzz/corpus/DECODER-ENDING` is tried by the short tests, so that an ending that took millions of inputs to find is
//! looked at every time. A change of the layout makes it anew: `cargo run --release -p tandem-fuzz -- --keep fuzz/corpus`.

use std::collections::BTreeMap;

use tandem_wire::{Malformed, Topic};

use crate::chance::Chance;
use crate::{decoders, mutate, seeds};

/// By decoder and ending, the message.
pub type Corpus = BTreeMap<String, Vec<u8>>;

/// Gathers a corpus from the cases of `cases` seeds.
#[must_use]
pub fn gather(cases: u64) -> Corpus {
    let mut corpus = Corpus::new();
    for seed in 0..cases {
        let mut chance = Chance::new(seed);
        let (topic, golden) = chance.pick(seeds::messages());
        let mut bytes = golden.clone();
        mutate::damage(&mut bytes, 4, &mut chance);
        let ending = format!(
            "{}-{}",
            decoders::name(*topic),
            ending(decoders::try_one(*topic, &bytes))
        );
        let is_shorter = corpus.get(&ending).is_none_or(|kept| bytes.len() < kept.len());
        if is_shorter {
            corpus.insert(ending, bytes);
        }
    }
    corpus
}

/// Tries one message of a corpus with every decoder, and says how its own ended: the name under which it belongs.
///
/// # Panics
/// When what is read is not written again the same, or `name` names no decoder.
#[must_use]
pub fn again(name: &str, bytes: &[u8]) -> String {
    for (topic, _) in seeds::messages() {
        decoders::try_one(*topic, bytes).ok();
    }
    decoders::try_one(Topic::Device, bytes).ok();
    let decoder = name.split('-').next().unwrap_or_default();
    let mut topics = seeds::messages().iter().map(|(topic, _)| *topic);
    let topic = topics.find(|topic| decoders::name(*topic) == decoder);
    let topic = topic.expect("the name of a decoder");
    format!("{decoder}-{}", ending(decoders::try_one(topic, bytes)))
}

const fn ending(read: Result<(), Malformed>) -> &'static str {
    match read {
        Ok(()) => "read",
        Err(Malformed::Truncated(_)) => "truncated",
        Err(Malformed::Oversized(_)) => "oversized",
        Err(Malformed::Version(_)) => "version",
        Err(Malformed::Kind { .. }) => "kind",
        Err(Malformed::NotFinite) => "not_finite",
        Err(Malformed::Body) => "body",
        Err(Malformed::Trailing(_)) => "trailing",
        Err(Malformed::Key) => "key",
        Err(Malformed::Topic) => "topic",
    }
}
