//! Bounds on the velocity that may be asked of the tool: speed, change of speed, workspace.

use tandem_wire::{Aabb, Limited, Malformed, Memory, Nanos, Remember, Stamp, Vec3, seconds};

/// Rounding must not raise a flag: a command capped at exactly the limit may come out one bit longer.
const SLACK: f64 = 1e-9;

/// The bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    pub(crate) workspace: Aabb,
    /// In metres per second.
    pub(crate) speed: f64,
    /// In metres per second squared.
    pub(crate) acceleration: f64,
    /// How long a velocity may hold before the next one comes: one control period.
    pub(crate) horizon: Nanos,
}

/// The bounds, and the last velocity that the next one is compared with.
#[derive(Clone, Debug)]
pub(crate) struct Limits {
    bounds: Bounds,
    last: Vec3,
    at: Stamp,
}

impl Limits {
    pub(crate) fn new(bounds: Bounds) -> Self {
        Self {
            bounds,
            last: Vec3::ZERO,
            at: Stamp(0),
        }
    }

    /// Motion is held: the next velocity starts from rest.
    pub(crate) fn rest(&mut self, now: Stamp) {
        self.last = Vec3::ZERO;
        self.at = now;
    }

    /// Another trial or another robot: what moved before does not move now.
    pub(crate) fn forget(&mut self) {
        self.last = Vec3::ZERO;
    }

    /// The velocity nearest to `wanted` that the bounds allow for a tool at `tool`, and what they changed.
    ///
    /// Speed first, then its change since the last velocity (a mean of two vectors within the speed limit stays
    /// within it), and the workspace last: a ramp must not carry the tool out. So the workspace may stop the tool
    /// harder than `acceleration`; the arm's own ramp takes that up.
    pub(crate) fn apply(&mut self, now: Stamp, tool: Vec3, wanted: Vec3) -> (Vec3, Limited) {
        let (slowed, speed) = capped(wanted, self.bounds.speed);
        let passed = seconds(now.since(self.at).min(self.bounds.horizon));
        let (change, acceleration) = capped(slowed - self.last, self.bounds.acceleration * passed);
        let ramped = if acceleration { self.last + change } else { slowed };
        let kept = self.inside(tool, ramped);
        self.last = kept;
        self.at = now;
        let limited = Limited {
            workspace: kept != ramped,
            speed,
            acceleration,
        };
        (kept, limited)
    }

    /// Takes away, per axis, what would leave the workspace within the horizon. Outside of it only the way back in
    /// remains.
    fn inside(&self, tool: Vec3, velocity: Vec3) -> Vec3 {
        let horizon = seconds(self.bounds.horizon);
        let (low, high) = (
            self.bounds.workspace.min.to_array(),
            self.bounds.workspace.max.to_array(),
        );
        let (tool, velocity) = (tool.to_array(), velocity.to_array());
        let kept: [f64; 3] = std::array::from_fn(|axis| {
            let back = (low[axis] - tool[axis]) / horizon;
            let forth = (high[axis] - tool[axis]) / horizon;
            between(
                velocity[axis],
                if back < 0.0 { back } else { 0.0 },
                if forth > 0.0 { forth } else { 0.0 },
            )
        });
        Vec3::from(kept)
    }
}

impl Remember for Limits {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self { bounds: _, last, at } = self;
        memory.part(last)?;
        memory.part(at)
    }
}

fn capped(vector: Vec3, limit: f64) -> (Vec3, bool) {
    if vector.norm() <= limit + SLACK {
        (vector, false)
    } else {
        (vector.capped(limit), true)
    }
}

/// Spelled out, because `f64::min` and `max` leave the sign of a zero to the processor, and setpoints repeat to the bit.
fn between(value: f64, low: f64, high: f64) -> f64 {
    if value < low {
        low
    } else if value > high {
        high
    } else {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::MILLISECOND;

    const CENTRE: Vec3 = Vec3::new(0.5, 0.0, 0.3);

    fn limits() -> Limits {
        Limits::new(Bounds {
            workspace: Aabb {
                min: Vec3::new(0.2, -0.5, 0.0),
                max: Vec3::new(0.8, 0.5, 0.8),
            },
            speed: 0.5,
            acceleration: 10.0,
            horizon: 100 * MILLISECOND,
        })
    }

    fn at(millis: u64) -> Stamp {
        Stamp(millis * MILLISECOND)
    }

    #[test]
    fn what_is_within_the_bounds_passes_untouched() {
        let wanted = Vec3::new(0.1, -0.05, 0.02);
        assert_eq!(limits().apply(at(100), CENTRE, wanted), (wanted, Limited::default()));
    }

    #[test]
    fn the_speed_is_capped_and_the_direction_kept() {
        let (velocity, limited) = limits().apply(at(100), CENTRE, Vec3::new(0.0, 3.0, 4.0));
        assert!((velocity - Vec3::new(0.0, 0.3, 0.4)).norm() < 1e-12);
        assert!(limited.speed && !limited.acceleration && !limited.workspace);
    }

    #[test]
    fn a_step_is_spread_over_time_at_the_acceleration_limit() {
        let mut limits = limits();
        let wanted = Vec3::new(0.0, 0.5, 0.0);
        let (first, limited) = limits.apply(at(20), CENTRE, wanted);
        assert!((first.y - 0.2).abs() < 1e-12 && limited.acceleration);
        assert!((limits.apply(at(40), CENTRE, wanted).0.y - 0.4).abs() < 1e-12);
        assert_eq!(limits.apply(at(60), CENTRE, wanted), (wanted, Limited::default()));
    }

    #[test]
    fn a_long_silence_does_not_allow_a_jump() {
        let mut limits = limits();
        limits.bounds.acceleration = 1.0;
        let (velocity, _) = limits.apply(at(60_000), CENTRE, Vec3::new(0.5, 0.0, 0.0));
        assert!((velocity.x - 0.1).abs() < 1e-12);
    }

    #[test]
    fn the_border_stops_only_the_component_that_would_cross_it() {
        let tool = Vec3::new(0.79, 0.0, 0.3);
        let (velocity, limited) = limits().apply(at(100), tool, Vec3::new(0.3, 0.2, 0.0));
        assert!((velocity.x - 0.1).abs() < 1e-12 && velocity.y == 0.2 && limited.workspace);
    }

    #[test]
    fn outside_only_the_way_back_is_open() {
        let tool = Vec3::new(0.9, 0.0, -0.1);
        let (velocity, _) = limits().apply(at(100), tool, Vec3::new(0.2, 0.1, -0.2));
        assert_eq!(velocity, Vec3::new(0.0, 0.1, 0.0));
        let (velocity, limited) = limits().apply(at(100), tool, Vec3::new(-0.2, 0.1, 0.2));
        assert_eq!((velocity, limited), (Vec3::new(-0.2, 0.1, 0.2), Limited::default()));
    }
}
