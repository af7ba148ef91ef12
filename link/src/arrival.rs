//! A bad line in lockstep: what reaches a node, and at which virtual instant.
//!
//! Everybody waits for every tick's sample, so one that is lost or kept back is told as [`Input::Missed`]: the loop goes
//! on without it. One that was kept back follows at its instant, behind the tick that did not wait for it and before
//! anything of a later one. Shell and world both ask here, so that both give the same.

use tandem_wire::{Input, NodeName, Stamp, Topic, codec};

use crate::impairment::{Fate, Impairment};

/// What a line lets through in lockstep.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// When it reaches the node, in virtual time.
    pub at: Stamp,
    topic: Topic,
    what: What,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum What {
    Sample(Vec<u8>),
    Missed(u32),
}

impl Arrival {
    /// What the node takes in.
    #[must_use]
    pub fn input(&self) -> Input<'_> {
        let topic = self.topic;
        match &self.what {
            What::Sample(bytes) => Input::Sample { topic, bytes },
            What::Missed(tick) => Input::Missed { topic, tick: *tick },
        }
    }

    const fn sample(at: Stamp, topic: Topic, bytes: Vec<u8>) -> Self {
        let what = What::Sample(bytes);
        Self { at, topic, what }
    }
}

impl Impairment {
    /// In lockstep: what reaches the node now that a sample has come at `now`, in this order.
    ///
    /// The robot goes on by a whole period once it knows that a setpoint does not come in time. What comes within that
    /// period reaches it before.
    #[must_use]
    pub fn arrive(&mut self, now: Stamp, topic: Topic, bytes: Vec<u8>) -> Vec<Arrival> {
        let mut arrivals = Vec::new();
        self.release(now, &mut arrivals);
        let (true, Ok((_, header))) = (self.befalls(topic), codec::peek(&bytes)) else {
            arrivals.push(Arrival::sample(now, topic, bytes));
            return arrivals;
        };
        match self.fate(now, topic, header.seq.0) {
            Fate::After(0) => {
                arrivals.push(Arrival::sample(now, topic, bytes));
                return arrivals;
            }
            Fate::After(late) => self.hold(now.after(late), topic, bytes),
            Fate::Lost => {}
        }
        let mut at = now;
        if self.receiver() == NodeName::RobotSim {
            at = now.after(self.period());
            self.release(at, &mut arrivals);
            at = arrivals.last().map_or(now, |arrival| arrival.at.max(now));
        }
        arrivals.push(Arrival {
            at,
            topic,
            what: What::Missed(header.tick),
        });
        arrivals
    }

    fn release(&mut self, until: Stamp, arrivals: &mut Vec<Arrival>) {
        while let Some((at, topic, bytes)) = self.due(until) {
            arrivals.push(Arrival::sample(at, topic, bytes));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impairment::{Direction, Impairments, LineSettings};
    use tandem_wire::{Command, Envelope, Header, MILLISECOND, Seq, Timing, encode};

    fn sample(tick: u32) -> Vec<u8> {
        let header = Header {
            tick,
            seq: Seq(u64::from(tick)),
            ..Header::default()
        };
        let mut bytes = Vec::new();
        let body = Command::default();
        encode(&Envelope { header, body }, &mut bytes);
        bytes
    }

    /// What reaches the receiver of so many ticks' samples: milliseconds, tick, and whether it is the sample itself.
    fn heard(direction: Direction, ticks: u32, line: LineSettings) -> Vec<(u64, u32, bool)> {
        let (timing, topic) = (Timing::default().lockstep(), direction.topic());
        let mut impairments = Impairments::default();
        impairments.set(direction, line);
        let mut line = Impairment::new(&impairments, direction.receiver(), timing);
        let mut heard = Vec::new();
        for tick in 1..=ticks {
            let now = Stamp::of_tick(tick, timing.period);
            for arrival in line.arrive(now, topic, sample(tick)) {
                let millis = arrival.at.0 / MILLISECOND;
                heard.push(match arrival.input() {
                    Input::Sample { bytes, .. } => (millis, codec::peek(bytes).expect("a command").1.tick, true),
                    Input::Missed { tick, .. } => (millis, tick, false),
                    other => panic!("{other:?}"),
                });
            }
        }
        heard
    }

    #[test]
    fn a_late_sample_is_missed_in_its_tick_and_comes_at_its_instant_before_the_next() {
        let late = LineSettings {
            delay_ms: 30.0,
            ..LineSettings::default()
        };
        let heard = heard(Direction::Command, 3, late);
        let expected = [
            (100, 1, false),
            (130, 1, true),
            (200, 2, false),
            (230, 2, true),
            (300, 3, false),
        ];
        assert_eq!(heard, expected);
    }

    #[test]
    fn a_lost_sample_is_missed_and_never_comes() {
        let lost = LineSettings {
            loss: 1.0,
            ..LineSettings::default()
        };
        let heard = heard(Direction::Command, 2, lost);
        assert_eq!(heard, [(100, 1, false), (200, 2, false)]);
    }

    #[test]
    fn a_late_setpoint_reaches_the_robot_before_it_goes_on_without_one() {
        let late = LineSettings {
            delay_ms: 30.0,
            ..LineSettings::default()
        };
        let heard = heard(Direction::Setpoint, 2, late);
        assert_eq!(
            heard,
            [(130, 1, true), (130, 1, false), (230, 2, true), (230, 2, false)]
        );
    }
}
