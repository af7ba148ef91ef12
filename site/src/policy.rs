//! Who may say, hear, ask and answer what: least privilege, as data and in Zenoh's words.
//!
//! Zenoh applies `access_control` per link: whoever listens filters what a member sends (`ingress`) and what is sent to
//! it (`egress`), by the common name of the member's certificate. What nobody was given is denied. A router's certificate
//! stands for what it carries, which it has checked at its own door.
//!
//! | role | says | hears |
//! | --- | --- | --- |
//! | operator | command, lease, trial, the emergency stop's end | state, setpoint, storage |
//! | supervisor | the same, and take-over | the same |
//! | predictor | proposal, forecast | state |
//! | arbiter | setpoint | command, proposal, state, lease, take-over, the emergency stop's end |
//! | robot-sim | state, scene | setpoint, trial, the emergency stop's end |
//! | recorder | storage | everything |
//! | viewer | | everything |
//!
//! of its own robots; besides, everybody may say and hear the emergency stop, hear state and setpoint (which
//! acknowledge it), see who is there, ping, and ask nodes for their configuration; a node answers for itself, sends its
//! journal and says what it knows of the others' clocks.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use tandem_wire::keys::{PINGS, ROOT};
use tandem_wire::{NodeName, Topic};

use crate::{Identity, Member, Robots, Role, Roster, Site};

/// What a role may publish.
#[must_use]
pub fn says(role: Role) -> Vec<Topic> {
    let own: &[Topic] = match role {
        Role::Operator => &[Topic::Command, Topic::Lease, Topic::Trial, Topic::AllClear],
        Role::Supervisor => &[
            Topic::Command,
            Topic::Lease,
            Topic::Trial,
            Topic::AllClear,
            Topic::TakeOver,
        ],
        Role::Predictor => &[Topic::Proposal, Topic::Forecast],
        Role::Arbiter => &[Topic::Setpoint],
        Role::RobotSim => &[Topic::State, Topic::Scene],
        Role::Recorder => &[Topic::Storage],
        Role::Viewer | Role::Router => &[],
    };
    let journal = role
        .node()
        .filter(|node| *node != NodeName::Recorder)
        .map(Topic::Journal);
    let clock = role.node().map(Topic::Clock);
    own.iter()
        .copied()
        .chain(journal)
        .chain(clock)
        .chain([Topic::Emergency])
        .collect()
}

/// What a role may subscribe to, besides everything for those who [hear all](hears_all).
#[must_use]
pub fn hears(role: Role) -> Vec<Topic> {
    let own: &[Topic] = match role {
        Role::Operator | Role::Supervisor => &[Topic::Storage],
        Role::Arbiter => &[
            Topic::Command,
            Topic::Proposal,
            Topic::Lease,
            Topic::TakeOver,
            Topic::AllClear,
        ],
        Role::RobotSim => &[Topic::Trial, Topic::AllClear],
        Role::Predictor | Role::Recorder | Role::Viewer | Role::Router => &[],
    };
    own.iter()
        .copied()
        .chain([Topic::State, Topic::Setpoint, Topic::Emergency])
        .collect()
}

/// Whether a role may subscribe to everything about its robots.
#[must_use]
pub const fn hears_all(role: Role) -> bool {
    matches!(role, Role::Recorder | Role::Viewer)
}

/// What a role may ask nodes for.
#[must_use]
pub fn asks(role: Role) -> Vec<Topic> {
    let journals = (role == Role::Recorder).then_some(NodeName::ALL.map(Topic::Journal));
    NodeName::ALL
        .map(Topic::Info)
        .into_iter()
        .chain(journals.into_iter().flatten())
        .collect()
}

/// What a role answers when it is asked.
#[must_use]
pub fn answers(role: Role) -> Vec<Topic> {
    let node = role.node();
    node.into_iter()
        .flat_map(|node| [Topic::Info(node), Topic::Journal(node), Topic::Ping(node)])
        .collect()
}

