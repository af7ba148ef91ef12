//! The keyboard as the node knows it: device samples in, velocity and deadman out. No terminal here.
//!
//! A sample says which keys are down now. It is seven bytes, sent every 20 ms whether anything changed or not:
//!
//! | byte | meaning |
//! | --- | --- |
//! | 0 | version of this layout, 2 |
//! | 1 | keys down, a bit each: +x, −x, +y, −y of the task, up, down, hold |
//! | 2 | presses so far, modulo 256: how often a first key went down |
//! | 3 | trials asked for so far, modulo 256 |
//! | 4 | emergency stops so far, modulo 256 |
//! | 5 | times that the lease was given up so far, modulo 256 |
//! | 6 | times that the lease was to be taken over so far, modulo 256 |
//!
//! The counts let a lost sample hide nothing, and a repeated one do nothing twice.

use bincode::{Decode, Encode};
use tandem_wire::{Deadman, Malformed, Memory, Nanos, Remember, Stamp, Vec3};

use crate::config::KeyConfig;

/// The version of a sample's layout.
const VERSION: u8 = 2;
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

/// Who holds what.
///
/// ```text
///          all up             a key goes down
///  Absent ────────▶ Open ─────────────────────────▶ Held ◀┐ keys change; pressed anew: next number
///    ▲ │             ▲  ◀──────── all up ───────────  │ └─┘
///    │ └─ keys down ─┼─▶ Spent ◀── no picture ────────┤
///    │               └──── │ ── pressed anew ─▶ Held  │
///    └─────────────────────┴────────── silence ───────┘
/// ```
///
/// Keys that are already down when we first look are `Spent`: they must go up before they count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
enum Grip {
    Absent,
    Open(Contact),
    Held(Contact, Keys),
    Spent(Contact),
}

/// The newest sample's arrival and counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
struct Contact {
    arrived: Stamp,
    sample: DeviceSample,
}

/// What the keyboard is doing, for whoever looks at the status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handling {
    /// No samples arrive.
    Absent,
    /// No key is down.
    Open,
    /// Keys are down and count.
    Held,
    /// Keys are down from before a loss: they must go up first.
    Spent,
}

/// A keyboard whose samples may stop at any time.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Keyboard {
    config: KeyConfig,
    grip: Grip,
    press: u32,
    /// Emergency stops so far, modulo 256. Outlasts silence: one that was asked for meanwhile still counts.
    stops: u8,
}

impl Keyboard {
    pub(crate) const fn new(config: KeyConfig) -> Self {
        Self {
            config,
            grip: Grip::Absent,
            press: 0,
            stops: 0,
        }
    }

    /// Takes in a sample; says what it asks for.
    pub(crate) fn take(&mut self, now: Stamp, sample: DeviceSample, has_picture: bool) -> Asked {
        let contact = Contact { arrived: now, sample };
        let before = self.contact().map(|contact| contact.sample);
        let anew = before.is_some_and(|before| before.presses != sample.presses);
        self.grip = match self.grip {
            _ if sample.keys.is_empty() => Grip::Open(contact),
            _ if !has_picture => Grip::Spent(contact),
            Grip::Absent => Grip::Spent(contact),
            Grip::Spent(_) if !anew => Grip::Spent(contact),
            Grip::Held(..) if !anew => Grip::Held(contact, sample.keys),
            Grip::Open(_) | Grip::Spent(_) | Grip::Held(..) => {
                self.press = self.press.wrapping_add(1);
                Grip::Held(contact, sample.keys)
            }
        };
        let stop = std::mem::replace(&mut self.stops, sample.stops) != sample.stops;
        let Some(before) = before else {
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
        if self.deadline().is_some_and(|deadline| now >= deadline) {
            self.grip = Grip::Absent;
        }
    }

    /// There is no picture any more: what is held does not count.
    pub(crate) fn go_blind(&mut self) {
        if let Grip::Held(contact, _) = self.grip {
            self.grip = Grip::Spent(contact);
        }
    }

    pub(crate) fn deadline(&self) -> Option<Stamp> {
        self.contact()
            .map(|contact| contact.arrived.after(self.config.timeout).after(1))
    }

    pub(crate) fn velocity(&self) -> Vec3 {
        let Grip::Held(_, keys) = self.grip else {
            return Vec3::ZERO;
        };
        let [x, y, up] = keys.direction();
        let direction = self.config.frame.vector_to_base([x, y]) + Vec3::new(0.0, 0.0, up);
        (direction * self.config.speed).capped(self.config.speed)
    }

    pub(crate) fn deadman(&self) -> Deadman {
        match self.grip {
            Grip::Held(..) => Deadman::Held { press: self.press },
            Grip::Absent | Grip::Open(_) | Grip::Spent(_) => Deadman::Released,
        }
    }

    pub(crate) fn handling(&self) -> Handling {
        match self.grip {
            Grip::Absent => Handling::Absent,
            Grip::Open(_) => Handling::Open,
            Grip::Held(..) => Handling::Held,
            Grip::Spent(_) => Handling::Spent,
        }
    }

    fn contact(&self) -> Option<Contact> {
        match self.grip {
            Grip::Absent => None,
            Grip::Open(contact) | Grip::Held(contact, _) | Grip::Spent(contact) => Some(contact),
        }
    }
}

impl Remember for Keyboard {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            config: _,
            grip,
            press,
            stops,
        } = self;
        memory.part(grip)?;
        memory.part(press)?;
        memory.part(stops)
    }
}

