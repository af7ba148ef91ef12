//! A whole trial under virtual time: the four nodes of the loop in one thread, without a network.
//!
//! ```text
//!   what a node says ──▶ queue of (topic, bytes) ──▶ every node that listens to the topic ──▶ …
//!                             └──▶ whoever watches
//! ```
//!
//! The nodes are the ones that [`Blueprint`] makes, and they exchange the very bytes that would cross the network,
//! through their own [`Ports`], so that a trial here and the same trial through the shell in lockstep give the same
//! messages, byte for byte (`trials/tests/world.rs`). In lockstep `now` is what the shell takes it to be,
//! [`lockstep_now`]. In real time it is the earliest deadline of any node once everything that was said has been
//! heard: messages take no time at all, unless the configuration asks for a bad line, and neither does thinking.
//!
//! A [`Player`] is whoever takes a node's part: usually a [`Seat`] with the node itself, but a recorded human can
//! sit in the operator's place.

use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::sync::mpsc::{Receiver, channel};

use tandem_link::{Impairment, Impairments, lockstep_now};
use tandem_wire::{
    Input, Nanos, Node, NodeName, Numbering, Outbox, Pace, Ports, Session, Stamp, Timing, Topic, Trial, Vec3, encode,
};

use crate::{Blueprint, Trace, Tracer, Unbuildable};

/// What was said and has not been heard yet, oldest first.
pub type Said = VecDeque<(Topic, Vec<u8>)>;

/// Whoever takes the part of a node in a [`World`].
pub trait Player: Send {
    /// Which node it is, or stands for.
    fn name(&self) -> NodeName;

    /// Whether it listens to a topic.
    fn hears(&self, topic: Topic) -> bool;

    /// When it next wants to be woken in real time; `None` if never.
    fn deadline(&self) -> Option<Stamp>;

    /// Takes in one input and adds what it answers to `said`.
    fn take(&mut self, now: Stamp, input: Input<'_>, said: &mut Said);
}

/// A node with what its shell would keep for it.
pub struct Seat<N: Node> {
    node: N,
    outbox: Outbox<N::Output>,
    local: Local<N::Output>,
}

/// Is told every output of a node.
type Local<O> = Box<dyn FnMut(&O) + Send>;

impl<N: Node> Seat<N> {
    /// Seats a node.
    #[must_use]
    pub fn new(node: N) -> Self {
        Self::with_local(node, |_| {})
    }

    /// Seats a node whose outputs, those that stay in the process included, are also given to `local`.
    #[must_use]
    pub fn with_local(node: N, local: impl FnMut(&N::Output) + Send + 'static) -> Self {
        Self {
            node,
            outbox: Outbox::default(),
            local: Box::new(local),
        }
    }

    /// The node itself.
    pub const fn node_mut(&mut self) -> &mut N {
        &mut self.node
    }
}

impl<N> Player for Seat<N>
where
    N: Ports + Send,
    N::Output: Send,
{
    fn name(&self) -> NodeName {
        N::NAME
    }

    fn hears(&self, topic: Topic) -> bool {
        N::INPUTS.contains(&topic)
    }

    fn deadline(&self) -> Option<Stamp> {
        self.node.deadline()
    }

    fn take(&mut self, now: Stamp, input: Input<'_>, said: &mut Said) {
        self.node.step(now, N::event(input), &mut self.outbox);
        for output in self.outbox.drain() {
            let mut bytes = Vec::new();
            if let Some(topic) = N::sample(&output, &mut bytes) {
                said.push_back((topic, bytes));
            }
            (self.local)(&output);
        }
    }
}

/// Why a [`World`] stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Halt {
    /// Whoever watches had seen enough.
    Watched,
    /// The time that was allowed is over.
    TimeUp,
    /// Nobody had anything left to say.
    Silence,
}

/// The nodes of one loop, and what is under way between them.
pub struct World {
    players: Vec<Box<dyn Player>>,
    /// The line to each of them.
    lines: Vec<Impairment>,
    timing: Timing,
    now: Stamp,
    said: Said,
    marks: Numbering,
    /// Where the simulated human wished to be, by the robot's ticks.
    wishes: Option<Receiver<(u32, Vec3)>>,
}

impl World {
    /// The four nodes of a blueprint.
    ///
    /// # Errors
    /// If the blueprint's settings or its model do not fit together.
    pub fn new(blueprint: &Blueprint) -> Result<Self, Unbuildable> {
        let (sender, wishes) = channel();
        let tell = move |output: &tandem_operator::Output| {
            if let tandem_operator::Output::Status(status) = output
                && let Some((seen, wish)) = status.seen.zip(status.wish)
            {
                // A world that is gone has no use for wishes.
                let _ = sender.send((seen.tick, wish));
            }
        };
        let operator = Seat::with_local(blueprint.operator(), tell);
        let world = Self::with_operator(blueprint, Box::new(operator))?;
        Ok(Self {
            wishes: Some(wishes),
            ..world
        })
    }

    /// The predictor, the arbiter and the robot of a blueprint, with somebody else in the operator's place.
    ///
    /// # Errors
    /// If the blueprint's settings or its model do not fit together.
    pub fn with_operator(blueprint: &Blueprint, operator: Box<dyn Player>) -> Result<Self, Unbuildable> {
        let players: Vec<Box<dyn Player>> = vec![
            operator,
            Box::new(Seat::new(blueprint.predictor()?)),
            Box::new(Seat::new(blueprint.arbiter()?)),
            Box::new(Seat::new(blueprint.robot_sim()?)),
        ];
        let world = Self::of(players, blueprint.timing(), blueprint.session());
        Ok(world.impaired(&blueprint.configuration().impairment))
    }

