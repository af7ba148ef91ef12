//! Whoever may issue and revoke: the holder of `ca.key`.

use std::fs;
use std::path::{Path, PathBuf};

use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair, KeyUsagePurpose,
};
use time::{Duration, OffsetDateTime};

use crate::files::{Exposed, create_folder, exposed_secret, replace};
use crate::folder::read;
use crate::{
    CA_CERTIFICATE, CA_KEY, Certificate, Day, Member, Name, ROSTER, Revocation, Robots, Role, Roster, Site, SiteError,
    write_public, write_secret,
};

/// How long the authority itself lasts. Changing it means a new site, so it outlives what it signs.
const AUTHORITY_DAYS: i64 = 3650;
/// A certificate holds from this long before it is made, for machines whose clock is behind.
const CLOCKS_APART: Duration = Duration::hours(1);

/// From when until when a certificate holds, in seconds since 1970.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Validity {
    not_before: i64,
    not_after: i64,
}

impl Validity {
    /// From now (an hour ago, for clocks that are behind) for `days`.
    #[must_use]
    pub fn days(days: u32) -> Self {
        let now = OffsetDateTime::now_utc();
        Self {
            not_before: (now - CLOCKS_APART).unix_timestamp(),
            not_after: now.saturating_add(Duration::days(i64::from(days))).unix_timestamp(),
        }
    }

    /// From one second since 1970 to another.
    #[must_use]
    pub const fn between(not_before: i64, not_after: i64) -> Self {
        Self { not_before, not_after }
    }
}

/// A certificate to be issued.
#[derive(Clone, Debug)]
pub struct NewMember {
    /// What it is called.
    pub name: Name,
    /// What it may do.
    pub role: Role,
    /// With which robots.
    pub robots: Robots,
    /// Where it can be reached, for one that listens: addresses and host names, besides this machine's own loopback.
    pub hosts: Vec<String>,
    /// How long it holds.
    pub validity: Validity,
}

/// A site whose private key is here.
pub struct Authority {
    site: Site,
    key: KeyPair,
}

impl Authority {
    /// Makes a new site in `folder`, with nobody in it.
    ///
    /// # Errors
    /// If anything is in the folder already, or it cannot be written.
    pub fn new(folder: &Path, name: Name) -> Result<Self, SiteError> {
        let unwritable = |path: &Path| {
            let path = path.to_owned();
            move |source| SiteError::Unwritable { path, source }
        };
        let taken = fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()) || folder.is_file();
        if taken {
            let path = folder.to_owned();
            return Err(SiteError::Exists { path });
        }
        create_folder(folder).map_err(unwritable(folder))?;
        let key = KeyPair::generate().map_err(refused)?;
        let mut parameters = authority(&name);
        let validity = Validity::days(u32::try_from(AUTHORITY_DAYS).unwrap_or(u32::MAX));
        (parameters.not_before, parameters.not_after) = (instant(validity.not_before)?, instant(validity.not_after)?);
        let certificate = parameters.self_signed(&key).map_err(refused)?;
        let (secret, open, roster) = (folder.join(CA_KEY), folder.join(CA_CERTIFICATE), folder.join(ROSTER));
        write_secret(&secret, &key.serialize_pem()).map_err(unwritable(&secret))?;
        write_public(&open, &certificate.pem()).map_err(unwritable(&open))?;
        let empty = Roster {
            site: name,
            members: Vec::new(),
        };
        write_public(&roster, &empty.to_toml()).map_err(unwritable(&roster))?;
        Ok(Self {
            site: Site::open(folder)?,
            key,
        })
    }

    /// Takes up the site in `folder`.
    ///
    /// # Errors
    /// If its private key is not here, or not safe.
    pub fn open(folder: &Path) -> Result<Self, SiteError> {
        let site = Site::open(folder)?;
        let file = site.folder().join(CA_KEY);
        let text = read(&file)?;
        let exposed = exposed_secret(&file).map_err(|source| SiteError::Unreadable {
            file: file.clone(),
            source,
        })?;
        if let Some(Exposed { mode }) = exposed {
            return Err(SiteError::OpenKey { file, mode });
        }
        let key = KeyPair::from_pem(&text).map_err(refused)?;
        Ok(Self { site, key })
    }

    /// The site.
    #[must_use]
    pub const fn site(&self) -> &Site {
        &self.site
    }

    /// Issues a certificate and enters it into the roster.
    ///
    /// # Errors
    /// If the name is in use, a host is none, or a file is there already or cannot be written.
    pub fn issue(&mut self, new: NewMember) -> Result<Member, SiteError> {
        let common_name = self.site.roster().fresh_common_name(&new.name);
        if self.site.roster().trusted(new.name.as_str()).is_some() {
            return Err(SiteError::Request(format!(
                "{} has a certificate that is trusted: revoke it first, or take another name",
                new.name
            )));
        }
        let key = KeyPair::generate().map_err(refused)?;
        let parameters = parameters(&new, &common_name)?;
        let issuer = Issuer::new(authority(&self.site.roster().site), &self.key);
        let pem = parameters.signed_by(&key, &issuer).map_err(refused)?.pem();
        let read = Certificate::from_pem(pem.as_bytes());
        let certificate = read.ok_or_else(|| SiteError::Request("the new certificate cannot be read back".into()))?;
        let member = Member {
            name: new.name,
            role: new.role,
            robots: new.robots,
            common_name,
            fingerprint: certificate.fingerprint.clone(),
            expires: certificate.expires().to_string(),
            revoked: None,
        };
        self.write_pair(&member, &pem, &key.serialize_pem())?;
        let mut roster = self.site.roster().clone();
        roster.members.push(member.clone());
        self.enter(&roster)?;
        Ok(member)
    }

    fn write_pair(&self, member: &Member, certificate: &str, key: &str) -> Result<(), SiteError> {
        let files = [self.site.file(member, "pem"), self.site.file(member, "key")];
        if let Some(path) = files.iter().find(|file| file.exists()) {
            return Err(SiteError::Exists { path: path.clone() });
        }
        let [open, secret] = files;
        write_secret(&secret, key).map_err(unwritable(&secret))?;
        write_public(&open, certificate).map_err(unwritable(&open))
    }

    /// Marks a member's certificate as no longer trusted, and puts its files here aside.
    ///
    /// # Errors
    /// If nobody of that name is trusted, or a file cannot be written.
    pub fn revoke(&mut self, name: &str, why: &str) -> Result<Member, SiteError> {
        let mut roster = self.site.roster().clone();
        let known = || {
            roster
                .all_trusted()
                .map(|member| member.name.as_str())
                .collect::<Vec<_>>()
                .join(", ")
        };
        let unknown = SiteError::NoMember {
            folder: self.site.folder().to_owned(),
            name: name.to_owned(),
            known: known(),
        };
        let trusted = |member: &&mut Member| member.name.as_str() == name && member.revoked.is_none();
        let member = roster.members.iter_mut().find(trusted).ok_or(unknown)?;
        member.revoked = Some(Revocation {
            on: Day::today().to_string(),
            why: why.to_owned(),
        });
        let member = member.clone();
        self.enter(&roster)?;
        for extension in ["pem", "key"] {
            let file = self.site.file(&member, extension);
            if file.exists() {
                let aside = self
                    .site
                    .folder()
                    .join(format!("{}.revoked.{extension}", member.common_name));
                fs::rename(&file, &aside).map_err(unwritable(&aside))?;
            }
        }
        Ok(member)
    }

    fn enter(&mut self, roster: &Roster) -> Result<(), SiteError> {
        let file = self.site.folder().join(ROSTER);
        replace(&file, &roster.to_toml()).map_err(unwritable(&file))?;
        self.site = Site::open(self.site.folder())?;
        Ok(())
    }
}

