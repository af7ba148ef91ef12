//! `tandem keys show`: every certificate of a site, and what is wrong with it.

use std::path::Path;

use serde_json::{Value, json};
use tandem_site::{CA_KEY, Certificate, Member, Site, SiteError};

use crate::Outcome;

/// From so many days on, the end of a certificate is worth a word.
pub(crate) const SOON: i64 = 30;

/// What a certificate looks like from here.
enum Condition {
    /// Its files are here and good for so many days.
    Good(i64),
    /// The same, but not for long.
    Ending(i64),
    /// Its private key is elsewhere, as it should be.
    Elsewhere,
    /// It is no longer trusted.
    Revoked(String),
    /// Its files are here and refused.
    Refused(SiteError),
}

pub(super) fn run(folder: &Path, as_json: bool) -> anyhow::Result<Outcome> {
    let site = Site::open(folder)?;
    let authority = Certificate::from_pem(site.ca_pem()?.as_bytes());
    let members: Vec<(&Member, Condition)> = site
        .roster()
        .members
        .iter()
        .map(|member| (member, condition(&site, member)))
        .collect();
    let is_here = site.folder().join(CA_KEY).exists();
    let until = authority.map(|authority| authority.expires().to_string());
    if as_json {
        let members: Vec<Value> = members
            .iter()
            .map(|(member, condition)| row(member, condition))
            .collect();
        let summary = json!({
            "site": site.roster().site, "authority_expires": until, "authority_key_here": is_here, "members": members,
        });
        println!("{summary}");
    } else {
        let key = if is_here {
            "its key is here"
        } else {
            "its key is elsewhere"
        };
        let until = until.as_deref().unwrap_or("never: ca.pem cannot be read");
        println!("site {}, authority until {until}, {key}", site.roster().site);
        print!("{}", table(&members));
    }
    let refused = members
        .iter()
        .any(|(_, condition)| matches!(condition, Condition::Refused(_)));
    Ok(if refused { Outcome::Failed } else { Outcome::Done })
}

fn condition(site: &Site, member: &Member) -> Condition {
    if let Some(revocation) = &member.revoked {
        return Condition::Revoked(format!("revoked on {}: {}", revocation.on, revocation.why));
    }
    if !site.file(member, "key").exists() {
        return Condition::Elsewhere;
    }
    match site.check(member.clone()) {
        Ok(identity) => match identity.certificate.days_left() {
            days if days < SOON => Condition::Ending(days),
            days => Condition::Good(days),
        },
        Err(why) => Condition::Refused(why),
    }
}

impl Condition {
    const fn word(&self) -> &'static str {
        match self {
            Self::Good(_) => "good",
            Self::Ending(_) => "ending",
            Self::Elsewhere => "elsewhere",
            Self::Revoked(_) => "revoked",
            Self::Refused(_) => "refused",
        }
    }

    fn words(&self) -> String {
        match self {
            Self::Good(days) => format!("good for {days} days"),
            Self::Ending(days) => format!("ENDS in {days} days: revoke it and issue it again"),
            Self::Elsewhere => "its key is elsewhere".into(),
            Self::Revoked(why) => why.clone(),
            Self::Refused(why) => format!("REFUSED: {why}"),
        }
    }
}

fn row(member: &Member, condition: &Condition) -> Value {
    let robots: Vec<&str> = member.robots.chunks().collect();
    json!({
        "name": member.name, "role": member.role, "robots": robots, "common_name": member.common_name,
        "fingerprint": member.fingerprint, "expires": member.expires,
        "condition": condition.word(), "says": condition.words(),
    })
}

fn table(members: &[(&Member, Condition)]) -> String {
    let mut rows = vec![["member", "role", "robots", "last day", "fingerprint", ""].map(str::to_owned)];
    rows.extend(members.iter().map(|(member, condition)| {
        [
            member.name.to_string(),
            member.role.to_string(),
            member.robots.to_string(),
            member.expires.clone(),
            member.fingerprint.chars().take(16).collect(),
            condition.words(),
        ]
    }));
    crate::table::columns(&rows)
}
