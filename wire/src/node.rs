//! What a node is: a value with one door.

use crate::{Malformed, NodeName, Question, Remember, Stamp, Topic};

/// A pure step machine.
///
/// Inside [`step`](Self::step) there is no clock, randomness from outside, thread, log line or I/O: the same
/// events at the same stamps give the same outputs, byte for byte, on every machine. That is what lets a
/// recorded session be executed again. `step` is total: whatever comes in becomes state and outputs. What a node carries
/// from one step to the next passes through [`Remember`], so that an execution can begin in the middle.
pub trait Node: Remember {
    /// Everything that can happen to the node.
    type Event;
    /// Everything that the node can cause.
    type Output;

    /// Takes in one event and leaves what follows from it in `outbox`.
    fn step(&mut self, now: Stamp, event: Self::Event, outbox: &mut Outbox<Self::Output>);

    /// When the node next wants to be woken without any event from outside; `None` if never.
    fn deadline(&self) -> Option<Stamp>;

    /// The running trial as far as the node knows, 0 if none runs. Where another one begins, the shell takes a
    /// [`snapshot`](crate::snapshot).
    fn trial(&self) -> u32;

    /// Whether the node, asked to end, still waits for something. The shell goes on for a bounded time and then asks a
    /// second time, which is final.
    fn lingers(&self) -> bool {
        false
    }
}

/// Where a step leaves its outputs, in order. Reused from step to step, so it stops allocating.
#[derive(Debug)]
pub struct Outbox<O> {
    outputs: Vec<O>,
}

impl<O> Default for Outbox<O> {
    fn default() -> Self {
        Self {
            outputs: Vec::with_capacity(8),
        }
    }
}

impl<O> Outbox<O> {
    /// Adds an output.
    pub fn push(&mut self, output: O) {
        self.outputs.push(output);
    }

    /// Takes the outputs, oldest first.
    pub fn drain(&mut self) -> impl Iterator<Item = O> + '_ {
        self.outputs.drain(..)
    }

    /// The outputs so far.
    #[must_use]
    pub fn as_slice(&self) -> &[O] {
        &self.outputs
    }
}

/// What reaches a node from outside, before anybody has looked inside. This is what a journal holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input<'a> {
    /// Bytes arrived on a topic.
    Sample {
        /// Which topic.
        topic: Topic,
        /// The bytes, untrusted.
        bytes: &'a [u8],
    },
    /// The node's deadline has come.
    Wake,
    /// A peer's presence token appeared or vanished. Presence only, never safety.
    Presence {
        /// Which peer.
        peer: NodeName,
        /// Whether it is there.
        alive: bool,
    },
    /// The process is about to end: say goodbye.
    Stop,
    /// In lockstep: the sample of a tick does not come now, because a bad line lost it or keeps it back. The tick is
    /// answered without it; one that was kept back follows later as a [`Sample`](Self::Sample).
    Missed {
        /// Whose sample.
        topic: Topic,
        /// Which tick's.
        tick: u32,
    },
}

/// Where a node takes its steps in real time: on which thread, and how soon after something came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// At once, on the thread that brings the input. For nodes that others wait for and whose every step takes
    /// microseconds: it saves waking a thread, which takes longer than the step, but holds up whatever that thread brings
    /// next.
    OnArrival,
    /// On the node's own thread, which is woken. For nodes whose steps may take longer.
    Own,
    /// On the node's own thread, several inputs at a time, each stamped with when it arrived. For nodes whose answers nobody
    /// waits for, and whose wake-ups would cost those that somebody does wait for.
    InBatches,
}

/// The bytes at a node's edge: inputs become events, outputs become samples. Pure, and total like the node.
pub trait Ports: Node {
    /// The node's name.
    const NAME: NodeName;
    /// Where its steps are taken in real time.
    const TURN: Turn;
    /// The topics it listens to.
    const INPUTS: &'static [Topic];
    /// The topics it may publish.
    const OUTPUTS: &'static [Topic];

    /// Makes an event of an input. Bytes that cannot be read become an event that says so.
    fn event(input: Input<'_>) -> Self::Event;

    /// Writes an output's bytes into `bytes` (cleared first) and says which topic they belong to;
    /// `None` for an output that stays inside the process.
    fn sample(output: &Self::Output, bytes: &mut Vec<u8>) -> Option<Topic>;

    /// The question that an output puts to another node; its answer comes in as a sample of that node's journal, an
    /// empty one if nobody answers.
    fn question(output: &Self::Output) -> Option<Question> {
        let _ = output;
        None
    }
}

/// A sample that could not be read, as an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unreadable {
    /// Where it came from.
    pub topic: Topic,
    /// What is wrong with it.
    pub why: Malformed,
}
