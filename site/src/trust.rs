//! Whether a certificate holds: asked of the same verifiers that Zenoh's links use.

use std::sync::Arc;

use rustls::client::WebPkiServerVerifier;
use rustls::client::danger::ServerCertVerifier as _;
use rustls::crypto::{CryptoProvider, ring};
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use rustls::server::WebPkiClientVerifier;
use rustls::sign::CertifiedKey;
use rustls::{AlertDescription, CertificateError, ClientConfig, RootCertStore};

use crate::Day;

/// Why a certificate, or the other side's word about ours, is no ground for trust.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Distrust {
    /// Its time is over.
    #[error("it expired{}", last_day(.on))]
    Expired {
        /// On which day, if known.
        on: Option<String>,
    },
    /// Its time has not come.
    #[error("it is not valid yet: compare this machine's clock with the issuer's")]
    NotYet,
    /// Somebody else signed it, or it signed itself.
    #[error("it was not signed by this site's authority (ca.pem): it is self-signed, or another site's")]
    Stranger,
    /// It was made for something else.
    #[error("it is not meant for this use: only a router, robot-sim or arbiter may be dialled")]
    Purpose,
    /// It does not name the host that was dialled.
    #[error("it does not name {host:?}: issue it again with --host {host}")]
    Host {
        /// What was dialled.
        host: String,
    },
    /// The private key is another one's.
    #[error("the private key does not belong to the certificate")]
    OtherKey,
    /// The other side wants a certificate.
    #[error("the other side demands a certificate: say --site")]
    Demanded,
    /// What rustls says.
    #[error("{0}")]
    Other(String),
}

fn last_day(day: &Option<String>) -> String {
    day.as_ref().map(|day| format!(" on {day}")).unwrap_or_default()
}

impl From<rustls::Error> for Distrust {
    fn from(error: rustls::Error) -> Self {
        use rustls::Error;
        match error {
            Error::InvalidCertificate(why) => why.into(),
            Error::InconsistentKeys(_) => Self::OtherKey,
            Error::AlertReceived(AlertDescription::CertificateExpired) => Self::Expired { on: None },
            Error::AlertReceived(AlertDescription::UnknownCA | AlertDescription::DecryptError) => Self::Stranger,
            Error::AlertReceived(AlertDescription::CertificateRequired) => Self::Demanded,
            other => Self::Other(other.to_string()),
        }
    }
}

impl From<CertificateError> for Distrust {
    fn from(error: CertificateError) -> Self {
        match error {
            CertificateError::Expired => Self::Expired { on: None },
            CertificateError::ExpiredContext { not_after, .. } => Self::Expired {
                on: i64::try_from(not_after.as_secs())
                    .ok()
                    .map(|seconds| Day::of_unix(seconds).to_string()),
            },
            CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. } => Self::NotYet,
            CertificateError::UnknownIssuer | CertificateError::BadSignature => Self::Stranger,
            CertificateError::InvalidPurpose | CertificateError::InvalidPurposeContext { .. } => Self::Purpose,
            CertificateError::NotValidForNameContext { expected, .. } => Self::Host {
                host: expected.to_str().into_owned(),
            },
            other => Self::Other(other.to_string()),
        }
    }
}

pub(crate) fn provider() -> Arc<CryptoProvider> {
    Arc::new(ring::default_provider())
}

fn roots(ca_pem: &[u8]) -> Result<Arc<RootCertStore>, Distrust> {
    let unreadable = |error: rustls::pki_types::pem::Error| Distrust::Other(format!("ca.pem cannot be read: {error}"));
    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_slice(ca_pem).map_err(unreadable)?)?;
    Ok(Arc::new(roots))
}

/// Whether whoever listens would take `certificate` for a member's who dials, now.
///
/// # Errors
/// Why not.
pub fn trusts_as_client(ca_pem: &[u8], certificate: &CertificateDer<'_>) -> Result<(), Distrust> {
    let verifier = WebPkiClientVerifier::builder_with_provider(roots(ca_pem)?, provider()).build();
    let verifier = verifier.map_err(|error| Distrust::Other(error.to_string()))?;
    verifier.verify_client_cert(certificate, &[], UnixTime::now())?;
    Ok(())
}

/// Whether whoever dials `host` would take `certificate` for a member's who listens there, now.
///
/// # Errors
/// Why not.
pub fn trusts_as_server(ca_pem: &[u8], certificate: &CertificateDer<'_>, host: &str) -> Result<(), Distrust> {
    let verifier = WebPkiServerVerifier::builder_with_provider(roots(ca_pem)?, provider()).build();
    let verifier = verifier.map_err(|error| Distrust::Other(error.to_string()))?;
    let name = ServerName::try_from(host).map_err(|_invalid| Distrust::Other(format!("{host:?} is no host")))?;
    verifier.verify_server_cert(certificate, &[], &name, &[], UnixTime::now())?;
    Ok(())
}

/// What a member who dials tells TLS: its own certificate, and that only the site's authority is believed.
///
/// # Errors
/// If a file is unreadable, or the key is another certificate's.
pub fn client_configuration(ca_pem: &[u8], cert_pem: &[u8], key_pem: &[u8]) -> Result<ClientConfig, Distrust> {
    let builder = ClientConfig::builder_with_provider(provider()).with_safe_default_protocol_versions()?;
    let builder = builder.with_root_certificates(roots(ca_pem)?);
    let (certificate, key) = pair(cert_pem, key_pem)?;
    Ok(builder.with_client_auth_cert(vec![certificate], key)?)
}

/// Whether a private key and a certificate belong together.
pub(crate) fn belong_together(cert_pem: &[u8], key_pem: &[u8]) -> Result<(), Distrust> {
    let (certificate, key) = pair(cert_pem, key_pem)?;
    let pair = CertifiedKey::from_der(vec![certificate], key, &provider())?;
    Ok(pair.keys_match()?)
}

fn pair(cert_pem: &[u8], key_pem: &[u8]) -> Result<(CertificateDer<'static>, PrivateKeyDer<'static>), Distrust> {
    let unreadable = |what: &str| Distrust::Other(format!("the {what} is not in PEM, or cut off"));
    let certificate = CertificateDer::from_pem_slice(cert_pem).map_err(|_error| unreadable("certificate"))?;
    let key = PrivateKeyDer::from_pem_slice(key_pem).map_err(|_error| unreadable("private key"))?;
    Ok((certificate, key))
}
