//! What sites and members are called.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::BadRoster;

/// What a site or a member is called: 1 to 24 of `a–z A–Z 0–9 _ -`, so that two of them with a dot between make a common
/// name, a file's name and a chunk of a key.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Name(String);

impl Name {
    /// The name as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl FromStr for Name {
    type Err = BadRoster;

    fn from_str(text: &str) -> Result<Self, BadRoster> {
        let fits = text
            .bytes()
            .all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
        // "ca" is the authority's file.
        if fits && (1..=24).contains(&text.len()) && text != "ca" {
            Ok(Self(text.to_owned()))
        } else {
            Err(BadRoster::Name { given: text.to_owned() })
        }
    }
}

impl TryFrom<String> for Name {
    type Error = BadRoster;

    fn try_from(text: String) -> Result<Self, BadRoster> {
        text.parse()
    }
}

impl From<Name> for String {
    fn from(name: Name) -> Self {
        name.0
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}
