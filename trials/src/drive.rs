//! Driving a live robot along a recorded path: a machine without a clock, a network or a keyboard.
//!
//! What is followed is the path that the recorded *tool* took, at the speed at which it went, not the bare commands of
//! the recorded human: those are only one part of a blend, and played open loop they would lead astray, ever farther.
//! What comes out is what an operator's hand would do, a velocity and a deadman, so that everything that keeps an
//! operator safe keeps this safe: arbiter and robot hold, weigh and limit it as they do anybody's.
//!
//! ```text
//!             first state: too far               press                    permitted
//!  Looking ─────────────────────▶ Ended   Waiting ─────▶ Asking ─────────────────────▶ Easing, Following ──▶ Ended
//!     └── near enough ──────────────────────▶ ▲            │ nobody permits it              │    the end of the path
//!                                             └────────────┴──────── stop, a hold, astray ──┘
//! ```
//!
//! Nothing leads from a hold back to motion but another press. The path waits meanwhile, and is gone on with where it
//! was left.

mod phase;
mod track;

use tandem_settings::settings;
use tandem_wire::{Envelope, JOINTS, MILLISECOND, Motion, Nanos, Reason, SECOND, Stamp, State, Vec3};

use phase::NO_PROGRESS;
pub use phase::{Deviation, End, Hand, Pause, Phase, Wish};
pub use track::{NoTrack, Track, Waypoint};

settings! {
    /// Driving a robot along a recording: `tandem replay --drive`.
    pub struct DriveSettings("replay") {
        /// A robot whose tool is no farther than this from the recording's first position starts at once, in millimetres.
        pub start_within_mm: f64 = 5.0, in 0.5..=50.0;
        /// One that is no farther than this is first brought there along a straight line, in millimetres. Obstacles on
        /// the way are not looked for. Beyond this it is refused.
        pub ease_in_within_mm: f64 = 100.0, in 0.5..=500.0;
        /// How fast it is brought there, in metres per second.
        pub ease_in_speed_m_s: f64 = 0.05, in 0.005..=0.25;
        /// A robot one of whose joints differs by more than this from the recording's first posture is refused, in
        /// radians: its elbow would go another way.
        pub joints_within_rad: f64 = 0.6, in 0.01..=6.3;
        /// A tool that is farther than this from where the recording has it is stopped, in millimetres.
        pub astray_mm: f64 = 50.0, in 2.0..=500.0;
        /// The share of the distance to the recorded position that is made good per second.
        pub correction_per_s: f64 = 4.0, in 0.0..=20.0;
    }
}

/// How long nobody may permit motion after a press.
const ANSWER_WITHIN: Nanos = SECOND;
/// A robot that was heard is given up after so much silence.
const SILENT: Nanos = SECOND;
/// And one that was never heard after this.
const NEVER_HEARD: Nanos = 5 * SECOND;
/// The nearest place on the path is looked for so far ahead and behind.
const NEARBY: Nanos = 500 * MILLISECOND;
/// At the end of the path, the tool may take so long to come to rest there.
const SETTLE: Nanos = SECOND;
/// A tool that came this much nearer has made progress, in metres.
const NEARER_M: f64 = 0.001;
/// A longer gap than this between two steps does not carry the path on: the process was suspended.
const LONGEST_STEP: Nanos = 100 * MILLISECOND;

/// Follows a [`Track`] with a live robot.
#[derive(Clone, Debug)]
pub struct Driver {
    track: Track,
    settings: DriveSettings,
    /// Of the recorded speed, in thousandths.
    per_mille: u32,
    phase: Phase,
    /// How far along the track.
    at: Nanos,
    presses: u8,
    began: Stamp,
    stepped: Stamp,
    /// Since when it has been in this phase.
    since: Stamp,
    robot: Option<Robot>,
    /// The press that permitted motion before ours.
    before: Option<u32>,
    /// The smallest distance to the path since easing in began, and when it was reached.
    nearest: (f64, Stamp),
    deviation: Deviation,
}

