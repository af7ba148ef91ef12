//! The `[arbiter]` section, and the checked rules it becomes.

use tandem_settings::{choices, settings};
use tandem_wire::{Aabb, Finite, Law, MILLISECOND, Nanos, Timing, Vec3};

use crate::lease::Terms;
use crate::limits::Bounds;
use crate::weight::{Attention, WeightRules};

choices! {
    /// How human and robot share the command, by name.
    pub enum LawName {
        /// The human's weight follows the interval.
        Adaptive = "adaptive",
        /// Half and half.
        Fixed = "fixed",
        /// The human alone.
        Human = "human",
        /// The robot alone, once there is a forecast.
        Robot = "robot",
        /// A constant weight of the human.
        Constant = "constant",
        /// The human's weight follows what the hand says.
        Attentive = "attentive",
    }
}

settings! {
    /// Who decides, and within which bounds.
    pub struct ArbiterSettings("arbiter") {
        /// How human and robot share the command once there is a forecast; before that the human drives alone.
        pub law: LawName = LawName::Adaptive;
        /// The human's weight under the law "constant".
        pub constant_weight: f64 = 0.5, in 0.0..=1.0;
        /// The smallest weight the adaptive law gives the human. Below .1 a human who disagrees works harder, not less.
        pub weight_floor: f64 = 0.1, in 0.0..=1.0;
        /// The weight that the law "attentive" gives a human who does not push across the robot's way. Much below .65 a
        /// human who cancels the robot works harder, not less.
        pub attentive_least: f64 = 0.65, in 0.0..=1.0;
        /// The weight that it gives one who does. Below 1 the robot still helps along its way.
        pub attentive_most: f64 = 0.9, in 0.0..=1.0;
        /// Under the law "attentive" a human who pushes this fast across the robot's way gets the largest weight, in
        /// metres per second.
        pub attentive_full_m_s: f64 = 0.05, in 0.001..=10.0;
        /// Under the law "attentive": the share of a control period's push that enters the smoothed one. 1 for no
        /// smoothing; a tremor then counts as disagreement.
        pub attentive_share: f64 = 0.3, in 0.01..=1.0;
        /// How fast the human's weight may fall, per second; 0 for no limit, as in the paper. It always rises at once.
        pub weight_fall_per_s: f64 = 0.0, in 0.0..=100.0;
        /// Whether a human who pushes against the robot (20 mm/s, two ticks) gets all of the weight. Not in the paper.
        pub yield_to_push: bool = false;
        /// The fastest the tool may be asked to move, in metres per second.
        pub tool_speed_m_s: f64 = 0.5, in 0.01..=1.7;
        /// The hardest change of speed, in metres per second squared: at 10 a stream of 50 Hz may still change by 0.2 m/s
        /// from one setpoint to the next. The Panda's own limit is 13.
        pub tool_acceleration_m_s2: f64 = 10.0, in 0.1..=13.0;
        /// Setpoints go out this often while motion is permitted, in hertz, besides one for every command; 0: only those.
        pub setpoint_hz: f64 = 0.0, in 0.0..=1000.0;
        /// An operator whose commands are silent for longer has lost the lease, in milliseconds.
        pub lease_timeout_ms: u32 = 2000, in 100..=60000;
        /// An operator that has let go of the deadman for longer gives way to whoever presses, in milliseconds.
        pub lease_idle_ms: u32 = 10000, in 0..=3600000;
        /// Operators of these names may take the lease from whoever holds it. Names are not proven without certificates.
        pub supervisors: Vec<String> = ["supervisor"];
        /// The corner of the workspace with the smallest coordinates, in the base frame, in metres.
        pub workspace_min_m: [f64; 3] = [0.2, -0.5, 0.02], in -2.0..=2.0;
        /// The corner with the largest.
        pub workspace_max_m: [f64; 3] = [0.8, 0.5, 0.8], in -2.0..=2.0;
    }
}

/// A workspace whose smallest corner is not smaller than its largest.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("arbiter.workspace_min_m[{axis}] = {min} must be less than arbiter.workspace_max_m[{axis}] = {max}")]
pub struct WorkspaceTurnedOver {
    /// Which axis, from 0.
    pub axis: usize,
    /// Its lower bound.
    pub min: f64,
    /// Its upper bound.
    pub max: f64,
}

impl ArbiterSettings {
    /// The law, with its number if it has one.
    #[must_use]
    pub fn sharing(&self) -> Law {
        match self.law {
            LawName::Adaptive => Law::Adaptive,
            LawName::Fixed => Law::Fixed,
            LawName::Human => Law::Human,
            LawName::Robot => Law::Robot,
            LawName::Constant => Law::Constant(Finite(self.constant_weight)),
            LawName::Attentive => Law::Attentive,
        }
    }

    pub(crate) fn weight_rules(&self, timing: &Timing) -> WeightRules {
        let fall = self.weight_fall_per_s;
        WeightRules {
            law: self.sharing(),
            floor: self.weight_floor,
            attention: Attention {
                least: self.attentive_least,
                most: self.attentive_most.max(self.attentive_least),
                full_m_s: self.attentive_full_m_s,
                share: self.attentive_share,
            },
            fall_per_tick: (fall > 0.0).then(|| fall * timing.period_s()),
            yields_to_push: self.yield_to_push,
        }
    }

    /// The period at which setpoints are repeated while motion is permitted.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive here, and a conversion from a float saturates"
    )]
    pub(crate) fn setpoint_period(&self) -> Option<Nanos> {
        (self.setpoint_hz > 0.0).then(|| ((1e9 / self.setpoint_hz) as Nanos).max(1))
    }

    pub(crate) fn terms(&self) -> Terms {
        Terms {
            timeout: u64::from(self.lease_timeout_ms) * MILLISECOND,
            idle: u64::from(self.lease_idle_ms) * MILLISECOND,
        }
    }

    pub(crate) fn bounds(&self, timing: &Timing) -> Result<Bounds, WorkspaceTurnedOver> {
        for axis in 0..3 {
            let (min, max) = (self.workspace_min_m[axis], self.workspace_max_m[axis]);
            if min >= max {
                return Err(WorkspaceTurnedOver { axis, min, max });
            }
        }
        Ok(Bounds {
            workspace: Aabb {
                min: Vec3::from(self.workspace_min_m),
                max: Vec3::from(self.workspace_max_m),
            },
            speed: self.tool_speed_m_s,
            acceleration: self.tool_acceleration_m_s2,
            horizon: timing.period,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_settings::{Document, show};

    #[test]
    fn the_defaults_read_back_as_they_print() {
        let text = show(&ArbiterSettings::default());
        let document = Document::parse("defaults", &text).unwrap();
        assert_eq!(document.section::<ArbiterSettings>(), Ok(ArbiterSettings::default()));
    }

    #[test]
    fn a_workspace_turned_over_is_refused_by_name() {
        let settings = ArbiterSettings {
            workspace_min_m: [0.2, 0.5, 0.0],
            workspace_max_m: [0.8, -0.5, 0.8],
            ..ArbiterSettings::default()
        };
        let refused = settings.bounds(&Timing::default()).unwrap_err();
        assert_eq!(
            refused.to_string(),
            "arbiter.workspace_min_m[1] = 0.5 must be less than arbiter.workspace_max_m[1] = -0.5"
        );
    }
}
