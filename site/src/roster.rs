//! Who belongs to a site: names, roles, robots. Pure: text in, text out.

mod name;
mod robots;
mod role;

use serde::{Deserialize, Serialize};

pub use name::Name;
pub use robots::Robots;
pub use role::Role;

/// That and why a certificate is no longer trusted.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Revocation {
    /// The day, as in 2026-11-22, UTC.
    pub on: String,
    /// Why, for people.
    pub why: String,
}

/// One certificate that the site has given out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Member {
    /// What it is called; its files are `NAME.pem` and `NAME.key`.
    pub name: Name,
    /// What it may do.
    pub role: Role,
    /// With which robots.
    pub robots: Robots,
    /// How its certificate calls it. No two certificates of a site ever share one.
    pub common_name: String,
    /// SHA-256 of the certificate, in hexadecimal.
    pub fingerprint: String,
    /// The certificate's last day, as in 2027-11-22, UTC.
    pub expires: String,
    /// Set once it is no longer trusted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub revoked: Option<Revocation>,
}

/// Every certificate that a site has given out, revoked ones included.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Roster {
    /// What the site is called.
    pub site: Name,
    /// The certificates, oldest first.
    #[serde(default, rename = "member")]
    pub members: Vec<Member>,
}

/// Why a roster, or a part of one, cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BadRoster {
    /// No name.
    #[error("{given:?} cannot name a site or a member: use 1 to 24 letters, digits, '-' or '_', and not \"ca\"")]
    Name {
        /// What was given.
        given: String,
    },
    /// No role.
    #[error("{given:?} is no role: use operator, predictor, arbiter, robot-sim, recorder, viewer or router")]
    Role {
        /// What was given.
        given: String,
    },
    /// No robot's name.
    #[error(transparent)]
    Robot(#[from] tandem_wire::keys::BadRobotName),
    /// A member without robots.
    #[error("a member needs at least one robot, or [\"*\"] for all of the site's")]
    NoRobots,
    /// Not TOML, or other keys than a roster's.
    #[error("{0}")]
    Text(String),
    /// A common name that two certificates share, or that is none of this site's.
    #[error("{common_name:?} stands twice in the roster, or is no name of this site: restore the file from a copy")]
    CommonName {
        /// The name.
        common_name: String,
    },
}

impl Roster {
    /// Reads `site.toml`.
    ///
    /// # Errors
    /// If it is not TOML, lacks or has other keys, or names a certificate twice.
    pub fn parse(text: &str) -> Result<Self, BadRoster> {
        let roster: Self = toml::from_str(text).map_err(|error| BadRoster::Text(error.to_string()))?;
        let mut seen = std::collections::BTreeSet::new();
        for Member { common_name, .. } in &roster.members {
            let ours = common_name.strip_prefix(&format!("{}.", roster.site));
            let is_name = ours.is_some_and(|rest| {
                let known = |b: u8| b.is_ascii_alphanumeric() || b == b'-' || b == b'_' || b == b'.';
                !rest.is_empty() && rest.bytes().all(known)
            });
            if !is_name || !seen.insert(common_name) {
                return Err(BadRoster::CommonName {
                    common_name: common_name.clone(),
                });
            }
        }
        Ok(roster)
    }

    /// The file's text.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let body = toml::to_string(self).expect("names and lists of texts are TOML");
        format!(
            "# Who belongs to this site, and may do what. Written by tandem keys; no secret, but whoever listens obeys it.\n\n{body}"
        )
    }

    /// The trusted certificate of that name.
    #[must_use]
    pub fn trusted(&self, name: &str) -> Option<&Member> {
        self.all_trusted().find(|member| member.name.as_str() == name)
    }

    /// The certificates that are trusted.
    pub fn all_trusted(&self) -> impl Iterator<Item = &Member> {
        self.members.iter().filter(|member| member.revoked.is_none())
    }

    /// The certificate with that common name, trusted or not.
    #[must_use]
    pub fn certified(&self, common_name: &str) -> Option<&Member> {
        self.members.iter().find(|member| member.common_name == common_name)
    }

    /// A common name that no certificate of this site has had: `lab.desk`, then `lab.desk.2` and so on.
    #[must_use]
    pub fn fresh_common_name(&self, name: &Name) -> String {
        let plain = format!("{}.{name}", self.site);
        let numbered = (2_u64..).map(|number| format!("{plain}.{number}"));
        std::iter::once(plain.clone())
            .chain(numbered)
            .find(|candidate| self.certified(candidate).is_none())
            .unwrap_or(plain)
    }

    /// What whoever listens says of a common name, in words that its owner can act on; `Ok` says what it may.
    ///
    /// # Errors
    /// Why it may do nothing.
    pub fn verdict(&self, common_name: &str) -> Result<String, String> {
        match self.certified(common_name) {
            None => Err(format!(
                "{common_name} does not stand in the listener's roster of site {}: if it is new, copy the newer site.toml \
                 to where the listener runs",
                self.site
            )),
            Some(Member {
                revoked: Some(revocation),
                ..
            }) => Err(format!(
                "{common_name} was revoked on {}: {}; ask for a new certificate (tandem keys issue)",
                revocation.on, revocation.why
            )),
            Some(member) => Ok(format!("{} of {}", member.role, member.robots)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn member(name: &str, role: Role) -> Member {
        Member {
            name: name.parse().unwrap(),
            role,
            robots: Robots::All,
            common_name: format!("lab.{name}"),
            fingerprint: "00".into(),
            expires: "2027-11-22".into(),
            revoked: None,
        }
    }

    fn roster() -> Roster {
        Roster {
            site: "lab".parse().unwrap(),
            members: vec![member("arbiter", Role::Arbiter), member("robot-sim", Role::RobotSim)],
        }
    }

    #[test]
    fn a_roster_is_read_back_whole() {
        let mut roster = roster();
        roster.members[0].robots = vec!["right".to_owned(), "left".to_owned()].try_into().unwrap();
        roster.members[1].revoked = Some(Revocation {
            on: "2026-11-22".into(),
            why: "a \"lost\" laptop".into(),
        });
        assert_eq!(Roster::parse(&roster.to_toml()), Ok(roster));
    }

    #[test]
    fn a_roster_that_was_tampered_with_is_refused_in_words() {
        let text = roster().to_toml();
        for (from, to, word) in [
            ("\"*\"", "\"pan*\"", "cannot name a robot"),
            ("\"arbiter\"\nrole", "\"../x\"\nrole", "cannot name a site or a member"),
            ("lab.robot-sim", "lab.arbiter", "stands twice"),
            ("lab.robot-sim", "other.robot-sim", "no name of this site"),
            ("expires", "expire", "unknown field"),
            ("role = \"arbiter\"", "role = \"king\"", "unknown variant"),
            ("robots = [\"*\"]", "robots = []", "at least one robot"),
        ] {
            let changed = text.replacen(from, to, 1);
            assert_ne!(changed, text, "{from}");
            let why = Roster::parse(&changed).unwrap_err().to_string();
            assert!(why.contains(word), "{why}");
        }
    }

    #[test]
    fn a_common_name_is_never_given_twice() {
        let mut roster = roster();
        let name: Name = "arbiter".parse().unwrap();
        assert_eq!(roster.fresh_common_name(&name), "lab.arbiter.2");
        let mut again = member("arbiter", Role::Arbiter);
        again.common_name = "lab.arbiter.2".into();
        roster.members.push(again);
        assert_eq!(roster.fresh_common_name(&name), "lab.arbiter.3");
    }
}
