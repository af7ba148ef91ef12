//! The model file: a header anyone can read, the payload, and a hash over both.
//!
//! ```text
//! offset  bytes  what
//!      0      8  magic, 89 43 45 53 4E 0D 0A 1A ("CESN" between bytes that text tools damage)
//!      8      4  version of this layout
//!     12      4  N, units
//!     16      4  context numbers
//!     20      4  Ny, outputs
//!     24      4  T, steps
//!     28      4  zero
//!     32      8  length of the payload
//!     40      …  payload: bincode 2, little endian, fixed-width integers; in layout 2, that of a model that is
//!                conditioned anew, what its contexts are compared with comes last
//!     end    32  SHA-256 of everything before
//! ```
//! All integers are little endian. A file is taken apart from the outside in: magic, version, length, hash, payload,
//! shapes, numbers. Each refusal says what was found, and whatever passes can be run without a further check.

mod stored;

use sha2::{Digest, Sha256};

use crate::model::Model;
use crate::replan::Conditions;
use crate::reservoir::StoredReservoir;
use crate::triangle::StoredTriangle;
use stored::Stored;

/// The first bytes of a model file.
pub const MAGIC: [u8; 8] = *b"\x89CESN\r\n\x1a";
/// The layout of a model of one checkpoint.
pub const VERSION: u32 = 1;
/// The layout of a model that is conditioned anew, which programs that know only the other must not run.
pub const REPLANNING_VERSION: u32 = 2;
/// The largest model file; a dense reservoir of the largest size stays below it.
pub const MAX_BYTES: usize = 256 << 20;
const HEADER: usize = 40;
const HASH: usize = 32;
/// A movement of more steps than this is a wrong number, not a movement.
const MAX_STEPS: usize = 1 << 20;

/// Why a model file is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ArtefactError {
    /// It does not begin like a model file.
    #[error("this is not a model file: it begins with {found:02x?}")]
    Foreign {
        /// Its first bytes, up to eight.
        found: Vec<u8>,
    },
    /// It ends too early.
    #[error("the model file is truncated: {found} bytes of {expected}")]
    Truncated {
        /// Bytes there are.
        found: usize,
        /// Bytes there should be.
        expected: usize,
    },
    /// Something follows its end.
    #[error("the model file is {found} bytes long and should end after {expected}")]
    Trailing {
        /// Bytes there are.
        found: usize,
        /// Bytes there should be.
        expected: usize,
    },
    /// It was written in another layout, most likely by a later version.
    #[error(
        "the model file has layout version {found}; this program reads up to {supported}; update it, or train again"
    )]
    Version {
        /// The file's version.
        found: u32,
        /// The newest version read here.
        supported: u32,
    },
    /// It is, or says it is, larger than any model.
    #[error("the model file has {found} bytes; the limit is {limit}")]
    TooLarge {
        /// Its size.
        found: u64,
        /// The limit.
        limit: usize,
    },
    /// Its hash does not match: bits were flipped.
    #[error("the model file is damaged: its content does not match its hash")]
    Damaged,
    /// The payload is not what this version writes.
    #[error("the model file's payload cannot be decoded: {reason}")]
    Payload {
        /// The decoder's complaint.
        reason: String,
    },
    /// Its parts do not fit each other.
    #[error("the model file is inconsistent: {what}")]
    Inconsistent {
        /// What does not fit.
        what: String,
    },
}

