//! Certificates and roles over real TLS on loopback: who gets in, whose word arrives, and what those hear whose does not.

#![expect(clippy::unwrap_used, reason = "where a helper cannot go on, the test has failed")]

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde_json::{Value, json};
use tandem_link::net::free_port;
use tandem_link::{Link, LinkError, LinkSettings, Observer, Reach, Sighting};
use tandem_site::{Authority, NewMember, Robots, Role, Validity, policy};
use tandem_wire::{NodeName, Pace, Topic};
use zenoh::Wait;

const LIMIT: Duration = Duration::from_secs(20);

/// A site, and a router of it at work.
struct Lab {
    folder: tempfile::TempDir,
    authority: Authority,
    port: u16,
}

impl Lab {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let authority = Authority::new(&folder.path().join("lab"), "lab".parse().unwrap()).unwrap();
        let mut lab = Self {
            folder,
            authority,
            port: free_port().unwrap(),
        };
        for role in Role::ALL {
            lab.issue(role.as_str(), role, Robots::All, Validity::days(1));
        }
        lab
    }

    fn issue(&mut self, name: &str, role: Role, robots: Robots, validity: Validity) {
        let new = NewMember {
            name: name.parse().unwrap(),
            role,
            robots,
            hosts: vec![],
            validity,
        };
        self.authority.issue(new).unwrap();
    }

    fn site(&self) -> PathBuf {
        self.folder.path().join("lab")
    }

    /// A copy of what a member has on its machine, as of now.
    fn machine_of(&self, name: &str) -> PathBuf {
        let machine = self.folder.path().join(format!("machine of {name}"));
        std::fs::create_dir(&machine).unwrap();
        for file in ["site.toml", "ca.pem", &format!("{name}.pem"), &format!("{name}.key")] {
            std::fs::copy(self.site().join(file), machine.join(file)).unwrap();
        }
        machine
    }

    fn endpoint(&self) -> String {
        format!("tcp/127.0.0.1:{}", self.port)
    }

    fn listen(&self, role: Role) -> Link {
        let settings = LinkSettings {
            listen: vec![self.endpoint()],
            ..settings(&self.site())
        };
        Link::open_as(&settings, Some(role)).unwrap()
    }

    fn dial(&self, name: &str) -> Link {
        self.dial_from(&self.site(), name).unwrap()
    }

    fn dial_from(&self, site: &Path, name: &str) -> Result<Link, LinkError> {
        let settings = LinkSettings {
            connect: vec![self.endpoint()],
            member: name.into(),
            ..settings(site)
        };
        Link::open(&settings)
    }

    /// A session that plays by nobody's rules: Zenoh alone, with these files.
    fn rogue(&self, tls: Value) -> zenoh::Result<zenoh::Session> {
        let config = json!({
            "mode": "client", "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
            "connect": { "endpoints": [format!("tls/127.0.0.1:{}", self.port)], "timeout_ms": 3000, "exit_on_failure": true },
            "transport": { "link": { "tls": tls } },
        });
        zenoh::open(zenoh::Config::from_json5(&config.to_string())?).wait()
    }

    fn tls(&self, name: &str) -> Value {
        let site = self.authority.site();
        policy::tls(&site.identity(name, None).unwrap())
    }
}

fn settings(site: &Path) -> LinkSettings {
    LinkSettings {
        robot: "panda".into(),
        site: site.to_str().unwrap().into(),
        ..LinkSettings::default()
    }
}

/// Says what must not arrive and then what may, until that has arrived; gives the topics that did.
fn heard(observer: &Observer, say: impl Fn()) -> Vec<Topic> {
    let limit = Instant::now() + LIMIT;
    let mut topics = Vec::new();
    while !topics.contains(&Topic::Emergency) {
        assert!(Instant::now() < limit, "what may be said arrives");
        say();
        while let Some(sighting) = observer.next(Duration::from_millis(50)) {
            if let Sighting::Sample { topic, .. } = sighting {
                topics.push(topic);
            }
        }
    }
    topics
}

