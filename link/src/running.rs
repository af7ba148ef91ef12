//! A node at work, as whoever started it sees it: what the shell is told, what it tells, and what waits in between.

use std::thread::JoinHandle;

use tandem_wire::{Input, NodeInfo, NodeName, Stamp, Timing, Topic};

use crate::Clock;
use crate::config::ClockSettings;
use crate::dropped::Dropped;
use crate::entrance::Door;
use crate::faults::Faults;
use crate::impairment::Impairments;
use crate::journal::JournalReport;
use crate::spool::SpoolOptions;

/// What the shell needs to know besides the node.
#[derive(Clone, Debug)]
pub struct ShellOptions {
    /// Rates, and what drives time.
    pub timing: Timing,
    /// What the node answers when asked who it is. Its session is this run's.
    pub info: NodeInfo,
    /// In lockstep: the peers that must be there before the first step.
    pub await_peers: Vec<NodeName>,
    /// What befalls samples on their way to the node.
    pub impairment: Impairments,
    /// Where the journal is kept for a recorder that misses some of it.
    pub spool: SpoolOptions,
    /// What is lost on purpose.
    pub faults: Faults,
    /// How the peers' clocks are watched, in real time.
    pub clocks: ClockSettings,
    /// Inputs that may wait for the node, at least one. In real time more cost the oldest ones, which are counted.
    pub queue: usize,
}

impl ShellOptions {
    /// Inputs that may wait for a node that decides: at the rates of a session far more than it may be behind.
    pub const QUEUE: usize = 512;
}

/// What became of a node's run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Steps taken.
    pub steps: u64,
    /// Inputs dropped because the node could not keep up, or took them up too late.
    pub dropped: u64,
    /// The journal.
    pub journal: JournalReport,
    /// In lockstep: the node that was waited for in vain, if that ended the run.
    pub awaited: Option<NodeName>,
}

/// A node at work.
#[derive(Debug)]
pub struct Running {
    pub(crate) door: Door,
    pub(crate) dropped: Dropped,
    pub(crate) thread: JoinHandle<Report>,
}

impl Running {
    /// Asks the node to end: it says goodbye, its journal is flushed.
    pub fn stop(&self) {
        // A node that is gone has stopped.
        let _ = self.door.put(Item::Stop);
    }

    /// Waits until the node has ended. `None` if its thread panicked.
    #[must_use]
    pub fn join(self) -> Option<Report> {
        self.thread.join().ok()
    }

    /// Whether the node has ended.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.thread.is_finished()
    }

    /// What its full queue has cost so far; the count goes on.
    #[must_use]
    pub fn dropped(&self) -> Dropped {
        self.dropped.clone()
    }

    /// The way in for raw samples of a device in this process.
    #[must_use]
    pub fn device(&self) -> Device {
        Device {
            door: self.door.clone(),
        }
    }
}

/// The way in for raw samples of a device in this process.
#[derive(Clone, Debug)]
pub struct Device {
    door: Door,
}

impl Device {
    /// Hands a sample to the node; says whether it was taken.
    #[must_use]
    pub fn send(&self, bytes: Vec<u8>) -> bool {
        self.door.offer(Item::Sample {
            topic: Topic::Device,
            bytes,
            arrived: Clock::of_process().now(),
        })
    }
}

pub(crate) enum Item {
    Sample {
        topic: Topic,
        bytes: Vec<u8>,
        arrived: Stamp,
    },
    Presence {
        peer: NodeName,
        alive: bool,
    },
    Stop,
}

impl Item {
    pub(crate) fn input(&self) -> Input<'_> {
        match self {
            Self::Sample { topic, bytes, .. } => Input::Sample { topic: *topic, bytes },
            Self::Presence { peer, alive } => Input::Presence {
                peer: *peer,
                alive: *alive,
            },
            Self::Stop => Input::Stop,
        }
    }
}
