//! A bad line, on purpose: delay, jitter, loss, reordering and outages of chosen streams, drawn from a seed.
//!
//! It stands between the network and a node, before the journal, so that a journal tells what the node saw and an
//! execution of it needs no bad line. What befalls a sample depends on seed, receiver, stream and sequence number
//! alone: the same trial meets the same line again, whatever else changes.
//!
//! [`Impairments`] says which streams it befalls and how. Every line ends in a shell: the *receiver's*. So "commands" are
//! those on their way to the arbiter, and states have a line of their own to each of the three who listen to them.
//!
//! In lockstep everybody waits for every tick's sample: [`arrival`](crate::Arrival) says what becomes of one that is
//! kept back there. Pure: time is an argument.

mod lines;

use std::collections::VecDeque;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use tandem_wire::{MILLISECOND, Nanos, NodeName, SECOND, Stamp, Timing, Topic, codec};

pub use lines::{Direction, ImpairmentSettings, Impairments, LineSettings};

/// What befalls a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It arrives so much later than it did; usually not at all.
    After(Nanos),
    /// It never arrives.
    Lost,
}

/// The line to one node.
#[derive(Clone, Debug)]
pub struct Impairment {
    /// What befalls the streams that were chosen; the others have none.
    lines: Vec<(Topic, LineSettings)>,
    receiver: NodeName,
    timing: Timing,
    /// Late samples with the instant at which they arrive, earliest first.
    held: VecDeque<(Stamp, Topic, Vec<u8>)>,
}

impl Impairment {
    /// The line to `receiver`.
    #[must_use]
    pub fn new(impairments: &Impairments, receiver: NodeName, timing: Timing) -> Self {
        let here = impairments
            .lines()
            .filter(|(direction, _)| direction.receiver() == receiver);
        Self {
            lines: here.map(|(direction, line)| (direction.topic(), line)).collect(),
            receiver,
            timing,
            held: VecDeque::new(),
        }
    }

    /// Whether samples of a stream may be late or lost.
    #[must_use]
    pub fn befalls(&self, topic: Topic) -> bool {
        self.line(topic).is_some()
    }

    /// Whether any stream to this receiver was chosen.
    #[must_use]
    pub const fn is_bad(&self) -> bool {
        !self.lines.is_empty()
    }

    fn line(&self, topic: Topic) -> Option<&LineSettings> {
        let mut lines = self.lines.iter();
        lines.find(|(of, _)| *of == topic).map(|(_, line)| line)
    }

    pub(crate) const fn receiver(&self) -> NodeName {
        self.receiver
    }

    pub(crate) const fn period(&self) -> Nanos {
        self.timing.period
    }

    /// Takes in a sample that arrives at `now`. Given back, it may be heard at once; otherwise it is lost, or waits for
    /// its instant.
    pub fn take(&mut self, now: Stamp, topic: Topic, bytes: Vec<u8>) -> Option<Vec<u8>> {
        if !self.befalls(topic) {
            return Some(bytes);
        }
        let Ok((_, header)) = codec::peek(&bytes) else {
            // What cannot be read is the node's to refuse.
            return Some(bytes);
        };
        match self.fate(now, topic, header.seq.0) {
            Fate::After(0) => Some(bytes),
            Fate::After(late) => {
                self.hold(now.after(late), topic, bytes);
                None
            }
            Fate::Lost => None,
        }
    }

    /// When the next sample that is late arrives.
    #[must_use]
    pub fn deadline(&self) -> Option<Stamp> {
        self.held.front().map(|(at, ..)| *at)
    }

    /// The next sample that was late and has arrived by `now`, with the instant at which it did.
    pub fn due(&mut self, now: Stamp) -> Option<(Stamp, Topic, Vec<u8>)> {
        self.held.pop_front_if(|(at, ..)| *at <= now)
    }

    pub(crate) fn hold(&mut self, at: Stamp, topic: Topic, bytes: Vec<u8>) {
        let behind = self.held.iter().take_while(|(other, ..)| *other <= at).count();
        self.held.insert(behind, (at, topic, bytes));
    }

    /// What befalls sample number `seq` of a stream that would arrive at `now`.
    #[must_use]
    pub fn fate(&self, now: Stamp, topic: Topic, seq: u64) -> Fate {
        let Some(line) = self.line(topic) else {
            return Fate::After(0);
        };
        let mut draws = self.draws(topic, line.seed, seq);
        let [loss, reorder, jitter] = std::array::from_fn(|_| unit(draws.next_u64()));
        if loss < line.loss || is_out(line, now) {
            return Fate::Lost;
        }
        let overtaken = if reorder < line.reorder {
            self.timing.message_period() / 2 * 3
        } else {
            0
        };
        Fate::After(nanos(line.delay_ms + line.jitter_ms * jitter, MILLISECOND).saturating_add(overtaken))
    }

    fn draws(&self, topic: Topic, seed: u64, seq: u64) -> ChaCha8Rng {
        let mut key = *b"................tandem link line";
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8] = topic.kind();
        key[9] = self.receiver as u8;
        let mut generator = ChaCha8Rng::from_seed(key);
        generator.set_stream(seq);
        generator
    }
}

