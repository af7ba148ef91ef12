//! The keyboard as the node knows it: device samples in, velocity and deadman out. No terminal here.
//!
//! A sample says which keys are down now. It is seven bytes, sent every 20 ms whether anything changed or not:
//!
//! | byte | meaning |
//! | --- | --- |
//! | 0 | version of this layout, 3: 2 is that of a recording that is played |
//! | 1 | keys down, a bit each: +x, −x, +y, −y of the task, up, down, hold |
//! | 2 | presses so far, modulo 256: how often a first key went down |
//! | 3 | trials asked for so far, modulo 256 |
//! | 4 | emergency stops so far, modulo 256 |
//! | 5 | times that the lease was given up so far, modulo 256 |
//! | 6 | times that the lease was to be taken over so far, modulo 256 |
//!
//! The counts let a lost sample hide nothing, and a repeated one do nothing twice.

use bincode::{Decode, Encode};
use tandem_wire::{Malformed, Memory, Nanos, Remember, Stamp, Vec3};

use crate::config::KeyConfig;
use crate::hand::Hand;

/// The version of a sample's layout.
const VERSION: u8 = 3;
/// The length of a sample.
const SAMPLE_BYTES: usize = 7;

/// Which keys are down.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub struct Keys(u8);

impl Keys {
    /// Towards the task's positive x: to the right in the plan view.
    pub const RIGHT: Self = Self(1);
    /// Towards the task's negative x.
    pub const LEFT: Self = Self(1 << 1);
    /// Towards the task's positive y: up in the plan view.
    pub const FORWARD: Self = Self(1 << 2);
    /// Towards the task's negative y.
    pub const BACK: Self = Self(1 << 3);
    /// Up, off the table.
    pub const UP: Self = Self(1 << 4);
    /// Down, onto the table.
    pub const DOWN: Self = Self(1 << 5);
    /// Holds the deadman without moving: lets the robot lead.
    pub const HOLD: Self = Self(1 << 6);

    const KNOWN: u8 = 0x7f;

    /// These keys and those.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether all of `other` are down.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Whether none is down.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Where the keys point: 1, 0 or −1 along the task's x, its y, and up. Opposite keys cancel.
    fn direction(self) -> [f64; 3] {
        let axis = |plus, minus| f64::from(u8::from(self.contains(plus))) - f64::from(u8::from(self.contains(minus)));
        [
            axis(Self::RIGHT, Self::LEFT),
            axis(Self::FORWARD, Self::BACK),
            axis(Self::UP, Self::DOWN),
        ]
    }
}

/// One sample of a keyboard.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub struct DeviceSample {
    /// Which keys are down.
    pub keys: Keys,
    /// Presses so far, modulo 256: how often a key went down while none was.
    pub presses: u8,
    /// Trials asked for so far, modulo 256.
    pub requests: u8,
    /// Emergency stops so far, modulo 256.
    pub stops: u8,
    /// Times that the lease was given up so far, modulo 256.
    pub releases: u8,
    /// Times that the lease was to be taken over so far, modulo 256.
    pub take_overs: u8,
}

/// What a sample asks for besides motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Asked {
    /// A new trial.
    pub(crate) trial: bool,
    /// An emergency stop.
    pub(crate) stop: bool,
    /// To give the lease up.
    pub(crate) release: bool,
    /// To take the lease over.
    pub(crate) take_over: bool,
}

impl DeviceSample {
    /// The sample's bytes.
    #[must_use]
    pub const fn to_bytes(self) -> [u8; SAMPLE_BYTES] {
        let Self {
            keys,
            presses,
            requests,
            stops,
            releases,
            take_overs,
        } = self;
        [VERSION, keys.0, presses, requests, stops, releases, take_overs]
    }

    /// Reads a sample.
    ///
    /// # Errors
    /// If the length, the version or the keys are not those of this layout.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Malformed> {
        match *bytes {
            [VERSION, keys, presses, requests, stops, releases, take_overs] if keys & !Keys::KNOWN == 0 => Ok(Self {
                keys: Keys(keys),
                presses,
                requests,
                stops,
                releases,
                take_overs,
            }),
            [VERSION, _, _, _, _, _, _] => Err(Malformed::Body),
            [version, _, _, _, _, _, _] => Err(Malformed::Version(version)),
            _ if bytes.len() < SAMPLE_BYTES => Err(Malformed::Truncated(bytes.len())),
            _ => Err(Malformed::Oversized(bytes.len())),
        }
    }
}

