//! Who is at the other end: reachable, there, and of the same making.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use tandem_link::{Link, LinkError, LinkSettings, Network, Reach};
use tandem_wire::{Envelope, NodeInfo, NodeName, RobotName, Topic};

use super::check::Check;
use crate::status::{Robot, skew_words, worst_skew};
use crate::{BUILD, nodes};

/// How long whoever listens may take to let us in.
const DIAL: Duration = Duration::from_secs(5);
/// How long nodes have to show themselves.
const PRESENCE: Duration = Duration::from_millis(1500);
/// Nodes tell of clocks once a second.
const CLOCKS: Duration = Duration::from_millis(2500);
/// How long a node may take to say who it is.
const ANSWER: Duration = Duration::from_secs(3);

/// Whether whoever is dialled answers.
pub(super) fn doors(reach: &Reach) -> Vec<Check> {
    let doors = reach.knock();
    doors
        .into_iter()
        .map(|door| match door.answer {
            Ok(Some(certificate)) => Check::good(
                "reach",
                format!(
                    "{} is {}, whose certificate is good until {}",
                    door.endpoint,
                    certificate.common_name,
                    certificate.expires()
                ),
            ),
            Ok(None) => Check::good("reach", format!("{} answers", door.endpoint)),
            Err(why) => Check::bad("reach", why.to_string(), advice(&why)),
        })
        .collect()
}

fn advice(why: &tandem_site::Knock) -> &'static str {
    use tandem_site::Knock;
    match why {
        Knock::Silent { .. } => "start whoever listens there; check address, port and firewall",
        Knock::Files(_) => "tandem keys show lists what there is",
        Knock::Theirs { .. } => {
            "on the listener's machine: issue its certificate again, with --host for how it is dialled"
        }
        Knock::Ours { .. } => "issue this member's certificate again, and copy it here",
        Knock::Unknown { .. } => "copy the newer site.toml from where the site was made",
        Knock::NotTls { .. } => "start the listener with --site, or this one without",
    }
}

/// Who is there, and whether all were made from the same wire.
pub(super) fn nodes(settings: &LinkSettings, reach: &Reach, named: Option<&str>) -> Vec<Check> {
    let link = match open(settings, reach) {
        Ok(Some(link)) => link,
        Ok(None) => return vec![Check::skipped("nodes", "nobody lets us in, so nobody can be asked")],
        Err(why) => {
            let todo = "see what whoever keeps the site says of this certificate";
            return vec![Check::bad("nodes", why.to_string(), todo)];
        }
    };
    let found = present(&link, named, reach);
    let checks = match found {
        Err(why) => vec![Check::skipped("nodes", why.to_string())],
        Ok(found) if found.is_empty() => vec![Check::worth(
            "nodes",
            "somebody carries messages, but no node says that it is there",
            "start the nodes; each needs the same --connect",
        )],
        Ok(found) => found
            .iter()
            .flat_map(|(robot, nodes)| robot_checks(&link, robot, nodes, reach))
            .collect(),
    };
    link.close();
    checks
}

fn open(settings: &LinkSettings, reach: &Reach) -> Result<Option<Link>, LinkError> {
    nodes::dial(settings, reach)?.recv_timeout(DIAL).ok().transpose()
}

type Found = BTreeMap<String, (RobotName, Vec<NodeName>)>;

fn present(link: &Link, named: Option<&str>, reach: &Reach) -> Result<Vec<(RobotName, Vec<NodeName>)>, LinkError> {
    let own = reach.secured.as_ref().map(|secured| &secured.identity.member.robots);
    let robots: Vec<String> = match (named, own) {
        (Some(name), _) => vec![name.to_owned()],
        (None, Some(robots)) => robots.chunks().map(str::to_owned).collect(),
        (None, None) => vec!["*".to_owned()],
    };
    let network = Network::watch(link, &robots, &[])?;
    let until = Instant::now() + PRESENCE;
    let mut found = Found::new();
    while let Some(left) = until.checked_duration_since(Instant::now()) {
        let Some(noticed) = network.next(left) else { break };
        if let (Topic::Alive(node), true) = (noticed.topic, noticed.alive) {
            let entry = found.entry(noticed.robot.to_string());
            entry.or_insert_with(|| (noticed.robot, Vec::new())).1.push(node);
        }
    }
    Ok(found.into_values().collect())
}