/// Whether nothing passes at `now`.
fn is_out(line: &LineSettings, now: Stamp) -> bool {
    line.outages_s.iter().any(|&[begin, length]| {
        let begin = Stamp(nanos(begin, SECOND));
        now >= begin && now.since(begin) < nanos(length, SECOND)
    })
}

/// From 0 to 1, 1 excluded, with 53 bits.
fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1_u64 << 53) as f64
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the ranges above keep it positive and far below the end of time"
)]
fn nanos(amount: f64, unit: Nanos) -> Nanos {
    (amount * unit as f64).round() as Nanos
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::{Command, Envelope, Header, Seq, encode};

    fn command(tick: u32) -> Vec<u8> {
        let header = Header {
            tick,
            seq: Seq(u64::from(tick)),
            ..Header::default()
        };
        let mut bytes = Vec::new();
        encode(
            &Envelope {
                header,
                body: Command::default(),
            },
            &mut bytes,
        );
        bytes
    }

    fn line(change: impl FnOnce(&mut LineSettings)) -> Impairment {
        let mut line = LineSettings::default();
        change(&mut line);
        let mut impairments = Impairments::default();
        impairments.set(Direction::Command, line);
        Impairment::new(&impairments, NodeName::Arbiter, Timing::default())
    }

    /// Sends so many commands, one every 20 ms from 20 ms on; which arrive, and when, in milliseconds.
    fn heard(line: &mut Impairment, count: u32) -> Vec<(u32, u64)> {
        let number = |bytes: &[u8]| codec::peek(bytes).expect("a command").1.tick;
        let mut heard = Vec::new();
        for tick in 1..=count {
            let now = Stamp(u64::from(tick) * 20 * MILLISECOND);
            while let Some((at, topic, bytes)) = line.due(now) {
                assert_eq!(topic, Topic::Command);
                heard.push((number(&bytes), at.0 / MILLISECOND));
            }
            if let Some(bytes) = line.take(now, Topic::Command, command(tick)) {
                heard.push((number(&bytes), now.0 / MILLISECOND));
            }
        }
        heard
    }

    #[test]
    fn a_line_that_nothing_befalls_lets_everything_through_at_once() {
        assert_eq!(heard(&mut line(|_| {}), 3), [(1, 20), (2, 40), (3, 60)]);
    }

    #[test]
    fn a_delay_brings_every_sample_later_and_in_order() {
        let mut late = line(|settings| settings.delay_ms = 35.0);
        assert_eq!(heard(&mut late, 4), [(1, 55), (2, 75)]);
        assert_eq!(late.deadline(), Some(Stamp(95 * MILLISECOND)));
    }

    #[test]
    fn an_outage_loses_everything_within_it_and_nothing_else() {
        let mut out = line(|settings| settings.outages_s = vec![[0.04, 0.04]]);
        assert_eq!(heard(&mut out, 5), [(1, 20), (4, 80), (5, 100)]);
    }

    #[test]
    fn a_share_of_samples_is_lost_and_the_same_ones_again() {
        let lossy = || line(|settings| settings.loss = 0.3);
        let through = heard(&mut lossy(), 1000);
        assert!((650..750).contains(&through.len()), "{}", through.len());
        assert_eq!(through, heard(&mut lossy(), 1000));
        let mut other = line(|settings| {
            settings.loss = 0.3;
            settings.seed = 2;
        });
        assert_ne!(through, heard(&mut other, 1000));
    }

    #[test]
    fn samples_that_are_reordered_are_overtaken_by_the_next() {
        let all = heard(&mut line(|settings| settings.reorder = 0.5), 200);
        let inversions = all.windows(2).filter(|pair| pair[0].0 > pair[1].0).count();
        assert!(inversions > 30, "{inversions}");
        assert!(all.len() >= 198, "nothing is lost: {}", all.len());
    }

    #[test]
    fn other_streams_and_what_cannot_be_read_pass_untouched() {
        let mut lossy = line(|settings| settings.loss = 1.0);
        assert_eq!(lossy.take(Stamp(0), Topic::Command, command(1)), None);
        assert!(lossy.take(Stamp(0), Topic::State, command(1)).is_some());
        assert_eq!(lossy.take(Stamp(0), Topic::Command, vec![1, 2, 3]), Some(vec![1, 2, 3]));
    }

    #[test]
    fn every_stream_has_its_own_line_at_its_own_receiver() {
        let mut impairments = Impairments::default();
        impairments.all.streams = vec![Direction::Proposal, Direction::StateToOperator];
        impairments.all.loss = 1.0;
        let delay_ms = 30.0;
        let late = LineSettings {
            delay_ms,
            ..LineSettings::default()
        };
        impairments.set(Direction::Command, late);
        let to = |receiver| Impairment::new(&impairments, receiver, Timing::default());
        let (arbiter, operator, robot) = (to(NodeName::Arbiter), to(NodeName::Operator), to(NodeName::RobotSim));
        let fate = |line: &Impairment, topic| line.fate(Stamp(0), topic, 1);
        assert_eq!(fate(&arbiter, Topic::Command), Fate::After(30 * MILLISECOND));
        assert_eq!(fate(&arbiter, Topic::Proposal), Fate::Lost);
        assert_eq!(fate(&arbiter, Topic::State), Fate::After(0));
        assert_eq!(fate(&operator, Topic::State), Fate::Lost);
        assert!(!robot.is_bad() && arbiter.is_bad());
    }
}