#[derive(Clone, Copy, Debug)]
struct Robot {
    heard: Stamp,
    tool: Vec3,
    motion: Motion,
}

impl Driver {
    /// A driver along `track`, at this many thousandths of the recorded speed.
    #[must_use]
    pub const fn new(track: Track, settings: DriveSettings, per_mille: u32, now: Stamp) -> Self {
        Self {
            track,
            settings,
            per_mille,
            phase: Phase::Looking,
            at: 0,
            presses: 0,
            began: now,
            stepped: now,
            since: now,
            robot: None,
            before: None,
            nearest: (f64::INFINITY, now),
            deviation: Deviation::NONE,
        }
    }

    /// Where it stands.
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.phase
    }

    /// How far along the track it is.
    #[must_use]
    pub const fn position(&self) -> Nanos {
        self.at
    }

    /// The track.
    #[must_use]
    pub const fn track(&self) -> &Track {
        &self.track
    }

    /// How far the tool was from the path so far.
    #[must_use]
    pub const fn deviation(&self) -> Deviation {
        self.deviation
    }

    /// The robot published a state.
    pub fn see(&mut self, now: Stamp, state: &Envelope<State>) {
        let robot = Robot {
            heard: now,
            tool: state.body.tool.position,
            motion: state.body.motion,
        };
        self.robot = Some(robot);
        match self.phase {
            Phase::Looking => {
                let refused = self.too_far(robot.tool).or_else(|| self.other_posture(&state.body));
                self.enter(now, refused.map_or(Phase::Waiting(Pause::Ready), Phase::Ended));
            }
            Phase::Asking => self.hear_answer(now, robot),
            Phase::Easing(_) | Phase::Following => self.watch(now, robot),
            Phase::Waiting(_) | Phase::Ended(_) => {}
        }
    }

    /// The person pressed something.
    pub fn wish(&mut self, now: Stamp, wish: Wish) {
        match (wish, self.phase, self.robot) {
            (Wish::Go, Phase::Waiting(_), Some(robot)) => {
                if let Some(end) = self.too_far(robot.tool) {
                    return self.enter(now, Phase::Ended(end));
                }
                self.before = press(robot.motion);
                self.presses = self.presses.wrapping_add(1);
                self.enter(now, Phase::Asking);
            }
            (Wish::Stop, Phase::Asking | Phase::Easing(_) | Phase::Following, _) => {
                self.enter(now, Phase::Waiting(Pause::Stopped));
            }
            _ => {}
        }
    }

    /// Lets time pass, and says what the hand does now.
    pub fn step(&mut self, now: Stamp) -> Hand {
        let passed = now.since(self.stepped).min(LONGEST_STEP);
        self.stepped = self.stepped.max(now);
        self.watch_silence(now);
        let velocity = match (self.phase, self.robot) {
            (Phase::Asking, _) => {
                if now.since(self.since) > ANSWER_WITHIN {
                    let reason = self.robot.and_then(|robot| robot.motion.reason());
                    self.enter(
                        now,
                        Phase::Waiting(Pause::Held(reason.unwrap_or(Reason::AwaitingPress))),
                    );
                }
                Vec3::ZERO
            }
            (Phase::Easing(_), Some(robot)) => self.ease(now, robot.tool),
            (Phase::Following, Some(robot)) => self.follow(now, passed, robot.tool),
            _ => Vec3::ZERO,
        };
        let held = matches!(self.phase, Phase::Asking | Phase::Easing(_) | Phase::Following);
        Hand {
            held,
            presses: self.presses,
            velocity: if held { velocity } else { Vec3::ZERO },
        }
    }

    fn enter(&mut self, now: Stamp, phase: Phase) {
        self.phase = phase;
        self.since = now;
    }

    fn too_far(&self, tool: Vec3) -> Option<End> {
        let distance = (self.track.position(self.at) - tool).norm();
        let limit = self.settings.ease_in_within_mm.max(self.settings.start_within_mm) * 1e-3;
        (distance > limit).then_some(End::TooFar { distance, limit })
    }

    fn other_posture(&self, state: &State) -> Option<End> {
        let recorded = self.track.joints()?;
        let differs: [f64; JOINTS] = std::array::from_fn(|i| (recorded[i] - state.joints[i].0).abs());
        let (joint, by) = differs
            .into_iter()
            .enumerate()
            .fold((0, 0.0), |most, one| if one.1 > most.1 { one } else { most });
        let limit = self.settings.joints_within_rad;
        (by > limit).then_some(End::OtherPosture {
            joint: joint + 1,
            by,
            limit,
        })
    }

    /// After a press: motion that is permitted by another press than before is permitted by ours.
    fn hear_answer(&mut self, now: Stamp, robot: Robot) {
        match press(robot.motion) {
            Some(press) if self.before != Some(press) => {
                let distance = (self.track.position(self.at) - robot.tool).norm();
                self.nearest = (distance, now);
                let near = distance <= self.settings.start_within_mm * 1e-3;
                self.enter(
                    now,
                    if near {
                        Phase::Following
                    } else {
                        Phase::Easing(distance)
                    },
                );
            }
            Some(_) => {}
            None => self.before = None,
        }
    }

    fn watch(&mut self, now: Stamp, robot: Robot) {
        if let Some(reason) = robot.motion.reason() {
            return self.enter(now, Phase::Waiting(Pause::Held(reason)));
        }
        let in_time = (self.track.position(self.at) - robot.tool).norm();
        if self.phase == Phase::Following {
            let distance = self.track.distance(robot.tool, self.at, NEARBY);
            self.deviation.add(distance, in_time);
            if in_time > self.settings.astray_mm * 1e-3 {
                self.enter(now, Phase::Waiting(Pause::Astray(in_time)));
            }
        }
    }

    fn watch_silence(&mut self, now: Stamp) {
        let (since, limit, ever) = match self.robot {
            Some(robot) => (robot.heard, SILENT, true),
            None => (self.began, NEVER_HEARD, false),
        };
        let nanos = now.since(since);
        if nanos > limit && !matches!(self.phase, Phase::Ended(_)) {
            self.enter(now, Phase::Ended(End::Silent { nanos, ever }));
        }
    }

    /// Straight to the path, slower the nearer.
    fn ease(&mut self, now: Stamp, tool: Vec3) -> Vec3 {
        let way = self.track.position(self.at) - tool;
        let distance = way.norm();
        if distance <= self.settings.start_within_mm * 1e-3 {
            self.enter(now, Phase::Following);
            return Vec3::ZERO;
        }
        if distance < self.nearest.0 - NEARER_M {
            self.nearest = (distance, now);
        } else if now.since(self.nearest.1) > NO_PROGRESS {
            self.enter(now, Phase::Waiting(Pause::NoProgress));
            return Vec3::ZERO;
        }
        self.phase = Phase::Easing(distance);
        (way * self.settings.correction_per_s.max(1.0)).capped(self.settings.ease_in_speed_m_s)
    }

    /// The recorded velocity, and a part of what is missing.
    fn follow(&mut self, now: Stamp, passed: Nanos, tool: Vec3) -> Vec3 {
        let on = u128::from(passed) * u128::from(self.per_mille) / 1000;
        let end = self.track.duration();
        self.at = self.at.saturating_add(u64::try_from(on).unwrap_or(u64::MAX)).min(end);
        let missing = self.track.position(self.at) - tool;
        if self.at < end {
            self.since = now;
        } else if missing.norm() < NEARER_M || now.since(self.since) > SETTLE {
            self.enter(now, Phase::Ended(End::Arrived));
        }
        let speed = f64::from(self.per_mille) * 1e-3;
        self.track.velocity(self.at) * speed + missing * self.settings.correction_per_s
    }
}

const fn press(motion: Motion) -> Option<u32> {
    match motion {
        Motion::Permitted { press } => Some(press),
        Motion::Held(_) => None,
    }
}
