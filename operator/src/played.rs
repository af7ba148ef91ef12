//! A recording at the operator's hand: samples of the velocity that it asks for, while somebody holds the deadman.
//!
//! A sample is 27 bytes, sent every 20 ms whether anything changed or not:
//!
//! | byte | meaning |
//! | --- | --- |
//! | 0 | version of this layout, 2: a keyboard's is 3 |
//! | 1 | 1 while the deadman is held, else 0 |
//! | 2 | presses so far, modulo 256 |
//! | 3–26 | velocity of the tool in the base frame, three little-endian numbers, in metres per second |
//!
//! They come from `tandem replay --drive`, through the same journal as a keyboard's, so that a session which was driven
//! by a recording can be executed again without it.

use tandem_wire::{Malformed, Memory, Nanos, Remember, Stamp, Vec3};

use crate::hand::Hand;

/// The version of a sample's layout.
pub(crate) const VERSION: u8 = 2;
/// The length of a sample.
const SAMPLE_BYTES: usize = 27;

/// One sample of a recording that is played.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlayedSample {
    /// Whether somebody holds the deadman.
    pub held: bool,
    /// Presses so far, modulo 256.
    pub presses: u8,
    /// Velocity of the tool, in the base frame, in metres per second.
    pub velocity: Vec3,
}

impl PlayedSample {
    /// The sample's bytes.
    #[must_use]
    pub fn to_bytes(self) -> Vec<u8> {
        let mut bytes = vec![VERSION, u8::from(self.held), self.presses];
        for component in self.velocity.to_array() {
            bytes.extend_from_slice(&component.to_le_bytes());
        }
        bytes
    }

    /// Reads a sample.
    ///
    /// # Errors
    /// If the length, the version, the deadman or the numbers are not those of this layout.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Malformed> {
        let Ok(sample) = <&[u8; SAMPLE_BYTES]>::try_from(bytes) else {
            return Err(match bytes.len() {
                length if length < SAMPLE_BYTES => Malformed::Truncated(length),
                length => Malformed::Oversized(length),
            });
        };
        if sample[0] != VERSION {
            return Err(Malformed::Version(sample[0]));
        }
        if sample[1] > 1 {
            return Err(Malformed::Body);
        }
        let number = |at: usize| f64::from_le_bytes(std::array::from_fn(|i| sample[at + i]));
        let velocity = Vec3::new(number(3), number(11), number(19));
        if !velocity.is_finite() {
            return Err(Malformed::NotFinite);
        }
        Ok(Self {
            held: sample[1] == 1,
            presses: sample[2],
            velocity,
        })
    }
}

/// A recording that is played, and may stop at any time.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Played(Hand<Vec3>);

impl Played {
    pub(crate) const fn new(timeout: Nanos) -> Self {
        Self(Hand::new(timeout))
    }

    /// Takes in a sample.
    pub(crate) fn take(&mut self, now: Stamp, sample: PlayedSample, has_picture: bool) {
        let held = sample.held.then_some(sample.velocity);
        self.0.take(now, held, sample.presses, has_picture);
    }

    pub(crate) fn velocity(&self) -> Vec3 {
        self.0.held().unwrap_or(Vec3::ZERO)
    }

    pub(crate) const fn hand(&self) -> &Hand<Vec3> {
        &self.0
    }

    pub(crate) const fn hand_mut(&mut self) -> &mut Hand<Vec3> {
        &mut self.0
    }
}

impl Remember for Played {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self(hand) = self;
        hand.remember(memory)
    }
}

#[cfg(test)]
mod tests {
    use tandem_wire::{Deadman, MILLISECOND};

    use super::*;

    const AHEAD: Vec3 = Vec3::new(0.1, -0.2, 0.0);

    fn held(presses: u8) -> PlayedSample {
        PlayedSample {
            held: true,
            presses,
            velocity: AHEAD,
        }
    }

    #[test]
    fn samples_are_read_back_and_others_refused() {
        let bytes = held(7).to_bytes();
        assert_eq!(PlayedSample::from_bytes(&bytes), Ok(held(7)));
        for length in 0..bytes.len() {
            let cut = PlayedSample::from_bytes(&bytes[..length]);
            assert_eq!(cut, Err(Malformed::Truncated(length)));
        }
        let with = |at: usize, value: u8| {
            let mut bytes = bytes.clone();
            bytes[at] = value;
            PlayedSample::from_bytes(&bytes)
        };
        assert_eq!(with(0, 1), Err(Malformed::Version(1)));
        assert_eq!(with(1, 2), Err(Malformed::Body));
        let endless = PlayedSample {
            velocity: Vec3::new(f64::NAN, 0.0, 0.0),
            ..held(0)
        };
        assert_eq!(PlayedSample::from_bytes(&endless.to_bytes()), Err(Malformed::NotFinite));
        assert_eq!(
            PlayedSample::from_bytes(&[bytes, vec![0]].concat()),
            Err(Malformed::Oversized(28))
        );
    }

    #[test]
    fn a_velocity_counts_while_it_is_held_and_not_after_silence() {
        let mut played = Played::new(150 * MILLISECOND);
        played.take(Stamp(0), held(0), true);
        assert_eq!(
            (played.velocity(), played.hand().deadman()),
            (Vec3::ZERO, Deadman::Released)
        );
        played.take(Stamp(1), PlayedSample::default(), true);
        played.take(Stamp(2), held(1), true);
        assert_eq!(
            (played.velocity(), played.hand().deadman()),
            (AHEAD, Deadman::Held { press: 1 })
        );
        played.hand_mut().expire(Stamp(200 * MILLISECOND));
        assert_eq!(
            (played.velocity(), played.hand().deadman()),
            (Vec3::ZERO, Deadman::Released)
        );
    }
}
