//! Instants and counters: plain integers, so that they are exact, total and the same on every machine.

use bincode::{Decode, Encode};

/// A duration in nanoseconds.
pub type Nanos = u64;

/// Nanoseconds in one millisecond.
pub const MILLISECOND: Nanos = 1_000_000;
/// Nanoseconds in one second.
pub const SECOND: Nanos = 1_000_000_000;

/// An instant: nanoseconds since the clock that made it was started.
///
/// Stamps of two clocks cannot be compared; a `Stamp` that came in a message is the *sender's* and is never
/// used to decide whether the robot may move.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Encode, Decode)]
pub struct Stamp(pub Nanos);

impl Stamp {
    /// The instant `tick · period`, which is what "now" means in lockstep.
    #[must_use]
    pub const fn of_tick(tick: u32, period: Nanos) -> Self {
        Self((tick as u64).saturating_mul(period))
    }

    /// This instant `nanos` later, stopping at the end of time.
    #[must_use]
    pub const fn after(self, nanos: Nanos) -> Self {
        Self(self.0.saturating_add(nanos))
    }

    /// How long ago `earlier` was; zero if it lies ahead.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Nanos {
        self.0.saturating_sub(earlier.0)
    }

    /// This instant in seconds, for plots and tables.
    #[must_use]
    pub fn seconds(self) -> f64 {
        seconds(self.0)
    }
}

/// A duration in seconds.
#[must_use]
pub fn seconds(nanos: Nanos) -> f64 {
    // Exact up to 104 days (2^53 ns); beyond that the error is below a microsecond for a century.
    nanos as f64 * 1e-9
}

/// One run of one process: drawn at its start, so that a restarted sender is told from the one before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Encode, Decode)]
pub struct Session(pub u64);

/// Counts the messages of one stream within a session, from 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Encode, Decode)]
pub struct Seq(pub u64);

impl Seq {
    /// Advances to the next number and returns it.
    pub fn advance(&mut self) -> Self {
        self.0 = self.0.wrapping_add(1);
        *self
    }
}

/// A message named exactly: which run of its sender, and which one of that stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Encode, Decode)]
pub struct MessageId {
    /// The sender's run.
    pub session: Session,
    /// Its place in the stream.
    pub seq: Seq,
}
