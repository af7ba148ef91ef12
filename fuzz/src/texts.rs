//! Files that people bring: models and configurations.

use sha2::{Digest, Sha256};
use tandem_cesn::Model;
use tandem_settings::Document;
use tandem_trials::Configuration;

use crate::chance::Chance;
use crate::{Target, Tried, count, mutate, seeds};

/// The hash at the end of a model file.
const HASH: usize = 32;

/// Model files.
pub(crate) struct Models {
    file: Vec<u8>,
}

impl Models {
    pub(crate) fn new() -> Self {
        Self {
            file: seeds::model().to_bytes(),
        }
    }
}

impl Target for Models {
    fn name(&self) -> &'static str {
        "models"
    }

    fn run(&mut self, seed: u64, tried: &mut Tried) {
        count(tried, self.name());
        let mut chance = Chance::new(seed);
        let mut file = self.file.clone();
        // Most of the file is weights; what is worth damaging stands at its ends.
        let content = file.len() - HASH;
        let anywhere = chance.below(content);
        let from = *chance.pick(&[0, 0, content - 200.min(content), anywhere]);
        let to = (from + 400).min(content);
        let mut part = file[from..to].to_vec();
        mutate::damage(&mut part, 4, &mut chance);
        file.splice(from..to, part);
        if !chance.once_in(8) {
            // Sealed anew, so that what lies behind the hash is looked at.
            let content = file.len() - HASH;
            let payload = content.saturating_sub(40) as u64;
            if chance.once_in(2) {
                file[32..40].copy_from_slice(&payload.to_le_bytes());
            }
            let hash = Sha256::digest(&file[..content]);
            file[content..].copy_from_slice(&hash);
        }
        if let Ok(model) = Model::from_bytes(&file) {
            let context = [0.28, 0.1, 0.0, 0.0].map(|number| number * if chance.once_in(20) { 1e30 } else { 1.0 });
            for numbers in 0..=context.len() {
                // An error is a fine answer.
                let _ = model.forecast(&context[..numbers], chance.below(90));
            }
        }
    }
}

/// Configuration files.
pub(crate) struct Settings {
    file: Vec<u8>,
}

impl Settings {
    pub(crate) fn new() -> Self {
        // The lines that say something; what the comments say is not read.
        let lines: Vec<_> = seeds::configuration()
            .lines()
            .filter(|line| !line.starts_with('#') && !line.is_empty())
            .map(|line| format!("{line}\n"))
            .collect();
        Self {
            file: lines.concat().into_bytes(),
        }
    }
}

impl Target for Settings {
    fn name(&self) -> &'static str {
        "settings"
    }

    fn run(&mut self, seed: u64, tried: &mut Tried) {
        count(tried, self.name());
        let mut chance = Chance::new(seed);
        let mut file = self.file.clone();
        mutate::damage(&mut file, 4, &mut chance);
        let text = String::from_utf8_lossy(&file);
        let read = Document::parse("fuzz", &text).and_then(|document| Configuration::from_document(&document));
        if let Ok(configuration) = read {
            let shown = configuration.to_toml();
            let again = Document::parse("shown", &shown).and_then(|document| Configuration::from_document(&document));
            let again = again.expect("what was shown can be read");
            assert_eq!(again.to_toml(), shown);
        }
    }
}
