//! What never reached a node because it could not keep up, by topic.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use tandem_wire::Topic;

use crate::running::Item;

/// Inputs that never reached a node because its queue was full, counted by topic; all clones count together.
///
/// The lock is taken only where something is lost, or somebody asks.
#[derive(Clone, Debug, Default)]
pub struct Dropped(Arc<Mutex<BTreeMap<Topic, u64>>>);

impl Dropped {
    /// How many so far, by topic; presence counts as [`Topic::Alive`].
    #[must_use]
    pub fn by_topic(&self) -> BTreeMap<Topic, u64> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// All of them.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.by_topic()
            .values()
            .fold(0, |sum, number| sum.saturating_add(*number))
    }

    pub(crate) fn count(&self, item: &Item) {
        let topic = match item {
            Item::Sample { topic, .. } => *topic,
            Item::Presence { peer, .. } => Topic::Alive(*peer),
            // The wish to end is never lost; where the node has ended it has come true.
            Item::Stop => return,
        };
        let mut numbers = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        *numbers.entry(topic).or_default() += 1;
    }
}