/// A keyboard whose samples may stop at any time.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Keyboard {
    config: KeyConfig,
    hand: Hand<Keys>,
    /// The newest sample, until the device falls silent.
    newest: Option<DeviceSample>,
    /// Emergency stops so far, modulo 256. Outlasts silence: one that was asked for meanwhile still counts.
    stops: u8,
}

impl Keyboard {
    pub(crate) const fn new(config: KeyConfig) -> Self {
        Self {
            config,
            hand: Hand::new(config.timeout),
            newest: None,
            stops: 0,
        }
    }

    /// Takes in a sample; says what it asks for.
    pub(crate) fn take(&mut self, now: Stamp, sample: DeviceSample, has_picture: bool) -> Asked {
        let keys = Some(sample.keys).filter(|keys| !keys.is_empty());
        self.hand.take(now, keys, sample.presses, has_picture);
        let stop = std::mem::replace(&mut self.stops, sample.stops) != sample.stops;
        let Some(before) = self.newest.replace(sample) else {
            return Asked {
                stop,
                ..Asked::default()
            };
        };
        Asked {
            trial: before.requests != sample.requests,
            stop,
            release: before.releases != sample.releases,
            take_over: before.take_overs != sample.take_overs,
        }
    }

    /// Lets time pass: a device that has been silent for too long is absent.
    pub(crate) fn expire(&mut self, now: Stamp) {
        if self.hand.expire(now) {
            self.newest = None;
        }
    }

    pub(crate) fn velocity(&self) -> Vec3 {
        let Some(keys) = self.hand.held() else {
            return Vec3::ZERO;
        };
        let [x, y, up] = keys.direction();
        let direction = self.config.frame.vector_to_base([x, y]) + Vec3::new(0.0, 0.0, up);
        (direction * self.config.speed).capped(self.config.speed)
    }

    pub(crate) const fn hand(&self) -> &Hand<Keys> {
        &self.hand
    }

    pub(crate) const fn hand_mut(&mut self) -> &mut Hand<Keys> {
        &mut self.hand
    }
}

impl Remember for Keyboard {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            config: _,
            hand,
            newest,
            stops,
        } = self;
        hand.remember(memory)?;
        memory.part(newest)?;
        memory.part(stops)
    }
}

/// How often a device is sampled.
pub const SAMPLE_PERIOD: Nanos = 20 * tandem_wire::MILLISECOND;

#[cfg(test)]
mod tests {
    use tandem_wire::{Deadman, MILLISECOND, TaskFrame};

    use super::*;
    use crate::hand::Handling;

    fn keyboard() -> Keyboard {
        Keyboard::new(KeyConfig {
            frame: TaskFrame::default(),
            speed: 0.1,
            timeout: 150 * MILLISECOND,
        })
    }

    fn sample(keys: Keys, presses: u8) -> DeviceSample {
        DeviceSample {
            keys,
            presses,
            ..DeviceSample::default()
        }
    }

    const HELD: fn(u32) -> Deadman = |press| Deadman::Held { press };

    #[test]
    fn samples_are_read_back_and_others_refused() {
        let sample = DeviceSample {
            keys: Keys::LEFT.and(Keys::HOLD),
            presses: 200,
            requests: 3,
            stops: 4,
            releases: 5,
            take_overs: 6,
        };
        assert_eq!(DeviceSample::from_bytes(&sample.to_bytes()), Ok(sample));
        assert_eq!(sample.to_bytes(), [3, 0b0100_0010, 200, 3, 4, 5, 6]);
        assert_eq!(DeviceSample::from_bytes(&[]), Err(Malformed::Truncated(0)));
        assert_eq!(DeviceSample::from_bytes(&[3; 8]), Err(Malformed::Oversized(8)));
        assert_eq!(
            DeviceSample::from_bytes(&[1, 0, 0, 0, 0, 0, 0]),
            Err(Malformed::Version(1))
        );
        assert_eq!(
            DeviceSample::from_bytes(&[3, 0x80, 0, 0, 0, 0, 0]),
            Err(Malformed::Body)
        );
    }

