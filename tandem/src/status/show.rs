//! What was seen, as a screen for people and as JSON for scripts.

use serde_json::{Value, json};
use tandem_recorder::{Basis, Hop, HopBudget};
use tandem_wire::{Motion, Nanos, NodeName, Refusals, State, Topic, seconds};

use super::tally::{Robot, STREAMS, skew_words, worst_skew};

/// One robot, in a few lines; rates of what may be heard.
pub(super) fn text(name: &str, robot: &Robot, heard: &[Topic], watched: Nanos) -> String {
    let mut rows = vec![("nodes", nodes(robot))];
    rows.push(("motion", motion(robot)));
    rows.push(("drives", drives(robot)));
    let streams = STREAMS.into_iter().filter(|topic| heard.contains(topic));
    let rates = streams.map(|topic| {
        let rate = robot.rate(topic, watched);
        let missed = if rate.missed > 0 {
            format!(" ({} missed)", rate.missed)
        } else {
            String::new()
        };
        let senders = if rate.senders > 1 {
            format!(" from {}", rate.senders)
        } else {
            String::new()
        };
        format!("{topic} {:.1}/s{senders}{missed}", rate.hz)
    });
    rows.push(("rates", rates.collect::<Vec<_>>().join(", ")));
    rows.push((
        "loop",
        match robot.turn() {
            Some(turn) => format!(
                "p50 {:.1} ms, p99 {:.1} ms, worst {:.1} ms, from a state to the state that obeys its answer",
                turn.p50_ms, turn.p99_ms, turn.worst_ms
            ),
            None if heard.contains(&Topic::Command) => "no command has come round".into(),
            None => "only a recorder or viewer hears commands".into(),
        },
    ));
    rows.extend(robot.budget.hops().iter().map(|hop| ("hop", hop_row(hop))));
    let hidden: Vec<&str> = hidden(heard).into_iter().map(Hop::words).collect();
    if !hidden.is_empty() {
        let why = "only a recorder's or viewer's certificate hears what they are made of";
        rows.push(("hidden", format!("{}: {why}", hidden.join(", "))));
    }
    if let Some((reporter, peer)) = worst_skew(&robot.clocks) {
        let apart = if peer.is_skewed { "TOO FAR APART: " } else { "" };
        rows.push(("clocks", format!("{apart}at worst {}", skew_words(reporter, &peer))));
    }
    let (arbiter, own) = robot.refused();
    if arbiter.count + own.count + robot.unreadable > 0 {
        rows.push((
            "dropped",
            format!(
                "{}, {}{}",
                refused("arbiter", arbiter),
                refused("robot", own),
                unreadable(robot)
            ),
        ));
    }
    if let Some(storage) = robot.storage {
        rows.push(("recording", storage.to_string()));
    } else if robot.alive.contains(&NodeName::Recorder) {
        rows.push(("recording", "a recorder is there".into()));
    }
    format!("{name}\n{}\n", crate::table::rows(&rows))
}

/// The hops that this member cannot measure, for it may not hear what they are made of.
fn hidden(heard: &[Topic]) -> Vec<Hop> {
    let clocks = Topic::Clock(NodeName::RobotSim);
    let hears_for = |hop: &Hop| match hop {
        Hop::Device => heard.contains(&Topic::Journal(NodeName::Operator)),
        Hop::State => heard.contains(&Topic::Journal(NodeName::Operator)) && heard.contains(&clocks),
        Hop::Command | Hop::Setpoint | Hop::CommandToMotion => heard.contains(&clocks),
        Hop::Loop => heard.contains(&Topic::Command),
        Hop::Decision | Hop::Uptake | Hop::Report => true,
    };
    Hop::ALL.into_iter().filter(|hop| !hears_for(hop)).collect()
}

fn hop_row(hop: &HopBudget) -> String {
    let ms = |nanos: Nanos| seconds(nanos) * 1e3;
    let by = match hop.hop.basis() {
        Basis::OneClock => "by one clock".to_owned(),
        Basis::Corrected if hop.uncertainty == 0 => "within one process".to_owned(),
        Basis::Corrected => format!("± {:.2} ms", ms(hop.uncertainty)),
    };
    let recent = hop.recent;
    let (p50, p95, p99) = (ms(recent.p50), ms(recent.p95), ms(recent.p99));
    format!(
        "{:<25} p50 {p50:>7.2}  p95 {p95:>7.2}  p99 {p99:>7.2} ms  {by}",
        hop.hop.words()
    )
}

fn nodes(robot: &Robot) -> String {
    let (there, missing): (Vec<NodeName>, Vec<NodeName>) =
        NodeName::ALL.into_iter().partition(|node| robot.alive.contains(node));
    let list = |nodes: &[NodeName]| nodes.iter().map(|node| node.as_str()).collect::<Vec<_>>().join(", ");
    match (there.is_empty(), missing.is_empty()) {
        (true, _) => "none says that it is there".into(),
        (_, true) => list(&there),
        _ => format!("{}; not there: {}", list(&there), list(&missing)),
    }
}

