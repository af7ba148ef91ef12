//! What the rules grant, read as Zenoh reads them: a key is allowed if a rule's expression includes it.

#![expect(clippy::unwrap_used, reason = "where a helper cannot go on, the test has failed")]

use serde_json::Value;
use tandem_site::policy::{access_control, dialling_access_control};
use tandem_site::{Member, Robots, Role, Roster};

fn member(name: &str, role: Role, robots: &[&str]) -> Member {
    let robots: Vec<String> = robots.iter().map(|robot| (*robot).to_owned()).collect();
    Member {
        name: name.parse().unwrap(),
        role,
        robots: Robots::try_from(robots).unwrap(),
        common_name: format!("lab.{name}"),
        fingerprint: String::new(),
        expires: "2027-11-22".into(),
        revoked: None,
    }
}

fn roster() -> Roster {
    let mut members: Vec<Member> = Role::ALL
        .iter()
        .map(|role| member(role.as_str(), *role, &["*"]))
        .collect();
    members.push(member("desk", Role::Operator, &["left"]));
    let mut gone = member("gone", Role::Arbiter, &["*"]);
    gone.revoked = Some(tandem_site::Revocation {
        on: "2026-11-22".into(),
        why: "left the group".into(),
    });
    members.push(gone);
    Roster {
        site: "lab".parse().unwrap(),
        members,
    }
}

/// Whether `expression` includes `key`, for the expressions that the rules use and keys that may hold wildcards.
fn includes(expression: &[&str], key: &[&str]) -> bool {
    match (expression, key) {
        (["**"], _) => true,
        (["*", expression @ ..], [chunk, key @ ..]) if *chunk != "**" => includes(expression, key),
        ([own, expression @ ..], [chunk, key @ ..]) if own == chunk => includes(expression, key),
        ([], []) => true,
        _ => false,
    }
}

fn list<'a>(value: &'a Value, field: &str) -> Vec<&'a str> {
    value[field]
        .as_array()
        .unwrap()
        .iter()
        .map(|text| text.as_str().unwrap())
        .collect()
}

/// Whether the owner of a certificate may do it.
fn may(access: &Value, common_name: &str, flow: &str, message: &str, key: &str) -> bool {
    let subjects: Vec<&str> = access["subjects"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|subject| {
            subject.get("cert_common_names").is_none() || list(subject, "cert_common_names").contains(&common_name)
        })
        .map(|subject| subject["id"].as_str().unwrap())
        .collect();
    let policies = access["policies"].as_array().unwrap().iter();
    let rules: Vec<&str> = policies
        .filter(|policy| {
            list(policy, "subjects")
                .iter()
                .any(|subject| subjects.contains(subject))
        })
        .flat_map(|policy| list(policy, "rules"))
        .collect();
    let key: Vec<&str> = key.split('/').collect();
    access["rules"].as_array().unwrap().iter().any(|rule| {
        rules.contains(&rule["id"].as_str().unwrap())
            && list(rule, "flows").contains(&flow)
            && list(rule, "messages").contains(&message)
            && list(rule, "key_exprs")
                .iter()
                .any(|expression| includes(&expression.split('/').collect::<Vec<_>>(), &key))
    })
}

fn who_may(flow: &str, message: &str, key: &str) -> Vec<String> {
    let access = access_control(&roster());
    let names = roster().members.into_iter().map(|member| member.name.to_string());
    // A router's word stands for what it carries.
    names
        .chain(["stranger".into()])
        .filter(|name| name != "router" && may(&access, &format!("lab.{name}"), flow, message, key))
        .collect()
}

#[test]
fn only_the_arbiter_may_put_a_setpoint() {
    assert_eq!(who_may("ingress", "put", "tandem/left/setpoint"), ["arbiter"]);
    assert_eq!(who_may("ingress", "put", "tandem/panda/setpoint"), ["arbiter"]);
}

#[test]
fn an_operator_may_command_its_own_robots_only() {
    for topic in ["command", "lease", "trial"] {
        assert_eq!(
            who_may("ingress", "put", &format!("tandem/left/{topic}")),
            ["operator", "supervisor", "desk"]
        );
        assert_eq!(
            who_may("ingress", "put", &format!("tandem/right/{topic}")),
            ["operator", "supervisor"]
        );
    }
    assert_eq!(who_may("ingress", "put", "tandem/left/state"), ["robot-sim"]);
    assert_eq!(who_may("ingress", "put", "tandem/left/proposal"), ["predictor"]);
}

