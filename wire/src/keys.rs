//! Key expressions and names: the only place where a key is spelled.

use std::fmt;
use std::str::FromStr;

use bincode::{Decode, Encode};

use crate::codec::Message;
use crate::{
    Claim, ClockReport, Command, Emergency, Forecast, JournalBatch, NodeInfo, Pong, Proposal, Scene, Setpoint, State,
    Storage, Trial,
};

/// The first chunk of every key.
pub const ROOT: &str = "tandem";

/// Behind a robot's name, the question that every node answers on its own [`Topic::Ping`].
pub const PINGS: &str = "ping/*";

/// One of the five kinds of node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Encode, Decode)]
pub enum NodeName {
    /// Turns a person's input, or a simulated person's, into commands.
    Operator,
    /// Forecasts the movement and how sure it is.
    Predictor,
    /// Blends the two commands and decides who drives.
    Arbiter,
    /// Moves the arm.
    RobotSim,
    /// Writes the session file and feeds the live view.
    Recorder,
}

impl NodeName {
    /// All nodes, in the order in which a table shows them.
    pub const ALL: [Self; 5] = [
        Self::Operator,
        Self::Predictor,
        Self::Arbiter,
        Self::RobotSim,
        Self::Recorder,
    ];

    /// The name as it stands in keys, files and on the command line.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Operator => "operator",
            Self::Predictor => "predictor",
            Self::Arbiter => "arbiter",
            Self::RobotSim => "robot-sim",
            Self::Recorder => "recorder",
        }
    }
}

impl fmt::Display for NodeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// What a message is about; with a robot's name it makes a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Encode, Decode)]
pub enum Topic {
    /// What the human wants: [`Command`].
    Command,
    /// What the robot would do: [`Proposal`].
    Proposal,
    /// A whole forecast: [`Forecast`].
    Forecast,
    /// What shall be done: [`Setpoint`].
    Setpoint,
    /// What the arm does: [`State`].
    State,
    /// Obstacles, start, goal, workspace: [`Scene`].
    Scene,
    /// A trial begins or ends: [`Trial`].
    Trial,
    /// What one node saw and answered: [`JournalBatch`].
    Journal(NodeName),
    /// A node's configuration, build and model, for whoever asks: [`NodeInfo`].
    Info(NodeName),
    /// Presence of a node; carries nothing.
    Alive(NodeName),
    /// A raw sample of an input device: stays inside the operator's process, and is journalled there.
    Device,
    /// An operator wants the lease, or gives it up: [`Claim`].
    Lease,
    /// Stop at once, whoever drives: [`Emergency`].
    Emergency,
    /// How well the session file is kept: [`Storage`].
    Storage,
    /// What a node knows of its peers' clocks: [`ClockReport`].
    Clock(NodeName),
    /// Answers a ping, with nothing but times: [`Pong`].
    Ping(NodeName),
    /// An operator takes the lease from whoever holds it, a right of its own: [`Claim`].
    TakeOver,
    /// An emergency stop may end, a right of its own: [`Emergency`].
    AllClear,
}

/// How a topic wants to be carried.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// The newest value is all that counts; late ones are worthless.
    Stream,
    /// Rare, each one counts, and nothing may hold it up. Its sender repeats it until it is heard.
    Urgent,
    /// Rare, and each one counts.
    Event,
    /// Much of it, never in the way of a stream.
    Bulk,
}

impl Topic {
    /// The part of the key that follows the robot's name.
    #[must_use]
    pub fn suffix(self) -> String {
        match self {
            Self::Command => "command".into(),
            Self::Proposal => "proposal".into(),
            Self::Forecast => "forecast".into(),
            Self::Setpoint => "setpoint".into(),
            Self::State => "state".into(),
            Self::Scene => "scene".into(),
            Self::Trial => "trial".into(),
            Self::Lease => "lease".into(),
            Self::Emergency => "estop".into(),
            Self::Journal(node) => format!("journal/{node}"),
            Self::Info(node) => format!("node/{node}"),
            Self::Alive(node) => format!("alive/{node}"),
            Self::Device => "device".into(),
            Self::Storage => "storage".into(),
            Self::Clock(node) => format!("clock/{node}"),
            Self::Ping(node) => format!("ping/{node}"),
            Self::TakeOver => "lease/take-over".into(),
            Self::AllClear => "estop/clear".into(),
        }
    }

    /// The whole key, `tandem/<robot>/<suffix>`.
    #[must_use]
    pub fn key(self, robot: &RobotName) -> String {
        format!("{ROOT}/{robot}/{}", self.suffix())
    }

    /// How the topic is carried.
    #[must_use]
    pub const fn delivery(self) -> Delivery {
        match self {
            Self::Command | Self::Proposal | Self::Setpoint | Self::State | Self::Device => Delivery::Stream,
            Self::Lease | Self::TakeOver | Self::Emergency | Self::AllClear => Delivery::Urgent,
            Self::Forecast | Self::Scene | Self::Trial | Self::Info(_) | Self::Alive(_) => Delivery::Event,
            // Clocks' exchanges go lower still, as whoever makes them asks for.
            Self::Journal(_) | Self::Storage | Self::Clock(_) | Self::Ping(_) => Delivery::Bulk,
        }
    }

