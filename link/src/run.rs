//! The loop that every node lives in: wait, journal, step, publish.

use std::collections::VecDeque;
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, bounded};
use tandem_wire::{
    Delivery, Happening, Input, Nanos, Node, NodeName, Outbox, Pace, Ports, SECOND, Stamp, Topic, codec, snapshot,
};
use zenoh::Wait;
use zenoh::pubsub::Publisher;

use crate::Clock;
use crate::answer::Asker;
use crate::clocks::Clocks;
use crate::declared::{Declared, Entrance};
use crate::dropped::Dropped;
use crate::impairment::Impairment;
use crate::journal::Journal;
use crate::net::{Link, LinkError};
use crate::running::{Item, Report, Running, ShellOptions};
use crate::spool::LINGER;

/// In lockstep this much silence after a node's own word means that somebody does not answer.
const SILENCE: Duration = Duration::from_secs(2);

/// A journal holds a snapshot of its node at least this often, by the node's own time: what a recorder that came late, or
/// a gap, can cost an execution of the session.
const SNAPSHOT_EVERY: Nanos = 10 * SECOND;

/// Starts `node` on a thread of its own. `local` is given every output, those that stay in the process included, on
/// that thread; it must not block.
///
/// # Errors
/// If Zenoh refuses a declaration or the system a thread.
pub fn spawn<N>(
    link: &Link,
    node: N,
    options: ShellOptions,
    local: impl FnMut(Stamp, N::Output) + Send + 'static,
) -> Result<Running, LinkError>
where
    N: Ports + Send + 'static,
    N::Output: Send,
{
    // A queue without a place would hand over nothing.
    let (sender, receiver) = bounded(options.queue.max(1));
    let dropped = Dropped::default();
    let pace = options.timing.pace;
    let entrance = Entrance {
        sender: sender.clone(),
        oldest: receiver.clone(),
        dropped: dropped.clone(),
        pace,
    };
    let publishers = N::OUTPUTS
        .iter()
        .map(|&topic| Ok((topic, link.publisher(topic, pace)?)))
        .collect::<Result<_, LinkError>>()?;
    let journal_key = Topic::Journal(N::NAME);
    let thread_refused = |error: std::io::Error| LinkError::Declare {
        key: journal_key.key(&link.robot),
        reason: error.to_string(),
    };
    let journal = match N::NAME {
        // The recorder's inputs are the recording itself.
        NodeName::Recorder => None,
        _ => Some(Journal::start(link, N::NAME, &options)?),
    };
    let clocks = match pace {
        Pace::Real => Some(Clocks::start(link, N::NAME, options.info.session, &options.clocks)?),
        // Stamps are no times.
        Pace::Lockstep => None,
    };
    let declared = Declared::new::<N>(link, &entrance, &options)?;
    let shell = Shell {
        node,
        line: Impairment::new(&options.impairment, N::NAME, options.timing),
        options,
        local,
        publishers,
        journal,
        clock: Clock::of_process(),
        now: Stamp(0),
        outbox: Outbox::default(),
        bytes: Vec::new(),
        steps: 0,
        late: 0,
        spoke: false,
        ticks: lockstep_streams::<N>(),
        trial: 0,
        next_snapshot: Stamp(0),
        asker: Asker::new(link, entrance),
        recorder: Recorded::default(),
        items: 0,
    };
    let counted = dropped.clone();
    let thread = std::thread::Builder::new()
        .name(N::NAME.as_str().into())
        .spawn(move || {
            let mut report = shell.live(&receiver);
            drop(declared);
            drop(clocks);
            report.dropped += counted.total();
            report
        })
        .map_err(thread_refused)?;
    Ok(Running {
        sender,
        dropped,
        thread,
    })
}

