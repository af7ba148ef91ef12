//! What a watcher knows of each robot: rates, gaps, the loop's age, who drives. Pure: time is an argument.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use tandem_recorder::{Budget, Sample};
use tandem_wire::{
    ClockReport, Command, MessageId, Nanos, NodeName, PeerClock, Proposal, Refusals, SECOND, Setpoint, Stamp, State,
    Storage, Topic, codec, decode,
};

/// Rates and latencies are those of so long a time.
const WINDOW: Nanos = 5 * SECOND;
/// Messages whose arrival is remembered, to tell the loop's age: some seconds of a stream.
const REMEMBERED: usize = 512;

/// The streams whose rate is told, in the order of one turn of the loop.
pub(crate) const STREAMS: [Topic; 4] = [Topic::Command, Topic::Proposal, Topic::Setpoint, Topic::State];

/// One robot, as it was seen.
#[derive(Clone, Debug, Default)]
pub(crate) struct Robot {
    /// Who is there.
    pub(crate) alive: BTreeSet<NodeName>,
    /// The newest state, and when it came.
    pub(crate) state: Option<(Stamp, State)>,
    /// The newest setpoint.
    pub(crate) setpoint: Option<(Stamp, Setpoint)>,
    /// The recorder's newest word.
    pub(crate) storage: Option<Storage>,
    /// What each node knows of the others' clocks.
    pub(crate) clocks: BTreeMap<NodeName, ClockReport>,
    /// Messages that could not be read.
    pub(crate) unreadable: u64,
    streams: BTreeMap<Topic, Stream>,
    states: Arrivals<Stamp>,
    commands: Arrivals<MessageId>,
    turns: VecDeque<(Stamp, Nanos)>,
    last_turn: Option<MessageId>,
    /// Where the time goes, as far as a listener can tell.
    pub(crate) budget: Budget,
}

/// Keeps the newest by their numbers.
#[derive(Clone, Debug)]
struct Arrivals<T>(VecDeque<(MessageId, T)>);

impl<T> Default for Arrivals<T> {
    fn default() -> Self {
        Self(VecDeque::new())
    }
}

impl<T: Copy> Arrivals<T> {
    fn note(&mut self, id: MessageId, what: T) {
        if self.0.len() == REMEMBERED {
            self.0.pop_front();
        }
        self.0.push_back((id, what));
    }

    fn find(&self, id: MessageId) -> Option<T> {
        self.0
            .iter()
            .rev()
            .find(|(known, _)| *known == id)
            .map(|(_, what)| *what)
    }
}

/// One stream: what came of it lately, by each sender, and what is missing.
#[derive(Clone, Debug, Default)]
struct Stream {
    arrivals: VecDeque<Stamp>,
    newest: BTreeMap<u64, u64>,
    missed: u64,
}

impl Stream {
    fn hear(&mut self, now: Stamp, id: MessageId) {
        self.arrivals.push_back(now);
        // Many senders only come about where somebody means harm; they are not worth the memory.
        if self.newest.len() > 64 {
            self.newest.clear();
        }
        let newest = self.newest.entry(id.session.0).or_insert(id.seq.0);
        self.missed += id.seq.0.saturating_sub(*newest).saturating_sub(1);
        *newest = (*newest).max(id.seq.0);
    }
}

/// A stream as it is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Rate {
    /// Messages per second.
    pub(crate) hz: f64,
    /// Numbers that never came, since the watching began.
    pub(crate) missed: u64,
    /// Senders heard since then.
    pub(crate) senders: usize,
}

/// The loop's age at two quantiles, in milliseconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Turn {
    /// Half of the turns were shorter.
    pub(crate) p50_ms: f64,
    /// All but one in a hundred were shorter.
    pub(crate) p99_ms: f64,
    /// The longest.
    pub(crate) worst_ms: f64,
}

impl Robot {
    /// Takes in a sample that arrived at `now`.
    pub(crate) fn hear(&mut self, now: Stamp, topic: Topic, bytes: &[u8]) {
        let Ok((_, header)) = codec::peek(bytes) else {
            self.unreadable += 1;
            return;
        };
        if let Ok(sample) = Sample::read(topic, bytes) {
            self.budget.hear(&sample);
        }
        let read = match topic {
            Topic::State => decode::<State>(bytes).map(|state| self.hear_state(now, header.id(), state.body)),
            Topic::Setpoint => decode::<Setpoint>(bytes).map(|setpoint| self.setpoint = Some((now, setpoint.body))),
            Topic::Command => decode::<Command>(bytes).map(|command| {
                if let Some(seen) = command.body.seen {
                    self.commands.note(header.id(), seen);
                }
            }),
            Topic::Proposal => decode::<Proposal>(bytes).map(drop),
            Topic::Clock(node) => {
                decode::<ClockReport>(bytes).map(|report| drop(self.clocks.insert(node, report.body)))
            }
            Topic::Storage => decode::<Storage>(bytes).map(|storage| self.storage = Some(storage.body)),
            _ => return,
        };
        match read {
            Ok(()) => self.streams.entry(topic).or_default().hear(now, header.id()),
            Err(_) => self.unreadable += 1,
        }
    }

