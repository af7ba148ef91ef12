//! The stream of states, for whoever counts time by the robot's ticks.

use bincode::{Decode, Encode};

use super::{Guard, Refusal};
use crate::{Header, Malformed, Memory, MessageId, Nanos, Pace, Remember, Session, Stamp, Timing};

/// Ticks may run ahead of the time that has passed by so many: a first state that was held up for two seconds at the
/// usual control period. A forged one further on than this would freeze whatever advances with the tick.
const LEAP: u32 = 20;

/// A [`Guard`] that also bounds the tick, by the receiver's own clock.
///
/// Ticks never restart within a session, so whoever counts by them keeps the largest one it has seen: one state of the
/// last tick there is would be the last to count. In lockstep the tick is the time, and only the leap is bounded.
///
/// Time is counted from the state that came with the least delay of all, not from the newest one: behind an outage a
/// line delivers what it had queued, late and all at once, and then what is, which is seconds further on.
#[derive(Clone, Debug, PartialEq)]
pub struct StateGuard {
    guard: Guard,
    /// The control period; zero in lockstep, where no clock bounds the tick.
    period: Nanos,
    lead: Lead,
}

/// The state that came with the least delay: when, and its tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
struct Lead {
    arrived: Stamp,
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
            lead: Lead {
                arrived: Stamp(0),
                tick: 0,
            },
        }
    }

    /// Takes in a state that arrived at `now`, or says why it must be dropped.
    ///
    /// # Errors
    /// The reason why the state must be dropped; see [`Guard::admit`].
    pub fn admit(&mut self, now: Stamp, header: &Header) -> Result<(), Refusal> {
        let same = self.session() == Some(header.session);
        if same && header.tick > self.latest_tick(now) {
            return Err(Refusal::TooFarAhead);
        }
        self.guard.admit(now, header)?;
        let came = Lead {
            arrived: now,
            tick: header.tick,
        };
        if !same || self.is_ahead(came) {
            self.lead = came;
        }
        Ok(())
    }

    /// In lockstep: the state of a tick does not come now. Time has gone on all the same, so that the next one is not too
    /// far ahead however many were lost.
    pub const fn miss(&mut self, tick: u32) {
        self.lead.tick = tick;
    }

    /// The last tick that a state may name now.
    ///
    /// What has been refused for long must not be refused for ever: the longer nothing is admitted, the further a tick may
    /// be ahead. One whose first state was held up for longer than the leap is heard again after as long as that.
    fn latest_tick(&self, now: Stamp) -> u32 {
        let silent = self.guard.silent(now).unwrap_or_default();
        let passed = now.since(self.lead.arrived).saturating_add(silent);
        let passed = passed.checked_div(self.period).unwrap_or(0);
        let leap = LEAP.saturating_add(u32::try_from(passed).unwrap_or(u32::MAX));
        self.lead.tick.saturating_add(leap)
    }

    /// Whether a state came with less delay than any before. In lockstep there is no delay: the newest leads.
    fn is_ahead(&self, came: Lead) -> bool {
        let ticks = u64::from(came.tick.saturating_sub(self.lead.tick));
        self.period == 0 || ticks.saturating_mul(self.period) > came.arrived.since(self.lead.arrived)
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
        let Self { guard, period: _, lead } = self;
        guard.remember(memory)?;
        memory.part(lead)
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
        assert_eq!(states.admit(at(80), &header(3, 7 + 20 + 2)), Err(Refusal::TooFarAhead));
        assert_eq!(states.admit(at(80), &header(3, 7 + 20 + 1)), Ok(()));
    }

    /// Twenty states, one every 100 ms and one per tick, from tick 1.
    fn on_a_good_line() -> StateGuard {
        let mut states = StateGuard::new(&Timing::default());
        for tick in 1..=20 {
            assert_eq!(
                states.admit(at(100 * u64::from(tick)), &header(u64::from(tick), tick)),
                Ok(())
            );
        }
        states
    }

    #[test]
    fn what_was_queued_during_an_outage_does_not_lock_out_what_comes_behind_it() {
        let mut states = on_a_good_line();
        for tick in 21..=25 {
            assert_eq!(states.admit(at(7000), &header(u64::from(tick), tick)), Ok(()));
        }
        assert_eq!(states.admit(at(7001), &header(70, 70)), Ok(()));
    }

    #[test]
    fn a_forged_tick_is_refused_behind_an_outage_too() {
        let mut states = on_a_good_line();
        assert_eq!(states.admit(at(7000), &header(21, 21)), Ok(()));
        assert_eq!(states.admit(at(7020), &header(22, 70 + 21)), Err(Refusal::TooFarAhead));
        assert_eq!(states.admit(at(7020), &header(22, 70)), Ok(()));
    }

    #[test]
    fn whoever_joined_on_a_line_seconds_late_hears_again_once_the_line_is_good() {
        let mut states = StateGuard::new(&Timing::default());
        states.admit(at(0), &header(1, 0)).unwrap();
        // From now on five seconds earlier: fifty ticks further on.
        let late = (1_u32..100).find(|tick| {
            let number = 1 + u64::from(*tick);
            states
                .admit(at(100 * u64::from(*tick)), &header(number, 50 + tick))
                .is_ok()
        });
        assert_eq!(late, Some(30));
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
