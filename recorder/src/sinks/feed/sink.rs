//! What a file or a viewer has to do to stand behind a queue.

use std::sync::Arc;

use crate::heard::Heard;
use crate::sinks::Notice;

/// Something that takes what was heard. It may fail, and it may block: it has a thread of its own.
pub(in crate::sinks) trait Sink: Send + 'static {
    /// Called once, on the sink's own thread.
    fn begin(&mut self) -> Result<(), Notice> {
        Ok(())
    }

    /// Takes one thing, and says whether it is kept. One that is not counts as dropped; an error ends the sink.
    fn take(&mut self, heard: &Arc<Heard>) -> Result<bool, Notice>;

    /// Puts everything taken so far beyond the reach of a crash. Also called when there is nothing new.
    fn flush(&mut self) -> Result<(), Notice>;

    /// Ends the sink in good order, after failures too.
    fn close(&mut self) -> Result<(), Notice>;

    /// How many things, taken and said to be kept, turned out to be lost.
    fn lost_later(&self) -> u64 {
        0
    }
}
