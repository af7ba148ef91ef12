//! `tandem recorder`: its flags, and the process around it.

use std::path::PathBuf;

use clap::Args;
use tandem_link::stand_back;
use tandem_recorder::{Closed, Live, Notice, RecorderSettings, Sinks};
use tandem_wire::NodeName;

use super::process::Process;
use super::show::ShowFlags;
use super::{NodeFlags, watcher};
use crate::Outcome;
use crate::configuration::BadConfiguration;
use crate::parts::{CLOSE_LIMIT, Parts, lost};

#[derive(Args)]
pub(crate) struct RecorderFlags {
    /// The session file; the Rerun recording goes beside it [default: recorder.path and recorder.rrd of the configuration;
    /// without a session file it only watches].
    #[arg(long, value_name = "PATH")]
    record: Option<PathBuf>,
    /// Replaces recordings that are there already.
    #[arg(long)]
    overwrite: bool,
    #[command(flatten)]
    show: ShowFlags,
    #[command(flatten)]
    node: NodeFlags,
}

/// `tandem recorder`.
pub(crate) fn recorder(flags: &RecorderFlags) -> anyhow::Result<Outcome> {
    // Before anything is started: Zenoh's threads, the files' and a viewer that is spawned stand back, too.
    stand_back();
    let mut overrides = flags.show.overrides(flags.record.as_deref());
    overrides.extend(flags.overwrite.then(|| ("recorder.overwrite", "true".to_owned())));
    let configuration = flags.node.configuration(&overrides)?;
    let keeps = keeps_session(&configuration.recorder)?;
    let parts = Parts::new(configuration, None)?;
    let sinks = parts.sinks()?;
    let begun = match keeps {
        true => Process::begin(&parts, NodeName::Recorder),
        false => watcher::begin(&parts),
    };
    let process = match begun {
        Ok(Some(process)) => process,
        gave_up => {
            discard(sinks);
            return gave_up.map(|_| Outcome::Done);
        }
    };
    let closed = match keeps {
        true => record(&parts, &process, sinks),
        false => watcher::watch(&parts, &process, sinks),
    }?;
    process.link.close();
    Ok(tell(&closed))
}

/// Whether there is a session file to be kept, rather than only something to be shown.
fn keeps_session(settings: &RecorderSettings) -> Result<bool, BadConfiguration> {
    let shows = !settings.rrd.is_empty() || settings.live != Live::None;
    match (settings.path.is_empty(), shows) {
        (false, _) => Ok(true),
        (true, true) => Ok(false),
        (true, false) => Err(BadConfiguration::Conflict(
            "nothing to record to and nothing to show: say --record session.mcap (recorder.path), or --view to watch \
             without recording (recorder.live)"
                .to_owned(),
        )),
    }
}

fn record(parts: &Parts, process: &Process, sinks: Sinks) -> anyhow::Result<Closed> {
    let recorder = parts.recorder(&process.link, sinks)?;
    process.wait(recorder.node());
    recorder.stop()
}

/// Nothing was heard, so nothing can have been lost, and no empty file shall stand in the way of the next try.
fn discard(sinks: Sinks) {
    let empty = sinks.close(CLOSE_LIMIT).sinks.into_iter();
    let empty = empty.filter(|ended| ended.messages == Some(0));
    for path in empty.filter_map(|ended| ended.path).filter(|path| path.is_file()) {
        // If even this fails, an empty file stays, and says so at the next try.
        std::fs::remove_file(path).ok();
    }
}

/// Says how it ended, sink by sink.
fn tell(closed: &Closed) -> Outcome {
    for ended in &closed.sinks {
        let taken = ended
            .messages
            .map_or("an unknown number of".into(), |messages| messages.to_string());
        eprintln!(
            "recorder: {} ended after {taken} messages, {} missed",
            ended.sink, ended.dropped
        );
    }
    for notice in &closed.notices {
        eprintln!("recorder: {notice}");
    }
    let channels: Vec<_> = closed.drops.session_file.by_channel().collect();
    if !channels.is_empty() {
        eprintln!("recorder: {}", Notice::Dropped { channels });
    }
    match lost(closed) {
        0 => Outcome::Done,
        _ => Outcome::SamplesLost,
    }
}