fn unwritable(path: &Path) -> impl FnOnce(std::io::Error) -> SiteError + use<> {
    let path: PathBuf = path.to_owned();
    move |source| SiteError::Unwritable { path, source }
}

fn refused(error: rcgen::Error) -> SiteError {
    SiteError::Request(format!("the certificate cannot be made: {error}"))
}

fn instant(seconds: i64) -> Result<OffsetDateTime, SiteError> {
    let instant = OffsetDateTime::from_unix_timestamp(seconds).ok();
    // Certificates know years of four digits.
    let instant = instant.filter(|instant| (1950..=9999).contains(&instant.year()));
    instant.ok_or_else(|| SiteError::Request("a certificate cannot hold for so many days".into()))
}

/// The authority as it stands in what it signs: the same for every certificate of a site.
fn authority(site: &Name) -> CertificateParams {
    let mut parameters = CertificateParams::default();
    parameters.distinguished_name = rcgen::DistinguishedName::new();
    parameters
        .distinguished_name
        .push(DnType::CommonName, format!("Tandem site {site}"));
    parameters.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    parameters.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    parameters
}

fn parameters(new: &NewMember, common_name: &str) -> Result<CertificateParams, SiteError> {
    let hosts = match new.role.listens() {
        true => {
            let own = ["localhost", "127.0.0.1", "::1"].map(str::to_owned);
            own.into_iter().chain(new.hosts.iter().cloned()).collect()
        }
        false if new.hosts.is_empty() => Vec::new(),
        false => {
            return Err(SiteError::Request(format!(
                "{} does not listen, so its certificate names no host: leave --host out",
                new.role
            )));
        }
    };
    let mut parameters = CertificateParams::new(hosts)
        .map_err(|error| SiteError::Request(format!("a --host is neither an address nor a name: {error}")))?;
    parameters.not_before = instant(new.validity.not_before)?;
    parameters.not_after = instant(new.validity.not_after)?;
    parameters.distinguished_name = rcgen::DistinguishedName::new();
    parameters.distinguished_name.push(DnType::CommonName, common_name);
    parameters.is_ca = IsCa::ExplicitNoCa;
    parameters.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    parameters.extended_key_usages = vec![ExtendedKeyUsagePurpose::ClientAuth];
    if new.role.listens() {
        parameters.extended_key_usages.push(ExtendedKeyUsagePurpose::ServerAuth);
    }
    parameters.use_authority_key_identifier_extension = true;
    Ok(parameters)
}
