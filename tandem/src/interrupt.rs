//! Ctrl-C and the termination signal, as a channel.

use anyhow::Context as _;
use crossbeam_channel::{Receiver, bounded};

/// Catches Ctrl-C and SIGTERM from now on; each one arrives on the channel.
pub(crate) fn catch() -> anyhow::Result<Receiver<()>> {
    let (sender, receiver) = bounded(1);
    // One pending request to end is enough.
    let notify = move || {
        let _ = sender.try_send(());
    };
    ctrlc::set_handler(notify).context("cannot catch Ctrl-C")?;
    Ok(receiver)
}
