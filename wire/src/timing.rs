//! The rates and limits in time that all nodes share.

use crate::stamp::{MILLISECOND, Nanos, Stamp};
use crate::stream_timeout;

/// What drives time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pace {
    /// The clock: operator and arbiter stream, decisions advance at the control rate.
    #[default]
    Real,
    /// The messages: the robot owns tick `k`, and `now = k · period` everywhere.
    Lockstep,
}

/// Rates and limits in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timing {
    /// What drives time.
    pub pace: Pace,
    /// The control period: checkpoint, weight and phase advance once per period.
    pub period: Nanos,
    /// The period of the streams of commands, setpoints and states in real time.
    pub stream_period: Nanos,
    /// A stream is lost after this much silence, or 2.5 of its periods if that is longer.
    pub timeout: Nanos,
    /// An answer made from a state older than this is dropped.
    pub loop_age_limit: Nanos,
    /// The number of the first control period in lockstep, so that several loops one after the other count on.
    pub first_tick: u32,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            pace: Pace::Real,
            period: 100 * MILLISECOND,
            stream_period: 20 * MILLISECOND,
            timeout: 100 * MILLISECOND,
            loop_age_limit: 500 * MILLISECOND,
            first_tick: 0,
        }
    }
}

impl Timing {
    /// The same rates, driven by messages.
    #[must_use]
    pub const fn lockstep(self) -> Self {
        Self {
            pace: Pace::Lockstep,
            ..self
        }
    }

    /// The period at which messages of a stream follow each other under this pace.
    #[must_use]
    pub const fn message_period(&self) -> Nanos {
        match self.pace {
            Pace::Real => self.stream_period,
            Pace::Lockstep => self.period,
        }
    }

    /// After this much silence a stream is lost.
    #[must_use]
    pub const fn stream_timeout(&self) -> Nanos {
        stream_timeout(self.timeout, self.message_period())
    }

    /// Where a message belongs on the session's time axis: where it arrived, or in lockstep, whose messages arrive as fast
    /// as they can, where its tick is.
    #[must_use]
    pub fn session_time(&self, at: Stamp, tick: u32) -> Stamp {
        match self.pace {
            Pace::Real => at,
            Pace::Lockstep => Stamp::of_tick(tick, self.period),
        }
    }

    /// The control period in seconds.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        crate::seconds(self.period)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_belongs_where_it_arrived_and_in_lockstep_where_its_tick_is() {
        let (real, at) = (Timing::default(), Stamp(7 * MILLISECOND));
        assert_eq!(real.session_time(at, 3), at);
        assert_eq!(real.lockstep().session_time(at, 3), Stamp(3 * real.period));
    }
}
