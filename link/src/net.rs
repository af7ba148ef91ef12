//! Zenoh sessions: opening, declaring, publishing, closing.

use std::net::{IpAddr, TcpListener};
use std::time::Duration;

use tandem_wire::{Delivery, Pace, RobotName, Topic};
use zenoh::Wait;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};

use crate::config::LinkSettings;

/// Where a process connects if nothing else is said, and where the README's recipe listens.
pub const DEFAULT_ENDPOINT: &str = "tcp/127.0.0.1:7447";

/// How often a free port is looked for before giving up: another process may take it in between.
const PORT_TRIES: usize = 8;

/// Why there is no link.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// Listening beyond this machine without certificates.
    #[error(
        "refusing to listen on {endpoint}: it is reachable from other machines and there are no certificates; \
             listen on 127.0.0.1, or spell out --insecure if the network is trusted"
    )]
    Exposed {
        /// The address.
        endpoint: String,
    },
    /// An endpoint that Zenoh would not understand.
    #[error("{endpoint:?} is no endpoint; write it like tcp/127.0.0.1:7447")]
    Endpoint {
        /// What was given.
        endpoint: String,
    },
    /// Zenoh would not open the session.
    #[error("cannot open a Zenoh session (listen {listen:?}, connect {connect:?}): {reason}{}", advice(.reason))]
    Open {
        /// Where it was to listen.
        listen: Vec<String>,
        /// Where it was to connect.
        connect: Vec<String>,
        /// What Zenoh said.
        reason: String,
    },
    /// Zenoh would not make a publisher, subscriber, queryable or token.
    #[error("cannot declare {key}: {reason}")]
    Declare {
        /// The key.
        key: String,
        /// What Zenoh said.
        reason: String,
    },
    /// The journal cannot be kept.
    #[error(
        "cannot keep the journal in {folder:?}: let link.spool name a folder that can be written, or set \
             link.spool_mib = 0 to keep none"
    )]
    Spool {
        /// The folder.
        folder: std::path::PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// No free port on the loopback interface.
    #[error("no free port on 127.0.0.1")]
    NoPort(#[source] std::io::Error),
    /// The robot's name is no name.
    #[error(transparent)]
    Robot(#[from] tandem_wire::keys::BadRobotName),
}

impl LinkError {
    /// Whether what was asked for cannot be, rather than what was tried went wrong.
    #[must_use]
    pub const fn is_bad_usage(&self) -> bool {
        matches!(self, Self::Exposed { .. } | Self::Endpoint { .. } | Self::Robot(_))
    }
}

fn advice(reason: &str) -> &'static str {
    if reason.contains("Address already in use") {
        "; another program listens there: choose another port, or end that program"
    } else {
        ""
    }
}

/// One Zenoh session, talking about one robot.
#[derive(Clone, Debug)]
pub struct Link {
    pub(crate) session: zenoh::Session,
    pub(crate) robot: RobotName,
}

impl Link {
    /// Opens the session that the settings ask for. Blocks until the first of `connect` answers.
    ///
    /// # Errors
    /// If an endpoint is wrong, taken or exposed, or Zenoh refuses.
    pub fn open(settings: &LinkSettings) -> Result<Self, LinkError> {
        let robot = settings.robot.parse()?;
        let default = [DEFAULT_ENDPOINT.to_owned()];
        let connect: &[String] = if settings.listen.is_empty() && settings.connect.is_empty() {
            &default
        } else {
            &settings.connect
        };
        for endpoint in &settings.listen {
            check_listen(endpoint, settings.insecure)?;
        }
        for endpoint in &settings.connect {
            host(endpoint)?;
        }
        Self::open_session(robot, &settings.listen, connect)
    }

    /// Opens the demo's two sessions, joined by a real TCP connection over loopback: the edge, which routes, and the
    /// remote side.
    ///
    /// # Errors
    /// If there is no free port or Zenoh refuses.
    pub fn open_pair(robot: &RobotName) -> Result<(Self, Self), LinkError> {
        let mut tries = 0;
        loop {
            tries += 1;
            let endpoint = [format!("tcp/127.0.0.1:{}", free_port()?)];
            match Self::open_session(robot.clone(), &endpoint, &[]) {
                Ok(edge) => return Ok((edge, Self::open_session(robot.clone(), &[], &endpoint)?)),
                Err(_) if tries < PORT_TRIES => {}
                Err(error) => return Err(error),
            }
        }
    }

    fn open_session(robot: RobotName, listen: &[String], connect: &[String]) -> Result<Self, LinkError> {
        let opened = configuration(listen, connect).and_then(|config| zenoh::open(config).wait());
        match opened {
            Ok(session) => Ok(Self { session, robot }),
            Err(error) => Err(LinkError::Open {
                listen: listen.to_vec(),
                connect: connect.to_vec(),
                reason: plain(&error),
            }),
        }
    }

    /// The robot that this link is about.
    #[must_use]
    pub const fn robot(&self) -> &RobotName {
        &self.robot
    }

    /// Whether a session that dials is connected to anybody now. It dials again by itself when that ends; what is
    /// published meanwhile reaches nobody.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        let info = self.session.info();
        info.routers_zid().wait().next().is_some() || info.peers_zid().wait().next().is_some()
    }

    /// Closes the session; what was published before is on its way.
    pub fn close(&self) {
        // A session that is closed already, or whose peer is gone, is what we want.
        let _ = self.session.close().wait();
    }

    /// Declares a publisher with the topic's way of delivery.
    ///
    /// # Errors
    /// If Zenoh refuses.
    pub(crate) fn publisher(&self, topic: Topic, pace: Pace) -> Result<Publisher<'static>, LinkError> {
        let key = topic.key(&self.robot);
        let (priority, congestion, express) = quality(topic.delivery(), pace);
        // A node's thread must not wait for a peer that is slow to take an event: Zenoh would let it, for five seconds.
        let congestion = match pace {
            Pace::Real => CongestionControl::Drop,
            Pace::Lockstep => congestion,
        };
        let built = self.session.declare_publisher(key.clone());
        built
            .priority(priority)
            .congestion_control(congestion)
            .express(express)
            .wait()
            .map_err(|error| declare(&key, &error))
    }

    /// Publishes under a name of the caller's, `tandem/<robot>/<name>`, for what is no node's: a replay.
    ///
    /// # Errors
    /// If Zenoh refuses.
    pub fn publish_as(&self, name: &str, delivery: Delivery, pace: Pace, bytes: Vec<u8>) -> Result<(), LinkError> {
        let key = format!("{}/{}/{name}", tandem_wire::keys::ROOT, self.robot);
        let (priority, congestion, express) = quality(delivery, pace);
        let put = self.session.put(&key, bytes);
        put.priority(priority)
            .congestion_control(congestion)
            .express(express)
            .wait()
            .map_err(|error| declare(&key, &error))
    }

    /// Publishes once on a topic that has no publisher of its own: a trial's mark, for instance.
    ///
    /// # Errors
    /// If Zenoh refuses.
    pub fn publish(&self, topic: Topic, bytes: Vec<u8>) -> Result<(), LinkError> {
        let key = topic.key(&self.robot);
        let (priority, congestion, express) = quality(topic.delivery(), Pace::Real);
        let put = self.session.put(&key, bytes);
        put.priority(priority)
            .congestion_control(congestion)
            .express(express)
            .wait()
            .map_err(|error| declare(&key, &error))
    }
}

