//! Where a session listens and whom it dials: endpoints checked, and what Zenoh is told of them.

use std::net::IpAddr;

use serde_json::{Value, json};
use tandem_site::{Certificate, Identity, Knock, Role, Site, knock, policy, touch};

use crate::config::LinkSettings;
use crate::net::LinkError;

/// Where a process connects if nothing else is said, and where the README's recipe listens.
pub const DEFAULT_ENDPOINT: &str = "tcp/127.0.0.1:7447";

/// Messages of each of our classes but bulk that may wait for each link. Zenoh comes with two. Whoever publishes a third
/// waits for a millisecond, then drops it: a node that does so on the thread that receives keeps all others waiting.
const WAITING: usize = 8;

/// Batches of 64 KiB of bulk that may wait for each link. An answer about a journal takes five; with two, Zenoh drops
/// answers, and the word that they have ended with them.
const WAITING_BULK: usize = 16;

/// Where a session listens and whom it dials, and as whom.
#[derive(Clone, Debug)]
pub struct Reach {
    /// Where it listens, as Zenoh spells it.
    pub listen: Vec<String>,
    /// Whom it dials, as Zenoh spells it.
    pub connect: Vec<String>,
    /// Who it is, where certificates are used.
    pub secured: Option<Secured>,
}

/// Who a process is in its site.
#[derive(Clone, Debug)]
pub struct Secured {
    /// The site, with its roster.
    pub site: Site,
    /// The member that this process is.
    pub identity: Identity,
}

/// What one endpoint says when it is dialled.
#[derive(Debug)]
pub struct Door {
    /// The endpoint.
    pub endpoint: String,
    /// Who listens there (`None` where no certificates are used), or why we do not get in.
    pub answer: Result<Option<Certificate>, Knock>,
}

impl Reach {
    /// Checks the settings of a process with this role (or none: a tool), and the files that they name.
    ///
    /// # Errors
    /// If an endpoint is wrong or exposed, or the site's files are refused.
    pub fn new(settings: &LinkSettings, role: Option<Role>) -> Result<Self, LinkError> {
        let secured = secured(settings, role)?;
        let default = [DEFAULT_ENDPOINT.to_owned()];
        let connect: &[String] = if settings.listen.is_empty() && settings.connect.is_empty() {
            &default
        } else {
            &settings.connect
        };
        let spell = |endpoint: &String| spell(endpoint, secured.is_some());
        let listen: Vec<String> = settings.listen.iter().map(spell).collect::<Result<_, _>>()?;
        let connect: Vec<String> = connect.iter().map(spell).collect::<Result<_, _>>()?;
        for endpoint in &listen {
            check_listen(endpoint, settings.insecure || secured.is_some())?;
        }
        // Zenoh takes the brackets for a part of the host's name.
        if let Some(endpoint) = connect.iter().find(|endpoint| endpoint.starts_with("tls/[")) {
            let endpoint = endpoint.clone();
            return Err(LinkError::Bracketed { endpoint });
        }
        Ok(Self {
            listen,
            connect,
            secured,
        })
    }

    /// Without certificates, as the demo's sessions on loopback are.
    #[must_use]
    pub(crate) fn plain(listen: &[String], connect: &[String]) -> Self {
        Self {
            listen: listen.to_vec(),
            connect: connect.to_vec(),
            secured: None,
        }
    }

