//! A site's folder on a machine, and the member that a process is.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use tandem_wire::RobotName;

use crate::files::{Exposed, exposed_folder, exposed_secret};
use crate::trust::belong_together;
use crate::{BadRoster, Certificate, Distrust, Member, Role, Roster, trusts_as_client};

/// The roster's file.
pub const ROSTER: &str = "site.toml";
/// The authority's certificate.
pub const CA_CERTIFICATE: &str = "ca.pem";
/// The authority's private key.
pub const CA_KEY: &str = "ca.key";

/// Why a site's folder cannot be used, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum SiteError {
    /// No such folder.
    #[error("there is no site in {folder}: make one with tandem keys new, or copy its files here", folder = .folder.display())]
    NoSite {
        /// Where it was looked for.
        folder: PathBuf,
    },
    /// A file that belongs to the others is not there.
    #[error("{file} is missing: a member needs site.toml, ca.pem, its .pem and its .key; copy what lacks from where the \
             site was made, or issue the member again", file = .file.display())]
    Partial {
        /// Which one.
        file: PathBuf,
    },
    /// The system refuses.
    #[error("cannot read {file}", file = .file.display())]
    Unreadable {
        /// Which file.
        file: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A private key that others can read.
    #[error("permissions {mode:04o} for {file} are too open: others could read the private key, so it is not used; \
             chmod 600 {file}", file = .file.display())]
    OpenKey {
        /// Which file.
        file: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// A folder into which others can put files.
    #[error("permissions {mode:04o} for {folder} are too open: others could exchange its certificates, so it is not used; \
             chmod 700 {folder}", folder = .folder.display())]
    OpenFolder {
        /// Which folder.
        folder: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// A roster that cannot be used.
    #[error("{file}: {source}", file = .file.display())]
    Roster {
        /// Which file.
        file: PathBuf,
        /// What is wrong.
        source: BadRoster,
    },
    /// A file that holds no certificate.
    #[error("{file} holds no certificate in PEM, or only part of one: copy it again", file = .file.display())]
    NoCertificate {
        /// Which file.
        file: PathBuf,
    },
    /// A certificate that nobody would believe.
    #[error("the certificate {file} is refused: {source}; a new one comes from tandem keys issue", file = .file.display())]
    Distrusted {
        /// Which file.
        file: PathBuf,
        /// Why.
        source: Distrust,
    },
    /// A certificate that differs from what the roster says.
    #[error("{file} is not the certificate that site.toml lists for {name}: copy both from the same place", file = .file.display())]
    NotListed {
        /// Which file.
        file: PathBuf,
        /// Whose it should be.
        name: String,
    },
    /// A certificate that is no longer trusted.
    #[error("the certificate of {name} was revoked on {on}: {why}; a new one comes from tandem keys issue")]
    Revoked {
        /// Whose.
        name: String,
        /// Since when.
        on: String,
        /// Why.
        why: String,
    },
    /// No such member.
    #[error("{folder}: the roster has no member {name:?}; it has {known}", folder = .folder.display())]
    NoMember {
        /// The site's folder.
        folder: PathBuf,
        /// What was asked for.
        name: String,
        /// Who is there.
        known: String,
    },
    /// Another role than the one that is needed.
    #[error("{name} has the role {has} in this site, but this needs {needs}: name another with --member")]
    WrongRole {
        /// Who.
        name: String,
        /// What it is.
        has: Role,
        /// What it would have to be.
        needs: Role,
    },
    /// No key for that role here.
    #[error("{folder} holds no key of {} {role}: copy site.toml, ca.pem and the member's .pem and .key here, or issue one \
             with tandem keys issue", article(*.role), folder = .folder.display())]
    NoKey {
        /// The site's folder.
        folder: PathBuf,
        /// Which role.
        role: Role,
    },
    /// No key at all.
    #[error("{folder} holds no member's key: copy one member's .pem and .key here", folder = .folder.display())]
    NoKeys {
        /// The site's folder.
        folder: PathBuf,
    },
    /// Several would do.
    #[error("{folder} holds the keys of {known}: say which one this is with --member", folder = .folder.display())]
    Ambiguous {
        /// The site's folder.
        folder: PathBuf,
        /// Who is there.
        known: String,
    },
    /// A robot that is none of this member's.
    #[error("{name} has to do with {robots}, not with {robot}: issue it again with --robots, or name another --robot")]
    OtherRobot {
        /// Who.
        name: String,
        /// Its robots.
        robots: String,
        /// The one that was asked for.
        robot: String,
    },
    /// Something is there already.
    #[error("{path} is there already, and keys are never overwritten: name another folder or member", path = .path.display())]
    Exists {
        /// What.
        path: PathBuf,
    },
    /// The system refuses.
    #[error("cannot write {path}", path = .path.display())]
    Unwritable {
        /// Which file or folder.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A host or a number of days that cannot stand in a certificate.
    #[error("{0}")]
    Request(String),
}

const fn article(role: Role) -> &'static str {
    match role {
        Role::Operator | Role::Arbiter => "an",
        _ => "a",
    }
}

/// A site's folder, its roster read and its permissions checked.
#[derive(Clone, Debug)]
pub struct Site {
    folder: PathBuf,
    roster: Roster,
}

/// A member on its own machine: everything there, checked, and good today.
#[derive(Clone, Debug)]
pub struct Identity {
    /// What the roster says of it.
    pub member: Member,
    /// Its certificate, read.
    pub certificate: Certificate,
    /// The file of its certificate.
    pub certificate_file: PathBuf,
    /// The file of its private key.
    pub key_file: PathBuf,
    /// The file of the authority's certificate.
    pub ca_file: PathBuf,
}

impl Site {
    /// Reads the roster in `folder`.
    ///
    /// # Errors
    /// If there is none, it cannot be used, or others may exchange it.
    pub fn open(folder: &Path) -> Result<Self, SiteError> {
        let file = folder.join(ROSTER);
        if !folder.is_dir() {
            let folder = folder.to_owned();
            return Err(SiteError::NoSite { folder });
        }
        // Zenoh takes paths as they are; a service's working directory is not the user's.
        let folder = folder.canonicalize().map_err(|source| unreadable(folder, source))?;
        let text = read(&file)?;
        let exposed = exposed_folder(&folder).map_err(|source| unreadable(&folder, source))?;
        if let Some(Exposed { mode }) = exposed {
            return Err(SiteError::OpenFolder { folder, mode });
        }
        let roster = Roster::parse(&text).map_err(|source| SiteError::Roster { file, source })?;
        Ok(Self { folder, roster })
    }

    /// Who belongs to it.
    #[must_use]
    pub const fn roster(&self) -> &Roster {
        &self.roster
    }

    /// Where it is, without symbolic links.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The authority's certificate, as text.
    ///
    /// # Errors
    /// If it is missing.
    pub fn ca_pem(&self) -> Result<String, SiteError> {
        read(&self.folder.join(CA_CERTIFICATE))
    }

    /// The member that a process with this role is: the one of that `name`, or, if it is empty, the only one of the role
    /// whose key lies here. Without a role, whoever may do least.
    ///
    /// # Errors
    /// If there is none or more than one, or it is not whole and good today.
    pub fn identity(&self, name: &str, role: Option<Role>) -> Result<Identity, SiteError> {
        let member = if name.is_empty() {
            self.only_member(role)?
        } else {
            self.member(name)?
        };
        match role {
            Some(needs) if !member.role.serves_as(needs) => Err(SiteError::WrongRole {
                name: member.name.to_string(),
                has: member.role,
                needs,
            }),
            _ => self.check(member.clone()),
        }
    }

    /// The newest certificate of that name, revoked or not.
    fn member(&self, name: &str) -> Result<&Member, SiteError> {
        let found = self
            .roster
            .members
            .iter()
            .rev()
            .find(|member| member.name.as_str() == name);
        found.ok_or_else(|| SiteError::NoMember {
            folder: self.folder.clone(),
            name: name.to_owned(),
            known: names(self.roster.all_trusted()),
        })
    }

    fn only_member(&self, role: Option<Role>) -> Result<&Member, SiteError> {
        let here = |member: &&Member| self.file(member, "key").exists();
        let folder = || self.folder.clone();
        let Some(role) = role else {
            let order = [
                Role::Viewer,
                Role::Recorder,
                Role::Predictor,
                Role::Operator,
                Role::Supervisor,
            ];
            let rank = |member: &&Member| {
                order
                    .iter()
                    .position(|role| *role == member.role)
                    .unwrap_or(order.len())
            };
            let least = self.roster.all_trusted().filter(here).min_by_key(rank);
            return least.ok_or_else(|| SiteError::NoKeys { folder: folder() });
        };
        let mut found: Vec<&Member> = self.roster.all_trusted().filter(here).collect();
        found.retain(|member| member.role.serves_as(role));
        if found.iter().any(|member| member.role == role) {
            // Nobody has more rights than it needs, unless asked for by name.
            found.retain(|member| member.role == role);
        }
        match found.as_slice() {
            [only] => Ok(only),
            // Somebody whose only certificate was revoked shall hear that, and not that it has none.
            [] => {
                let mut revoked = self.roster.members.iter().rev().filter(here);
                let revoked = revoked.find(|member| member.role.serves_as(role) && member.revoked.is_some());
                revoked.ok_or_else(|| SiteError::NoKey { folder: folder(), role })
            }
            several => Err(SiteError::Ambiguous {
                folder: folder(),
                known: names(several.iter().copied()),
            }),
        }
    }

    /// The file of a member's certificate (`pem`) or private key (`key`).
    #[must_use]
    pub fn file(&self, member: &Member, extension: &str) -> PathBuf {
        self.folder.join(format!("{}.{extension}", member.name))
    }

    /// Whether everything of a member is here and would be believed today.
    ///
    /// # Errors
    /// What is wrong first.
    pub fn check(&self, member: Member) -> Result<Identity, SiteError> {
        let (certificate_file, key_file) = (self.file(&member, "pem"), self.file(&member, "key"));
        let ca = self.ca_pem()?;
        let cert = read(&certificate_file)?;
        let key = read(&key_file)?;
        if let Some(Exposed { mode }) = exposed_secret(&key_file).map_err(|source| unreadable(&key_file, source))? {
            return Err(SiteError::OpenKey { file: key_file, mode });
        }
        if let Some(revocation) = member.revoked {
            return Err(SiteError::Revoked {
                name: member.name.to_string(),
                on: revocation.on,
                why: revocation.why,
            });
        }
        let read = Certificate::from_pem(cert.as_bytes());
        let certificate = read.ok_or_else(|| SiteError::NoCertificate {
            file: certificate_file.clone(),
        })?;
        let distrusted = |source| SiteError::Distrusted {
            file: certificate_file.clone(),
            source,
        };
        trusts_as_client(ca.as_bytes(), &certificate.der).map_err(distrusted)?;
        belong_together(cert.as_bytes(), key.as_bytes()).map_err(distrusted)?;
        if certificate.common_name != member.common_name || certificate.fingerprint != member.fingerprint {
            return Err(SiteError::NotListed {
                file: certificate_file,
                name: member.name.to_string(),
            });
        }
        Ok(Identity {
            member,
            certificate,
            certificate_file,
            key_file,
            ca_file: self.folder.join(CA_CERTIFICATE),
        })
    }
}

impl Identity {
    /// Whether this member has to do with `robot`.
    ///
    /// # Errors
    /// With which it has, if not.
    pub fn serves(&self, robot: &RobotName) -> Result<(), SiteError> {
        if self.member.robots.contain(robot) {
            return Ok(());
        }
        Err(SiteError::OtherRobot {
            name: self.member.name.to_string(),
            robots: self.member.robots.to_string(),
            robot: robot.to_string(),
        })
    }
}

fn names<'a>(members: impl Iterator<Item = &'a Member>) -> String {
    members
        .map(|member| member.name.as_str())
        .collect::<Vec<_>>()
        .join(", ")
}

pub(crate) fn read(file: &Path) -> Result<String, SiteError> {
    fs::read_to_string(file).map_err(|source| match source.kind() {
        io::ErrorKind::NotFound => SiteError::Partial { file: file.to_owned() },
        _ => unreadable(file, source),
    })
}

fn unreadable(file: &Path, source: io::Error) -> SiteError {
    SiteError::Unreadable {
        file: file.to_owned(),
        source,
    }
}
