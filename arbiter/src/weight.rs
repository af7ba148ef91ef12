//! The laws: from the forecast's interval to `ω`, the human's weight.
//!
//! Before there is guidance `ω = 1`. With it, `ω` is 0.5 (fixed), 1 (human), 0 (robot), a constant, or (adaptive)
//!
//! `ω = clip((ratio − 1) / (ratio_high − 1), floor, 1)`
//!
//! where `ratio` is the interval's half-width over that of the training data at the same step: it measures how new
//! the situation is to the model, and confidence level, noise and axis cancel in it. `ratio_high`, a property of the
//! model, is where the human gets everything. The floor keeps the human's hand on the robot: somebody who corrects
//! the robot's path at a weight of `ω` must push `1/ω` times as hard.
//!
//! The interval knows how new the situation is, not what the human wants. The law *attentive* asks the hand instead:
//! `p`, the part of the human's velocity across the robot's, smoothed as a vector (so that a tremor cancels out), says
//! how far aside of the forecast the human wants to be;
//!
//! `p ← p + share · (across − p)`, `ω = least + (most − least) · min(1, |p| / full)`.
//!
//! What lies along the robot's way is no disagreement: there the robot only helps. It belongs together with a robot that
//! gives way across its path (`predictor.correction_across`); docs/sharing.md has the figures of both.

use tandem_wire::{Guidance, Law, Malformed, Memory, Remember, Vec3};

/// Slower than this, neither human nor robot counts as pushing, in metres per second.
const PUSH_SPEED: f64 = 0.02;
/// So many ticks against the robot make a push: one alone may be a tremor.
const PUSH_TICKS: u32 = 2;

/// Which law, and what may be added to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WeightRules {
    pub(crate) law: Law,
    /// The smallest weight of the adaptive law.
    pub(crate) floor: f64,
    /// How the law "attentive" listens.
    pub(crate) attention: Attention,
    /// How much `ω` may fall in one tick; `None` for no limit. It always rises at once.
    pub(crate) fall_per_tick: Option<f64>,
    /// Whether the human gets everything while pushing against the robot.
    pub(crate) yields_to_push: bool,
}

/// How the law "attentive" listens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Attention {
    /// The smallest weight.
    pub(crate) least: f64,
    /// The largest weight; no smaller than the smallest.
    pub(crate) most: f64,
    /// At this smoothed push across the robot's way the human gets everything.
    pub(crate) full_m_s: f64,
    /// The share of a tick's push that enters the smoothed one.
    pub(crate) share: f64,
}

/// `ω` and what its next value depends on.
#[derive(Clone, Debug)]
pub(crate) struct Weight {
    rules: WeightRules,
    omega: f64,
    tick: Option<u32>,
    pushed: u32,
    /// The human's push across the robot's way, smoothed; only the law "attentive" listens.
    push: Vec3,
}

impl Weight {
    pub(crate) fn new(rules: WeightRules) -> Self {
        Self {
            rules,
            omega: 1.0,
            tick: None,
            pushed: 0,
            push: Vec3::ZERO,
        }
    }

    pub(crate) fn law(&self) -> Law {
        self.rules.law
    }

    /// A new trial: as if nothing had been shared yet.
    pub(crate) fn reset(&mut self) {
        *self = Self::new(self.rules);
    }

    /// `ω` for guidance of this tick. Decided once per tick and kept in between; without guidance it is 1 at once,
    /// and stays so until a later tick brings guidance again.
    pub(crate) fn decide(&mut self, guidance: Option<(u32, Guidance)>, human: Vec3) -> f64 {
        match guidance {
            None => {
                self.omega = 1.0;
                self.pushed = 0;
                self.push = Vec3::ZERO;
            }
            Some((tick, guidance)) if self.tick != Some(tick) => {
                self.tick = Some(tick);
                self.advance(&guidance, human);
            }
            Some(_) => {}
        }
        self.omega
    }

