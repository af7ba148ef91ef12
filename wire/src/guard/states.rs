//! The stream of states, for whoever counts time by the robot's ticks.

use super::{Guard, Refusal};
use crate::{Header, Malformed, Memory, MessageId, Nanos, Pace, Remember, Session, Stamp, Timing};

/// Ticks may run ahead of the time that has passed by so many: a state that was held up for two seconds at the usual
/// control period. A forged one further on than this would freeze whatever advances with the tick.
const LEAP: u32 = 20;

/// A [`Guard`] that also bounds the tick, by the receiver's own clock.
///
/// Ticks never restart within a session, so whoever counts by them keeps the largest one it has seen: one state of the
/// last tick there is would be the last to count. In lockstep the tick is the time, and only the leap is bounded.
#[derive(Clone, Debug, PartialEq)]
pub struct StateGuard {
    guard: Guard,
    /// The control period; zero in lockstep, where no clock bounds the tick.
    period: Nanos,
    tick: u32,
}

impl StateGuard {
    /// A guard for states at these rates.
    #[must_use]
    pub const fn new(timing: &Timing) -> Self {
        Self {
            guard: Guard::new(timing.stream_timeout()),
            period: match timing.pace {
                Pace::Real => timing.period,
                Pace::Lockstep => 0,
            },
            tick: 0,
        }
    }

    /// Takes in a state that arrived at `now`, or says why it must be dropped.
    ///
    /// # Errors
    /// The reason why the state must be dropped; see [`Guard::admit`].
    pub fn admit(&mut self, now: Stamp, header: &Header) -> Result<(), Refusal> {
        let silent = self
            .guard
            .silent(now)
            .filter(|_| self.session() == Some(header.session));
        if silent.is_some_and(|silent| header.tick.saturating_sub(self.tick) > self.leap(silent)) {
            return Err(Refusal::TooFarAhead);
        }
        self.guard.admit(now, header)?;
        self.tick = header.tick;
        Ok(())
    }

    /// In lockstep: the state of a tick does not come now. Time has gone on all the same, so that the next one is not too
    /// far ahead however many were lost.
    pub const fn miss(&mut self, tick: u32) {
        self.tick = tick;
    }

    fn leap(&self, silent: Nanos) -> u32 {
        let passed = silent.checked_div(self.period).unwrap_or(0);
        LEAP.saturating_add(u32::try_from(passed).unwrap_or(u32::MAX))
    }

    /// How long the states have been silent; `None` before the first one.
    #[must_use]
    pub fn silent(&self, now: Stamp) -> Option<Nanos> {
        self.guard.silent(now)
    }

    /// Whether the states are lost, or have never begun.
    #[must_use]
    pub fn is_lost(&self, now: Stamp) -> bool {
        self.guard.is_lost(now)
    }

    /// When the states will be lost unless one arrives; `None` before the first one.
    #[must_use]
    pub fn deadline(&self) -> Option<Stamp> {
        self.guard.deadline()
    }

    /// The newest admitted state.
    #[must_use]
    pub const fn newest(&self) -> Option<MessageId> {
        self.guard.newest()
    }

    /// The robot's run.
    #[must_use]
    pub fn session(&self) -> Option<Session> {
        self.guard.session()
    }
}

impl Remember for StateGuard {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self { guard, period: _, tick } = self;
        guard.remember(memory)?;
        memory.part(tick)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MILLISECOND, Seq};

    fn header(seq: u64, tick: u32) -> Header {
        Header {
            tick,
            session: Session(1),
            seq: Seq(seq),
            ..Header::default()
        }
    }

    fn at(millis: u64) -> Stamp {
        Stamp(millis * MILLISECOND)
    }

    #[test]
    fn a_tick_that_time_does_not_allow_is_refused_and_does_not_take_its_number() {
        let mut states = StateGuard::new(&Timing::default());
        assert_eq!(states.admit(at(0), &header(1, 7)), Ok(()));
        assert_eq!(states.admit(at(10), &header(2, u32::MAX)), Err(Refusal::TooFarAhead));
        assert_eq!(states.admit(at(20), &header(2, 7)), Ok(()));
        assert_eq!(
            states.admit(at(1020), &header(3, 7 + 20 + 11)),
            Err(Refusal::TooFarAhead)
        );
        assert_eq!(states.admit(at(1020), &header(3, 7 + 20 + 10)), Ok(()));
    }

    #[test]
    fn in_lockstep_any_number_of_missed_states_may_be_followed_by_one() {
        let mut states = StateGuard::new(&Timing::default().lockstep());
        assert_eq!(states.admit(at(0), &header(1, 0)), Ok(()));
        (1..60).for_each(|tick| states.miss(tick));
        assert_eq!(states.admit(at(6000), &header(61, 60)), Ok(()));
    }

    #[test]
    fn in_lockstep_only_the_leap_is_bounded() {
        let mut states = StateGuard::new(&Timing::default().lockstep());
        assert_eq!(states.admit(at(0), &header(1, 0)), Ok(()));
        assert_eq!(
            states.admit(Stamp(u64::MAX), &header(2, u32::MAX)),
            Err(Refusal::TooFarAhead)
        );
        assert_eq!(states.admit(Stamp(u64::MAX), &header(2, 1)), Ok(()));
    }
}