#[test]
fn the_right_role_is_heard_and_the_wrong_one_is_not() {
    let lab = Lab::new();
    let router = lab.listen(Role::Router);
    let viewer = lab.dial("viewer");
    let observer = Observer::new(&viewer, Pace::Real).unwrap();
    let all = [
        Topic::Command,
        Topic::Proposal,
        Topic::Setpoint,
        Topic::State,
        Topic::Scene,
        Topic::Trial,
    ];
    let more = [
        Topic::Lease,
        Topic::TakeOver,
        Topic::AllClear,
        Topic::Storage,
        Topic::Forecast,
        Topic::Journal(NodeName::Arbiter),
    ];
    for role in Role::ALL.into_iter().filter(|role| *role != Role::Router) {
        let link = lab.dial(role.as_str());
        let mut topics = heard(&observer, || {
            for topic in all.iter().chain(&more).chain([&Topic::Emergency]) {
                link.publish(*topic, b"x".to_vec()).unwrap();
            }
        });
        topics.sort_unstable();
        topics.dedup();
        let mut allowed = policy::says(role);
        allowed.retain(|topic| all.contains(topic) || more.contains(topic) || *topic == Topic::Emergency);
        allowed.sort_unstable();
        assert_eq!(topics, allowed, "{role}");
        link.close();
    }
    router.close();
}

#[test]
fn an_operator_reaches_its_own_robots_only() {
    let mut lab = Lab::new();
    let own = Robots::try_from(vec!["panda".to_owned()]).unwrap();
    lab.issue("desk", Role::Operator, own, Validity::days(1));
    let router = lab.listen(Role::Router);
    let arbiter = lab.dial("arbiter");
    let (sender, receiver) = crossbeam_channel::unbounded();
    let other = sender.clone();
    let listen = |key: &str, sender: crossbeam_channel::Sender<String>| {
        let viewer = lab.rogue(lab.tls("viewer")).unwrap();
        let heard = move |sample: zenoh::sample::Sample| drop(sender.send(sample.key_expr().to_string()));
        viewer
            .declare_subscriber(key)
            .callback(heard)
            .background()
            .wait()
            .unwrap();
        viewer
    };
    let viewers = (
        listen("tandem/panda/command", sender),
        listen("tandem/other/command", other),
    );
    let rogue = lab.rogue(lab.tls("desk")).unwrap();
    let limit = Instant::now() + LIMIT;
    loop {
        assert!(Instant::now() < limit, "its own robot's command arrives");
        for key in [
            "tandem/other/command",
            "tandem/*/command",
            "tandem/**",
            "tandem/panda/command",
        ] {
            rogue.put(key, "x").wait().unwrap();
        }
        if let Ok(key) = receiver.recv_timeout(Duration::from_millis(100)) {
            assert_eq!(key, "tandem/panda/command");
            break;
        }
    }
    assert!(receiver.try_iter().all(|key| key == "tandem/panda/command"));
    for session in [viewers.0, viewers.1, rogue] {
        session.close().wait().unwrap();
    }
    arbiter.close();
    router.close();
}

#[test]
fn whoever_has_no_certificate_or_a_bad_one_does_not_get_in() {
    let mut lab = Lab::new();
    lab.issue(
        "old",
        Role::Operator,
        Robots::All,
        Validity::between(1_577_836_800, 1_600_000_000),
    );
    let other = Lab::new();
    let router = lab.listen(Role::Router);
    let mut nothing = lab.tls("operator");
    nothing["enable_mtls"] = json!(false);
    let mut stranger = other.tls("operator");
    stranger["root_ca_certificate"] = json!(lab.site().join("ca.pem"));
    let mut old = lab.tls("operator");
    old["connect_certificate"] = json!(lab.site().join("old.pem"));
    old["connect_private_key"] = json!(lab.site().join("old.key"));
    for (who, tls) in [("nobody", nothing), ("a stranger", stranger), ("the expired", old)] {
        let opened = lab.rogue(tls);
        assert!(opened.is_err(), "{who} does not get in");
    }
    // The same sessions with good files do: it is the certificate that is missing.
    lab.rogue(lab.tls("operator")).unwrap().close().wait().unwrap();
    router.close();
}

#[test]
fn whoever_was_revoked_says_nothing_and_hears_why() {
    let mut lab = Lab::new();
    let machine = lab.machine_of("operator");
    let tls = lab.tls("operator");
    let mut copied = tls.clone();
    for (key, file) in [
        ("connect_certificate", "operator.pem"),
        ("connect_private_key", "operator.key"),
    ] {
        copied[key] = json!(machine.join(file));
    }
    copied["listen_certificate"] = copied["connect_certificate"].clone();
    copied["listen_private_key"] = copied["connect_private_key"].clone();
    lab.authority.revoke("operator", "laptop lost").unwrap();
    let router = lab.listen(Role::Router);

    let refused = lab.dial_from(&machine, "operator").unwrap_err().to_string();
    assert!(
        refused.contains("revoked on") && refused.contains("laptop lost"),
        "{refused}"
    );

    let viewer = lab.dial("viewer");
    let observer = Observer::new(&viewer, Pace::Real).unwrap();
    let rogue = lab.rogue(copied).unwrap();
    let topics = heard(&observer, || {
        for topic in ["command", "lease", "estop"] {
            rogue.put(format!("tandem/panda/{topic}"), "x").wait().unwrap();
        }
        viewer.publish(Topic::Emergency, b"x".to_vec()).unwrap();
    });
    assert!(topics.iter().all(|topic| *topic == Topic::Emergency), "{topics:?}");
    rogue.close().wait().unwrap();
    viewer.close();
    router.close();
}