    /// The longest message that an honest sender makes, header included; 0 for a topic that carries none. A sample of a device
    /// never travels.
    #[must_use]
    pub const fn max_bytes(self) -> usize {
        match self {
            Self::Command => Command::MAX_BYTES,
            Self::Proposal => Proposal::MAX_BYTES,
            Self::Forecast => Forecast::MAX_BYTES,
            Self::Setpoint => Setpoint::MAX_BYTES,
            Self::State => State::MAX_BYTES,
            Self::Scene => Scene::MAX_BYTES,
            Self::Trial => Trial::MAX_BYTES,
            Self::Journal(_) => JournalBatch::MAX_BYTES,
            Self::Info(_) => NodeInfo::MAX_BYTES,
            Self::Lease | Self::TakeOver => Claim::MAX_BYTES,
            Self::Emergency | Self::AllClear => Emergency::MAX_BYTES,
            Self::Storage => Storage::MAX_BYTES,
            Self::Clock(_) => ClockReport::MAX_BYTES,
            Self::Ping(_) => Pong::MAX_BYTES,
            Self::Alive(_) | Self::Device => 0,
        }
    }

    /// The byte that says in a message's header what it is; 0 for topics that carry no message of ours.
    #[must_use]
    pub const fn kind(self) -> u8 {
        match self {
            Self::Command => 1,
            Self::Proposal => 2,
            Self::Forecast => 3,
            Self::Setpoint => 4,
            Self::State => 5,
            Self::Scene => 6,
            Self::Trial => 7,
            Self::Journal(_) => 8,
            Self::Info(_) => 9,
            Self::Device => 10,
            Self::Storage => 11,
            Self::Lease | Self::TakeOver => 12,
            Self::Emergency | Self::AllClear => 13,
            Self::Clock(_) => 14,
            Self::Ping(_) => 15,
            Self::Alive(_) => 0,
        }
    }
}

impl fmt::Display for Topic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.suffix())
    }
}

/// A robot's name: one chunk of a key, so 1 to 64 of `a–z A–Z 0–9 _ -`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct RobotName(String);

/// Why a text is not a robot's name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{name:?} cannot name a robot: use 1 to 64 letters, digits, '-' or '_'")]
pub struct BadRobotName {
    /// The text.
    pub name: String,
}

impl RobotName {
    /// The name as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// A key expression that matches everything about this robot.
    #[must_use]
    pub fn everything(&self) -> String {
        format!("{ROOT}/{self}/**")
    }
}

impl FromStr for RobotName {
    type Err = BadRobotName;

    fn from_str(name: &str) -> Result<Self, BadRobotName> {
        let fits = (1..=64).contains(&name.len())
            && name
                .bytes()
                .all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
        if fits {
            Ok(Self(name.to_owned()))
        } else {
            Err(BadRobotName { name: name.to_owned() })
        }
    }
}

impl fmt::Display for RobotName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// The key under which a replay says that it speaks in this robot's name; `*` for `id` means all of them. It is no
/// [`Topic`]: no node hears or says it, and [`parse`] does not know it.
#[must_use]
pub fn player(robot: &RobotName, id: &str) -> String {
    format!("{ROOT}/{robot}/player/{id}")
}

/// Reads a key back; `None` for a key that is not ours.
#[must_use]
pub fn parse(key: &str) -> Option<(RobotName, Topic)> {
    let mut chunks = key.split('/');
    if chunks.next()? != ROOT {
        return None;
    }
    let robot = chunks.next()?.parse().ok()?;
    let topic = match (chunks.next()?, chunks.next()) {
        ("command", None) => Topic::Command,
        ("proposal", None) => Topic::Proposal,
        ("forecast", None) => Topic::Forecast,
        ("setpoint", None) => Topic::Setpoint,
        ("state", None) => Topic::State,
        ("scene", None) => Topic::Scene,
        ("trial", None) => Topic::Trial,
        ("lease", None) => Topic::Lease,
        ("lease", Some("take-over")) => Topic::TakeOver,
        ("estop", None) => Topic::Emergency,
        ("estop", Some("clear")) => Topic::AllClear,
        ("storage", None) => Topic::Storage,
        ("journal", Some(node)) => Topic::Journal(node_named(node)?),
        ("node", Some(node)) => Topic::Info(node_named(node)?),
        ("alive", Some(node)) => Topic::Alive(node_named(node)?),
        ("clock", Some(node)) => Topic::Clock(node_named(node)?),
        ("ping", Some(node)) => Topic::Ping(node_named(node)?),
        _ => return None,
    };
    chunks.next().is_none().then_some((robot, topic))
}

fn node_named(name: &str) -> Option<NodeName> {
    NodeName::ALL.into_iter().find(|node| node.as_str() == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_topic_is_read_back_from_its_key() {
        let robot: RobotName = "panda-1".parse().unwrap();
        let mut topics = vec![Topic::Command, Topic::Proposal, Topic::Forecast, Topic::Setpoint];
        topics.extend([Topic::State, Topic::Scene, Topic::Trial, Topic::Lease]);
        topics.extend([Topic::TakeOver, Topic::Emergency, Topic::AllClear, Topic::Storage]);
        for node in NodeName::ALL {
            topics.extend([Topic::Journal(node), Topic::Info(node), Topic::Alive(node)]);
            topics.extend([Topic::Clock(node), Topic::Ping(node)]);
        }
        for topic in topics {
            assert_eq!(parse(&topic.key(&robot)), Some((robot.clone(), topic)));
        }
    }

    #[test]
    fn foreign_keys_are_not_ours() {
        for key in [
            "",
            "tandem",
            "tandem/r",
            "other/r/state",
            "tandem/r/state/x",
            "tandem/r/journal",
            "tandem/a*/state",
            "tandem/r/device",
            "tandem/r/player/1",
        ] {
            assert_eq!(parse(key), None, "{key}");
        }
    }
}
