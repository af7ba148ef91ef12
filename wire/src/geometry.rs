//! Numbers and vectors as they travel. Decoding refuses NaN and infinity, so nobody asks again further in.

use std::ops::{Add, Mul, Neg, Sub};

use bincode::de::{BorrowDecoder, Decoder};
use bincode::error::DecodeError;
use bincode::{BorrowDecode, Decode, Encode};

/// A number that is finite whenever it came off the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Encode)]
pub struct Finite(pub f64);

/// What the decoder says of a number that is not finite.
pub(crate) const NOT_FINITE: &str = "not a finite number";

fn decode_finite<D: Decoder>(decoder: &mut D) -> Result<f64, DecodeError> {
    let value = f64::decode(decoder)?;
    if value.is_finite() {
        Ok(value)
    } else {
        Err(DecodeError::Other(NOT_FINITE))
    }
}

impl<C> Decode<C> for Finite {
    fn decode<D: Decoder<Context = C>>(decoder: &mut D) -> Result<Self, DecodeError> {
        decode_finite(decoder).map(Self)
    }
}

impl<'de, C> BorrowDecode<'de, C> for Finite {
    fn borrow_decode<D: BorrowDecoder<'de, Context = C>>(decoder: &mut D) -> Result<Self, DecodeError> {
        decode_finite(decoder).map(Self)
    }
}

/// A vector of three numbers in the frame and unit that its field names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode)]
pub struct Vec3 {
    /// First component.
    pub x: f64,
    /// Second component.
    pub y: f64,
    /// Third component.
    pub z: f64,
}

impl Vec3 {
    /// The zero vector.
    pub const ZERO: Self = Self::new(0.0, 0.0, 0.0);

    /// A vector from its components.
    #[must_use]
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self { x, y, z }
    }

    /// The scalar product.
    #[must_use]
    pub fn dot(self, other: Self) -> f64 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    /// The Euclidean length.
    #[must_use]
    pub fn norm(self) -> f64 {
        self.dot(self).sqrt()
    }

    /// The same direction, no longer than `limit`. A vector that is not finite becomes zero.
    #[must_use]
    pub fn capped(self, limit: f64) -> Self {
        let length = self.norm();
        if !length.is_finite() {
            Self::ZERO
        } else if length > limit {
            self * (limit / length)
        } else {
            self
        }
    }

    /// Whether every component is finite.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.z.is_finite()
    }

    /// The components in order.
    #[must_use]
    pub const fn to_array(self) -> [f64; 3] {
        [self.x, self.y, self.z]
    }
}

impl From<[f64; 3]> for Vec3 {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

impl Add for Vec3 {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::new(self.x + other.x, self.y + other.y, self.z + other.z)
    }
}

impl Sub for Vec3 {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::new(self.x - other.x, self.y - other.y, self.z - other.z)
    }
}

impl Neg for Vec3 {
    type Output = Self;
    fn neg(self) -> Self {
        Self::new(-self.x, -self.y, -self.z)
    }
}

impl Mul<f64> for Vec3 {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self::new(self.x * factor, self.y * factor, self.z * factor)
    }
}

impl<C> Decode<C> for Vec3 {
    fn decode<D: Decoder<Context = C>>(decoder: &mut D) -> Result<Self, DecodeError> {
        Ok(Self::new(
            decode_finite(decoder)?,
            decode_finite(decoder)?,
            decode_finite(decoder)?,
        ))
    }
}

impl<'de, C> BorrowDecode<'de, C> for Vec3 {
    fn borrow_decode<D: BorrowDecoder<'de, Context = C>>(decoder: &mut D) -> Result<Self, DecodeError> {
        Self::decode(decoder)
    }
}

/// Position and orientation of a frame, seen from the robot's base.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode, Decode)]
pub struct Pose {
    /// Origin of the frame, in metres.
    pub position: Vec3,
    /// Orientation as a unit quaternion `[x, y, z, w]`.
    pub orientation: [Finite; 4],
}

/// An axis-aligned box in the base frame, in metres.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct Aabb {
    /// The corner with the smallest coordinates.
    pub min: Vec3,
    /// The corner with the largest coordinates.
    pub max: Vec3,
}

impl Aabb {
    /// Whether `point` lies inside or on the border.
    #[must_use]
    pub fn contains(&self, point: Vec3) -> bool {
        let inside = |p: f64, low: f64, high: f64| (low..=high).contains(&p);
        inside(point.x, self.min.x, self.max.x)
            && inside(point.y, self.min.y, self.max.y)
            && inside(point.z, self.min.z, self.max.z)
    }
}