pub(crate) fn declare(key: &str, error: &zenoh::Error) -> LinkError {
    LinkError::Declare {
        key: key.to_owned(),
        reason: plain(error),
    }
}

/// How a topic travels. Streams have a priority of their own: a blocking message in the same queue could hold them
/// for seconds.
const fn quality(delivery: Delivery, pace: Pace) -> (Priority, CongestionControl, bool) {
    match (pace, delivery) {
        (Pace::Lockstep, _) => (Priority::DataHigh, CongestionControl::Block, true),
        (Pace::Real, Delivery::Stream) => (Priority::RealTime, CongestionControl::Drop, true),
        (Pace::Real, Delivery::Urgent) => (Priority::InteractiveHigh, CongestionControl::Block, true),
        (Pace::Real, Delivery::Event) => (Priority::DataHigh, CongestionControl::Block, true),
        (Pace::Real, Delivery::Bulk) => (Priority::DataLow, CongestionControl::Drop, false),
    }
}

fn configuration(listen: &[String], connect: &[String]) -> zenoh::Result<zenoh::Config> {
    let list = |endpoints: &[String]| {
        let quoted: Vec<String> = endpoints.iter().map(|endpoint| format!("{endpoint:?}")).collect();
        format!("[{}]", quoted.join(","))
    };
    let mut config = zenoh::Config::default();
    config.insert_json5("mode", if listen.is_empty() { "\"client\"" } else { "\"router\"" })?;
    config.insert_json5("listen/endpoints", &list(listen))?;
    config.insert_json5("connect/endpoints", &list(connect))?;
    config.insert_json5("connect/timeout_ms", "-1")?;
    config.insert_json5("connect/exit_on_failure", "false")?;
    config.insert_json5(
        "connect/retry",
        "{ period_init_ms: 100, period_max_ms: 1000, period_increase_factor: 2 }",
    )?;
    config.insert_json5("scouting/multicast/enabled", "false")?;
    config.insert_json5("scouting/gossip/enabled", "false")?;
    Ok(config)
}