    /// A state closes a turn: it obeys a setpoint made from a command whose maker had seen an earlier state.
    fn hear_state(&mut self, now: Stamp, id: MessageId, state: State) {
        self.states.note(id, now);
        let command = state
            .obeys
            .and_then(|obeyed| obeyed.setpoint.command)
            .map(|used| used.id);
        if let Some(command) = command
            && self.last_turn != Some(command)
        {
            self.last_turn = Some(command);
            let began = self.commands.find(command).and_then(|seen| self.states.find(seen));
            self.turns.extend(began.map(|began| (now, now.since(began))));
        }
        self.state = Some((now, state));
    }

    /// Forgets what is older than the window.
    pub(crate) fn forget(&mut self, now: Stamp) {
        let old = |at: Stamp| now.since(at) > WINDOW;
        for stream in self.streams.values_mut() {
            while stream.arrivals.front().is_some_and(|at| old(*at)) {
                stream.arrivals.pop_front();
            }
        }
        while self.turns.front().is_some_and(|(at, _)| old(*at)) {
            self.turns.pop_front();
        }
        self.state = self.state.filter(|(at, _)| !old(*at));
        self.setpoint = self.setpoint.filter(|(at, _)| !old(*at));
    }

    /// A stream's rate over the last `watched` time, at most the window's.
    pub(crate) fn rate(&self, topic: Topic, watched: Nanos) -> Rate {
        let Some(stream) = self.streams.get(&topic) else {
            return Rate::default();
        };
        let seconds = tandem_wire::seconds(watched.clamp(1, WINDOW));
        Rate {
            hz: stream.arrivals.len() as f64 / seconds,
            missed: stream.missed,
            senders: stream.newest.len(),
        }
    }

    /// How old the state was that a command was made from, when the state that obeys it came: all by this watcher's clock,
    /// so it needs nobody else's.
    pub(crate) fn turn(&self) -> Option<Turn> {
        let mut ages: Vec<Nanos> = self.turns.iter().map(|(_, age)| *age).collect();
        ages.sort_unstable();
        let last = ages.len().checked_sub(1)?;
        let at = |percent: usize| tandem_wire::seconds(ages[(ages.len() * percent / 100).min(last)]) * 1e3;
        Some(Turn {
            p50_ms: at(50),
            p99_ms: at(99),
            worst_ms: at(100),
        })
    }

    /// What arbiter and robot have dropped, as they say themselves.
    pub(crate) fn refused(&self) -> (Refusals, Refusals) {
        let arbiter = self.setpoint.map(|(_, setpoint)| setpoint.refused).unwrap_or_default();
        let robot = self.state.map(|(_, state)| state.refused).unwrap_or_default();
        (arbiter, robot)
    }
}

/// The pair of nodes whose wall clocks are furthest apart, and the reporter of the two.
pub(crate) fn worst_skew(clocks: &BTreeMap<NodeName, ClockReport>) -> Option<(NodeName, PeerClock)> {
    let pairs = clocks
        .iter()
        .flat_map(|(node, report)| report.peers.iter().map(|peer| (*node, *peer)));
    pairs.max_by_key(|(_, peer)| peer.skew.unsigned_abs())
}

/// Such a pair in words.
pub(crate) fn skew_words(reporter: NodeName, peer: &PeerClock) -> String {
    let millis = |nanos: u64| tandem_wire::seconds(nanos) * 1e3;
    format!(
        "{:.1} ms ± {:.1} between {reporter} and {}, round trip {:.1} ms",
        millis(peer.skew.unsigned_abs()),
        millis(peer.uncertainty),
        peer.node,
        millis(peer.round_trip_median),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::{Deadman, MILLISECOND, Numbering, Session, Vec3, encode};

    fn at(millis: u64) -> Stamp {
        Stamp(millis * MILLISECOND)
    }

    fn command(numbering: &mut Numbering) -> Vec<u8> {
        let mut bytes = Vec::new();
        let command = Command {
            velocity: Vec3::default(),
            deadman: Deadman::Released,
            seen: None,
        };
        encode(&numbering.envelope(Stamp(0), 0, command), &mut bytes);
        bytes
    }

    #[test]
    fn a_rate_is_that_of_the_window_and_a_gap_is_counted_once() {
        let mut robot = Robot::default();
        let mut numbering = Numbering::new(Session(1));
        for millis in (0..10_000).step_by(20) {
            let bytes = command(&mut numbering);
            if millis != 5000 {
                robot.hear(at(millis), Topic::Command, &bytes);
            }
        }
        robot.forget(at(10_000));
        let rate = robot.rate(Topic::Command, 10 * SECOND);
        assert!((49.0..=51.0).contains(&rate.hz), "{rate:?}");
        assert_eq!((rate.missed, rate.senders), (1, 1));
        robot.forget(at(20_000));
        assert_eq!(robot.rate(Topic::Command, 20 * SECOND).hz, 0.0);
    }

    #[test]
    fn what_cannot_be_read_is_counted_and_changes_nothing() {
        let mut robot = Robot::default();
        let mut bytes = command(&mut Numbering::new(Session(1)));
        robot.hear(at(0), Topic::State, &bytes);
        bytes.pop();
        robot.hear(at(0), Topic::Command, &bytes);
        robot.hear(at(0), Topic::Setpoint, b"");
        assert_eq!(robot.unreadable, 3);
        assert!(robot.state.is_none() && robot.turn().is_none());
    }
}
