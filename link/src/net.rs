//! Zenoh sessions: opening, declaring, publishing, closing.

use std::net::TcpListener;
use std::sync::Arc;
use std::time::Duration;

use tandem_site::{Role, SiteError};
use tandem_wire::{Delivery, Pace, RobotName, Topic};
use zenoh::Wait;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::Queryable;

use crate::config::LinkSettings;
use crate::reach::Reach;
use crate::verdict;

/// The variable of the environment, and what a program had better put into it before its first session, if it is not set:
/// one thread receives and works on what it receives, instead of handing each message to another, which takes a quarter or
/// more off the median of a message's way on two cores. It also accepts whoever dials, which takes off another tenth: a
/// socket wakes the thread that accepted it first, whoever reads from it (docs/figures-network.md).
pub const ZENOH_THREADS: (&str, &str) = (
    "ZENOH_RUNTIME",
    "(rx: (worker_threads: 1), app: (handover: rx), acc: (handover: rx))",
);

/// How often a free port is looked for before giving up: another process may take it in between.
const PORT_TRIES: usize = 8;

/// Why there is no link.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// Listening beyond this machine without certificates.
    #[error(
        "refusing to listen on {endpoint}: it is reachable from other machines and there are no certificates; \
             listen on 127.0.0.1, or say --site with a folder of certificates (tandem keys new), or spell out \
             --insecure if the network is trusted"
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
    /// TLS without certificates.
    #[error("{endpoint} needs certificates: say --site with their folder (tandem keys new makes one)")]
    NoSite {
        /// The address.
        endpoint: String,
    },
    /// Certificates on a way that cannot use them.
    #[error("{endpoint} cannot be protected by certificates: write tls/ instead of udp/, or leave --site out")]
    Unprotected {
        /// The address.
        endpoint: String,
    },
    /// TLS to an address that Zenoh cannot check.
    #[error(
        "{endpoint} cannot be dialled with certificates: use a host's name that stands in the listener's certificate, \
             or an IPv4 address"
    )]
    Bracketed {
        /// The address.
        endpoint: String,
    },
    /// A certificate that is good for dialling only.
    #[error("{name} is {role} in its site and may not listen: let a router, robot-sim or arbiter listen, and dial it")]
    MayNotListen {
        /// Who.
        name: String,
        /// What it is.
        role: Role,
    },
    /// The site's files.
    #[error(transparent)]
    Site(#[from] SiteError),
    /// Who listens does not want us, or we do not want it.
    #[error("refused by whoever listens: {reason}")]
    Refused {
        /// Why.
        reason: String,
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
        match self {
            Self::Exposed { .. } | Self::Endpoint { .. } | Self::Robot(_) => true,
            Self::NoSite { .. } | Self::Unprotected { .. } | Self::Bracketed { .. } | Self::MayNotListen { .. } => true,
            Self::Site(why) => matches!(
                why,
                SiteError::NoSite { .. }
                    | SiteError::NoMember { .. }
                    | SiteError::WrongRole { .. }
                    | SiteError::Ambiguous { .. }
                    | SiteError::OtherRobot { .. }
            ),
            _ => false,
        }
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
    /// Tells whoever asks what its certificate is good for; of a session that listens.
    _verdicts: Option<Arc<Queryable<()>>>,
}

impl Link {
    /// Opens the session that the settings ask for, for a tool that has no role of its own. Blocks until the first of
    /// `connect` answers.
    ///
    /// # Errors
    /// As [`Link::open_as`].
    pub fn open(settings: &LinkSettings) -> Result<Self, LinkError> {
        Self::open_as(settings, None)
    }

    /// Opens the session that the settings ask for, for a process of that role. Blocks until the first of `connect`
    /// answers.
    ///
    /// # Errors
    /// If an endpoint is wrong, taken or exposed, the site's files are refused, whoever listens gives us nothing to do,
    /// or Zenoh refuses.
    pub fn open_as(settings: &LinkSettings, role: Option<Role>) -> Result<Self, LinkError> {
        Self::open_at(settings.robot.parse()?, &Reach::new(settings, role)?)
    }

    /// Opens a session at places that were checked before.
    ///
    /// # Errors
    /// As [`Link::open_as`].
    pub fn open_at(robot: RobotName, reach: &Reach) -> Result<Self, LinkError> {
        let mut link = Self::open_session(robot, reach)?;
        if let Some(secured) = &reach.secured {
            if !reach.listen.is_empty() {
                link._verdicts = Some(Arc::new(verdict::give(&link.session, secured.site.roster())?));
            } else if let Err(reason) = verdict::ask(&link.session, secured, reach) {
                link.close();
                return Err(LinkError::Refused { reason });
            }
        }
        Ok(link)
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
            match Self::open_session(robot.clone(), &Reach::plain(&endpoint, &[])) {
                Ok(edge) => {
                    let remote = Self::open_session(robot.clone(), &Reach::plain(&[], &endpoint))?;
                    return Ok((edge, remote));
                }
                Err(_) if tries < PORT_TRIES => {}
                Err(error) => return Err(error),
            }
        }
    }

    fn open_session(robot: RobotName, reach: &Reach) -> Result<Self, LinkError> {
        let config = zenoh::Config::from_json5(&reach.zenoh().to_string());
        match config.and_then(|config| zenoh::open(config).wait()) {
            Ok(session) => Ok(Self {
                session,
                robot,
                _verdicts: None,
            }),
            Err(error) => Err(LinkError::Open {
                listen: reach.listen.clone(),
                connect: reach.connect.clone(),
                reason: plain(&error),
            }),
        }
    }

    /// The same session, about another robot: for a process that has several.
    #[must_use]
    pub fn about(&self, robot: RobotName) -> Self {
        Self { robot, ..self.clone() }
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
        // A node's thread must not wait for a peer that is slow to take an event: Zenoh would let it, for five seconds. Nodes
        // repeat what matters; whoever says it once, with `publish`, waits.
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
        (Pace::Real, Delivery::Urgent) => (Priority::InteractiveHigh, CongestionControl::Drop, true),
        (Pace::Real, Delivery::Event) => (Priority::DataHigh, CongestionControl::Block, true),
        (Pace::Real, Delivery::Bulk) => (Priority::DataLow, CongestionControl::Drop, false),
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