#[test]
fn only_a_supervisor_may_take_the_lease_over_and_only_who_may_drive_may_end_an_emergency_stop() {
    assert_eq!(who_may("ingress", "put", "tandem/left/lease/take-over"), ["supervisor"]);
    assert_eq!(
        who_may("ingress", "put", "tandem/left/estop/clear"),
        ["operator", "supervisor", "desk"]
    );
    for role in ["arbiter", "robot-sim"] {
        assert!(who_may("egress", "put", "tandem/left/estop/clear").contains(&role.to_owned()));
    }
}

#[test]
fn everybody_may_ping_and_each_node_answers_for_itself() {
    let nodes = [
        "operator",
        "supervisor",
        "predictor",
        "arbiter",
        "robot-sim",
        "recorder",
        "desk",
    ];
    assert_eq!(who_may("egress", "query", "tandem/left/ping/*"), nodes);
    assert!(who_may("ingress", "query", "tandem/left/ping/*").contains(&"viewer".to_owned()));
    assert_eq!(who_may("ingress", "reply", "tandem/left/ping/arbiter"), ["arbiter"]);
    assert_eq!(who_may("ingress", "put", "tandem/left/clock/robot-sim"), ["robot-sim"]);
}

#[test]
fn everybody_may_stop_and_strangers_and_the_revoked_may_do_nothing() {
    let all = [
        "operator",
        "supervisor",
        "predictor",
        "arbiter",
        "robot-sim",
        "recorder",
        "viewer",
        "desk",
    ];
    assert_eq!(who_may("ingress", "put", "tandem/left/estop"), all);
    assert_eq!(who_may("ingress", "declare_subscriber", "tandem/left/state"), all);
    assert_eq!(who_may("egress", "put", "tandem/left/state"), all);
    let verdict = "tandem-site/lab/lab.gone";
    assert!(
        who_may("ingress", "query", verdict).contains(&"gone".to_owned()),
        "it may ask why"
    );
    assert!(who_may("ingress", "put", verdict).is_empty());
    assert!(
        who_may("ingress", "declare_queryable", verdict).is_empty(),
        "nobody answers for the listener"
    );
}

#[test]
fn no_wildcard_gets_past_the_rules() {
    for key in [
        "tandem/*/setpoint",
        "tandem/**",
        "**",
        "tandem/left/*",
        "tandem/*/command",
        "@/**",
    ] {
        for message in ["put", "delete"] {
            let may: Vec<String> = who_may("ingress", message, key)
                .into_iter()
                // With all robots as its own, a put to all of them is within its rights.
                .filter(|name| !(message == "put" && key == "tandem/*/setpoint" && name == "arbiter"))
                .filter(|name| {
                    !(message == "put"
                        && key == "tandem/*/command"
                        && ["operator", "supervisor"].contains(&name.as_str()))
                })
                .collect();
            assert!(may.is_empty(), "{message} {key}: {may:?}");
        }
    }
    assert_eq!(
        who_may("ingress", "declare_subscriber", "tandem/**"),
        ["recorder", "viewer"]
    );
    assert_eq!(who_may("ingress", "declare_subscriber", "**"), Vec::<String>::new());
}

#[test]
fn a_viewer_only_watches_and_nobody_answers_for_another() {
    for topic in [
        "command",
        "setpoint",
        "state",
        "lease",
        "trial",
        "scene",
        "storage",
        "journal/operator",
    ] {
        assert!(
            !who_may("ingress", "put", &format!("tandem/left/{topic}")).contains(&"viewer".to_owned()),
            "{topic}"
        );
    }
    assert_eq!(
        who_may("ingress", "liveliness_token", "tandem/left/alive/arbiter"),
        ["arbiter"]
    );
    assert_eq!(who_may("ingress", "reply", "tandem/left/node/arbiter"), ["arbiter"]);
    assert_eq!(
        who_may("ingress", "declare_queryable", "tandem/left/journal/robot-sim"),
        ["robot-sim"]
    );
    assert_eq!(
        who_may("ingress", "query", "tandem/left/journal/robot-sim"),
        ["recorder"]
    );
}

#[test]
fn whoever_dials_speaks_only_with_those_who_may_listen() {
    let access = dialling_access_control(&roster());
    for (name, trusted) in [
        ("arbiter", true),
        ("robot-sim", true),
        ("router", true),
        ("operator", false),
        ("gone", false),
    ] {
        assert_eq!(
            may(&access, &format!("lab.{name}"), "egress", "put", "tandem/left/command"),
            trusted,
            "{name}"
        );
    }
    assert!(!may(&access, "edge.example", "ingress", "put", "tandem/left/state"));
}
