//! Losses on purpose.

use tandem_wire::Delivery;

use crate::running::Item;

/// What a shell loses on purpose, so that a test sees what becomes of a session on a bad network. Nothing by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// One in so many batches of the journal is not sent; 0 for none.
    pub batches_one_in: u32,
    /// One in so many samples of a stream does not reach the node; 0 for none.
    pub samples_one_in: u32,
}

impl Faults {
    /// Whether the `number`-th batch is lost.
    pub(crate) const fn loses_batch(&self, number: u32) -> bool {
        self.batches_one_in > 0 && number.is_multiple_of(self.batches_one_in)
    }

    /// Whether the `number`-th item is lost, if it is a sample of a stream.
    pub(crate) fn loses_sample(&self, number: u64, item: &Item) -> bool {
        let stream = matches!(item, Item::Sample { topic, .. } if topic.delivery() == Delivery::Stream);
        stream && self.samples_one_in > 0 && number.is_multiple_of(u64::from(self.samples_one_in))
    }
}
