//! When to forecast, and the context it is conditioned on.
//!
//! A checkpoint is a plane `x = const` of the task, where the demonstrations were all at the same step. It is passed
//! at the first crossing in the direction of increasing `x`; whoever never crosses it never gets a forecast. Positions
//! are compared once per control tick, so the context is interpolated onto the plane.

use tandem_wire::{Malformed, Memory, Remember};

/// A checkpoint: where it is, and the demonstrations' step there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Plane {
    /// `x` in task coordinates, in metres.
    pub(crate) x: f64,
    /// The step at which the demonstrations are there.
    pub(crate) step: f64,
}

/// The movement went through a checkpoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Crossing {
    /// Where, in task coordinates: the forecast's context.
    pub(crate) point: [f64; 2],
    /// Where the movement is now on the demonstrations' time axis, in steps: the plane's, and what passed since.
    pub(crate) phase: f64,
    /// Which checkpoint, from 0 in the order in which a movement passes them.
    pub(crate) plane: usize,
}

/// Looks out for the checkpoints, one after the other.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Lookout {
    /// In the order in which a movement passes them.
    planes: Vec<Plane>,
    passed: usize,
    before: Option<[f64; 2]>,
}

impl Lookout {
    pub(crate) fn new(planes: Vec<Plane>) -> Self {
        Self {
            planes,
            passed: 0,
            before: None,
        }
    }

    /// The checkpoint that was passed last.
    pub(crate) fn last(&self) -> Option<usize> {
        self.passed.checked_sub(1)
    }

    /// A new trial begins.
    pub(crate) fn reset(&mut self) {
        self.passed = 0;
        self.before = None;
    }

    /// The tool is at `here`, `ticks` control periods after the last call.
    ///
    /// With `f` the share of the way from there to here that lies behind the plane, the crossing was at
    /// `here − f·(here − before)`, `f·ticks` periods ago. Of several that were crossed at once the last one counts.
    pub(crate) fn pass(&mut self, here: [f64; 2], ticks: u32) -> Option<Crossing> {
        let before = self.before.replace(here)?;
        let mut crossing = None;
        while let Some(plane) = self.planes.get(self.passed)
            && before[0] < plane.x
            && plane.x <= here[0]
        {
            let behind = (here[0] - plane.x) / (here[0] - before[0]);
            crossing = Some(Crossing {
                // The plane's own x: interpolating it would only add rounding.
                point: [plane.x, here[1] - behind * (here[1] - before[1])],
                phase: plane.step + behind * f64::from(ticks),
                plane: self.passed,
            });
            self.passed += 1;
        }
        crossing
    }
}

impl Remember for Lookout {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self { planes, passed, before } = self;
        memory.part(passed)?;
        memory.check(*passed <= planes.len())?;
        memory.part(before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lookout() -> Lookout {
        Lookout::new(vec![Plane { x: 0.3, step: 41.0 }])
    }

    /// The crossing of a straight way that advances by `speed` per tick and is `share` of a tick past the plane.
    fn straight(speed: f64, share: f64) -> Crossing {
        let mut lookout = lookout();
        let at = |tick: f64| {
            let x = 0.3 + speed * (tick + share);
            [x, 0.1 + 0.5 * (x - 0.3)]
        };
        assert_eq!(lookout.pass(at(-2.0), 1), None);
        assert_eq!(lookout.pass(at(-1.0), 1), None);
        let crossing = lookout.pass(at(0.0), 1).unwrap();
        assert_eq!(lookout.pass(at(1.0), 1), None);
        crossing
    }

    #[test]
    fn context_and_phase_are_interpolated_at_every_speed_and_fraction() {
        for speed in [1e-4, 0.003, 0.0134, 0.05] {
            for share in [0.001, 0.25, 0.5, 0.75, 0.999] {
                let crossing = straight(speed, share);
                assert!((crossing.phase - 41.0 - share).abs() < 1e-9, "{speed} {share}");
                assert!((crossing.point[1] - 0.1).abs() < 1e-9, "{speed} {share}");
                assert_eq!(crossing.point[0], 0.3);
            }
        }
    }

    #[test]
    fn a_tick_that_ends_on_the_plane_has_crossed_it_and_the_next_has_not() {
        let mut lookout = lookout();
        lookout.pass([0.25, 0.0], 1);
        let crossing = lookout.pass([0.3, 0.1], 1).unwrap();
        assert_eq!((crossing.point, crossing.phase), ([0.3, 0.1], 41.0));
        assert_eq!(lookout.pass([0.35, 0.1], 1), None);
    }

    #[test]
    fn checkpoints_are_passed_one_after_the_other_and_of_two_at_once_the_last_counts() {
        let planes = || {
            let plane = |x, step| Plane { x, step };
            Lookout::new(vec![plane(0.3, 41.0), plane(0.4, 55.0)])
        };
        let mut lookout = planes();
        let passed = [0.2, 0.35, 0.38, 0.45, 0.5].map(|x| lookout.pass([x, 0.0], 1).map(|crossing| crossing.plane));
        assert_eq!(passed, [None, Some(0), None, Some(1), None]);
        let mut lookout = planes();
        lookout.pass([0.2, 0.0], 1);
        let crossing = lookout.pass([0.6, 0.4], 1).unwrap();
        assert_eq!(crossing.plane, 1);
        assert!((crossing.point[1] - 0.2).abs() < 1e-12 && (crossing.phase - 55.5).abs() < 1e-12);
    }

    #[test]
    fn ticks_that_were_never_seen_still_count() {
        let mut lookout = lookout();
        lookout.pass([0.2, 0.0], 1);
        let crossing = lookout.pass([0.4, 0.0], 4).unwrap();
        assert!((crossing.phase - 43.0).abs() < 1e-9);
    }

    #[test]
    fn backwards_or_from_behind_is_no_crossing() {
        let mut lookout = lookout();
        for x in [0.4, 0.2, 0.1] {
            assert_eq!(lookout.pass([x, 0.0], 1), None);
        }
        assert!(lookout.pass([0.31, 0.0], 1).is_some());
    }

    #[test]
    fn a_new_trial_may_cross_again_but_not_by_jumping_back_to_its_start() {
        let mut lookout = lookout();
        lookout.pass([0.2, 0.0], 1);
        assert!(lookout.pass([0.4, 0.0], 1).is_some());
        lookout.reset();
        assert_eq!(lookout.pass([0.4, 0.0], 1), None);
        assert_eq!(lookout.pass([0.0, 0.0], 1), None);
        assert!(lookout.pass([0.4, 0.0], 1).is_some());
    }
}
