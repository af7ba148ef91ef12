//! One TLS handshake with whoever listens, to say in words why Zenoh, which only tries again, does not get through.

use std::io::{self, Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustls::ClientConnection;
use rustls::pki_types::ServerName;

use crate::{Certificate, Distrust, Identity, SiteError, client_configuration};

/// How long whoever listens may take, for the connection and for each answer.
const PATIENCE: Duration = Duration::from_secs(2);
/// Whoever refuses our certificate says so after the handshake, which is over for us by then. This long we wait for it.
const REFUSAL: Duration = Duration::from_millis(400);

/// Why nobody let us in.
#[derive(Debug, thiserror::Error)]
pub enum Knock {
    /// Nobody listens there.
    #[error("nobody answers at {host}:{port}: {source}")]
    Silent {
        /// Where.
        host: String,
        /// On which port.
        port: u16,
        /// What the system says.
        source: io::Error,
    },
    /// Our own files.
    #[error(transparent)]
    Files(#[from] SiteError),
    /// We do not believe who listens.
    #[error("the certificate of whoever listens at {host}:{port} is refused: {source}")]
    Theirs {
        /// Where.
        host: String,
        /// On which port.
        port: u16,
        /// Why.
        source: Distrust,
    },
    /// Who listens does not believe us.
    #[error("whoever listens at {host}:{port} refuses the certificate of {name}: {source}")]
    Ours {
        /// Where.
        host: String,
        /// On which port.
        port: u16,
        /// Who we are.
        name: String,
        /// Why.
        source: Distrust,
    },
    /// It is a member of the site, but not in this machine's roster.
    #[error(
        "whoever listens at {host}:{port} is {common_name}, whom the roster here does not trust: copy the newer site.toml"
    )]
    Unknown {
        /// Where.
        host: String,
        /// On which port.
        port: u16,
        /// What it calls itself.
        common_name: String,
    },
    /// It speaks, but not TLS.
    #[error("whoever listens at {host}:{port} does not speak TLS, or ended it: {source}; was it started with --site?")]
    NotTls {
        /// Where.
        host: String,
        /// On which port.
        port: u16,
        /// What came.
        source: io::Error,
    },
}

/// Shakes hands with whoever listens at `host` and `port`, as `identity`. Gives the other side's certificate.
///
/// Takes a few seconds at the most.
///
/// # Errors
/// Why there was no handshake, and at which side to act.
pub fn knock(identity: &Identity, host: &str, port: u16) -> Result<Certificate, Knock> {
    let place = || (host.to_owned(), port);
    let mut stream = connect(host, port).map_err(|source| {
        let (host, port) = place();
        Knock::Silent { host, port, source }
    })?;
    let theirs = |source: Distrust| {
        let (host, port) = place();
        Knock::Theirs { host, port, source }
    };
    let mut session = client(identity, host)?.map_err(theirs)?;
    let ended = shake_hands(&mut session, &mut stream);
    let certificate = session
        .peer_certificates()
        .and_then(<[_]>::first)
        .and_then(|der| Certificate::from_der(der));
    let (host, port) = place();
    match (ended, certificate) {
        (Ok(()), Some(certificate)) => Ok(certificate),
        (Ok(()), None) => Err(Knock::NotTls {
            host,
            port,
            source: io::ErrorKind::UnexpectedEof.into(),
        }),
        (Err(source), _) => Err(refused(identity, host, port, source)),
    }
}

/// Whether anybody listens at `host` and `port`, and leaves us the first word, as Zenoh without certificates does.
///
/// Takes a few seconds at the most.
///
/// # Errors
/// If nobody answers.
pub fn touch(host: &str, port: u16) -> Result<(), Knock> {
    connect(host, port).map(drop).map_err(|source| Knock::Silent {
        host: host.to_owned(),
        port,
        source,
    })
}

/// Who refused whom.
fn refused(identity: &Identity, host: String, port: u16, error: io::Error) -> Knock {
    let said = error
        .get_ref()
        .and_then(|inner| inner.downcast_ref::<rustls::Error>())
        .cloned();
    match said {
        Some(alert @ rustls::Error::AlertReceived(_)) => Knock::Ours {
            host,
            port,
            name: identity.member.name.to_string(),
            source: alert.into(),
        },
        Some(why @ (rustls::Error::InvalidCertificate(_) | rustls::Error::NoCertificatesPresented)) => Knock::Theirs {
            host,
            port,
            source: why.into(),
        },
        _ => Knock::NotTls {
            host,
            port,
            source: error,
        },
    }
}

fn client(identity: &Identity, host: &str) -> Result<Result<ClientConnection, Distrust>, SiteError> {
    let read = |file: &std::path::Path| {
        std::fs::read(file).map_err(|source| SiteError::Unreadable {
            file: file.to_owned(),
            source,
        })
    };
    let (ca, cert, key) = (
        read(&identity.ca_file)?,
        read(&identity.certificate_file)?,
        read(&identity.key_file)?,
    );
    Ok(client_configuration(&ca, &cert, &key).and_then(|configuration| {
        let name = ServerName::try_from(host.to_owned());
        let name = name.map_err(|_invalid| Distrust::Other(format!("{host:?} is no host")))?;
        Ok(ClientConnection::new(Arc::new(configuration), name)?)
    }))
}

fn connect(host: &str, port: u16) -> io::Result<TcpStream> {
    let mut last = io::Error::from(io::ErrorKind::NotFound);
    for address in (host, port).to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, PATIENCE) {
            Ok(stream) => {
                stream.set_read_timeout(Some(PATIENCE))?;
                stream.set_write_timeout(Some(PATIENCE))?;
                return Ok(stream);
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}

/// Until the handshake is over and whoever listens has had time to refuse us.
fn shake_hands(session: &mut ClientConnection, stream: &mut TcpStream) -> io::Result<()> {
    let until = Instant::now() + 2 * PATIENCE;
    while session.is_handshaking() && Instant::now() < until {
        session.complete_io(stream)?;
    }
    stream.flush()?;
    stream.set_read_timeout(Some(REFUSAL))?;
    let mut nothing = [0];
    match rustls::Stream::new(session, stream).read(&mut nothing) {
        // Whoever waits for our first word is content with us.
        Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => Ok(()),
        Ok(1..) => Ok(()),
        Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
        Err(error) => Err(error),
    }
}