    #[test]
    fn keys_move_along_the_task_and_no_faster_on_the_diagonal() {
        let mut keyboard = keyboard();
        keyboard.take(Stamp(0), sample(Keys::default(), 0), true);
        keyboard.take(Stamp(1), sample(Keys::RIGHT, 1), true);
        assert_eq!(keyboard.velocity(), Vec3::new(0.0, 0.1, 0.0));
        keyboard.take(Stamp(2), sample(Keys::RIGHT.and(Keys::FORWARD), 1), true);
        assert!((keyboard.velocity().norm() - 0.1).abs() < 1e-12 && keyboard.velocity().x < 0.0);
        assert_eq!(keyboard.hand().deadman(), HELD(1));
        keyboard.take(Stamp(3), sample(Keys::RIGHT.and(Keys::LEFT), 1), true);
        assert_eq!((keyboard.velocity(), keyboard.hand().deadman()), (Vec3::ZERO, HELD(1)));
        keyboard.take(Stamp(4), sample(Keys::HOLD, 1), true);
        assert_eq!((keyboard.velocity(), keyboard.hand().deadman()), (Vec3::ZERO, HELD(1)));
    }

    #[test]
    fn a_release_between_two_samples_is_a_fresh_press() {
        let mut keyboard = keyboard();
        keyboard.take(Stamp(0), sample(Keys::default(), 255), true);
        keyboard.take(Stamp(1), sample(Keys::LEFT, 0), true);
        assert_eq!(keyboard.hand().deadman(), HELD(1));
        keyboard.take(Stamp(2), sample(Keys::LEFT, 1), true);
        assert_eq!(keyboard.hand().deadman(), HELD(2));
    }

    #[test]
    fn keys_down_at_the_start_or_after_silence_must_go_up_first() {
        let mut keyboard = keyboard();
        keyboard.take(Stamp(0), sample(Keys::LEFT, 1), true);
        assert_eq!(keyboard.hand().deadman(), Deadman::Released);
        keyboard.take(Stamp(1), sample(Keys::default(), 1), true);
        keyboard.take(Stamp(2), sample(Keys::LEFT, 2), true);
        assert_eq!(keyboard.hand().deadman(), HELD(1));
        keyboard.expire(Stamp(2).after(150 * MILLISECOND));
        assert_eq!(keyboard.hand().deadman(), HELD(1));
        keyboard.expire(Stamp(3).after(150 * MILLISECOND));
        assert_eq!(
            (keyboard.hand().deadman(), keyboard.velocity()),
            (Deadman::Released, Vec3::ZERO)
        );
        keyboard.take(Stamp(200 * MILLISECOND), sample(Keys::LEFT, 2), true);
        assert_eq!(keyboard.hand().handling(), Handling::Spent);
    }

    #[test]
    fn an_emergency_stop_asked_for_while_the_device_was_silent_counts_once() {
        let mut keyboard = keyboard();
        let mut ask = |millis, stops| {
            let sample = DeviceSample {
                stops,
                ..DeviceSample::default()
            };
            keyboard.expire(Stamp(millis * MILLISECOND));
            keyboard.take(Stamp(millis * MILLISECOND), sample, false).stop
        };
        assert_eq!([ask(0, 0), ask(20, 0)], [false, false]);
        assert_eq!([ask(400, 1), ask(420, 1), ask(900, 1)], [true, false, false]);
    }

    #[test]
    fn a_request_is_a_change_of_its_count() {
        let mut keyboard = keyboard();
        let mut ask = |at, requests| {
            let sample = DeviceSample {
                requests,
                ..DeviceSample::default()
            };
            keyboard.take(Stamp(at), sample, true).trial
        };
        assert_eq!(
            [ask(0, 7), ask(1, 7), ask(2, 8), ask(3, 8)],
            [false, false, true, false]
        );
    }
}
