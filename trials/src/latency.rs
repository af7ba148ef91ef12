//! Command-to-motion latency, from the nodes' own journals and the robot's own word.
//!
//! `latency = (setpoint arrives at robot-sim) − (operator publishes the command it was made from) + (first inner tick
//! under it) − (its arrival)`. The first two are read off one process's monotonic clock, the last two off the robot's.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use tandem_wire::{Command, Happening, JournalBatch, NodeName, Setpoint, Stamp, State, Topic, decode, seconds};

/// Collects what it takes, and pairs it at the end.
#[derive(Debug, Default)]
pub(crate) struct Latency {
    /// Command number → when it was published.
    published: BTreeMap<u64, Stamp>,
    /// Setpoint number → the command it was made from.
    made_from: BTreeMap<u64, u64>,
    /// Command number → when the first setpoint made from it reached the robot; an arbiter may repeat it.
    arrived: BTreeMap<u64, Stamp>,
    /// Setpoint number → how long the robot took from its arrival to the first inner tick under it.
    taken_up: BTreeMap<u64, u64>,
}

/// Latency at two quantiles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quantiles {
    /// Half of the commands were faster.
    pub p50_ms: f64,
    /// All but one in a hundred were faster.
    pub p99_ms: f64,
}

impl Latency {
    pub(crate) fn see_journal(&mut self, node: NodeName, batch: &JournalBatch) {
        for entry in &batch.entries {
            match (node, &entry.what) {
                (
                    NodeName::Operator,
                    Happening::Output {
                        topic: Topic::Command,
                        bytes,
                    },
                ) => {
                    if let Ok(command) = decode::<Command>(bytes) {
                        self.published.insert(command.header.seq.0, entry.wall);
                    }
                }
                (
                    NodeName::RobotSim,
                    Happening::Sample {
                        topic: Topic::Setpoint,
                        bytes,
                    },
                ) => {
                    if let Ok(setpoint) = decode::<Setpoint>(bytes)
                        && let Some(command) = setpoint.body.command
                    {
                        self.made_from.insert(setpoint.header.seq.0, command.id.seq.0);
                        self.arrived.entry(command.id.seq.0).or_insert(entry.wall);
                    }
                }
                _ => {}
            }
        }
    }

    pub(crate) fn see_state(&mut self, state: &State) {
        if let Some(obeyed) = state.obeys
            && obeyed.setpoint.motion.is_permitted()
        {
            self.taken_up
                .insert(obeyed.id.seq.0, obeyed.moved.since(obeyed.arrived));
        }
    }

    /// `None` if no command could be followed to the robot.
    pub(crate) fn quantiles(&self) -> Option<Quantiles> {
        let mut latencies: Vec<f64> = self
            .taken_up
            .iter()
            .filter_map(|(setpoint, taken_up)| {
                let command = self.made_from.get(setpoint)?;
                let (published, arrived) = (self.published.get(command)?, self.arrived.get(command)?);
                Some(seconds(arrived.since(*published) + taken_up) * 1e3)
            })
            .collect();
        latencies.sort_by(f64::total_cmp);
        let at =
            |percent: usize| latencies.get((latencies.len() * percent / 100).min(latencies.len().saturating_sub(1)));
        Some(Quantiles {
            p50_ms: *at(50)?,
            p99_ms: *at(99)?,
        })
    }
}
