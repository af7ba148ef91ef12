//! `tandem bench`: how quick the loop is and how much a router carries, on this machine, over loopback.
//!
//! Every measurement runs its sides as processes of their own ([`part`]): this program starts them, waits, and reads what
//! they tell at their end. Clocks of two processes of one machine are put together exactly (`clock.rs`). docs/figures-network.md
//! says what came of it.

mod bulk;
mod child;
mod clock;
mod fleet;
mod latency;
mod part;
mod payload;
mod tap;

use clap::Subcommand;

use crate::Outcome;

#[derive(Subcommand)]
pub(crate) enum BenchCommands {
    /// Operator to robot over loopback TCP, two processes, against a bare Zenoh chain of the same hops and payload.
    Latency(latency::LatencyFlags),
    /// The same with and without a recorder, a viewer and bulk traffic through the router.
    Bulk(bulk::BulkFlags),
    /// Many robots through one router: how many commands come late.
    Fleet(fleet::FleetFlags),
    /// One side of a measurement.
    #[command(hide = true)]
    Part(part::PartFlags),
}

pub(crate) fn run(command: &BenchCommands) -> anyhow::Result<Outcome> {
    match command {
        BenchCommands::Latency(flags) => latency::run(flags),
        BenchCommands::Bulk(flags) => bulk::run(flags),
        BenchCommands::Fleet(flags) => fleet::run(flags),
        BenchCommands::Part(flags) => part::run(flags),
    }
}

/// Milliseconds at some quantiles of what was measured.
#[derive(serde::Serialize)]
struct Figures {
    messages: usize,
    p50_ms: f64,
    p95_ms: f64,
    p99_ms: f64,
    worst_ms: f64,
}

impl Figures {
    /// `None` of nothing.
    fn of(mut latencies_ms: Vec<f64>) -> Option<Self> {
        latencies_ms.sort_by(f64::total_cmp);
        let at = |level| tandem_trials::statistics::quantile(&latencies_ms, level);
        Some(Self {
            messages: latencies_ms.len(),
            p50_ms: at(0.5)?,
            p95_ms: at(0.95)?,
            p99_ms: at(0.99)?,
            worst_ms: at(1.0)?,
        })
    }

    fn row(&self) -> String {
        let Self {
            messages,
            p50_ms,
            p95_ms,
            p99_ms,
            worst_ms,
        } = self;
        format!("p50 {p50_ms:.3}  p95 {p95_ms:.3}  p99 {p99_ms:.3}  worst {worst_ms:.3} ms  ({messages} messages)")
    }
}
