//! Monotonic time as [`Stamp`]s.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::sync::OnceLock;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use tandem_wire::{Session, Stamp};

/// The process's clock: nanoseconds since it was first asked, the same for every node in the process.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    origin: Instant,
    origin_unix_nanos: u64,
}

impl Clock {
    /// The clock of this process.
    #[must_use]
    pub fn of_process() -> Self {
        static CLOCK: OnceLock<Clock> = OnceLock::new();
        *CLOCK.get_or_init(|| Self {
            origin: Instant::now(),
            origin_unix_nanos: unix_nanos(),
        })
    }

    /// Now.
    #[must_use]
    pub fn now(&self) -> Stamp {
        self.stamp(Instant::now())
    }

    /// An instant of the standard library as a stamp; instants before the origin become zero.
    #[must_use]
    pub fn stamp(&self, instant: Instant) -> Stamp {
        let nanos = instant.saturating_duration_since(self.origin).as_nanos();
        Stamp(u64::try_from(nanos).unwrap_or(u64::MAX))
    }

    /// A stamp as an instant of the standard library, to wait for.
    #[must_use]
    pub fn instant(&self, stamp: Stamp) -> Instant {
        self.origin
            .checked_add(Duration::from_nanos(stamp.0))
            .unwrap_or_else(far_future)
    }

    /// What the wall clock showed at stamp zero, in nanoseconds since 1970: for files, never for decisions.
    #[must_use]
    pub const fn origin_unix_nanos(&self) -> u64 {
        self.origin_unix_nanos
    }
}

fn far_future() -> Instant {
    Instant::now() + Duration::from_secs(3600)
}

fn unix_nanos() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
}

/// A session number that no other run has, as far as chance goes.
#[must_use]
pub fn fresh_session() -> Session {
    // RandomState is keyed from the operating system's entropy, differently at each call.
    let mut hasher = RandomState::new().build_hasher();
    hasher.write_u64(unix_nanos());
    Session(hasher.finish())
}
