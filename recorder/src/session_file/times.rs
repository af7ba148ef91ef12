//! When a message happened, on the file's two axes and on the session's.

use foxglove::messages::Timestamp;
use mcap::records::MessageHeader;
use tandem_wire::{Nanos, Seq, Stamp};

use super::standard;

/// When a message happened, and which it is in its stream.
#[derive(Clone, Copy)]
pub(super) struct Times {
    log: Nanos,
    publish: Nanos,
    sequence: u32,
    /// On the session's time axis, for Foxglove's messages.
    pub(super) session: Timestamp,
}

impl Times {
    /// Of what arrived at `at`, which is `session_time` on the session's axis. `epoch` is the wall clock, in nanoseconds
    /// since 1970, when the recorder's clock stood at zero.
    pub(super) fn new(epoch: Nanos, at: Stamp, session_time: Stamp, sent: Stamp, seq: Seq) -> Self {
        Self {
            log: epoch.saturating_add(at.0),
            publish: epoch.saturating_add(sent.0),
            sequence: u32::try_from(seq.0 & u64::from(u32::MAX)).expect("masked to 32 bits"),
            session: standard::timestamp(epoch.saturating_add(session_time.0)),
        }
    }

    pub(super) const fn log(self) -> Nanos {
        self.log
    }

    pub(super) const fn header(self, channel_id: u16) -> MessageHeader {
        MessageHeader {
            channel_id,
            sequence: self.sequence,
            log_time: self.log,
            publish_time: self.publish,
        }
    }
}
