//! Lockstep: a node waits at its queue, time is in the messages, and whoever is silent for too long ends it.

use std::collections::VecDeque;
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError};
use tandem_wire::{Delivery, Input, Nanos, NodeName, Ports, Stamp, Topic, codec};

use crate::running::{Item, Report};
use crate::shell::Shell;
use crate::spool::LINGER;

/// This much silence after a node's own word means that somebody does not answer.
const SILENCE: Duration = Duration::from_secs(2);

/// What a node does next.
enum Next {
    /// Takes up an input.
    Item(Item),
    /// Gives up: nobody has said anything for [`SILENCE`].
    Silence,
}

/// How far each of the streams that a node listens to has come.
struct Ticks(Vec<(Topic, u32)>);

impl Ticks {
    fn of<N: Ports>() -> Self {
        let streams = N::INPUTS
            .iter()
            .filter(|topic| topic.delivery() == Delivery::Stream && **topic != Topic::Device);
        Self(streams.map(|&topic| (topic, 0)).collect())
    }

    fn note(&mut self, item: &Item) {
        if let Item::Sample { topic, bytes, .. } = item
            && let Some((_, tick)) = self.0.iter_mut().find(|(name, _)| name == topic)
            && let Ok((_, header)) = codec::peek(bytes)
        {
            *tick = header.tick;
        }
    }

    /// Who makes the stream that is farthest behind.
    fn awaited<N: Ports>(&self) -> NodeName {
        let behind = self.0.iter().min_by_key(|(_, tick)| *tick);
        behind.map_or(N::NAME, |(topic, _)| maker(*topic))
    }
}

/// Who makes a stream.
const fn maker(topic: Topic) -> NodeName {
    match topic {
        Topic::Proposal => NodeName::Predictor,
        Topic::Setpoint => NodeName::Arbiter,
        Topic::State => NodeName::RobotSim,
        _ => NodeName::Operator,
    }
}

impl<N: Ports, F: FnMut(Stamp, N::Output)> Shell<N, F> {
    /// The life of a node's thread.
    pub(crate) fn live_in_lockstep(mut self, queue: &Receiver<Item>) -> Report {
        let mut waited = self.await_peers(queue);
        let mut ticks = Ticks::of::<N>();
        self.keep_snapshot();
        loop {
            let next = waited.pop_front().map_or_else(|| self.next(queue), Next::Item);
            let Next::Item(item) = next else {
                self.step_at(Stamp(0), Input::Stop);
                return self.end(Some(ticks.awaited::<N>()));
            };
            if self.loses(&item) {
                continue;
            }
            ticks.note(&item);
            match item {
                Item::Sample { topic, bytes, .. } if self.line.is_bad() => self.pass(topic, bytes),
                item => {
                    self.step_at(Stamp(0), item.input());
                    if matches!(item, Item::Stop) {
                        self.hear_out_in_lockstep(queue);
                        return self.end(None);
                    }
                }
            }
        }
    }

    /// Nothing may be published before those who must answer are there.
    fn await_peers(&self, queue: &Receiver<Item>) -> VecDeque<Item> {
        let mut missing = self.options.await_peers.clone();
        let mut waiting = VecDeque::new();
        while !missing.is_empty() {
            let Ok(item) = queue.recv() else { break };
            let stop = matches!(item, Item::Stop);
            if let Item::Presence { peer, alive: true } = item {
                missing.retain(|name| *name != peer);
            }
            waiting.push_back(item);
            if stop {
                break;
            }
        }
        waiting
    }

    fn next(&self, queue: &Receiver<Item>) -> Next {
        // Before its first word a node may wait for a trial as long as it takes.
        let received = if self.voice.spoke {
            queue.recv_timeout(SILENCE)
        } else {
            queue.recv().map_err(RecvTimeoutError::from)
        };
        match received {
            Ok(item) => Next::Item(item),
            Err(RecvTimeoutError::Timeout) => Next::Silence,
            Err(RecvTimeoutError::Disconnected) => Next::Item(Item::Stop),
        }
    }

    /// Over a bad line a sample may reach the node later, and others with it.
    fn pass(&mut self, topic: Topic, bytes: Vec<u8>) {
        let sample = Input::Sample { topic, bytes: &bytes };
        let now = self.now.max(lockstep_now(sample, self.options.timing.period));
        for arrival in self.line.arrive(now, topic, bytes) {
            self.step_at(arrival.at, arrival.input());
        }
    }

    /// Steps no earlier than at `at`.
    fn step_at(&mut self, at: Stamp, input: Input<'_>) {
        let now = self.now.max(lockstep_now(input, self.options.timing.period)).max(at);
        self.step(now, self.clock.now(), input);
    }

    /// A node that was asked to end and waits for something hears it, for a bounded time.
    fn hear_out_in_lockstep(&mut self, queue: &Receiver<Item>) {
        let until = self.clock.now().after(LINGER);
        while self.node.lingers() && self.clock.now() < until {
            match queue.recv_deadline(self.clock.instant(until)) {
                Ok(Item::Stop) | Err(RecvTimeoutError::Disconnected) => break,
                Ok(item) => self.step_at(Stamp(0), item.input()),
                Err(RecvTimeoutError::Timeout) => self.step_at(Stamp(0), Input::Wake),
            }
        }
        if self.node.lingers() {
            self.step_at(Stamp(0), Input::Stop);
        }
    }
}

/// Lockstep's now: the tick in the header times the period. What has no header happens at the tick that is current,
/// for which zero stands here: time never runs back.
#[must_use]
pub fn lockstep_now(input: Input<'_>, period: Nanos) -> Stamp {
    match input {
        Input::Sample { topic, bytes } if topic.delivery() != Delivery::Bulk => {
            codec::peek(bytes).map_or(Stamp(0), |(_, header)| Stamp::of_tick(header.tick, period))
        }
        Input::Missed { tick, .. } => Stamp::of_tick(tick, period),
        _ => Stamp(0),
    }
}
