//! How a simulated human steers: from what it sees to the velocity it commands, in the plane of the task.
//!
//! With the wish `w(t)`, the tool's position `p`, the period `Δt`, the gain `g` and `e = w(t + 1) − p`:
//!
//! | kind | velocity |
//! | --- | --- |
//! | pursuit | `g e / Δt` |
//! | intermittent | the same, but nothing at all while repeating the last step's movement would miss `w(t + 1)` by no more than 4 mm |
//! | lagged | `g (w(t) − p) / Δt` |
//! | compensating | `(e/Δt − (1 − ω) r) / max(ω, 0.05)`, with the weight ω and the robot's velocity `r` as last seen |
//!
//! Noise and the speed cap come after, for whoever moves at all: a hand at rest does not tremble the stick.

use bincode::{Decode, Encode};

use crate::config::HumanKind;
use crate::wish::Wish;

/// What a human sees in one control period, and acts on, perhaps later. Task coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub(crate) struct Percept {
    /// Where the tool is.
    pub(crate) tool: [f64; 2],
    /// How far it moved in the last period.
    pub(crate) moved: [f64; 2],
    /// The step of the wish that is now.
    pub(crate) step: f64,
    /// The robot's velocity in the setpoint in force; zero if it has no say.
    pub(crate) robot: [f64; 2],
    /// The human's weight in the setpoint in force.
    pub(crate) weight: f64,
}

/// An intermittent human tolerates this miss, in metres.
const TOLERATED: f64 = 0.004;
/// A compensating human does not multiply its effort by more than the inverse of this.
const LEAST_WEIGHT: f64 = 0.05;

/// The velocity wanted; `None` from a human who leaves it as it is.
pub(crate) fn velocity(kind: HumanKind, gain: f64, wish: &Wish, seen: &Percept, period_s: f64) -> Option<[f64; 2]> {
    let next = wish.at(seen.step + 1.0);
    let towards = |target: [f64; 2]| each(|i| gain * (target[i] - seen.tool[i]) / period_s);
    match kind {
        HumanKind::Pursuit => Some(towards(next)),
        HumanKind::Intermittent => {
            let miss = each(|i| seen.tool[i] + seen.moved[i] - next[i]);
            (libm::hypot(miss[0], miss[1]) > TOLERATED).then(|| towards(next))
        }
        HumanKind::Lagged => Some(towards(wish.at(seen.step))),
        HumanKind::Compensating => Some(each(|i| {
            let wanted = (next[i] - seen.tool[i]) / period_s;
            (wanted - (1.0 - seen.weight) * seen.robot[i]) / seen.weight.max(LEAST_WEIGHT)
        })),
    }
}

pub(crate) fn each(of: impl Fn(usize) -> f64) -> [f64; 2] {
    [of(0), of(1)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::family::FamilyPath;
    use crate::random::Draws;
    use crate::wish::Spread;

    const PERIOD: f64 = 0.1;

    fn wish() -> Wish {
        Wish::new(FamilyPath::new(0.12), Spread::default(), Draws::new(1, 1))
    }

    /// A tool 10 mm short of the next wish in x, having moved by `moved` in x; the robot has 0.75 of the weight.
    fn percept(moved: f64) -> Percept {
        let [x, y] = wish().at(31.0);
        Percept {
            tool: [x - 0.01, y],
            moved: [moved, 0.0],
            step: 30.0,
            robot: [0.08, 0.02],
            weight: 0.25,
        }
    }

    #[track_caller]
    fn assert_near(found: Option<[f64; 2]>, expected: [f64; 2]) {
        let found = found.expect("it moves");
        for i in 0..2 {
            assert!((found[i] - expected[i]).abs() < 1e-12, "{found:?}, not {expected:?}");
        }
    }

    #[test]
    fn pursuit_goes_part_of_the_way_to_the_next_wish() {
        assert_near(
            velocity(HumanKind::Pursuit, 0.6, &wish(), &percept(0.0), PERIOD),
            [0.06, 0.0],
        );
    }

    #[test]
    fn lagged_goes_part_of_the_way_to_the_wish_of_now() {
        let seen = percept(0.0);
        let [x, y] = wish().at(30.0);
        let expected = [0.6 * (x - seen.tool[0]) / PERIOD, 0.6 * (y - seen.tool[1]) / PERIOD];
        assert_near(velocity(HumanKind::Lagged, 0.6, &wish(), &seen, PERIOD), expected);
    }

    #[test]
    fn intermittent_acts_only_when_the_movement_would_miss_by_more_than_4_mm() {
        let act = |moved| velocity(HumanKind::Intermittent, 0.6, &wish(), &percept(moved), PERIOD);
        assert_eq!(act(0.0061), None);
        assert_eq!(act(0.0139), None);
        assert_near(act(0.0059), [0.06, 0.0]);
        assert_near(act(0.0141), [0.06, 0.0]);
    }

    #[test]
    fn compensating_makes_the_blend_arrive() {
        let seen = percept(0.0);
        let human = velocity(HumanKind::Compensating, 0.6, &wish(), &seen, PERIOD).expect("it moves");
        let blend = each(|i| seen.weight * human[i] + (1.0 - seen.weight) * seen.robot[i]);
        assert_near(Some(blend), [0.1, 0.0]);
    }

    #[test]
    fn compensating_is_bounded_where_the_human_weighs_nothing() {
        let seen = Percept {
            weight: 0.0,
            ..percept(0.0)
        };
        let expected = [(0.1 - 0.08) / 0.05, -0.02 / 0.05];
        assert_near(velocity(HumanKind::Compensating, 0.6, &wish(), &seen, PERIOD), expected);
    }
}
