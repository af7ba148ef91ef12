//! A bad line, on purpose: delay, jitter, loss, reordering and outages of chosen streams, drawn from a seed.
//!
//! It stands between the network and a node, before the journal, so that a journal tells what the node saw and an
//! execution of it needs no bad line. What befalls a sample depends on seed, receiver, stream and sequence number
//! alone: the same trial meets the same line again, whatever else changes.
//!
//! In lockstep everybody waits for every tick's sample: [`arrival`](crate::Arrival) says what becomes of one that is
//! kept back there. Pure: time is an argument.

use std::collections::VecDeque;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use tandem_settings::{choices, settings};
use tandem_wire::{MILLISECOND, Nanos, NodeName, SECOND, Stamp, Timing, Topic, codec};

choices! {
    /// A stream in one direction: what it carries, and to whom.
    pub enum Direction {
        /// Commands to the arbiter.
        Command = "command",
        /// Proposals to the arbiter.
        Proposal = "proposal",
        /// Setpoints to the robot.
        Setpoint = "setpoint",
        /// States to the operator.
        StateToOperator = "state-to-operator",
        /// States to the predictor.
        StateToPredictor = "state-to-predictor",
        /// States to the arbiter.
        StateToArbiter = "state-to-arbiter",
    }
}

settings! {
    /// A bad line, on purpose. Every stream chosen here is drawn for itself.
    pub struct ImpairmentSettings("impairment") {
        /// Which streams it befalls; none: none.
        pub streams: Vec<Direction> = [];
        /// How late every sample is, in milliseconds.
        pub delay_ms: f64 = 0.0, in 0.0..=10000.0;
        /// How much later still, at most; drawn evenly, in milliseconds.
        pub jitter_ms: f64 = 0.0, in 0.0..=10000.0;
        /// The share of samples that are lost.
        pub loss: f64 = 0.0, in 0.0..=1.0;
        /// The share of samples each of which comes a message's period and a half later, so that the next one overtakes it.
        pub reorder: f64 = 0.0, in 0.0..=1.0;
        /// When nothing passes: begin and length, in seconds of the receiver's time.
        pub outages_s: Vec<[f64; 2]> = [], in 0.0..=1000000.0;
        /// What all of it is drawn from.
        pub seed: u64 = 1;
    }
}

impl Direction {
    /// The direction of a stream that `receiver` listens to.
    const fn of(receiver: NodeName, topic: Topic) -> Option<Self> {
        match (receiver, topic) {
            (NodeName::Arbiter, Topic::Command) => Some(Self::Command),
            (NodeName::Arbiter, Topic::Proposal) => Some(Self::Proposal),
            (NodeName::RobotSim, Topic::Setpoint) => Some(Self::Setpoint),
            (NodeName::Operator, Topic::State) => Some(Self::StateToOperator),
            (NodeName::Predictor, Topic::State) => Some(Self::StateToPredictor),
            (NodeName::Arbiter, Topic::State) => Some(Self::StateToArbiter),
            _ => None,
        }
    }
}

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
    settings: ImpairmentSettings,
    receiver: NodeName,
    timing: Timing,
    /// Late samples with the instant at which they arrive, earliest first.
    held: VecDeque<(Stamp, Topic, Vec<u8>)>,
}

impl Impairment {
    /// The line to `receiver`.
    #[must_use]
    pub const fn new(settings: ImpairmentSettings, receiver: NodeName, timing: Timing) -> Self {
        Self {
            settings,
            receiver,
            timing,
            held: VecDeque::new(),
        }
    }

    /// Whether samples of a stream may be late or lost.
    #[must_use]
    pub fn befalls(&self, topic: Topic) -> bool {
        Direction::of(self.receiver, topic).is_some_and(|direction| self.settings.streams.contains(&direction))
    }

    /// Whether any stream is chosen.
    #[must_use]
    pub const fn is_bad(&self) -> bool {
        !self.settings.streams.is_empty()
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
        let read = codec::peek(&bytes);
        let (true, Ok((_, header))) = (self.befalls(topic), read) else {
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
        let settings = &self.settings;
        let mut draws = self.draws(topic, seq);
        let [loss, reorder, jitter] = std::array::from_fn(|_| unit(draws.next_u64()));
        if loss < settings.loss || self.is_out(now) {
            return Fate::Lost;
        }
        let overtaken = if reorder < settings.reorder {
            self.timing.message_period() / 2 * 3
        } else {
            0
        };
        Fate::After(nanos(settings.delay_ms + settings.jitter_ms * jitter, MILLISECOND).saturating_add(overtaken))
    }

    fn is_out(&self, now: Stamp) -> bool {
        self.settings.outages_s.iter().any(|&[begin, length]| {
            let begin = Stamp(nanos(begin, SECOND));
            now >= begin && now.since(begin) < nanos(length, SECOND)
        })
    }

    fn draws(&self, topic: Topic, seq: u64) -> ChaCha8Rng {
        let mut key = *b"................tandem link line";
        key[..8].copy_from_slice(&self.settings.seed.to_le_bytes());
        key[8] = topic.kind();
        key[9] = self.receiver as u8;
        let mut generator = ChaCha8Rng::from_seed(key);
        generator.set_stream(seq);
        generator
    }
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

    fn line(change: impl FnOnce(&mut ImpairmentSettings)) -> Impairment {
        let mut settings = ImpairmentSettings {
            streams: vec![Direction::Command],
            ..ImpairmentSettings::default()
        };
        change(&mut settings);
        Impairment::new(settings, NodeName::Arbiter, Timing::default())
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
        let mut other = lossy();
        other.settings.seed = 2;
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
    fn the_defaults_read_back_as_they_print() {
        let text = tandem_settings::show(&ImpairmentSettings::default());
        let document = tandem_settings::Document::parse("defaults", &text).expect("TOML");
        assert_eq!(document.section(), Ok(ImpairmentSettings::default()));
    }
}
