//! The way into a node: a queue, and in real time a bell beside it.

use std::fmt;
use std::sync::Arc;

use crossbeam_channel::{Receiver, SendError, Sender, TrySendError};
use tandem_wire::Topic;
use zenoh::bytes::ZBytes;
use zenoh::sample::Sample;

use crate::Clock;
use crate::dropped::Dropped;
use crate::running::Item;

/// Rung on the thread that put something into a node's queue.
pub(crate) trait Bell: Send + Sync {
    fn ring(&self);
}

/// The way in for whoever can wait for room, or do without: devices in this process, the wish to end, answers.
#[derive(Clone)]
pub(crate) struct Door {
    pub(crate) sender: Sender<Item>,
    /// In lockstep there is none: the node waits at its queue.
    pub(crate) bell: Option<Arc<dyn Bell>>,
}

impl fmt::Debug for Door {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Door").finish_non_exhaustive()
    }
}

impl Door {
    /// Puts an item in as soon as there is room; says whether the node was there.
    pub(crate) fn put(&self, item: Item) -> bool {
        self.rung(self.sender.send(item).is_ok())
    }

    /// Puts an item in if there is room; says whether there was, and a node.
    pub(crate) fn offer(&self, item: Item) -> bool {
        self.rung(self.sender.try_send(item).is_ok())
    }

    fn rung(&self, taken: bool) -> bool {
        if let Some(bell) = self.bell.as_ref().filter(|_| taken) {
            bell.ring();
        }
        taken
    }
}

/// The way in for what Zenoh's callbacks bring, which must not wait in real time.
#[derive(Clone)]
pub(crate) struct Entrance {
    pub(crate) door: Door,
    /// The node's end of the queue, to make room at its front.
    pub(crate) oldest: Receiver<Item>,
    pub(crate) dropped: Dropped,
}

impl Entrance {
    /// In real time at once, at the cost of the oldest where the queue is full; in lockstep once there is room.
    pub(crate) fn put(&self, item: Item) {
        let Some(bell) = &self.door.bell else {
            if let Err(SendError(lost)) = self.door.sender.send(item) {
                self.dropped.count(&lost);
            }
            return;
        };
        put_newest(&self.door.sender, &self.oldest, item, &self.dropped);
        bell.ring();
    }

    pub(crate) fn sample(&self, topic: Topic, sample: &Sample) {
        let arrived = Clock::of_process().now();
        let bytes = at_most(topic.max_bytes(), sample.payload());
        self.put(Item::Sample { topic, bytes, arrived });
    }
}

/// A payload, cut one byte behind `limit`: enough to see that it is too long, whatever a stranger sends.
pub(crate) fn at_most(limit: usize, payload: &ZBytes) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(payload.len().min(limit + 1));
    payload.slices().for_each(|slice| {
        let room = (limit + 1).saturating_sub(bytes.len());
        bytes.extend_from_slice(&slice[..slice.len().min(room)]);
    });
    bytes
}

/// Puts an item into a queue, at the cost of the oldest ones where it is full: a node that is far behind must act on what
/// is, not on what was. What is lost is counted. The wish to end is never one of them.
fn put_newest(sender: &Sender<Item>, oldest: &Receiver<Item>, item: Item, dropped: &Dropped) {
    let mut next = item;
    loop {
        match sender.try_send(next) {
            Ok(()) => return,
            Err(TrySendError::Disconnected(lost)) => return dropped.count(&lost),
            Err(TrySendError::Full(refused)) => next = refused,
        }
        // The wish to end goes to the back, in the place of what came: nothing that comes now matters any more.
        match oldest.try_recv() {
            Ok(Item::Stop) => dropped.count(&std::mem::replace(&mut next, Item::Stop)),
            Ok(lost) => dropped.count(&lost),
            // The node has just made room.
            Err(_) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crossbeam_channel::bounded;
    use tandem_wire::NodeName;

    fn presence(alive: bool) -> Item {
        let peer = NodeName::Operator;
        Item::Presence { peer, alive }
    }

    #[test]
    fn a_full_queue_loses_its_oldest_and_keeps_the_newest() {
        let (sender, receiver) = bounded(2);
        let dropped = Dropped::default();
        put_newest(&sender, &receiver, presence(false), &dropped);
        put_newest(&sender, &receiver, presence(false), &dropped);
        assert_eq!(dropped.total(), 0);
        put_newest(&sender, &receiver, presence(true), &dropped);
        assert_eq!(dropped.total(), 1);
        let kept: Vec<Item> = receiver.try_iter().collect();
        assert!(matches!(
            kept.as_slice(),
            [Item::Presence { alive: false, .. }, Item::Presence { alive: true, .. }]
        ));
    }

    #[test]
    fn what_is_too_long_is_cut_one_byte_behind_the_limit() {
        let payload = ZBytes::from(vec![7; 1 << 20]);
        assert_eq!(at_most(128, &payload), [7; 129]);
        assert_eq!(at_most(1 << 20, &payload).len(), 1 << 20);
        assert!(at_most(0, &ZBytes::new()).is_empty());
    }

    #[test]
    fn the_wish_to_end_survives_a_full_queue() {
        let (sender, receiver) = bounded(2);
        let dropped = Dropped::default();
        put_newest(&sender, &receiver, Item::Stop, &dropped);
        for _ in 0..10 {
            put_newest(&sender, &receiver, presence(true), &dropped);
        }
        assert!(receiver.try_iter().any(|item| matches!(item, Item::Stop)));
    }

    #[test]
    fn what_is_lost_is_counted_by_what_it_was_about() {
        let (sender, receiver) = bounded(2);
        let dropped = Dropped::default();
        let sample = |topic| Item::Sample {
            topic,
            bytes: Vec::new(),
            arrived: tandem_wire::Stamp(0),
        };
        for topic in [Topic::State, Topic::State, Topic::Scene, Topic::Scene, Topic::Scene] {
            put_newest(&sender, &receiver, sample(topic), &dropped);
        }
        let lost: Vec<_> = dropped.by_topic().into_iter().collect();
        assert_eq!(lost, [(Topic::State, 2), (Topic::Scene, 1)]);
    }
}
