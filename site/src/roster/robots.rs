//! With which robots a member has to do.

use std::fmt;

use serde::{Deserialize, Serialize};
use tandem_wire::RobotName;

use super::BadRoster;

/// The robots that a member has to do with.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "Vec<String>", into = "Vec<String>")]
pub enum Robots {
    /// Every robot of the site, now and later; `["*"]` in the file.
    All,
    /// These, by name, in order; never none.
    Only(Vec<String>),
}

impl Robots {
    /// How they stand in a key: `*`, or each name.
    pub fn chunks(&self) -> impl Iterator<Item = &str> {
        let (all, only): (_, &[String]) = match self {
            Self::All => (Some("*"), &[]),
            Self::Only(names) => (None, names),
        };
        all.into_iter().chain(only.iter().map(String::as_str))
    }

    /// Whether `robot` is among them.
    #[must_use]
    pub fn contain(&self, robot: &RobotName) -> bool {
        match self {
            Self::All => true,
            Self::Only(names) => names.iter().any(|name| name == robot.as_str()),
        }
    }
}

impl TryFrom<Vec<String>> for Robots {
    type Error = BadRoster;

    fn try_from(mut names: Vec<String>) -> Result<Self, BadRoster> {
        if names == ["*"] {
            return Ok(Self::All);
        }
        for name in &names {
            let checked: Result<RobotName, _> = name.parse();
            checked.map_err(BadRoster::Robot)?;
        }
        names.sort();
        names.dedup();
        if names.is_empty() {
            Err(BadRoster::NoRobots)
        } else {
            Ok(Self::Only(names))
        }
    }
}

impl From<Robots> for Vec<String> {
    fn from(robots: Robots) -> Self {
        robots.chunks().map(str::to_owned).collect()
    }
}

impl fmt::Display for Robots {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => f.write_str("all robots"),
            Self::Only(names) => f.write_str(&names.join(", ")),
        }
    }
}