/// How often a device is sampled.
pub const SAMPLE_PERIOD: Nanos = 20 * tandem_wire::MILLISECOND;

#[cfg(test)]
mod tests {
    use tandem_wire::{MILLISECOND, TaskFrame};

    use super::*;

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
        assert_eq!(sample.to_bytes(), [2, 0b0100_0010, 200, 3, 4, 5, 6]);
        assert_eq!(DeviceSample::from_bytes(&[]), Err(Malformed::Truncated(0)));
        assert_eq!(DeviceSample::from_bytes(&[2; 8]), Err(Malformed::Oversized(8)));
        assert_eq!(
            DeviceSample::from_bytes(&[1, 0, 0, 0, 0, 0, 0]),
            Err(Malformed::Version(1))
        );
        assert_eq!(
            DeviceSample::from_bytes(&[2, 0x80, 0, 0, 0, 0, 0]),
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
        assert_eq!(keyboard.deadman(), HELD(1));
        keyboard.take(Stamp(3), sample(Keys::RIGHT.and(Keys::LEFT), 1), true);
        assert_eq!((keyboard.velocity(), keyboard.deadman()), (Vec3::ZERO, HELD(1)));
        keyboard.take(Stamp(4), sample(Keys::HOLD, 1), true);
        assert_eq!((keyboard.velocity(), keyboard.deadman()), (Vec3::ZERO, HELD(1)));
    }

    #[test]
    fn a_release_between_two_samples_is_a_fresh_press() {
        let mut keyboard = keyboard();
        keyboard.take(Stamp(0), sample(Keys::default(), 255), true);
        keyboard.take(Stamp(1), sample(Keys::LEFT, 0), true);
        assert_eq!(keyboard.deadman(), HELD(1));
        keyboard.take(Stamp(2), sample(Keys::LEFT, 1), true);
        assert_eq!(keyboard.deadman(), HELD(2));
    }

    #[test]
    fn keys_down_at_the_start_or_after_silence_must_go_up_first() {
        let mut keyboard = keyboard();
        keyboard.take(Stamp(0), sample(Keys::LEFT, 1), true);
        assert_eq!(keyboard.deadman(), Deadman::Released);
        keyboard.take(Stamp(1), sample(Keys::default(), 1), true);
        keyboard.take(Stamp(2), sample(Keys::LEFT, 2), true);
        assert_eq!(keyboard.deadman(), HELD(1));
        keyboard.expire(Stamp(2).after(150 * MILLISECOND));
        assert_eq!(keyboard.deadman(), HELD(1));
        keyboard.expire(Stamp(3).after(150 * MILLISECOND));
        assert_eq!(
            (keyboard.deadman(), keyboard.velocity()),
            (Deadman::Released, Vec3::ZERO)
        );
        keyboard.take(Stamp(200 * MILLISECOND), sample(Keys::LEFT, 2), true);
        assert_eq!(keyboard.handling(), Handling::Spent);
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
