//! What a member may do, by its name in the roster.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use tandem_wire::NodeName;

use super::BadRoster;

/// What a member does, and so what it may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// Sends commands and claims the lease.
    Operator,
    /// An operator that may take the lease from another.
    Supervisor,
    /// Proposes.
    Predictor,
    /// Decides: the only one that may send setpoints.
    Arbiter,
    /// Moves.
    RobotSim,
    /// Writes down.
    Recorder,
    /// Watches, and may stop.
    Viewer,
    /// Carries what others say, whole; trusted to have checked it.
    Router,
}

impl Role {
    /// All roles, in the order in which a table shows them.
    pub const ALL: [Self; 8] = [
        Self::Operator,
        Self::Supervisor,
        Self::Predictor,
        Self::Arbiter,
        Self::RobotSim,
        Self::Recorder,
        Self::Viewer,
        Self::Router,
    ];

    /// The role as it stands in files and on the command line; for the five nodes it is the node's name.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Operator => "operator",
            Self::Supervisor => "supervisor",
            Self::Predictor => "predictor",
            Self::Arbiter => "arbiter",
            Self::RobotSim => "robot-sim",
            Self::Recorder => "recorder",
            Self::Viewer => "viewer",
            Self::Router => "router",
        }
    }

    /// The role of a node.
    #[must_use]
    pub const fn of(node: NodeName) -> Self {
        match node {
            NodeName::Operator => Self::Operator,
            NodeName::Predictor => Self::Predictor,
            NodeName::Arbiter => Self::Arbiter,
            NodeName::RobotSim => Self::RobotSim,
            NodeName::Recorder => Self::Recorder,
        }
    }

    /// The node of a role, if it is one's.
    #[must_use]
    pub fn node(self) -> Option<NodeName> {
        NodeName::ALL.into_iter().find(|node| self.serves_as(Self::of(*node)))
    }

    /// Whether a member of this role may be what a process `needs`: a supervisor is an operator, too.
    #[must_use]
    pub fn serves_as(self, needs: Self) -> bool {
        self == needs || (self, needs) == (Self::Supervisor, Self::Operator)
    }

    /// Whether others may dial it. Everybody else's certificate is good for dialling only, so that a stolen laptop cannot
    /// pass for the robot's end of the line.
    #[must_use]
    pub const fn listens(self) -> bool {
        matches!(self, Self::Router | Self::RobotSim | Self::Arbiter)
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl FromStr for Role {
    type Err = BadRoster;

    fn from_str(text: &str) -> Result<Self, BadRoster> {
        let found = Self::ALL.into_iter().find(|role| role.as_str() == text);
        found.ok_or_else(|| BadRoster::Role { given: text.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_role_is_read_back_from_its_name_and_nodes_keep_theirs() {
        for role in Role::ALL {
            assert_eq!(role.as_str().parse(), Ok(role));
        }
        for node in NodeName::ALL {
            assert_eq!(Role::of(node).as_str(), node.as_str());
            assert_eq!(Role::of(node).node(), Some(node));
        }
    }
}
