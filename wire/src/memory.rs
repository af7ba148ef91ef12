//! What a node carries from step to step, as bytes: out of one node, into another one built from the same blueprint.
//!
//! A part that changes names its fields once, in [`Remember::remember`], for both directions; what a node is built
//! from (settings, the model, the run's number) stays out, so that a restored node has the constants of *this* build
//! and a changed one still shows. Implementations take themselves apart with `let Self { … } = self`, so that a new field
//! is named or does not compile.

use bincode::{Decode, Encode};

use crate::codec::{self, VERSION};
use crate::{Malformed, NodeName, Ports};

/// A snapshot begins with the version of the byte layout and the node's number.
const HEAD_BYTES: usize = 2;

/// Where a snapshot is written to, or read from.
#[derive(Debug)]
pub struct Memory<'a>(Way<'a>);

#[derive(Debug)]
enum Way<'a> {
    Writing(&'a mut Vec<u8>),
    Reading(&'a [u8]),
}

impl<'a> Memory<'a> {
    /// Appends every part to `bytes`.
    #[must_use]
    pub const fn writing(bytes: &'a mut Vec<u8>) -> Self {
        Self(Way::Writing(bytes))
    }

    /// Replaces every part by what was written.
    #[must_use]
    pub const fn reading(bytes: &'a [u8]) -> Self {
        Self(Way::Reading(bytes))
    }

    /// Writes the part, or replaces it by what is read. Writing allocates only while the bytes still grow.
    ///
    /// # Errors
    /// If what is read is no such part. Writing never fails.
    pub fn part<T: Encode + Decode<()>>(&mut self, part: &mut T) -> Result<(), Malformed> {
        match &mut self.0 {
            Way::Writing(bytes) => codec::append(part, bytes),
            Way::Reading(bytes) => *part = codec::take(bytes)?,
        }
        Ok(())
    }

    /// Refuses what was read unless `possible`: a part that no node can come to hold.
    ///
    /// # Errors
    /// [`Malformed::Body`] when reading something impossible.
    pub const fn check(&self, possible: bool) -> Result<(), Malformed> {
        match self.0 {
            Way::Reading(_) if !possible => Err(Malformed::Body),
            _ => Ok(()),
        }
    }

    /// What is left to be read.
    const fn left(&self) -> usize {
        match &self.0 {
            Way::Writing(_) => 0,
            Way::Reading(bytes) => bytes.len(),
        }
    }
}

/// Something that changes from step to step.
pub trait Remember {
    /// Passes everything that changes through `memory`, in a fixed order.
    ///
    /// # Errors
    /// If what is read cannot be. Then some parts have been replaced and others not: whoever restored must not go on
    /// with the value.
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed>;
}

/// Writes what `node` carries from step to step into `bytes`, cleared first. The node does not change.
pub fn snapshot<N: Ports>(node: &mut N, bytes: &mut Vec<u8>) {
    bytes.clear();
    bytes.extend_from_slice(&head(N::NAME));
    // A node that refuses to write has no snapshot: nothing, which `restore` refuses.
    if node.remember(&mut Memory::writing(bytes)).is_err() {
        bytes.clear();
    }
}

/// Has `node`, freshly built from the same blueprint, go on where the one that the snapshot was taken of had been.
///
/// # Errors
/// If the bytes are no snapshot of such a node; then `node` is half restored and must not be stepped.
pub fn restore<N: Ports>(node: &mut N, bytes: &[u8]) -> Result<(), Malformed> {
    let Some((found, parts)) = bytes.split_first_chunk::<HEAD_BYTES>() else {
        return Err(Malformed::Truncated(bytes.len()));
    };
    let [version, kind] = head(N::NAME);
    if found[0] != version {
        return Err(Malformed::Version(found[0]));
    }
    if found[1] != kind {
        return Err(Malformed::Kind {
            expected: kind,
            found: found[1],
        });
    }
    let mut memory = Memory::reading(parts);
    node.remember(&mut memory)?;
    match memory.left() {
        0 => Ok(()),
        left => Err(Malformed::Trailing(left)),
    }
}

const fn head(node: NodeName) -> [u8; HEAD_BYTES] {
    let number = match node {
        NodeName::Operator => 0,
        NodeName::Predictor => 1,
        NodeName::Arbiter => 2,
        NodeName::RobotSim => 3,
        NodeName::Recorder => 4,
    };
    [VERSION, number]
}