#[test]
fn a_robot_that_listens_enforces_the_same_and_presence_gets_through() {
    let lab = Lab::new();
    let robot = lab.listen(Role::RobotSim);
    let viewer = lab.dial("viewer");
    let observer = Observer::new(&viewer, Pace::Real).unwrap();
    let arbiter = lab.rogue(lab.tls("arbiter")).unwrap();
    let _token = arbiter
        .liveliness()
        .declare_token("tandem/panda/alive/arbiter")
        .wait()
        .unwrap();
    let _forged = arbiter
        .liveliness()
        .declare_token("tandem/panda/alive/operator")
        .wait()
        .unwrap();
    let limit = Instant::now() + LIMIT;
    let mut present = Vec::new();
    while !present.contains(&NodeName::Arbiter) && Instant::now() < limit {
        if let Some(Sighting::Presence { peer, alive: true }) = observer.next(Duration::from_millis(100)) {
            present.push(peer);
        }
    }
    assert_eq!(present, [NodeName::Arbiter]);
    let topics = heard(&observer, || {
        for topic in ["state", "command", "setpoint", "estop"] {
            arbiter.put(format!("tandem/panda/{topic}"), "x").wait().unwrap();
        }
    });
    assert!(
        topics
            .iter()
            .all(|topic| [Topic::Setpoint, Topic::Emergency].contains(topic)),
        "{topics:?}"
    );
    arbiter.close().wait().unwrap();
    viewer.close();
    robot.close();
}

#[test]
fn a_link_ends_when_the_certificate_does() {
    let mut lab = Lab::new();
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs();
    let now = i64::try_from(now).unwrap();
    lab.issue(
        "brief",
        Role::Operator,
        Robots::All,
        Validity::between(now - 60, now + 4),
    );
    let router = lab.listen(Role::Router);
    let link = lab.dial("brief");
    assert!(link.is_connected());
    let limit = Instant::now() + LIMIT;
    while link.is_connected() && Instant::now() < limit {
        std::thread::sleep(Duration::from_millis(50));
    }
    assert!(!link.is_connected(), "the link ended with the certificate");
    link.close();
    router.close();
}

#[test]
fn a_knock_says_why_a_door_stays_shut() {
    let mut lab = Lab::new();
    let before = lab.machine_of("operator");
    lab.issue("gate", Role::Router, Robots::All, Validity::days(1));
    let reach = |site: &Path, endpoint: String| {
        let settings = LinkSettings {
            connect: vec![endpoint],
            ..settings(site)
        };
        Reach::new(&settings, Some(Role::Operator)).unwrap()
    };
    let answer = |reach: &Reach| reach.knock().remove(0).answer;
    let why = answer(&reach(&lab.site(), lab.endpoint())).unwrap_err().to_string();
    assert!(why.contains("nobody answers"), "{why}");

    let settings = LinkSettings {
        listen: vec![lab.endpoint()],
        member: "gate".into(),
        ..settings(&lab.site())
    };
    let router = Link::open_as(&settings, Some(Role::Router)).unwrap();
    let certificate = answer(&reach(&lab.site(), lab.endpoint())).unwrap();
    assert_eq!(certificate.unwrap().common_name, "lab.gate");
    // Who has an older roster does not know the new router, and its own link denies it.
    let why = lab.dial_from(&before, "operator").unwrap_err().to_string();
    assert!(why.contains("copy the newer site.toml"), "{why}");
    let other = Lab::new();
    let why = answer(&reach(&other.site(), lab.endpoint())).unwrap_err().to_string();
    assert!(
        why.contains("whoever listens") && why.contains("not signed by this site's authority"),
        "{why}"
    );
    let elsewhere = answer(&reach(&lab.site(), format!("tcp/127.0.0.2:{}", lab.port)));
    assert!(
        elsewhere.is_err(),
        "the certificate does not name 127.0.0.2, and nobody listens there"
    );
    router.close();

    let bare = LinkSettings {
        listen: vec![lab.endpoint()],
        ..LinkSettings::default()
    };
    let bare = Link::open(&bare).unwrap();
    let why = answer(&reach(&lab.site(), lab.endpoint())).unwrap_err().to_string();
    assert!(why.contains("does not speak TLS"), "{why}");
    bare.close();
}