fn motion(robot: &Robot) -> String {
    let Some((_, state)) = &robot.state else {
        return "unknown: no state comes".into();
    };
    let trial = if state.trial == 0 {
        String::new()
    } else {
        format!(", trial {}", state.trial)
    };
    let rest = if state.at_rest { "at rest" } else { "moving" };
    match (state.motion, robot.setpoint) {
        // The arbiter knows the cause; the robot may only see that it shall not move.
        (Motion::Held(own), Some((_, setpoint))) => match setpoint.motion.reason() {
            Some(why) if why.to_string() != own.to_string() => format!("{rest}: {own} (arbiter: {why}){trial}"),
            _ => format!("{rest}: {own}{trial}"),
        },
        (Motion::Held(own), None) => format!("{rest}: {own}{trial}"),
        (Motion::Permitted { .. }, _) => format!("{rest}, permitted{trial}"),
    }
}

fn drives(robot: &Robot) -> String {
    let Some((_, setpoint)) = &robot.setpoint else {
        return "nobody: no setpoint comes".into();
    };
    let who = match setpoint.lease {
        None => "nobody holds the lease".into(),
        Some(lease) if lease.name.is_empty() => format!("operator {:016x}", lease.holder.0),
        Some(lease) => lease.name.to_string(),
    };
    let shared = if setpoint.guidance.is_some() {
        "with a forecast"
    } else {
        "without a forecast"
    };
    format!("{who}, ω {:.2} {shared}", setpoint.weight.0)
}

fn refused(who: &str, refused: Refusals) -> String {
    match refused.last {
        Some(why) => format!("{who} {} (last: {why})", refused.count),
        None => format!("{who} {}", refused.count),
    }
}

fn unreadable(robot: &Robot) -> String {
    match robot.unreadable {
        0 => String::new(),
        count => format!(", {count} unreadable here"),
    }
}

/// One robot, whole; streams that may not be heard are left out.
pub(super) fn json(name: &str, robot: &Robot, heard: &[Topic], watched: Nanos) -> Value {
    let alive: Vec<&str> = robot.alive.iter().map(|node| node.as_str()).collect();
    let streams = STREAMS.into_iter().filter(|topic| heard.contains(topic));
    let rates = streams.map(|topic| {
        let rate = robot.rate(topic, watched);
        let row = json!({ "hz": rate.hz, "missed": rate.missed, "senders": rate.senders });
        (topic.to_string(), row)
    });
    let (arbiter, own) = robot.refused();
    let dropped =
        |refused: Refusals| json!({ "count": refused.count, "last": refused.last.map(|why| why.to_string()) });
    json!({
        "robot": name, "alive": alive,
        "state": robot.state.as_ref().map(|(_, state)| state_json(state)),
        "setpoint": robot.setpoint.as_ref().map(|(_, setpoint)| json!({
            "permitted": setpoint.motion.is_permitted(),
            "reason": setpoint.motion.reason().map(|why| why.to_string()),
            "lease": setpoint.lease.map(|lease| json!({
                "number": lease.number, "holder": format!("{:016x}", lease.holder.0), "name": lease.name.to_string(),
            })),
            "weight": setpoint.weight.0, "guided": setpoint.guidance.is_some(),
        })),
        "streams": Value::Object(rates.collect()),
        "loop_ms": robot.turn().map(|turn| json!({ "p50": turn.p50_ms, "p99": turn.p99_ms, "worst": turn.worst_ms })),
        "hops": robot.budget.hops().iter().map(hop_json).collect::<Vec<_>>(),
        "hidden_hops": hidden(heard).into_iter().map(Hop::as_str).collect::<Vec<_>>(),
        "clocks": robot.clocks.iter().flat_map(|(node, report)| report.peers.iter().map(|peer| json!({
            "from": node.as_str(), "to": peer.node.as_str(), "skew_ns": peer.skew, "uncertainty_ns": peer.uncertainty,
            "round_trip_ns": peer.round_trip_median, "is_skewed": peer.is_skewed,
        }))).collect::<Vec<_>>(),
        "dropped": { "arbiter": dropped(arbiter), "robot": dropped(own), "unreadable_here": robot.unreadable },
        "recording": robot.storage.map(|storage| json!({
            "says": storage.to_string(), "dropped": storage.dropped,
        })),
    })
}

fn hop_json(hop: &HopBudget) -> Value {
    let ms = |nanos: Nanos| seconds(nanos) * 1e3;
    json!({
        "hop": hop.hop.as_str(), "p50_ms": ms(hop.recent.p50), "p95_ms": ms(hop.recent.p95),
        "p99_ms": ms(hop.recent.p99), "uncertainty_ms": ms(hop.uncertainty),
    })
}

fn state_json(state: &State) -> Value {
    json!({
        "trial": state.trial, "permitted": state.motion.is_permitted(), "at_rest": state.at_rest,
        "reason": state.motion.reason().map(|why| why.to_string()),
        "tool_m": state.tool.position.to_array(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hops_that_a_member_cannot_measure_are_named() {
        let operator = [Topic::State, Topic::Setpoint, Topic::Storage];
        let said = text("panda", &Robot::default(), &operator, 1);
        assert!(said.contains("device → command, operator → arbiter"), "{said}");
        assert!(said.contains("robot → operator"), "{said}");
        assert!(!said.contains("arbiter decides"), "{said}");
        let all = super::super::TOPICS;
        assert!(!text("panda", &Robot::default(), &all, 1).contains("hidden"));
        assert!(hidden(&all).is_empty());
    }
}