fn check_listen(endpoint: &str, insecure: bool) -> Result<(), LinkError> {
    let host = host(endpoint)?;
    let loopback = host == "localhost" || host.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback());
    if loopback || insecure {
        Ok(())
    } else {
        Err(LinkError::Exposed {
            endpoint: endpoint.to_owned(),
        })
    }
}

/// The host of an endpoint that is spelled right.
fn host(endpoint: &str) -> Result<&str, LinkError> {
    let wrong = || LinkError::Endpoint {
        endpoint: endpoint.to_owned(),
    };
    let (protocol, address) = endpoint.split_once('/').ok_or_else(wrong)?;
    let address = address.split(['#', '?']).next().unwrap_or(address);
    let (host, port) = address.rsplit_once(':').ok_or_else(wrong)?;
    if ["tcp", "udp", "tls"].contains(&protocol) && port.parse::<u16>().is_ok() && !host.is_empty() {
        Ok(host.trim_start_matches('[').trim_end_matches(']'))
    } else {
        Err(wrong())
    }
}

/// What Zenoh said, without the places in its sources that it names.
fn plain(error: &zenoh::Error) -> String {
    let said = error.to_string();
    let words: Vec<&str> = said.split(' ').collect();
    let is_place = |word: &str| word.contains(".rs:");
    let kept = words.iter().enumerate().filter(|(index, word)| {
        let before_place = **word == "at" && words.get(index + 1).is_some_and(|next| is_place(next));
        !before_place && !is_place(word)
    });
    kept.map(|(_, word)| *word).collect::<Vec<_>>().join(" ")
}

/// A port that was free a moment ago.
///
/// # Errors
/// If the loopback interface has none.
pub fn free_port() -> Result<u16, LinkError> {
    let listener = TcpListener::bind(("127.0.0.1", 0)).map_err(LinkError::NoPort)?;
    Ok(listener.local_addr().map_err(LinkError::NoPort)?.port())
}

/// How long a query for a node's configuration waits for its answer.
pub(crate) const QUERY_TIMEOUT: Duration = Duration::from_secs(5);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn listening_beyond_loopback_must_be_spelled_out() {
        for endpoint in ["tcp/127.0.0.1:7447", "tcp/[::1]:7447", "udp/localhost:1"] {
            assert!(check_listen(endpoint, false).is_ok(), "{endpoint}");
        }
        for endpoint in ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/192.0.2.1:7447"] {
            assert!(
                matches!(check_listen(endpoint, false), Err(LinkError::Exposed { .. })),
                "{endpoint}"
            );
            assert!(check_listen(endpoint, true).is_ok(), "{endpoint}");
        }
        for endpoint in ["", "7447", "tcp/127.0.0.1", "tcp/127.0.0.1:x", "http/127.0.0.1:80"] {
            assert!(
                matches!(check_listen(endpoint, false), Err(LinkError::Endpoint { .. })),
                "{endpoint}"
            );
        }
    }
}