    fn advance(&mut self, guidance: &Guidance, human: Vec3) {
        self.pushed = if against(human, guidance.velocity) {
            self.pushed.saturating_add(1)
        } else {
            0
        };
        self.listen(human, guidance.velocity);
        let yields = self.rules.yields_to_push && self.pushed >= PUSH_TICKS;
        let wanted = if yields { 1.0 } else { self.wanted(guidance) };
        self.omega = match self.rules.fall_per_tick {
            Some(step) => wanted.max(self.omega - step),
            None => wanted,
        };
    }

    /// Smooths the push as a vector, in which a tremor cancels out.
    fn listen(&mut self, human: Vec3, robot: Vec3) {
        let share = self.rules.attention.share;
        self.push = self.push + (across(human, robot) - self.push) * share;
    }

    /// `least + (most − least) · min(1, |push| / full)`; a push that is no number counts as the hardest.
    fn attentive(&self) -> f64 {
        let Attention {
            least, most, full_m_s, ..
        } = self.rules.attention;
        let share = self.push.norm() / full_m_s;
        if share < 1.0 {
            least + (most - least) * share
        } else {
            most
        }
    }

    fn wanted(&self, guidance: &Guidance) -> f64 {
        match self.rules.law {
            Law::Adaptive => adaptive(guidance.ratio.0, guidance.ratio_high.0, self.rules.floor),
            Law::Fixed => 0.5,
            Law::Human => 1.0,
            Law::Robot => 0.0,
            Law::Constant(weight) => weight.0,
            Law::Attentive => self.attentive(),
        }
    }
}

impl Remember for Weight {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            rules: _,
            omega,
            tick,
            pushed,
            push,
        } = self;
        memory.part(omega)?;
        memory.check((0.0..=1.0).contains(omega))?;
        memory.part(tick)?;
        memory.part(pushed)?;
        memory.part(push)
    }
}

/// `clip((ratio − 1) / (high − 1), floor, 1)`; a `high` that is not above 1 knows no doubt that could be measured, so
/// the human gets everything, as for numbers that are not finite.
fn adaptive(ratio: f64, high: f64, floor: f64) -> f64 {
    let doubt = (ratio - 1.0) / (high - 1.0);
    if high > 1.0 && doubt.is_finite() {
        doubt.clamp(floor, 1.0)
    } else {
        1.0
    }
}

/// What of the human's velocity does not lie along the robot's. Where the robot rests, all of it.
fn across(human: Vec3, robot: Vec3) -> Vec3 {
    let speed = robot.norm();
    if speed <= PUSH_SPEED {
        return human;
    }
    let direction = robot * (1.0 / speed);
    human - direction * human.dot(direction)
}

