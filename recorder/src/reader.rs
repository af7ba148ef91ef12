//! Reads a session file back, whole or damaged.
//!
//! Two things are put together. The protobuf channels say *when* every message reached the recorder; the journals hold
//! its *bytes as they travelled*. A message is played and exported from its bytes, because those are exact, checked by
//! the same decoder as live traffic, and independent of how the protobuf schemas grow. A message that stands in a
//! journal but never reached the recorder is put where it belongs by its sender's stamp and the smallest delay that
//! messages of that sender had.
//!
//! Reading is total: of a file that was cut anywhere, or holds chunks that cannot be unpacked, what can be read is
//! read, and [`Recording::damage`] says what is missing. Of a file one chunk is held in memory at a time; of each message
//! its bytes, or only the [`Place`] where they stand, from which a [`Reel`] fetches them: a long session need not fit
//! into memory to be played. The file's own index would not do: it knows when a message was heard, not where in the
//! journals its bytes are, and a file whose writer was killed has none.

mod damage;
mod gathering;
pub(crate) mod protobuf;
mod records;
mod reel;
mod repair;
mod spool;

use std::collections::BTreeMap;
use std::io::{Cursor, Read, Seek};

use tandem_wire::{Header, Nanos, NodeName, RobotName, Session, Stamp, Topic};

use crate::heard::Level;
use crate::tally::Counts;

pub use damage::{Damage, ReadError};
use gathering::Gathering;
pub use reel::{Place, Reel, ReelError};
pub use repair::{Repair, RepairError, Repaired, repair};

/// The messages of the loop, which are played and exported, as opposed to what is about it.
pub const PLAYED: [Topic; 11] = [
    Topic::Command,
    Topic::Proposal,
    Topic::Forecast,
    Topic::Setpoint,
    Topic::State,
    Topic::Scene,
    Topic::Trial,
    Topic::Lease,
    Topic::TakeOver,
    Topic::Emergency,
    Topic::AllClear,
];

/// A session as its file holds it; of each message `B` is kept: its bytes, or the [`Place`] where they stand.
#[derive(Clone, Debug, Default)]
pub struct Recording<B = Vec<u8>> {
    /// Whose session it is.
    pub robot: Option<RobotName>,
    /// Version and git revision of the recorder.
    pub recorder_build: String,
    /// The wall clock at the recorder's zero, in nanoseconds since 1970.
    pub epoch_unix_nanos: u64,
    /// What it takes to build the nodes again.
    pub nodes: BTreeMap<NodeName, NodeRecord>,
    /// The attached model files by name.
    pub models: BTreeMap<String, Vec<u8>>,
    /// Every message that can be played, by arrival; equal arrivals in the order of the file.
    pub messages: Vec<Recorded<B>>,
    /// What the recorder said of its peers' clocks, by arrival.
    pub offsets: Vec<OffsetRead>,
    /// What the recorder noted for people.
    pub notes: Vec<Noted>,
    /// Every channel of the file.
    pub channels: Vec<ChannelRead>,
    /// What was received and missed, counted anew from the file.
    pub counts: Counts,
    /// What the recorder wrote last of what it received and lost; `closed` says whether that was at the end. Empty if it
    /// never did.
    pub closing: BTreeMap<String, String>,
    /// Which part of its session the first file read is, if it is not the first.
    pub first_part: Option<String>,
    /// What is missing from the file or cannot be read.
    pub damage: Vec<Damage>,
}

/// One message as it travelled.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded<B = Vec<u8>> {
    /// When it reached the recorder, by the recorder's clock.
    pub at: Stamp,
    /// On which topic.
    pub topic: Topic,
    /// Its header.
    pub header: Header,
    /// Its bytes, header included, or where they stand.
    pub bytes: B,
}

/// What the file knows of a node.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NodeRecord {
    /// Its run.
    pub session: String,
    /// The seed of its random numbers.
    pub seed: String,
    /// Version and git revision.
    pub build: String,
    /// Its configuration, as TOML.
    pub config: String,
    /// SHA-256 of its model, in hexadecimal digits, if it has one.
    pub model_sha256: Option<String>,
}