impl Model {
    /// The model as a file; see the [module page](self) for the layout.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let stored = Stored {
            settings: self.settings.clone(),
            facts: self.facts.clone(),
            provenance: self.provenance.clone(),
            reservoir: StoredReservoir::from(&self.reservoir),
            w_out: self.readout.weights().to_vec(),
            triangle: StoredTriangle::from(&self.triangle),
            calibration: self.calibration.clone(),
        };
        let payload = match &self.conditions {
            None => bincode::encode_to_vec(stored, encoding()),
            Some(conditions) => bincode::encode_to_vec((stored, conditions), encoding()),
        };
        let payload = payload.expect("vectors of numbers and text always encode into growing memory");
        let mut bytes = Vec::with_capacity(HEADER + payload.len() + HASH);
        bytes.extend(self.header(payload.len()));
        bytes.extend(payload);
        bytes.extend(Sha256::digest(&bytes));
        bytes
    }

    /// Reads a model file.
    ///
    /// # Errors
    /// Whenever the bytes are not exactly what [`Self::to_bytes`] writes for a usable model.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ArtefactError> {
        let content = open(bytes)?;
        let payload = &content[HEADER..];
        let decoded = if content[8..12] == REPLANNING_VERSION.to_le_bytes() {
            bincode::decode_from_slice::<(Stored, Conditions), _>(payload, encoding())
                .map(|((stored, conditions), used)| (stored, Some(conditions), used))
        } else {
            bincode::decode_from_slice::<Stored, _>(payload, encoding()).map(|(stored, used)| (stored, None, used))
        };
        let (stored, conditions, used) = decoded.map_err(|error| ArtefactError::Payload {
            reason: error.to_string(),
        })?;
        if used != content.len() - HEADER {
            return Err(ArtefactError::Payload {
                reason: "bytes are left over".to_owned(),
            });
        }
        let model = stored.into_model(conditions)?;
        if model.header(used)[..] != content[..HEADER] {
            return Err(inconsistent("the header says other shapes than the payload"));
        }
        let _ = model.hash.set(Sha256::digest(bytes).into());
        Ok(model)
    }

    /// Reads several model files that stand one right after the other.
    ///
    /// # Errors
    /// If there is none, or one of them is not exactly what [`Self::to_bytes`] writes for a usable model.
    pub fn several_from_bytes(mut bytes: &[u8]) -> Result<Vec<Self>, ArtefactError> {
        let mut models = Vec::new();
        loop {
            let announced = bytes.get(32..HEADER).and_then(|length| length.first_chunk::<8>());
            let length = announced.map_or(0, |length| u64::from_le_bytes(*length));
            let end = usize::try_from(length)
                .ok()
                .and_then(|length| length.checked_add(HEADER + HASH));
            // What is too short, or announces more than there is, is refused by whoever reads it.
            let (first, rest) = match end {
                Some(end) if end < bytes.len() => bytes.split_at(end),
                _ => (bytes, &[][..]),
            };
            models.push(Self::from_bytes(first)?);
            if rest.is_empty() {
                return Ok(models);
            }
            bytes = rest;
        }
    }

    /// SHA-256 of its file, as every other program computes it: two models with one hash are one model.
    #[must_use]
    pub fn hash(&self) -> [u8; 32] {
        // Not the file's last 32 bytes: those are the hash of what stands before them, and nobody who holds the file
        // alone would call that the file's hash.
        *self.hash.get_or_init(|| Sha256::digest(self.to_bytes()).into())
    }

    fn header(&self, payload: usize) -> [u8; HEADER] {
        let shapes = [
            self.reservoir.units(),
            self.facts.context_columns.len(),
            self.outputs(),
            self.steps(),
            0,
        ];
        let version = if self.conditions.is_some() {
            REPLANNING_VERSION
        } else {
            VERSION
        };
        let mut header = [0; HEADER];
        header[..8].copy_from_slice(&MAGIC);
        header[8..12].copy_from_slice(&version.to_le_bytes());
        for (place, shape) in header[12..32].chunks_exact_mut(4).zip(shapes) {
            place.copy_from_slice(&u32::try_from(shape).unwrap_or(u32::MAX).to_le_bytes());
        }
        header[32..].copy_from_slice(&(payload as u64).to_le_bytes());
        header
    }
}

fn encoding() -> impl bincode::config::Config {
    bincode::config::standard()
        .with_fixed_int_encoding()
        .with_limit::<MAX_BYTES>()
}

/// Checks everything outside the payload; returns what the hash at the end covers.
fn open(bytes: &[u8]) -> Result<&[u8], ArtefactError> {
    let found = bytes.len();
    let begins = &bytes[..found.min(MAGIC.len())];
    if !MAGIC.starts_with(begins) || found == 0 {
        return Err(ArtefactError::Foreign { found: begins.to_vec() });
    }
    if found > MAX_BYTES {
        return Err(ArtefactError::TooLarge {
            found: found as u64,
            limit: MAX_BYTES,
        });
    }
    let number = |at: usize, width: usize| {
        let digits = bytes.get(at..at + width).ok_or(ArtefactError::Truncated {
            found,
            expected: HEADER + HASH,
        })?;
        Ok(digits
            .iter()
            .rev()
            .fold(0_u64, |number, byte| number << 8 | u64::from(*byte)))
    };
    let version = u32::try_from(number(8, 4)?).unwrap_or(u32::MAX);
    if ![VERSION, REPLANNING_VERSION].contains(&version) {
        return Err(ArtefactError::Version {
            found: version,
            supported: REPLANNING_VERSION,
        });
    }
    let payload = number(32, 8)?;
    let expected = usize::try_from(payload)
        .ok()
        .filter(|n| *n <= MAX_BYTES)
        .map(|n| HEADER + n + HASH);
    let expected = expected.ok_or(ArtefactError::TooLarge {
        found: payload,
        limit: MAX_BYTES,
    })?;
    if found < expected {
        return Err(ArtefactError::Truncated { found, expected });
    }
    if found > expected {
        return Err(ArtefactError::Trailing { found, expected });
    }
    let (content, trailer) = bytes.split_at(found - HASH);
    let hash: [u8; 32] = Sha256::digest(content).into();
    if hash[..] == *trailer {
        Ok(content)
    } else {
        Err(ArtefactError::Damaged)
    }
}

fn inconsistent(what: impl Into<String>) -> ArtefactError {
    ArtefactError::Inconsistent { what: what.into() }
}