fn against(human: Vec3, robot: Vec3) -> bool {
    human.dot(robot) < 0.0 && human.norm() > PUSH_SPEED && robot.norm() > PUSH_SPEED
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::Finite;

    const PAPER: WeightRules = WeightRules {
        law: Law::Adaptive,
        floor: 0.1,
        attention: Attention {
            least: 0.6,
            most: 0.9,
            full_m_s: 0.1,
            share: 0.5,
        },
        fall_per_tick: None,
        yields_to_push: false,
    };

    fn guidance(ratio: f64) -> Guidance {
        Guidance {
            ratio: Finite(ratio),
            ratio_high: Finite(1.5),
            velocity: Vec3::new(0.1, 0.0, 0.0),
            ..Guidance::default()
        }
    }

    fn omega(rules: WeightRules, ratio: f64) -> f64 {
        Weight::new(rules).decide(Some((1, guidance(ratio))), Vec3::ZERO)
    }

    #[test]
    fn the_adaptive_law_rises_from_its_floor_to_one() {
        assert_eq!(omega(PAPER, 0.9), 0.1);
        assert_eq!(omega(PAPER, 1.0), 0.1);
        assert_eq!(omega(PAPER, 1.25), 0.5);
        assert_eq!(omega(PAPER, 1.5), 1.0);
        assert_eq!(omega(PAPER, 80.0), 1.0);
    }

    #[test]
    fn a_ratio_that_says_nothing_gives_the_human_everything() {
        assert_eq!(adaptive(f64::NAN, 1.5, 0.1), 1.0);
        assert_eq!(adaptive(1.0, 1.0, 0.1), 1.0);
        assert_eq!(adaptive(1.0, 0.5, 0.1), 1.0);
        assert_eq!(adaptive(1e308, -1e308, 0.1), 1.0);
    }

    #[test]
    fn the_other_laws_are_constants() {
        for (law, weight) in [
            (Law::Fixed, 0.5),
            (Law::Human, 1.0),
            (Law::Robot, 0.0),
            (Law::Constant(Finite(0.3)), 0.3),
        ] {
            assert_eq!(omega(WeightRules { law, ..PAPER }, 1.2), weight);
        }
    }

    #[test]
    fn a_hand_that_pushes_across_the_way_gets_weight_and_one_that_pushes_along_does_not() {
        let rules = WeightRules {
            law: Law::Attentive,
            ..PAPER
        };
        let after = |human: Vec3, ticks: u32| {
            let mut weight = Weight::new(rules);
            let omegas = (1..=ticks).map(|tick| weight.decide(Some((tick, guidance(1.2))), human));
            omegas.last().expect("at least one tick")
        };
        let near = |found: f64, wanted: f64| assert!((found - wanted).abs() < 1e-12, "{found}, not {wanted}");
        near(after(Vec3::new(0.3, 0.0, 0.0), 5), 0.6);
        near(after(Vec3::new(-0.3, 0.0, 0.0), 5), 0.6);
        near(after(Vec3::new(0.1, 0.08, 0.0), 1), 0.6 + 0.3 * 0.4);
        near(after(Vec3::new(0.1, 0.08, 0.0), 2), 0.6 + 0.3 * 0.6);
        near(after(Vec3::new(0.1, 0.0, 0.5), 9), 0.9);
        near(after(Vec3::new(f64::NAN, 0.0, 0.0), 1), 0.9);
    }

    #[test]
    fn a_tremor_is_no_push() {
        let mut weight = Weight::new(WeightRules {
            law: Law::Attentive,
            ..PAPER
        });
        let mut omega = 0.0;
        for tick in 1..=20 {
            let side = if tick % 2 == 0 { 0.02 } else { -0.02 };
            omega = weight.decide(Some((tick, guidance(1.0))), Vec3::new(0.1, side, 0.0));
        }
        assert!(omega < 0.63, "{omega}");
    }

    #[test]
    fn the_weight_is_decided_once_per_tick_and_is_one_at_once_when_guidance_goes() {
        let mut weight = Weight::new(PAPER);
        assert_eq!(weight.decide(None, Vec3::ZERO), 1.0);
        assert_eq!(weight.decide(Some((7, guidance(1.25))), Vec3::ZERO), 0.5);
        assert_eq!(weight.decide(Some((7, guidance(1.4))), Vec3::ZERO), 0.5);
        assert_eq!(weight.decide(None, Vec3::ZERO), 1.0);
        assert_eq!(weight.decide(Some((7, guidance(1.25))), Vec3::ZERO), 1.0);
        assert_eq!(weight.decide(Some((8, guidance(1.25))), Vec3::ZERO), 0.5);
    }

    #[test]
    fn a_bounded_fall_still_rises_at_once() {
        let mut weight = Weight::new(WeightRules {
            fall_per_tick: Some(0.25),
            ..PAPER
        });
        let mut at = |tick, ratio| weight.decide(Some((tick, guidance(ratio))), Vec3::ZERO);
        assert_eq!([at(1, 1.0), at(2, 1.0), at(3, 1.5), at(4, 1.0)], [0.75, 0.5, 1.0, 0.75]);
    }

    #[test]
    fn two_ticks_against_the_robot_take_over_where_that_is_allowed() {
        let mut weight = Weight::new(WeightRules {
            yields_to_push: true,
            ..PAPER
        });
        let push = Vec3::new(-0.03, 0.0, 0.0);
        let mut at = |tick, human| weight.decide(Some((tick, guidance(1.0))), human);
        assert_eq!([at(1, push), at(2, push), at(3, -push)], [0.1, 1.0, 0.1]);
        assert_eq!([at(4, push), at(5, push * 0.5), at(6, push)], [0.1, 0.1, 0.1]);
    }
}
