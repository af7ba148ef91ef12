//! `tandem.toml` and the flags that override it, as checked settings of every part.

use std::path::PathBuf;

use clap::Args;
use tandem_recorder::NoEvidence;
use tandem_settings::Document;
use tandem_trials::plan::{BadCode, BadPlan, NoModel, OutOfReach};
use tandem_trials::run::RunError;
use tandem_trials::{Configuration, Unbuildable};

use crate::Outcome;

/// The file that is read when it is there and none is named.
const DEFAULT_FILE: &str = "tandem.toml";

/// Flags that every command with a configuration takes.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct CommonFlags {
    /// Configuration file [default: tandem.toml if it is there].
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Overrides one key of the configuration, as in --set arbiter.weight_floor=0.2.
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

/// What the user asked for cannot be: exit code 2.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BadConfiguration {
    #[error("cannot read the configuration {path}", path = path.display())]
    Unreadable { path: PathBuf, source: std::io::Error },
    #[error(transparent)]
    Setting(#[from] tandem_settings::Error),
    #[error("cannot read the session {path}", path = path.display())]
    Session { path: PathBuf, source: NoEvidence },
    #[error("--set {given:?}: write KEY=VALUE, as in --set arbiter.weight_floor=0.2")]
    Override { given: String },
    #[error(transparent)]
    Unbuildable(#[from] Unbuildable),
    #[error(transparent)]
    Plan(#[from] BadPlan),
    #[error(transparent)]
    Reach(#[from] OutOfReach),
    #[error(transparent)]
    Model(#[from] NoModel),
    #[error("condition {condition}")]
    Condition { condition: String, source: Unbuildable },
    #[error("cannot read the plan {path}", path = path.display())]
    NoPlan { path: PathBuf, source: std::io::Error },
    #[error(transparent)]
    Participant(#[from] BadCode),
    #[error(transparent)]
    Run(RunError),
    #[error("{0}")]
    Conflict(String),
}

/// Reads the file, lays `--set` and then `overrides` (key, value) over it, and checks all of it.
pub(crate) fn load(flags: &CommonFlags, overrides: &[(&str, String)]) -> Result<Configuration, BadConfiguration> {
    let mut document = document(flags)?;
    for given in &flags.set {
        let Some((key, value)) = given.split_once('=') else {
            return Err(BadConfiguration::Override { given: given.clone() });
        };
        document.set(key.trim(), value.trim());
    }
    for (key, value) in overrides {
        document.set(key, value);
    }
    Ok(Configuration::from_document(&document)?)
}

fn document(flags: &CommonFlags) -> Result<Document, BadConfiguration> {
    let path = match &flags.config {
        Some(path) => path.clone(),
        None if PathBuf::from(DEFAULT_FILE).is_file() => DEFAULT_FILE.into(),
        None => return Ok(Document::default()),
    };
    match std::fs::read_to_string(&path) {
        Ok(text) => Ok(Document::parse(&path.display().to_string(), &text)?),
        Err(source) => Err(BadConfiguration::Unreadable { path, source }),
    }
}

/// `tandem config show`.
pub(crate) fn print(flags: &CommonFlags) -> anyhow::Result<Outcome> {
    print!("{}", load(flags, &[])?.to_toml());
    Ok(Outcome::Done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_shown_is_read_back_whole() {
        let shown = Configuration::default().to_toml();
        let path = std::env::temp_dir().join(format!("tandem-config-{}.toml", std::process::id()));
        std::fs::write(&path, &shown).unwrap();
        let flags = CommonFlags {
            config: Some(path.clone()),
            set: vec![],
        };
        let again = load(&flags, &[]).unwrap().to_toml();
        std::fs::remove_file(path).unwrap();
        assert_eq!(again, shown);
    }

    #[test]
    fn an_override_goes_through_the_same_checks() {
        let flags = CommonFlags {
            config: None,
            set: vec!["arbiter.weight_floor=7".into()],
        };
        let refused = load(&flags, &[]).unwrap_err().to_string();
        assert!(
            refused.contains("arbiter.weight_floor") && refused.contains("0 to 1"),
            "{refused}"
        );
    }
}
