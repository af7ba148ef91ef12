//! Marking where a trial begins and ends, for whoever runs it.

use tandem_link::{Clock, Link, fresh_session};
use tandem_wire::{Numbering, Topic, Trial, encode};

/// Publishes a trial's marks as one sender.
pub(crate) struct TrialMarks {
    numbering: Numbering,
    link: Link,
}

impl TrialMarks {
    pub(crate) fn new(link: Link) -> Self {
        Self {
            numbering: Numbering::new(fresh_session()),
            link,
        }
    }

    pub(crate) fn mark(&mut self, trial: Trial) -> anyhow::Result<()> {
        let mut bytes = Vec::new();
        encode(
            &self.numbering.envelope(Clock::of_process().now(), 0, trial),
            &mut bytes,
        );
        Ok(self.link.publish(Topic::Trial, bytes)?)
    }
}