/// The key on which whoever listens says what a common name may do, to anybody who has a certificate.
#[must_use]
pub fn verdict_key(site: &str, common_name: &str) -> String {
    format!("tandem-site/{site}/{common_name}")
}

/// A topic of some robots, as key expressions.
fn keys_of(topics: &[Topic], robots: &Robots) -> Vec<String> {
    let of_robot = |robot: &str| {
        topics
            .iter()
            .map(|topic| format!("{ROOT}/{robot}/{}", topic.suffix()))
            .collect::<Vec<_>>()
    };
    robots.chunks().flat_map(of_robot).collect()
}

/// The question that all nodes of some robots answer at once; access control wants it spelled as it is asked.
fn pings(robots: &Robots) -> Vec<String> {
    let of_robot = |robot: &str| format!("{ROOT}/{robot}/{PINGS}");
    robots.chunks().map(of_robot).collect()
}

/// Everything about some robots, as key expressions.
fn everything(robots: &Robots) -> Vec<String> {
    match robots {
        Robots::All => vec![format!("{ROOT}/**")],
        Robots::Only(names) => names.iter().map(|robot| format!("{ROOT}/{robot}/**")).collect(),
    }
}

/// One rule of Zenoh's.
fn rule(id: &str, flow: &str, messages: &[&str], keys: &[String]) -> Value {
    json!({ "id": id, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys })
}

/// Rules and policies as they are collected.
#[derive(Default)]
struct Collected {
    rules: Vec<Value>,
    subjects: Vec<Value>,
    policies: Vec<Value>,
}

impl Collected {
    /// What a member of `role` may do with `robots`, in rules named after `id`.
    fn grant(&mut self, id: &str, role: Role, robots: &Robots, common_names: &[&str]) {
        let heard = match hears_all(role) {
            true => everything(robots),
            false => keys_of(&hears(role), robots),
        };
        let alive = role.node().map(|node| keys_of(&[Topic::Alive(node)], robots));
        let asked = [keys_of(&asks(role), robots), pings(robots)].concat();
        let answered = keys_of(&answers(role), robots);
        let questions = match role.node() {
            Some(_) => [answered.clone(), pings(robots)].concat(),
            None => answered.clone(),
        };
        let mut rules = Vec::new();
        let mut add = |what: &str, flow, messages: &[&str], keys: &[String]| {
            if !keys.is_empty() {
                rules.push(rule(&format!("{id} {what}"), flow, messages, keys));
            }
        };
        add("says", "ingress", &["put"], &keys_of(&says(role), robots));
        add("wants to hear", "ingress", &["declare_subscriber"], &heard);
        add("hears", "egress", &["put"], &heard);
        add("asks", "ingress", &["query"], &asked);
        add("is answered", "egress", &["reply"], &asked);
        add("answers", "ingress", &["declare_queryable", "reply"], &answered);
        add("is asked", "egress", &["query"], &questions);
        add("is there", "ingress", &["liveliness_token"], &alive.unwrap_or_default());
        self.enter(
            id,
            rules,
            &["sees who is there", "knows who listens"],
            &json!({ "cert_common_names": common_names }),
        );
    }

    fn enter(&mut self, id: &str, rules: Vec<Value>, shared: &[&str], subject: &Value) {
        let own = rules.iter().filter_map(|rule| rule["id"].as_str());
        let ids: Vec<&str> = own.chain(shared.iter().copied()).collect();
        self.policies.push(json!({ "id": id, "rules": ids, "subjects": [id] }));
        let mut named = subject.clone();
        named["id"] = json!(id);
        self.subjects.push(named);
        self.rules.extend(rules);
    }