    /// The same players over a bad line.
    #[must_use]
    pub fn impaired(mut self, impairments: &Impairments) -> Self {
        let names = self.players.iter().map(|player| player.name());
        self.lines = names
            .map(|name| Impairment::new(impairments, name, self.timing))
            .collect();
        self
    }

    /// Any players; trials are marked in `session`.
    #[must_use]
    pub fn of(players: Vec<Box<dyn Player>>, timing: Timing, session: Session) -> Self {
        let world = Self {
            players,
            lines: Vec::new(),
            timing,
            now: Stamp(0),
            said: Said::new(),
            marks: Numbering::new(session),
            wishes: None,
        };
        world.impaired(&Impairments::default())
    }

    /// Virtual time.
    #[must_use]
    pub const fn now(&self) -> Stamp {
        self.now
    }

    /// Marks the begin or the end of a trial, as whoever runs it would.
    pub fn mark(&mut self, trial: Trial) {
        let mut bytes = Vec::new();
        encode(&self.marks.envelope(self.now, 0, trial), &mut bytes);
        self.said.push_back((Topic::Trial, bytes));
    }

    /// Says something in nobody's name: whoever listens to the topic hears it next.
    pub fn say(&mut self, topic: Topic, bytes: Vec<u8>) {
        self.said.push_back((topic, bytes));
    }

    /// Runs one trial from its mark until the human has let go for good, or `limit` has passed, and traces it, the
    /// simulated human's wish included.
    pub fn trial(&mut self, number: u32, label: &str, limit: Nanos) -> (Trace, Halt) {
        let mut tracer = Tracer::of_trial(number);
        let wishes = self.wishes.take();
        self.mark(Trial::Begin {
            number,
            label: label.to_owned(),
        });
        let halt = self.run(limit, |_, topic, bytes| {
            tracer.see(topic, bytes);
            for (tick, wish) in wishes.iter().flat_map(Receiver::try_iter) {
                tracer.see_wish(tick, wish);
            }
            if tracer.is_over() {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        });
        self.wishes = wishes;
        (tracer.trace(), halt)
    }

    /// Has everybody hear what was said, and answer, until `watch` breaks, nobody says anything any more, or `limit`
    /// has passed. `watch` sees every message, with the virtual time at which it is heard, before anybody hears it.
    pub fn run(&mut self, limit: Nanos, mut watch: impl FnMut(Stamp, Topic, &[u8]) -> ControlFlow<()>) -> Halt {
        let end = self.now.after(limit);
        loop {
            while let Some((topic, bytes)) = self.said.pop_front() {
                let sample = Input::Sample { topic, bytes: &bytes };
                self.pass_time(sample);
                if self.now > end {
                    // Not lost: whoever goes on hears it then.
                    self.said.push_front((topic, bytes));
                    return Halt::TimeUp;
                }
                let watched = watch(self.now, topic, &bytes);
                self.deliver(topic, &bytes);
                if watched.is_break() {
                    return Halt::Watched;
                }
            }
            match self.next_deadline() {
                None => return Halt::Silence,
                Some(at) if at > end => {
                    self.now = end;
                    return Halt::TimeUp;
                }
                Some(at) => self.wake(at),
            }
        }
    }

    fn pass_time(&mut self, input: Input<'_>) {
        if self.timing.pace == Pace::Lockstep {
            self.now = self.now.max(lockstep_now(input, self.timing.period));
        }
    }

    fn deliver(&mut self, topic: Topic, bytes: &[u8]) {
        for (player, line) in self.players.iter_mut().zip(&mut self.lines) {
            if !player.hears(topic) {
                continue;
            }
            if line.is_bad() && self.timing.pace == Pace::Lockstep {
                for arrival in line.arrive(self.now, topic, bytes.to_vec()) {
                    player.take(arrival.at, arrival.input(), &mut self.said);
                }
            } else if !line.befalls(topic) {
                player.take(self.now, Input::Sample { topic, bytes }, &mut self.said);
            } else if let Some(bytes) = line.take(self.now, topic, bytes.to_vec()) {
                player.take(self.now, Input::Sample { topic, bytes: &bytes }, &mut self.said);
            }
        }
    }

    fn next_deadline(&self) -> Option<Stamp> {
        match self.timing.pace {
            Pace::Lockstep => None,
            Pace::Real => {
                let own = self.players.iter().filter_map(|player| player.deadline());
                own.chain(self.lines.iter().filter_map(Impairment::deadline)).min()
            }
        }
    }

    /// Wakes everybody whose deadline has come by `at`. One that lies behind costs a nanosecond, so that a player who
    /// keeps asking for the past cannot stop time.
    fn wake(&mut self, at: Stamp) {
        self.now = if at > self.now { at } else { self.now.after(1) };
        for (player, line) in self.players.iter_mut().zip(&mut self.lines) {
            while let Some((_, topic, bytes)) = line.due(self.now) {
                player.take(self.now, Input::Sample { topic, bytes: &bytes }, &mut self.said);
            }
            if player.deadline().is_some_and(|deadline| deadline <= self.now) {
                player.take(self.now, Input::Wake, &mut self.said);
            }
        }
    }
}

impl std::fmt::Debug for World {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names: Vec<NodeName> = self.players.iter().map(|player| player.name()).collect();
        f.debug_struct("World")
            .field("players", &names)
            .field("now", &self.now)
            .field("waiting", &self.said.len())
            .finish_non_exhaustive()
    }
}
