//! What Tandem's own speed is measured against: the same hops and payloads over bare Zenoh. Used by `tandem bench`, and by
//! nothing that runs a robot.

mod chain;
mod fleet;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use tandem_wire::{Stamp, keys};
use zenoh::Wait;
use zenoh::pubsub::Subscriber;

use crate::net::{Link, LinkError, declare};
pub use chain::{command, obey};
pub use fleet::{Fleet, Side};

/// A command's number and stamp, at the head of its payload.
const HEAD: usize = 16;

/// A command that went all the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Passed {
    /// Which one, from 1.
    pub number: u64,
    /// When it was sent, by its sender's clock.
    pub sent: Stamp,
    /// When the setpoint made of it was taken up, by this process's clock.
    pub arrived: Stamp,
}

/// A payload of at least `bytes` bytes that says which command it is.
fn payload(bytes: usize, number: u64, sent: Stamp) -> Vec<u8> {
    let mut payload = vec![0; bytes.max(HEAD)];
    payload[..8].copy_from_slice(&number.to_le_bytes());
    payload[8..HEAD].copy_from_slice(&sent.0.to_le_bytes());
    payload
}

/// Number and stamp of a payload.
fn head(payload: &[u8]) -> Option<(u64, Stamp)> {
    let word = |at: usize| Some(u64::from_le_bytes(*payload.get(at..)?.first_chunk()?));
    Some((word(0)?, Stamp(word(8)?)))
}

/// As Zenoh comes, but for looking around on the network, and for `mode` if one is given.
fn open(side: &str, endpoint: &str, mode: Option<&str>) -> Result<zenoh::Session, LinkError> {
    let open = || {
        let mut config = zenoh::Config::default();
        config.insert_json5("scouting/multicast/enabled", "false")?;
        config.insert_json5(&format!("{side}/endpoints"), &format!("[{endpoint:?}]"))?;
        if side == "connect" {
            config.insert_json5("listen/endpoints", "[]")?;
        }
        if let Some(mode) = mode {
            config.insert_json5("mode", &format!("{mode:?}"))?;
        }
        zenoh::open(config).wait()
    };
    open().map_err(|error| declare(endpoint, &error))
}

/// Counts what arrives about a robot, whatever it is: as a viewer that takes everything would.
pub struct Everything {
    bytes: Arc<AtomicU64>,
    _subscriber: Subscriber<()>,
}

impl Everything {
    /// Begins to count.
    ///
    /// # Errors
    /// If Zenoh refuses.
    pub fn about(link: &Link) -> Result<Self, LinkError> {
        let bytes = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&bytes);
        let key = format!("{}/{}/**", keys::ROOT, link.robot);
        let subscriber = link.session.declare_subscriber(&key).callback(move |sample| {
            counted.fetch_add(sample.payload().len() as u64, Ordering::Relaxed);
        });
        Ok(Self {
            bytes,
            _subscriber: subscriber.wait().map_err(|error| declare(&key, &error))?,
        })
    }

    /// Bytes so far.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }
}
