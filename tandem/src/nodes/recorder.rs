//! `tandem recorder`: its flags, and the process around it.

use std::path::PathBuf;

use clap::Args;
use tandem_link::stand_back;
use tandem_recorder::Notice;
use tandem_wire::NodeName;

use super::NodeFlags;
use super::process::Process;
use super::show::ShowFlags;
use crate::Outcome;
use crate::parts::{CLOSE_LIMIT, Parts, lost};

#[derive(Args)]
pub(crate) struct RecorderFlags {
    /// The session file; the Rerun recording goes beside it.
    #[arg(long, value_name = "PATH")]
    record: PathBuf,
    #[command(flatten)]
    show: ShowFlags,
    #[command(flatten)]
    node: NodeFlags,
}

/// `tandem recorder`.
pub(crate) fn recorder(flags: &RecorderFlags) -> anyhow::Result<Outcome> {
    // Before anything is started: Zenoh's threads, the files' and a viewer that is spawned stand back, too.
    stand_back();
    let overrides = flags.show.overrides(&flags.record);
    let parts = Parts::new(flags.node.configuration(&overrides)?, None)?;
    let sinks = parts.sinks()?;
    let process = match Process::begin(&parts, NodeName::Recorder) {
        Ok(Some(process)) => process,
        // An empty session file is a whole one, too.
        gave_up => {
            // Nothing was heard, so nothing can have been lost.
            let _ = sinks.close(CLOSE_LIMIT);
            return gave_up.map(|_| Outcome::Done);
        }
    };
    let recorder = parts.recorder(&process.link, sinks)?;
    process.wait(recorder.node());
    let closed = recorder.stop()?;
    process.link.close();
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
    Ok(if lost(&closed) > 0 {
        Outcome::SamplesLost
    } else {
        Outcome::Done
    })
}