fn robot_checks(link: &Link, robot: &RobotName, nodes: &[NodeName], reach: &Reach) -> Vec<Check> {
    let mut checks = Vec::new();
    let missing: Vec<&str> = NodeName::ALL
        .iter()
        .filter(|node| !nodes.contains(node))
        .map(|node| node.as_str())
        .collect();
    let there = nodes.iter().map(|node| node.as_str()).collect::<Vec<_>>().join(", ");
    checks.push(match missing.as_slice() {
        [] | ["recorder"] => Check::good("nodes", format!("{robot}: {there}")),
        missing => Check::worth(
            "nodes",
            format!("{robot}: {there}; not there: {}", missing.join(", ")),
            "a loop needs operator, arbiter and robot-sim; a predictor shares, a recorder records",
        ),
    });
    for node in nodes {
        checks.push(match link.ask(robot, *node, ANSWER) {
            None => Check::worth(
                "versions",
                format!("{robot}: {node} does not say who it is"),
                "it may speak another layout: compare tandem --version on both machines",
            ),
            Some(Envelope { body, .. }) => version(robot, *node, &body),
        });
    }
    checks.push(clocks(link, robot, reach));
    checks
}

/// How far apart the wall clocks of a robot's nodes are, by their own word.
fn clocks(link: &Link, robot: &RobotName, reach: &Reach) -> Check {
    let role = reach.secured.as_ref().map(|secured| secured.identity.member.role);
    if role.is_some_and(|role| !tandem_site::policy::hears_all(role)) {
        return Check::skipped(
            "clocks",
            "only a recorder's or viewer's certificate hears what nodes know of clocks",
        );
    }
    let topics = NodeName::ALL.map(Topic::Clock);
    let Ok(network) = Network::watch(link, &[robot.to_string()], &topics) else {
        return Check::skipped("clocks", format!("{robot}: nothing is heard of clocks"));
    };
    let (mut told, until) = (Robot::default(), Instant::now() + CLOCKS);
    while let Some(left) = until.checked_duration_since(Instant::now()) {
        if let Some(noticed) = network
            .next(left)
            .filter(|noticed| matches!(noticed.topic, Topic::Clock(_)))
        {
            told.hear(noticed.at, noticed.topic, &noticed.bytes);
        }
    }
    match worst_skew(&told.clocks) {
        None => Check::skipped(
            "clocks",
            format!("{robot}: no node says anything of the others' clocks"),
        ),
        Some((reporter, peer)) if peer.is_skewed => Check::worth(
            "clocks",
            format!(
                "{robot}: wall clocks are too far apart, {}",
                skew_words(reporter, &peer)
            ),
            "run chrony or systemd-timesyncd on both machines; files go by wall clocks, motion does not",
        ),
        Some((reporter, peer)) => Check::good(
            "clocks",
            format!("{robot}: wall clocks agree, at worst {}", skew_words(reporter, &peer)),
        ),
    }
}

/// Whether a node understands what this program says.
fn version(robot: &RobotName, node: NodeName, info: &NodeInfo) -> Check {
    let theirs = &info.build;
    if theirs == BUILD {
        return Check::good("versions", format!("{robot}: {node} is {theirs}, as this one"));
    }
    let says = format!("{robot}: {node} is {theirs}; this one is {BUILD}");
    match (wire(theirs), wire(BUILD)) {
        (Some(one), Some(other)) if one == other => Check::worth(
            "versions",
            format!("{says}: other programs, the same wire"),
            "they understand each other; to execute a recording again, use the program that made it",
        ),
        _ => Check::bad(
            "versions",
            format!("{says}: another wire"),
            "run the same version on all machines",
        ),
    }
}

/// The wire's hash in a build's text.
fn wire(build: &str) -> Option<&str> {
    build.rsplit_once("wire ").map(|(_, hash)| hash.trim_end_matches(')'))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::check::Verdict;

    fn verdict(build: &str) -> Verdict {
        let info = NodeInfo {
            build: build.to_owned(),
            ..NodeInfo::default()
        };
        version(&"panda".parse().unwrap(), NodeName::Arbiter, &info).verdict
    }

    #[test]
    fn the_same_wire_is_enough_and_another_one_is_bad() {
        let hash = wire(BUILD).expect("this program knows its wire");
        assert_eq!(verdict(BUILD), Verdict::Good);
        assert_eq!(verdict(&format!("0.2.0 (0123456789ab, wire {hash})")), Verdict::Worth);
        assert_eq!(verdict("0.2.0 (0123456789ab, wire 00000000)"), Verdict::Bad);
        assert_eq!(verdict("0.0.9 (0123456789ab)"), Verdict::Bad);
    }
}