/// How far a sender's clock was from the recorder's at some moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OffsetRead {
    /// When the recorder said so, by its own clock.
    pub at: Stamp,
    /// The sender's run.
    pub session: Session,
    /// The sender's clock less the recorder's, in nanoseconds.
    pub offset: i64,
    /// At most how far off that was.
    pub uncertainty: Nanos,
}

/// A line for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Noted {
    /// When, by the recorder's clock.
    pub at: Stamp,
    /// How much it matters.
    pub level: Level,
    /// Which node it is about.
    pub about: String,
    /// The words.
    pub text: String,
}

/// A channel and what is on it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ChannelRead {
    /// The channel's topic, `tandem/<robot>/…` for ours.
    pub topic: String,
    /// How its messages are encoded.
    pub encoding: String,
    /// How many messages it holds.
    pub messages: u64,
    /// The first arrival, in nanoseconds since 1970.
    pub first: Nanos,
    /// The last one.
    pub last: Nanos,
}

impl ChannelRead {
    /// Messages a second between the first and the last; `None` for fewer than two.
    #[must_use]
    pub fn rate_hz(&self) -> Option<f64> {
        let span = tandem_wire::seconds(self.last.saturating_sub(self.first));
        (self.messages > 1 && span > 0.0).then(|| (self.messages - 1) as f64 / span)
    }
}

/// What is kept of a message's bytes.
pub trait Keep: Sized {
    /// Keeps the bytes, or where they stand.
    fn keep(bytes: Vec<u8>, place: Place) -> Self;
}

impl Keep for Vec<u8> {
    fn keep(bytes: Vec<u8>, _: Place) -> Self {
        bytes
    }
}

impl Keep for Place {
    fn keep(_: Vec<u8>, place: Place) -> Self {
        place
    }
}

impl Recording {
    /// Reads the bytes of a session file.
    ///
    /// # Errors
    /// If there is no session in it at all. What is merely damaged is read as far as it goes.
    pub fn read(file: &[u8]) -> Result<Self, ReadError> {
        let mut parts = PartsReader::default();
        parts.add(Cursor::new(file))?;
        parts.finish()
    }
}

/// Reads the parts of one session together, in their order.
#[derive(Default)]
pub struct PartsReader<B = Vec<u8>> {
    gathering: Gathering<B>,
    parts: u16,
    damage: Vec<(usize, Damage)>,
}

impl<B: Keep> PartsReader<B> {
    /// Reads the next part. A part of another session is left out, which is said as [`Damage::OtherSession`].
    ///
    /// # Errors
    /// If it is no MCAP file, or the system cannot read it; then what was read before stands as it was.
    pub fn add(&mut self, mut file: impl Read + Seek) -> Result<(), ReadError> {
        let gathering = &mut self.gathering;
        gathering.begin_part(self.parts);
        records::summary(&mut file, |record| gathering.introduce(&record));
        let damage = records::walk(&mut file, |spot, record| gathering.take(spot, record))?;
        self.parts += 1;
        let number = usize::from(self.parts);
        if gathering.is_stranger() {
            self.damage.push((number, Damage::OtherSession));
        } else {
            self.damage.extend(damage.into_iter().map(|damage| (number, damage)));
        }
        Ok(())
    }

    /// Puts together what was read.
    ///
    /// # Errors
    /// If there is no session in it at all.
    pub fn finish(self) -> Result<Recording<B>, ReadError> {
        let is_whole = self.parts < 2;
        let place = |(part, damage)| match is_whole {
            true => damage,
            false => Damage::InPart {
                part,
                what: Box::new(damage),
            },
        };
        let damage = self.damage.into_iter().map(place).collect();
        let recording = self.gathering.assemble(damage);
        let is_session = recording.robot.is_some() || !recording.messages.is_empty();
        is_session.then_some(recording).ok_or(ReadError::NoSession)
    }
}
