//! The hops by name, and how long each took.

use std::collections::VecDeque;

use hdrhistogram::Histogram;
use tandem_wire::Nanos;

/// Measurements that are recent: ten seconds' worth at 50 Hz.
const RECENT: usize = 512;
/// What the histograms tell apart: from a tenth of a microsecond to an hour, to one part in a hundred.
const SHORTEST: Nanos = 100;
const LONGEST: Nanos = 3_600_000_000_000;
const DIGITS: u8 = 2;

/// A part of the loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Hop {
    /// A device's sample waits at the operator until a command is made of it.
    Device,
    /// The command travels to the arbiter.
    Command,
    /// The arbiter makes a setpoint of it.
    Decision,
    /// The setpoint travels to the robot.
    Setpoint,
    /// It waits there for the first inner tick under it.
    Uptake,
    /// That tick waits for the first state that tells of it.
    Report,
    /// A state travels to the operator.
    State,
    /// All from sending a command to the first inner tick under it.
    CommandToMotion,
    /// From sending a state to the arrival of the setpoint made of the command that answers it.
    Loop,
}

/// Which clocks a hop is measured by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Basis {
    /// One clock sees both ends.
    OneClock,
    /// Two clocks, corrected by their offset.
    Corrected,
}

impl Hop {
    /// All hops, in the loop's order; the sums last.
    pub const ALL: [Self; 9] = [
        Self::Device,
        Self::Command,
        Self::Decision,
        Self::Setpoint,
        Self::Uptake,
        Self::Report,
        Self::State,
        Self::CommandToMotion,
        Self::Loop,
    ];

    /// Its name in files and plots.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Device => "device",
            Self::Command => "command",
            Self::Decision => "decision",
            Self::Setpoint => "setpoint",
            Self::Uptake => "uptake",
            Self::Report => "report",
            Self::State => "state",
            Self::CommandToMotion => "command_to_motion",
            Self::Loop => "loop",
        }
    }

    /// The hop of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|hop| hop.as_str() == name)
    }

    /// What it is, for people.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Device => "device → command",
            Self::Command => "operator → arbiter",
            Self::Decision => "arbiter decides",
            Self::Setpoint => "arbiter → robot",
            Self::Uptake => "robot takes it up",
            Self::Report => "motion → state",
            Self::State => "robot → operator",
            Self::CommandToMotion => "command to motion",
            Self::Loop => "state to setpoint (loop)",
        }
    }

    /// Which clocks it is measured by.
    #[must_use]
    pub const fn basis(self) -> Basis {
        match self {
            Self::Command | Self::Setpoint | Self::State | Self::CommandToMotion => Basis::Corrected,
            Self::Device | Self::Decision | Self::Uptake | Self::Report | Self::Loop => Basis::OneClock,
        }
    }
}

/// Half, 95 and 99 of a hundred took at most so long.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Percentiles {
    /// The median.
    pub p50: Nanos,
    /// All but one in twenty.
    pub p95: Nanos,
    /// All but one in a hundred.
    pub p99: Nanos,
}

/// How long a hop took.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HopBudget {
    /// Which hop.
    pub hop: Hop,
    /// How often it was measured.
    pub count: u64,
    /// Of all measurements, to one part in a hundred.
    pub all: Percentiles,
    /// The longest of all.
    pub worst: Nanos,
    /// Of the newest 512 measurements.
    pub recent: Percentiles,
    /// By how much the newest may be off, for its clocks' offset is uncertain; 0 where one clock saw both ends.
    pub uncertainty: Nanos,
}

/// One measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Measured {
    pub(super) nanos: Nanos,
    pub(super) uncertainty: Nanos,
}

impl Measured {
    pub(super) const fn exact(nanos: Nanos) -> Self {
        Self { nanos, uncertainty: 0 }
    }
}

/// All hops' measurements.
#[derive(Clone, Debug)]
pub(super) struct Timings([Timing; Hop::ALL.len()]);

#[derive(Clone, Debug)]
struct Timing {
    hop: Hop,
    all: Histogram<u64>,
    recent: VecDeque<Nanos>,
    uncertainty: Nanos,
}

impl Default for Timings {
    fn default() -> Self {
        Self(Hop::ALL.map(|hop| Timing {
            hop,
            all: Histogram::new_with_bounds(SHORTEST, LONGEST, DIGITS).expect("bounds and digits that it can have"),
            recent: VecDeque::with_capacity(RECENT),
            uncertainty: 0,
        }))
    }
}

impl Timings {
    pub(super) fn add(&mut self, hop: Hop, measured: Measured) {
        let Some(timing) = self.0.iter_mut().find(|timing| timing.hop == hop) else {
            return;
        };
        timing.all.saturating_record(measured.nanos);
        if timing.recent.len() == RECENT {
            timing.recent.pop_front();
        }
        timing.recent.push_back(measured.nanos);
        timing.uncertainty = measured.uncertainty;
    }

    pub(super) fn extend(&mut self, hop: Hop, measured: Option<Measured>) {
        if let Some(measured) = measured {
            self.add(hop, measured);
        }
    }

    pub(super) fn hops(&self) -> Vec<HopBudget> {
        let measured = self.0.iter().filter(|timing| !timing.recent.is_empty());
        measured.map(Timing::budget).collect()
    }
}

impl Timing {
    fn budget(&self) -> HopBudget {
        let all = |quantile: f64| self.all.value_at_quantile(quantile);
        let mut sorted: Vec<Nanos> = self.recent.iter().copied().collect();
        sorted.sort_unstable();
        let recent = |percent: usize| {
            let place = (sorted.len() * percent / 100).min(sorted.len().saturating_sub(1));
            sorted.get(place).copied().unwrap_or(0)
        };
        HopBudget {
            hop: self.hop,
            count: self.all.len(),
            all: Percentiles {
                p50: all(0.5),
                p95: all(0.95),
                p99: all(0.99),
            },
            worst: self.all.max(),
            recent: Percentiles {
                p50: recent(50),
                p95: recent(95),
                p99: recent(99),
            },
            uncertainty: self.uncertainty,
        }
    }
}