    /// What Zenoh is told, as JSON; zenohd takes the same.
    #[must_use]
    pub fn zenoh(&self) -> Value {
        let listens = !self.listen.is_empty();
        let secured = self.secured.as_ref();
        let mut config = secured.map_or_else(
            || json!({}),
            |Secured { site, identity }| policy::configuration(site, identity, listens),
        );
        config["mode"] = json!(if listens { "router" } else { "client" });
        config["listen"] = json!({ "endpoints": self.listen });
        config["connect"] = json!({
            "endpoints": self.connect, "timeout_ms": -1, "exit_on_failure": false,
            "retry": { "period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2 },
        });
        let waiting = &mut config["transport"]["link"]["tx"]["queue"]["size"];
        for class in ["real_time", "interactive_high", "data_high"] {
            waiting[class] = json!(WAITING);
        }
        waiting["data_low"] = json!(WAITING_BULK);
        config["scouting"] = json!({ "multicast": { "enabled": false }, "gossip": { "enabled": false } });
        config
    }

    /// Knocks at every endpoint that is dialled, one after the other, a few seconds each at the most: Zenoh itself only
    /// tries again and does not say why.
    #[must_use]
    pub fn knock(&self) -> Vec<Door> {
        let doors = self
            .connect
            .iter()
            .filter_map(|endpoint| Some((endpoint, place(endpoint)?)));
        doors
            .map(|(endpoint, (host, port))| Door {
                endpoint: endpoint.clone(),
                answer: match &self.secured {
                    Some(Secured { site, identity }) => {
                        let shaken = knock(identity, host, port);
                        shaken
                            .and_then(|certificate| known(site, certificate, host, port))
                            .map(Some)
                    }
                    None if endpoint.starts_with("udp/") => Ok(None),
                    None => touch(host, port).map(|()| None),
                },
            })
            .collect()
    }
}

/// Whoever listens must stand in our own roster, for our own link denies everybody else.
fn known(site: &Site, certificate: Certificate, host: &str, port: u16) -> Result<Certificate, Knock> {
    match site.roster().verdict(&certificate.common_name) {
        Ok(_) => Ok(certificate),
        Err(_) => Err(Knock::Unknown {
            host: host.to_owned(),
            port,
            common_name: certificate.common_name,
        }),
    }
}

fn secured(settings: &LinkSettings, role: Option<Role>) -> Result<Option<Secured>, LinkError> {
    if settings.site.is_empty() {
        return Ok(None);
    }
    let site = Site::open(settings.site.as_ref())?;
    let identity = site.identity(&settings.member, role)?;
    if identity.member.role != Role::Router {
        identity.serves(&settings.robot.parse()?)?;
    }
    if !settings.listen.is_empty() && !identity.member.role.listens() {
        return Err(LinkError::MayNotListen {
            name: identity.member.name.to_string(),
            role: identity.member.role,
        });
    }
    Ok(Some(Secured { site, identity }))
}

/// An endpoint as it will be used: with certificates, TCP becomes TLS.
fn spell(endpoint: &str, secured: bool) -> Result<String, LinkError> {
    host(endpoint)?;
    let given = || endpoint.to_owned();
    match endpoint.split_once('/') {
        Some(("tcp", address)) if secured => Ok(format!("tls/{address}")),
        Some(("udp", _)) if secured => Err(LinkError::Unprotected { endpoint: given() }),
        Some(("tls", _)) if !secured => Err(LinkError::NoSite { endpoint: given() }),
        _ => Ok(given()),
    }
}

fn check_listen(endpoint: &str, allowed: bool) -> Result<(), LinkError> {
    host(endpoint)?;
    if is_loopback(endpoint) || allowed {
        Ok(())
    } else {
        Err(LinkError::Exposed {
            endpoint: endpoint.to_owned(),
        })
    }
}

/// Whether an endpoint is this machine's alone.
#[must_use]
pub fn is_loopback(endpoint: &str) -> bool {
    place(endpoint)
        .is_some_and(|(host, _)| host == "localhost" || host.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback()))
}

/// The host of an endpoint that is spelled right.
fn host(endpoint: &str) -> Result<&str, LinkError> {
    let wrong = || LinkError::Endpoint {
        endpoint: endpoint.to_owned(),
    };
    let (protocol, _) = endpoint.split_once('/').ok_or_else(wrong)?;
    let (host, _) = place(endpoint).ok_or_else(wrong)?;
    if ["tcp", "udp", "tls"].contains(&protocol) && !host.is_empty() {
        Ok(host)
    } else {
        Err(wrong())
    }
}

/// Host and port of an endpoint, if it has them.
#[must_use]
pub fn place(endpoint: &str) -> Option<(&str, u16)> {
    let (_, address) = endpoint.split_once('/')?;
    let address = address.split(['#', '?']).next().unwrap_or(address);
    let (host, port) = address.rsplit_once(':')?;
    let host = host.trim_start_matches('[').trim_end_matches(']');
    Some((host, port.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn listening_beyond_loopback_must_be_spelled_out() {
        for endpoint in ["tcp/127.0.0.1:7447", "tcp/[::1]:7447", "udp/localhost:1"] {
            assert!(check_listen(endpoint, false).is_ok(), "{endpoint}");
        }
        for endpoint in [
            "tcp/0.0.0.0:7447",
            "tcp/[::]:7447",
            "tcp/192.0.2.1:7447",
            "tcp/[::ffff:127.0.0.1]:7447",
            "tcp/localhost.example:7447",
            "tcp/0.0.0.0:7447#iface=lo",
        ] {
            assert!(
                matches!(check_listen(endpoint, false), Err(LinkError::Exposed { .. })),
                "{endpoint}"
            );
            assert!(check_listen(endpoint, true).is_ok(), "{endpoint}");
        }
        for endpoint in [
            "",
            "7447",
            "tcp/127.0.0.1",
            "tcp/127.0.0.1:x",
            "http/127.0.0.1:80",
            "tcp/:1",
        ] {
            assert!(
                matches!(check_listen(endpoint, false), Err(LinkError::Endpoint { .. })),
                "{endpoint}"
            );
        }
    }

    #[test]
    fn with_certificates_everything_is_tls_and_without_nothing() {
        assert_eq!(spell("tcp/192.0.2.1:7447", true).unwrap(), "tls/192.0.2.1:7447");
        assert_eq!(spell("tls/192.0.2.1:7447", true).unwrap(), "tls/192.0.2.1:7447");
        assert!(matches!(
            spell("udp/127.0.0.1:1", true),
            Err(LinkError::Unprotected { .. })
        ));
        assert!(matches!(spell("tls/127.0.0.1:1", false), Err(LinkError::NoSite { .. })));
        assert_eq!(spell("udp/127.0.0.1:1", false).unwrap(), "udp/127.0.0.1:1");
    }
}