/// What a shell does next.
enum Next {
    /// Takes up an input.
    Item(Item),
    /// Takes up a sample that the line had kept back.
    Released(Item),
    /// Wakes the node.
    Deadline,
    /// Gives up: in lockstep nobody has said anything for [`SILENCE`].
    Silence,
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

struct Shell<N: Node, F> {
    node: N,
    line: Impairment,
    options: ShellOptions,
    local: F,
    publishers: Vec<(Topic, Publisher<'static>)>,
    journal: Option<Journal>,
    clock: Clock,
    now: Stamp,
    outbox: Outbox<N::Output>,
    bytes: Vec<u8>,
    steps: u64,
    late: u64,
    spoke: bool,
    ticks: Vec<(Topic, u32)>,
    /// The trial at the last snapshot, and when the next one is due at the latest.
    trial: u32,
    next_snapshot: Stamp,
    asker: Asker,
    recorder: Recorded,
    /// Items taken up.
    items: u64,
}

/// Whether a recorder listens, and ever did.
#[derive(Clone, Copy, Debug, Default)]
struct Recorded {
    ever: bool,
    there: bool,
}

impl<N: Ports, F: FnMut(Stamp, N::Output)> Shell<N, F> {
    fn live(mut self, receiver: &Receiver<Item>) -> Report {
        let mut waited = self.await_peers(receiver);
        if self.options.timing.pace == Pace::Real {
            self.now = self.clock.now();
        }
        self.keep_snapshot();
        loop {
            match waited.pop_front().map_or_else(|| self.next(receiver), Next::Item) {
                Next::Item(item) if self.is_late(&item) => self.late += 1,
                Next::Item(item) if self.loses(&item) => {}
                Next::Item(item) => {
                    self.note_tick(&item);
                    self.note_recorder(&item);
                    let Some(item) = self.let_through(item) else { continue };
                    self.step(item.input());
                    if matches!(item, Item::Stop) {
                        self.hear_out(receiver);
                        return self.end(None);
                    }
                }
                Next::Released(item) => self.step(item.input()),
                Next::Deadline => self.step(Input::Wake),
                Next::Silence => {
                    let awaited = self.awaited();
                    self.step(Input::Stop);
                    return self.end(Some(awaited));
                }
            }
        }
    }

    /// A bad line keeps samples back before the journal sees them: what stands in it is what the node saw.
    fn let_through(&mut self, item: Item) -> Option<Item> {
        match item {
            item if !self.line.is_bad() => Some(item),
            Item::Sample { topic, bytes, .. } if self.options.timing.pace == Pace::Lockstep => {
                self.pass(topic, bytes);
                None
            }
            Item::Sample { topic, bytes, arrived } => {
                let bytes = self.line.take(self.clock.now(), topic, bytes)?;
                Some(Item::Sample { topic, bytes, arrived })
            }
            other => Some(other),
        }
    }

    /// Over a bad line in lockstep a sample may reach the node later, and others with it.
    fn pass(&mut self, topic: Topic, bytes: Vec<u8>) {
        let sample = Input::Sample { topic, bytes: &bytes };
        let now = self.now.max(lockstep_now(sample, self.options.timing.period));
        for arrival in self.line.arrive(now, topic, bytes) {
            self.step_at(arrival.at, arrival.input());
        }
    }

    /// Whether a stream's sample has waited here for so long that the stream counts as lost. It would look fresh to the
    /// node, which is stepped with the time at which it takes a sample up. A recorder decides nothing: it keeps all.
    fn is_late(&self, item: &Item) -> bool {
        let Item::Sample { topic, arrived, .. } = item else {
            return false;
        };
        let timing = &self.options.timing;
        timing.pace == Pace::Real
            && N::NAME != NodeName::Recorder
            && topic.delivery() == Delivery::Stream
            && self.clock.now().since(*arrived) > timing.stream_timeout()
    }

    fn loses(&mut self, item: &Item) -> bool {
        self.items = self.items.wrapping_add(1);
        self.options.faults.loses_sample(self.items, item)
    }

    fn note_recorder(&mut self, item: &Item) {
        if let Item::Presence {
            peer: NodeName::Recorder,
            alive,
        } = item
        {
            self.recorder = Recorded {
                ever: true,
                there: *alive,
            };
        }
    }

    /// A node that was asked to end and waits for something hears it, for a bounded time.
    fn hear_out(&mut self, receiver: &Receiver<Item>) {
        let until = self.clock.now().after(LINGER);
        while self.node.lingers() && self.clock.now() < until {
            let due = self.node.deadline().filter(|_| self.options.timing.pace == Pace::Real);
            let next = due.map_or(until, |due| due.min(until));
            match receiver.recv_deadline(self.clock.instant(next)) {
                Ok(Item::Stop) | Err(RecvTimeoutError::Disconnected) => break,
                Ok(item) => self.step(item.input()),
                Err(RecvTimeoutError::Timeout) => self.step(Input::Wake),
            }
        }
        if self.node.lingers() {
            self.step(Input::Stop);
        }
    }

    /// In lockstep: how far each of the streams that this node listens to has come.
    fn note_tick(&mut self, item: &Item) {
        if let Item::Sample { topic, bytes, .. } = item
            && let Some((_, tick)) = self.ticks.iter_mut().find(|(name, _)| name == topic)
            && let Ok((_, header)) = codec::peek(bytes)
        {
            *tick = header.tick;
        }
    }

    /// Who makes the stream that is farthest behind.
    fn awaited(&self) -> NodeName {
        let behind = self.ticks.iter().min_by_key(|(_, tick)| *tick);
        behind.map_or(N::NAME, |(topic, _)| maker(*topic))
    }

