//! What a certificate says.

use std::fmt;

use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject as _;
use sha2::{Digest as _, Sha256};
use time::OffsetDateTime;
use x509_parser::prelude::{FromDer as _, X509Certificate};

/// A day of the calendar, UTC, as in 2026-11-22.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Day(OffsetDateTime);

impl Day {
    /// The day on which `seconds` since 1970 lie.
    #[must_use]
    pub fn of_unix(seconds: i64) -> Self {
        Self(OffsetDateTime::from_unix_timestamp(seconds).unwrap_or(OffsetDateTime::UNIX_EPOCH))
    }

    /// Today.
    #[must_use]
    pub fn today() -> Self {
        Self(OffsetDateTime::now_utc())
    }
}

impl fmt::Display for Day {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(day) = self;
        write!(f, "{:04}-{:02}-{:02}", day.year(), u8::from(day.month()), day.day())
    }
}

/// A certificate, read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Certificate {
    /// The bytes that were signed, and the signature.
    pub der: CertificateDer<'static>,
    /// How it calls its owner.
    pub common_name: String,
    /// Who signed it.
    pub issuer: String,
    /// From when on it holds, in seconds since 1970.
    pub not_before: i64,
    /// Until when it holds, in seconds since 1970.
    pub not_after: i64,
    /// SHA-256 of it, in hexadecimal.
    pub fingerprint: String,
    /// Hosts that it may listen as.
    pub hosts: Vec<String>,
}

impl Certificate {
    /// Reads the first certificate of a PEM file; `None` if there is none that can be read.
    #[must_use]
    pub fn from_pem(pem: &[u8]) -> Option<Self> {
        Self::from_der(&CertificateDer::from_pem_slice(pem).ok()?)
    }

    /// Reads a certificate; `None` if it is none.
    #[must_use]
    pub fn from_der(der: &CertificateDer<'_>) -> Option<Self> {
        let (_, read) = X509Certificate::from_der(der).ok()?;
        let name = |name: &x509_parser::x509::X509Name<'_>| {
            let first = name.iter_common_name().next().and_then(|value| value.as_str().ok());
            first.unwrap_or_default().to_owned()
        };
        let hosts = read.subject_alternative_name().ok().flatten();
        let hosts = hosts.map(|extension| extension.value.general_names.iter().filter_map(host).collect());
        Some(Self {
            common_name: name(read.subject()),
            issuer: name(read.issuer()),
            not_before: read.validity().not_before.timestamp(),
            not_after: read.validity().not_after.timestamp(),
            fingerprint: Sha256::digest(der).iter().map(|byte| format!("{byte:02x}")).collect(),
            hosts: hosts.unwrap_or_default(),
            der: der.clone().into_owned(),
        })
    }

    /// Its last day.
    #[must_use]
    pub fn expires(&self) -> Day {
        Day::of_unix(self.not_after)
    }

    /// Whole days until it expires; negative once it has.
    #[must_use]
    pub fn days_left(&self) -> i64 {
        (self.not_after - OffsetDateTime::now_utc().unix_timestamp()).div_euclid(86_400)
    }
}

fn host(name: &x509_parser::extensions::GeneralName<'_>) -> Option<String> {
    use x509_parser::extensions::GeneralName;
    match name {
        GeneralName::DNSName(name) => Some((*name).to_owned()),
        GeneralName::IPAddress(bytes) => {
            let four = <[u8; 4]>::try_from(*bytes).map(std::net::IpAddr::from);
            let address = four.or_else(|_| <[u8; 16]>::try_from(*bytes).map(std::net::IpAddr::from));
            address.ok().map(|address| address.to_string())
        }
        _ => None,
    }
}
