//! Setpoints that are expected every millisecond, as Franka's control interface (FCI) does.
//!
//! FCI counts the milliseconds without a command: the robot bridges them, publishes the share of the last hundred that
//! brought one (`control_command_success_rate`), and stops after twenty misses in a row. It bridges them at constant
//! acceleration; here the last velocity holds, for setpoints are velocities and one that is wrong should not grow.

use bincode::{Decode, Encode};
use tandem_wire::{Arrivals, Finite};

/// Over so many milliseconds the success rate is taken.
const WINDOW: u32 = 100;
/// After so many misses in a row motion stops.
const MISSED_MAX: u32 = 20;

/// Counts milliseconds with and without a setpoint, while motion is permitted.
#[derive(Clone, Copy, Debug, Default, Encode, Decode)]
pub(crate) struct Pulse {
    /// Whether a setpoint has come since the last inner tick.
    came: bool,
    /// The last milliseconds, the newest in the lowest bit; set where a setpoint came.
    recent: u128,
    missed: u32,
    longest: u32,
}

impl Pulse {
    /// A setpoint has come.
    pub(crate) fn beat(&mut self) {
        self.came = true;
    }

    /// Lets an inner tick pass under motion; says how many setpoints in a row were missed if these are too many.
    pub(crate) fn tick(&mut self) -> Option<u32> {
        let came = std::mem::take(&mut self.came);
        self.recent = self.recent << 1 | u128::from(came);
        self.missed = if came { 0 } else { self.missed + 1 };
        self.longest = self.longest.max(self.missed);
        (self.missed >= MISSED_MAX).then_some(self.missed)
    }

    /// Motion is held: what comes next is counted afresh.
    pub(crate) fn rest(&mut self) {
        let Self { came, longest, .. } = *self;
        *self = Self {
            came,
            longest,
            ..Self::default()
        };
    }

    /// Motion is permitted anew.
    pub(crate) fn begin(&mut self) {
        self.longest = 0;
    }

    pub(crate) fn report(&self) -> Arrivals {
        let counted = self.recent & ((1 << WINDOW) - 1);
        Arrivals {
            success_rate: Finite(f64::from(counted.count_ones()) / f64::from(WINDOW)),
            missed: self.missed,
            longest: self.longest,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twenty_misses_in_a_row_are_too_many_and_nineteen_are_not() {
        let mut pulse = Pulse::default();
        for _ in 0..5 {
            assert!((0..19).all(|_| pulse.tick().is_none()));
            pulse.beat();
            assert_eq!(pulse.tick(), None);
        }
        assert_eq!(pulse.report().success_rate, Finite(0.05));
        assert_eq!((pulse.report().missed, pulse.report().longest), (0, 19));
        assert_eq!((0..20).find_map(|_| pulse.tick()), Some(20));
    }

    #[test]
    fn the_rate_is_that_of_the_last_hundred_milliseconds() {
        let mut pulse = Pulse::default();
        for tick in 0..300 {
            if tick >= 150 {
                pulse.beat();
            }
            let _ = pulse.tick();
        }
        assert_eq!(pulse.report().success_rate, Finite(1.0));
        pulse.rest();
        assert_eq!(pulse.report().success_rate, Finite(0.0));
    }
}