    /// What every member may.
    fn share(&mut self) {
        let presence = [format!("{ROOT}/*/alive/*")];
        let all = [format!("{ROOT}/**")];
        let interest = [
            "declare_subscriber",
            "declare_queryable",
            "declare_liveliness_subscriber",
            "liveliness_query",
        ];
        self.rules.push(json!({
            "id": "sees who is there", "permission": "allow", "flows": ["ingress", "egress"], "key_exprs": presence,
            "messages": ["liveliness_query", "declare_liveliness_subscriber"],
        }));
        // Who listens is no secret: a publisher that is not told sends nothing.
        self.rules.push(rule(
            "knows who listens",
            "egress",
            &[&interest[..], &["liveliness_token"]].concat(),
            &all,
        ));
    }

    fn finish(self) -> Value {
        json!({
            "enabled": true, "default_permission": "deny",
            "rules": self.rules, "subjects": self.subjects, "policies": self.policies,
        })
    }
}

/// What whoever listens allows: Zenoh's `access_control`, default deny.
#[must_use]
pub fn access_control(roster: &Roster) -> Value {
    let mut groups: BTreeMap<(Role, &Robots), Vec<&str>> = BTreeMap::new();
    for Member {
        role,
        robots,
        common_name,
        ..
    } in roster.all_trusted()
    {
        groups.entry((*role, robots)).or_default().push(common_name);
    }
    let mut collected = Collected::default();
    collected.share();
    for ((role, robots), common_names) in groups {
        let id = format!("{role} of {robots}");
        if role == Role::Router {
            let everything =
                ["ingress", "egress"].map(|flow| rule(&format!("{id} {flow}"), flow, &EVERY_MESSAGE, &["**".into()]));
            collected.enter(
                &id,
                everything.into(),
                &[],
                &json!({ "cert_common_names": common_names }),
            );
        } else {
            collected.grant(&id, role, robots, &common_names);
        }
    }
    // Whoever got through the TLS handshake may ask why nothing else gets through, even a member that was revoked.
    let verdicts = [verdict_key(roster.site.as_str(), "*")];
    let anybody = vec![
        rule("asks for a verdict", "ingress", &["query"], &verdicts),
        rule("hears a verdict", "egress", &["reply", "declare_queryable"], &verdicts),
    ];
    collected.enter("anybody", anybody, &[], &json!({ "link_protocols": ["tls"] }));
    collected.finish()
}

/// What whoever dials allows: anything, with those whom the roster knows to listen. A certificate that some public
/// authority gave for the host's name is no member's, though Zenoh would believe it.
#[must_use]
pub fn dialling_access_control(roster: &Roster) -> Value {
    let listening = roster.all_trusted().filter(|member| member.role.listens());
    let common_names: Vec<&str> = listening.map(|member| member.common_name.as_str()).collect();
    let mut collected = Collected::default();
    if !common_names.is_empty() {
        let rules =
            ["ingress", "egress"].map(|flow| rule(&format!("all {flow}"), flow, &EVERY_MESSAGE, &["**".into()]));
        collected.enter(
            "who listens",
            rules.into(),
            &[],
            &json!({ "cert_common_names": common_names }),
        );
    }
    collected.finish()
}

/// Every kind of message that Zenoh's access control knows.
const EVERY_MESSAGE: [&str; 9] = [
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
];

/// Zenoh's `transport/link/tls`: mutual, names checked, links closed when a certificate ends.
#[must_use]
pub fn tls(identity: &Identity) -> Value {
    let (certificate, key) = (&identity.certificate_file, &identity.key_file);
    json!({
        "root_ca_certificate": identity.ca_file,
        "listen_private_key": key, "listen_certificate": certificate,
        "connect_private_key": key, "connect_certificate": certificate,
        "enable_mtls": true, "verify_name_on_connect": true, "close_link_on_expiration": true,
    })
}

/// The part of Zenoh's configuration that a member of a site needs: `transport` and `access_control`.
#[must_use]
pub fn configuration(site: &Site, identity: &Identity, listens: bool) -> Value {
    let access = match listens {
        true => access_control(site.roster()),
        false => dialling_access_control(site.roster()),
    };
    json!({ "transport": { "link": { "tls": tls(identity) } }, "access_control": access })
}