    /// In lockstep nothing may be published before those who must answer are there.
    fn await_peers(&self, receiver: &Receiver<Item>) -> VecDeque<Item> {
        let mut missing = self.options.await_peers.clone();
        let mut waiting = VecDeque::new();
        while !missing.is_empty() {
            let Ok(item) = receiver.recv() else { break };
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

    fn next(&mut self, receiver: &Receiver<Item>) -> Next {
        if self.options.timing.pace == Pace::Real
            && self.line.deadline().is_some()
            && let Some((arrived, topic, bytes)) = self.line.due(self.clock.now())
        {
            return Next::Released(Item::Sample { topic, bytes, arrived });
        }
        let deadlines = [self.node.deadline(), self.line.deadline()];
        let received = match self.options.timing.pace {
            Pace::Real => match deadlines.into_iter().flatten().min() {
                Some(stamp) => receiver.recv_deadline(self.clock.instant(stamp)),
                None => receiver.recv().map_err(RecvTimeoutError::from),
            },
            // Before its first word a node may wait for a trial as long as it takes.
            Pace::Lockstep if self.spoke => receiver.recv_timeout(SILENCE),
            Pace::Lockstep => receiver.recv().map_err(RecvTimeoutError::from),
        };
        match (received, self.options.timing.pace) {
            (Ok(item), _) => Next::Item(item),
            (Err(RecvTimeoutError::Timeout), Pace::Real) => Next::Deadline,
            (Err(RecvTimeoutError::Timeout), Pace::Lockstep) => Next::Silence,
            (Err(RecvTimeoutError::Disconnected), _) => Next::Item(Item::Stop),
        }
    }

    fn step(&mut self, input: Input<'_>) {
        self.step_at(Stamp(0), input);
    }

    /// In lockstep no earlier than at `at`.
    fn step_at(&mut self, at: Stamp, input: Input<'_>) {
        let wall = self.clock.now();
        self.now = match self.options.timing.pace {
            Pace::Real => wall,
            Pace::Lockstep => self.now.max(lockstep_now(input, self.options.timing.period)).max(at),
        };
        let now = self.now;
        if let Some(journal) = &mut self.journal {
            journal.write(now, wall, Happening::from(input));
        }
        self.node.step(now, N::event(input), &mut self.outbox);
        self.steps += 1;
        for output in self.outbox.drain() {
            if let Some(topic) = N::sample(&output, &mut self.bytes) {
                // Nobody owes an answer to what is only for the record.
                self.spoke |= topic.delivery() != Delivery::Bulk;
                // Publish first: nothing that is only for the record may delay the robot. The clock is read before,
                // for a latency that begins when publishing ends would be too short.
                let wall = self.clock.now();
                let published = self.publishers.iter().find(|(name, _)| *name == topic);
                if let Some((_, publisher)) = published {
                    // A closed session is noticed by everyone's timeouts.
                    let _ = publisher.put(self.bytes.as_slice()).wait();
                }
                if let Some(journal) = &mut self.journal {
                    journal.write(
                        now,
                        wall,
                        Happening::Output {
                            topic,
                            bytes: self.bytes.clone(),
                        },
                    );
                }
            }
            if let Some(question) = N::question(&output) {
                self.asker.ask(question);
            }
            (self.local)(now, output);
        }
        self.keep_snapshot();
    }

    /// Writes into the journal what the node carries on: at the start, where a trial begins, and now and then. Between
    /// these instants nothing is allocated for it.
    fn keep_snapshot(&mut self) {
        let Some(journal) = &mut self.journal else { return };
        let before = std::mem::replace(&mut self.trial, self.node.trial());
        let begun = self.trial != 0 && self.trial != before;
        if !begun && self.now < self.next_snapshot {
            return;
        }
        self.next_snapshot = self.now.after(SNAPSHOT_EVERY);
        let mut bytes = Vec::new();
        snapshot(&mut self.node, &mut bytes);
        journal.write(self.now, self.clock.now(), Happening::Snapshot { bytes });
    }

    fn end(self, awaited: Option<NodeName>) -> Report {
        Report {
            steps: self.steps,
            dropped: self.late,
            journal: self
                .journal
                .map(|journal| journal.close(self.recorder.ever, self.recorder.there))
                .unwrap_or_default(),
            awaited,
        }
    }
}

/// The streams whose ticks lockstep waits for.
fn lockstep_streams<N: Ports>() -> Vec<(Topic, u32)> {
    let streams = N::INPUTS
        .iter()
        .filter(|topic| topic.delivery() == Delivery::Stream && **topic != Topic::Device);
    streams.map(|&topic| (topic, 0)).collect()
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
