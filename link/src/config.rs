//! The sections of `tandem.toml` that several nodes share: who to talk to, at which rates, and where the task lies.

use tandem_settings::{choices, settings};
use tandem_wire::{MILLISECOND, Nanos, Pace, TaskFrame, Timing, Vec3};

choices! {
    /// What drives time.
    pub enum PaceName {
        /// The clock does.
        Real = "real",
        /// Messages do, as fast as they travel.
        Max = "max",
    }
}

settings! {
    /// Who this process talks to. One process listens and is the router; the others connect to it.
    pub struct LinkSettings("link") {
        /// The robot that this is about; several share one network under different names.
        pub robot: String = "panda";
        /// Where to listen, such as "tcp/127.0.0.1:7447". Whoever listens routes for the others.
        pub listen: Vec<String> = [];
        /// Whom to connect to, for ever if need be. Without listen and connect: tcp/127.0.0.1:7447.
        pub connect: Vec<String> = [];
        /// The folder with this machine's certificates, which tandem keys makes. With it every connection is TLS, both sides
        /// show who they are, and whoever listens lets each do what its role may. Empty: no certificates.
        pub site: String = "";
        /// Which member of the site this process is; if empty, the one whose role it needs.
        pub member: String = "";
        /// Listen beyond this machine without certificates. Anyone who reaches the port can then command the robot.
        pub insecure: bool = false;
        /// The folder in which a node keeps its journal until a recorder has all of it; if empty, a folder of its own
        /// among the system's temporary files.
        pub spool: String = "";
        /// The most that a node's kept journal may take, in MiB; the oldest part goes first. 0 keeps nothing, so that a
        /// recorder cannot fill gaps.
        pub spool_mib: u64 = 64, in 0..=65536;
    }
}

settings! {
    /// Rates, limits in time and the seed; the same for all nodes of a robot.
    pub struct LoopSettings("loop") {
        /// What drives time.
        pub pace: PaceName = PaceName::Real;
        /// The control period, at which checkpoint, weight and phase advance, in milliseconds.
        pub period_ms: f64 = 100.0, in 1.0..=1000.0;
        /// The rate of commands, setpoints and states in real time, in hertz.
        pub stream_hz: f64 = 50.0, in 5.0..=1000.0;
        /// After this much silence a stream is lost (or 2.5 of its periods, if longer), in milliseconds.
        pub timeout_ms: f64 = 100.0, in 10.0..=2000.0;
        /// A command or setpoint made from a state older than this is dropped, in milliseconds.
        pub loop_age_limit_ms: f64 = 500.0, in 20.0..=5000.0;
        /// The number of the first control period in lockstep: the trials of a run count on from each other.
        pub first_tick: u32 = 0, in 0..=4_000_000_000;
        /// The seed of all that nodes draw at random: the simulated human's wish and the noise of its hand.
        pub seed: u64 = 1;
    }
}

settings! {
    /// How the nodes watch each other's clocks. Nothing that moves the robot looks at them.
    pub struct ClockSettings("clock") {
        /// How often a node pings its peers, in milliseconds, and four times as often while one of them is new; 0: never, it
        /// only answers. In lockstep nobody pings.
        pub every_ms: u64 = 2000, in 0..=60000;
        /// Wall clocks that are further apart than this, in milliseconds, are warned of.
        pub skew_alarm_ms: u64 = 100, in 1..=86400000;
    }
}

settings! {
    /// Where the task's plane lies in the robot's base frame: base = origin + x * x_axis + y * y_axis.
    pub struct TaskSettings("task") {
        /// Task coordinates (0, 0), in metres.
        pub origin_m: [f64; 3] = [0.5, -0.3, 0.15], in -2.0..=2.0;
        /// Direction of the task's x.
        pub x_axis: [f64; 3] = [0.0, 1.0, 0.0], in -1.0..=1.0;
        /// Direction of the task's y, at right angles to x_axis.
        pub y_axis: [f64; 3] = [-1.0, 0.0, 0.0], in -1.0..=1.0;
    }
}

/// The axes of the task's plane do not span one.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("task.x_axis and task.y_axis must have length 1 and stand at right angles (to 1e-6)")]
pub struct CrookedAxes;

impl LoopSettings {
    /// The settings as exact integers.
    #[must_use]
    pub fn timing(&self) -> Timing {
        Timing {
            pace: match self.pace {
                PaceName::Real => Pace::Real,
                PaceName::Max => Pace::Lockstep,
            },
            period: nanos(self.period_ms),
            stream_period: nanos(1000.0 / self.stream_hz),
            timeout: nanos(self.timeout_ms),
            loop_age_limit: nanos(self.loop_age_limit_ms),
            first_tick: self.first_tick,
        }
    }
}

impl TaskSettings {
    /// The settings as a frame.
    ///
    /// # Errors
    /// If the axes are not unit vectors at right angles.
    pub fn frame(&self) -> Result<TaskFrame, CrookedAxes> {
        let frame = TaskFrame {
            origin: Vec3::from(self.origin_m),
            x_axis: Vec3::from(self.x_axis),
            y_axis: Vec3::from(self.y_axis),
        };
        let off = |value: f64, wanted: f64| (value - wanted).abs() > 1e-6;
        let crooked =
            off(frame.x_axis.norm(), 1.0) || off(frame.y_axis.norm(), 1.0) || off(frame.x_axis.dot(frame.y_axis), 0.0);
        if crooked { Err(CrookedAxes) } else { Ok(frame) }
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the ranges above keep it positive and small"
)]
fn nanos(millis: f64) -> Nanos {
    (millis * MILLISECOND as f64).round() as Nanos
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_the_vocabularys_defaults() {
        assert_eq!(LoopSettings::default().timing(), Timing::default());
        assert_eq!(TaskSettings::default().frame(), Ok(TaskFrame::default()));
    }

    #[test]
    fn crooked_axes_are_refused() {
        let crooked = TaskSettings {
            y_axis: [0.0, 1.0, 0.0],
            ..TaskSettings::default()
        };
        assert_eq!(crooked.frame(), Err(CrookedAxes));
    }
}
