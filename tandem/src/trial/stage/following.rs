//! One trial, followed from outside: whether it goes on, and how it ended.

use std::time::{Duration, Instant};

use anyhow::bail;
use crossbeam_channel::Receiver;
use tandem_link::{Running, Sighting};
use tandem_trials::Tracer;
use tandem_wire::{NodeName, Pace, Stamp, State, Topic, codec, decode};

use super::{GATHERING, POLL, Stage};

/// This long without a state means that somebody does not answer.
const STALL: Duration = Duration::from_secs(2);

/// How a trial came to its end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum End {
    /// The human let go for good.
    Over,
    /// The time limit passed.
    TimeUp,
    /// It cannot go on, for this reason.
    Aborted(String),
    /// The person wants it to end: once more from the start, or for now.
    Left { repeat: bool },
    /// The program shall end.
    Interrupted,
}

impl std::fmt::Display for End {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Over => f.write_str("over"),
            Self::TimeUp => f.write_str("time is up"),
            Self::Aborted(why) => write!(f, "aborted: {}", why.chars().take(200).collect::<String>()),
            Self::Left { repeat: true } => f.write_str("to be repeated"),
            Self::Left { repeat: false } => f.write_str("left"),
            Self::Interrupted => f.write_str("interrupted"),
        }
    }
}

/// Whose message of a tick is awaited, in the order in which they follow each other.
const RELAY: [(Topic, NodeName); 4] = [
    (Topic::State, NodeName::RobotSim),
    (Topic::Command, NodeName::Operator),
    (Topic::Proposal, NodeName::Predictor),
    (Topic::Setpoint, NodeName::Arbiter),
];

/// Follows one trial from outside, as any listener could.
pub(crate) struct Following<'a> {
    pub(super) tracer: Tracer,
    pub(super) nodes: &'a [(NodeName, Running)],
    pub(super) stage: &'a mut Stage,
    pub(super) interrupted: &'a Receiver<()>,
    pub(super) newest: [Option<u32>; 4],
    /// When the last state came.
    pub(super) progressed: Instant,
    /// When the trial's first state came.
    pub(super) began: Option<Stamp>,
    pub(super) limit_ticks: u32,
}

impl Following<'_> {
    /// Waits for the end of a trial that drives itself. `show` sees how far it is.
    pub(crate) fn until_over(&mut self, mut show: impl FnMut(&Tracer)) -> End {
        loop {
            if let Some(end) = self.poll(POLL) {
                return end;
            }
            show(&self.tracer);
        }
    }

    /// The trial so far.
    pub(crate) const fn tracer(&self) -> &Tracer {
        &self.tracer
    }

    /// The operator's node, for whoever has a keyboard.
    pub(crate) fn operator(&self) -> Option<&Running> {
        self.nodes.first().map(|(_, node)| node)
    }

    /// Takes in the next thing that is seen within `wait`; says how the trial ended, if it did.
    pub(crate) fn poll(&mut self, wait: Duration) -> Option<End> {
        if self.interrupted.try_recv().is_ok() {
            return Some(End::Interrupted);
        }
        match self.stage.observer.next(wait) {
            Some(sighting) => self.see(&sighting),
            None => {
                if let Some(gone) = self.gone() {
                    return Some(End::Aborted(gone));
                }
            }
        }
        if self.tracer.is_over() {
            Some(End::Over)
        } else if self.tracer.elapsed_ticks() >= self.limit_ticks {
            Some(End::TimeUp)
        } else {
            None
        }
    }

    fn see(&mut self, sighting: &Sighting) {
        if let Sighting::Sample { topic, bytes, at } = sighting {
            if let Some(place) = RELAY.iter().position(|(relayed, _)| relayed == topic)
                && let Ok((_, header)) = codec::peek(bytes)
            {
                self.newest[place] = Some(header.tick);
            }
            if *topic == Topic::State {
                self.progressed = Instant::now();
                if self.began.is_none() && decode::<State>(bytes).is_ok_and(|state| state.body.trial > 0) {
                    self.began = Some(*at);
                }
            }
        }
        self.stage.see(sighting, &mut self.tracer);
    }

    /// Why the trial cannot go on, if it cannot.
    fn gone(&self) -> Option<String> {
        if let Some((name, _)) = self.nodes.iter().find(|(_, node)| node.is_finished()) {
            return Some(format!("{name} ended in the middle of the trial"));
        }
        (self.progressed.elapsed() > STALL)
            .then(|| format!("no state for {} s: {} does not answer", STALL.as_secs(), self.awaited()))
    }

    /// In lockstep: whose message of the newest tick is missing.
    fn awaited(&self) -> NodeName {
        let newest = self.newest[0];
        let missing = RELAY.iter().zip(self.newest).find(|(_, tick)| *tick < newest);
        match (self.stage.pace, missing) {
            (Pace::Lockstep, Some(((_, node), _))) => *node,
            _ => NodeName::RobotSim,
        }
    }

    /// Waits until all five nodes are there.
    pub(super) fn gather(&mut self) -> anyhow::Result<()> {
        let limit = Instant::now() + GATHERING;
        while let Some(name) = NodeName::ALL
            .into_iter()
            .find(|name| !self.stage.present.contains(name))
        {
            match self.stage.observer.next(POLL) {
                Some(sighting) => self.see(&sighting),
                None if self.gone_early() => bail!("{name} did not come up"),
                None if Instant::now() > limit => bail!("{name} did not come up within {} s", GATHERING.as_secs()),
                None => {}
            }
        }
        Ok(())
    }

    fn gone_early(&self) -> bool {
        self.nodes.iter().any(|(_, node)| node.is_finished())
    }
}
