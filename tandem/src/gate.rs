//! What whoever listens looks after besides its work: a roster that changes, and whom it refuses.
//!
//! Zenoh reads its rules when a session opens, and keeps every connection that it has let in by then. So a changed roster is
//! taken up by opening anew: all connections begin again, and a member that was revoked is heard no more.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use crossbeam_channel::{Receiver, never};
use tandem_link::{Link, LinkError, LinkSettings, Reach, refusals};
use tandem_site::{ROSTER, Role, Roster};

use crate::nodes;

/// How often the roster is read, and refusals are told.
pub(crate) const LOOK: Duration = Duration::from_secs(1);
/// How long a port may take to become free again.
const REOPEN: Duration = Duration::from_secs(10);
/// How often it is tried meanwhile.
const TRY: Duration = Duration::from_millis(250);
/// How often the same refusal is told.
const REPEAT: Duration = Duration::from_secs(60);

/// Where a process listens and dials, for as long as it runs.
pub(crate) struct Gate {
    role: Role,
    settings: LinkSettings,
    reach: Reach,
    /// The roster's file as it was when `reach` was read.
    text: Vec<u8>,
    refused: Receiver<String>,
    told: Told,
    complaint: String,
}

impl Gate {
    /// Reads the site's files, if there is a site.
    ///
    /// # Errors
    /// As [`Reach::new`].
    pub(crate) fn new(settings: &LinkSettings, role: Role) -> Result<Self, LinkError> {
        // Before the rest: what is written in between is then found by the next look.
        let text = roster_text(settings);
        let reach = Reach::new(settings, Some(role))?;
        let admits = reach.secured.is_some() && !reach.listen.is_empty();
        Ok(Self {
            role,
            settings: settings.clone(),
            reach,
            text,
            refused: if admits { refusals::hear() } else { never() },
            told: Told::default(),
            complaint: String::new(),
        })
    }

    /// Where it listens, whom it dials, and as whom.
    pub(crate) const fn reach(&self) -> &Reach {
        &self.reach
    }

    /// Opens a session, for as long as whoever is dialled takes; `None` if the user gave up.
    pub(crate) fn open(&self, interrupted: &Receiver<()>) -> anyhow::Result<Option<Link>> {
        nodes::connect(&self.settings, &self.reach, || interrupted.try_recv().is_ok())
    }

    /// Opens it again after the last one was closed; the system may keep the port for a moment.
    pub(crate) fn reopen(&self, interrupted: &Receiver<()>) -> anyhow::Result<Option<Link>> {
        let until = Instant::now() + REOPEN;
        loop {
            match self.open(interrupted) {
                Ok(opened) => return Ok(opened),
                Err(error) if Instant::now() > until => {
                    return Err(error).with_context(|| format!("the {} cannot listen again", self.role));
                }
                Err(_) if interrupted.recv_timeout(TRY).is_ok() => return Ok(None),
                Err(_) => {}
            }
        }
    }

    /// Tells whom it has refused, and says whether the roster has changed, so that the session has to be opened anew.
    pub(crate) fn look(&mut self) -> bool {
        for why in self.refused.try_iter() {
            self.told.tell(self.role, why);
        }
        self.reach.secured.is_some() && !self.reach.listen.is_empty() && self.takes_up_a_newer_roster()
    }

    /// A roster that cannot be used changes nothing, but is worth a word; it is told once, for the next look finds the same.
    fn takes_up_a_newer_roster(&mut self) -> bool {
        let text = roster_text(&self.settings);
        if text == self.text {
            return false;
        }
        match Reach::new(&self.settings, Some(self.role)) {
            Ok(newer) => {
                let changed = roster(&newer) != roster(&self.reach);
                (self.reach, self.text) = (newer, text);
                changed
            }
            Err(why) => {
                self.complain(why.to_string());
                false
            }
        }
    }

    fn complain(&mut self, why: String) {
        if self.complaint != why {
            let role = self.role;
            eprintln!("{role}: the site's files have changed and are refused, so the rules stay as they were: {why}");
            self.complaint = why;
        }
    }

    /// Who may come in, in words.
    pub(crate) fn admits(&self) -> String {
        let Some(roster) = roster(&self.reach) else {
            return "anybody who reaches it may say anything".to_owned();
        };
        let trusted = roster.all_trusted().count();
        let revoked = roster.members.len() - trusted;
        format!("site {}, {trusted} members, {revoked} revoked", roster.site)
    }
}

fn roster(reach: &Reach) -> Option<&Roster> {
    reach.secured.as_ref().map(|secured| secured.site.roster())
}

/// The roster's file; empty if it cannot be read, which `Reach::new` then says.
fn roster_text(settings: &LinkSettings) -> Vec<u8> {
    std::fs::read(PathBuf::from(&settings.site).join(ROSTER)).unwrap_or_default()
}

/// Refusals that were told: whoever dials on and on is worth one line a minute.
#[derive(Default)]
struct Told(Vec<(String, Instant, u64)>);

impl Told {
    fn tell(&mut self, role: Role, why: String) {
        let now = Instant::now();
        match self.0.iter_mut().find(|(said, ..)| *said == why) {
            Some((_, at, more)) if now.duration_since(*at) < REPEAT => *more += 1,
            Some((_, at, more)) => {
                eprintln!("{role}: refused {} more connections: {why}", *more + 1);
                (*at, *more) = (now, 0);
            }
            None => {
                eprintln!("{role}: refused a connection: {why}");
                self.0.push((why, now, 0));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_site::{Authority, NewMember, Robots, Validity};

    #[test]
    fn a_changed_roster_is_taken_up_once_and_one_that_cannot_be_read_changes_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let site = folder.path().join("lab");
        let mut authority = Authority::new(&site, "lab".parse().expect("a name")).expect("a site");
        for role in [Role::RobotSim, Role::Operator, Role::Viewer] {
            let new = NewMember {
                name: role.as_str().parse().expect("a name"),
                role,
                robots: Robots::All,
                hosts: vec![],
                validity: Validity::days(1),
            };
            authority.issue(new).expect("a certificate");
        }
        let settings = LinkSettings {
            site: site.display().to_string(),
            listen: vec!["tcp/127.0.0.1:7447".into()],
            ..LinkSettings::default()
        };
        let mut gate = Gate::new(&settings, Role::RobotSim).expect("a good site");
        assert!(!gate.look());
        authority.revoke("operator", "laptop lost").expect("revoked");
        let newer = roster_text(&settings);
        std::fs::write(site.join(ROSTER), "half a ro").expect("written");
        assert!(!gate.look());
        assert_eq!(gate.admits(), "site lab, 3 members, 0 revoked");
        std::fs::write(site.join(ROSTER), newer).expect("written");
        assert!(gate.look());
        assert!(!gate.look());
        assert_eq!(gate.admits(), "site lab, 2 members, 1 revoked");
    }
}
