//! A bad line, on purpose: delay, jitter, loss, reordering and outages of chosen streams, drawn from a seed.
//!
//! It stands between the network and a node, before the journal, so that a journal tells what the node saw and an
//! execution of it needs no bad line. What befalls a sample depends on seed, receiver, stream and sequence number
//! alone: the same trial meets the same line again, whatever else changes.
//!
//! In real time a sample that is late waits for its instant. In lockstep everybody waits for every tick's sample, so
//! one that is late or lost is *answered for*: the node gets [`Passed::Missed`] in its place, goes on with what it has,
//! and the late one comes at the first tick at or after its instant, ahead of that tick's own. Pure: time is an
//! argument.

use std::collections::VecDeque;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use tandem_settings::{choices, settings};
use tandem_wire::{Delivery, MILLISECOND, Nanos, NodeName, Pace, SECOND, Stamp, Timing, Topic, codec};

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
        /// The share of samples that come a message's period and a half later, so that the next one overtakes them.
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

/// What a node gets, and when.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Passed {
    /// The node's time at which it gets it.
    pub at: Stamp,
    /// The stream.
    pub topic: Topic,
    /// A sample, or in lockstep the tick whose sample is not there in time.
    pub what: Arrival,
}

/// A sample, or its absence.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Arrival {
    /// A sample's bytes.
    Sample(Vec<u8>),
    /// In lockstep: nothing arrived in this tick.
    Missed(u32),
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

    /// Takes in a sample at `now`; what it lets through at once is added to `out`. The rest is for [`due`](Self::due).
    pub fn take(&mut self, now: Stamp, topic: Topic, bytes: Vec<u8>, out: &mut VecDeque<Passed>) {
        let read = codec::peek(&bytes);
        let (true, Ok((_, header))) = (self.befalls(topic) && topic.delivery() == Delivery::Stream, read) else {
            // What cannot be read is the node's to refuse.
            return out.push_back(sample(now, topic, bytes));
        };
        let fate = self.fate(now, topic, header.seq.0);
        let lockstep = self.timing.pace == Pace::Lockstep;
        if lockstep {
            self.release(now, Some(topic), out);
        }
        match fate {
            Fate::After(0) => return out.push_back(sample(now, topic, bytes)),
            Fate::After(late) => self.hold(now.after(late), topic, bytes),
            Fate::Lost => {}
        }
        if lockstep {
            out.push_back(Passed {
                at: now,
                topic,
                what: Arrival::Missed(header.tick),
            });
        }
    }

    /// In real time: when the next late sample arrives.
    #[must_use]
    pub fn deadline(&self) -> Option<Stamp> {
        let (at, ..) = self.held.front()?;
        (self.timing.pace == Pace::Real).then_some(*at)
    }

    /// In real time: adds the late samples that have arrived by `now` to `out`.
    pub fn due(&mut self, now: Stamp, out: &mut VecDeque<Passed>) {
        if self.timing.pace == Pace::Real {
            self.release(now, None, out);
        }
    }

    fn release(&mut self, now: Stamp, only: Option<Topic>, out: &mut VecDeque<Passed>) {
        let mut rest = VecDeque::new();
        for (at, topic, bytes) in self.held.drain(..) {
            if at <= now && only.is_none_or(|only| only == topic) {
                out.push_back(sample(now, topic, bytes));
            } else {
                rest.push_back((at, topic, bytes));
            }
        }
        self.held = rest;
    }

    fn hold(&mut self, at: Stamp, topic: Topic, bytes: Vec<u8>) {
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

const fn sample(at: Stamp, topic: Topic, bytes: Vec<u8>) -> Passed {
    Passed {
        at,
        topic,
        what: Arrival::Sample(bytes),
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

    fn line(pace: Pace, change: impl FnOnce(&mut ImpairmentSettings)) -> Impairment {
        let mut settings = ImpairmentSettings {
            streams: vec![Direction::Command],
            ..ImpairmentSettings::default()
        };
        change(&mut settings);
        let timing = Timing {
            pace,
            ..Timing::default()
        };
        Impairment::new(settings, NodeName::Arbiter, timing)
    }

    /// What arrives in lockstep when one command a tick is sent: ticks of samples, and minus the tick for a miss.
    fn lockstep(line: &mut Impairment, ticks: u32) -> Vec<Vec<i64>> {
        let heard = |tick| {
            let (mut out, now) = (VecDeque::new(), Stamp::of_tick(tick, line.timing.period));
            line.take(now, Topic::Command, command(tick), &mut out);
            let of = |passed: Passed| match passed.what {
                Arrival::Sample(bytes) => i64::from(codec::peek(&bytes).expect("a command").1.tick),
                Arrival::Missed(tick) => -i64::from(tick),
            };
            out.into_iter().map(of).collect()
        };
        (1..=ticks).map(heard).collect()
    }

    #[test]
    fn a_line_that_nothing_befalls_lets_everything_through_at_once() {
        assert_eq!(lockstep(&mut line(Pace::Lockstep, |_| {}), 3), [[1], [2], [3]]);
    }

    #[test]
    fn in_lockstep_a_late_sample_is_answered_for_and_comes_at_the_first_tick_after_its_instant() {
        let mut late = line(Pace::Lockstep, |settings| settings.delay_ms = 150.0);
        let heard = lockstep(&mut late, 4);
        assert_eq!(heard, [vec![-1], vec![-2], vec![1, -3], vec![2, -4]]);
    }

    #[test]
    fn an_outage_loses_everything_within_it_and_nothing_else() {
        let mut out = line(Pace::Lockstep, |settings| settings.outages_s = vec![[0.2, 0.2]]);
        assert_eq!(lockstep(&mut out, 5), [[1], [-2], [-3], [4], [5]]);
    }

    #[test]
    fn a_share_of_samples_is_lost_and_the_same_ones_again() {
        let lossy = || line(Pace::Lockstep, |settings| settings.loss = 0.3);
        let heard = lockstep(&mut lossy(), 1000);
        let lost = heard.iter().filter(|heard| heard[0] < 0).count();
        assert!((250..350).contains(&lost), "{lost}");
        assert_eq!(heard, lockstep(&mut lossy(), 1000));
        let mut other = lossy();
        other.settings.seed = 2;
        assert_ne!(heard, lockstep(&mut other, 1000));
    }

    #[test]
    fn in_real_time_a_late_sample_waits_for_its_instant_and_may_be_overtaken() {
        let mut line = line(Pace::Real, |settings| settings.jitter_ms = 100.0);
        let mut out = VecDeque::new();
        let mut order = Vec::new();
        for tick in 1..=50 {
            let now = Stamp(u64::from(tick) * 20 * MILLISECOND);
            line.take(now, Topic::Command, command(tick), &mut out);
            assert!(line.deadline().is_none_or(|at| at <= now.after(100 * MILLISECOND)));
            line.due(now, &mut out);
            order.extend(out.drain(..).map(|passed| match passed.what {
                Arrival::Sample(bytes) => codec::peek(&bytes).expect("a command").1.tick,
                Arrival::Missed(_) => panic!("nothing is missed in real time"),
            }));
        }
        assert!(order.len() > 40 && !order.is_sorted(), "{order:?}");
    }

    #[test]
    fn other_streams_other_receivers_and_noise_pass_untouched() {
        let mut line = line(Pace::Lockstep, |settings| settings.loss = 1.0);
        let mut out = VecDeque::new();
        line.take(Stamp(0), Topic::State, command(1), &mut out);
        line.take(Stamp(0), Topic::Command, vec![1, 2, 3], &mut out);
        assert!(out.iter().all(|passed| matches!(passed.what, Arrival::Sample(_))));
        assert_eq!(out.len(), 2);
    }

    #[test]
    fn the_defaults_read_back_as_they_print() {
        let text = tandem_settings::show(&ImpairmentSettings::default());
        let document = tandem_settings::Document::parse("defaults", &text).expect("TOML");
        assert_eq!(document.section(), Ok(ImpairmentSettings::default()));
    }
}
