//! What a person wants to know of a session file.

mod arrivals;
mod facts;
mod latency;

use serde_json::{Value, json};
use tandem_recorder::{Gap, Recording};
use tandem_wire::Topic;

use super::verdict::Known;
use crate::table;
use arrivals::ArrivalsRead;
use facts::{Event, Facts, Stop};
use latency::{HopRead, OffsetRead};

pub(super) fn print(recording: &Recording, verdict: &Known, as_json: bool) -> anyhow::Result<()> {
    let facts = Facts::of(recording);
    if as_json {
        println!("{}", serde_json::to_string(&json(recording, &facts, verdict))?);
    } else {
        println!("{}", text(recording, &facts, verdict));
    }
    Ok(())
}

fn json(recording: &Recording, facts: &Facts, verdict: &Known) -> Value {
    let channels = recording.channels.iter().map(|channel| {
        json!({"topic": channel.topic, "messages": channel.messages, "rate_hz": channel.rate_hz(),
            "missed": facts::missed(recording, &channel.topic), "dropped": facts.dropped_on(&channel.topic)})
    });
    let streams = recording.counts.streams.iter().map(|count| {
        json!({"topic": count.topic.suffix(), "received": count.received, "missed": count.missed,
            "late": count.late, "repeated": count.repeated})
    });
    let journals = recording.counts.journals.iter().map(
        |count| json!({"node": count.node.as_str(), "entries": count.entries, "missing": count.lost + count.missed}),
    );
    let gaps = recording.counts.gaps.iter().map(|gap| {
        json!({"topic": gap.topic.suffix(), "session": format!("{:016x}", gap.session.0),
            "first": gap.first, "last": gap.last})
    });
    let clocks = facts.clocks.iter().map(|clock| {
        json!({"node": clock.node.as_str(), "session": format!("{:016x}", clock.session.0),
            "least_one_way_ns": clock.least, "mean_one_way_ns": clock.mean, "most_one_way_ns": clock.most,
            "messages": clock.messages})
    });
    let trials = facts.trials.iter().map(|trial| {
        json!({"number": trial.number, "label": trial.label, "begin_s": trial.begin_s, "end_s": trial.end_s,
            "outcome": trial.outcome})
    });
    let stops = |stops: &[Stop]| -> Value {
        let stop = |stop: &Stop| json!({"at_s": stop.at_s, "by": stop.by, "reason": stop.reason});
        stops.iter().map(stop).collect()
    };
    json!({
        "robot": recording.robot.as_ref().map(tandem_wire::RobotName::as_str),
        "duration_s": facts.duration_s,
        "began_unix_ns": recording.epoch_unix_nanos,
        "build": facts.build,
        "seed": facts.seed,
        "model_sha256": facts.model,
        "verdict": match verdict {
            Known::Noted { verdict, .. } => Some(verdict.as_str()),
            Known::Outdated => Some("outdated"),
            Known::None => None,
        },
        "trials": trials.collect::<Vec<_>>(),
        "channels": channels.collect::<Vec<_>>(),
        "streams": streams.collect::<Vec<_>>(),
        "journals": journals.collect::<Vec<_>>(),
        "gaps": gaps.collect::<Vec<_>>(),
        "gaps_forgotten": recording.counts.gaps_forgotten,
        "clocks": clocks.collect::<Vec<_>>(),
        "offsets": facts.offsets.iter().map(OffsetRead::json).collect::<Vec<_>>(),
        "setpoints": facts.setpoints.as_ref().map(ArrivalsRead::json),
        "latency": facts.hops.iter().map(HopRead::json).collect::<Vec<_>>(),
        "closed": facts.is_closed,
        "dropped_before_file": facts.dropped,
        "stops": stops(&facts.stops),
        "holds": stops(&facts.holds),
        "leases": events(&facts.leases),
        "emergency_stops": events(&facts.emergencies),
        "trouble": facts.trouble,
        "damage": recording.damage.iter().map(ToString::to_string).collect::<Vec<_>>(),
    })
}

fn text(recording: &Recording, facts: &Facts, verdict: &Known) -> String {
    let robot = recording.robot.as_ref();
    let mut rows = vec![
        ("robot", robot.map_or_else(|| "unknown".to_owned(), ToString::to_string)),
        ("duration", format!("{:.1} s", facts.duration_s)),
        ("build", facts.build.clone()),
        ("seed", facts.seed.clone()),
        ("model", facts.model.clone().unwrap_or_else(|| "none".to_owned())),
        ("verdict", verdict_words(verdict)),
        ("dropped before the file", dropped_words(facts)),
    ];
    for trial in &facts.trials {
        let end = trial.end_s.map_or_else(|| "…".to_owned(), |end| format!("{end:.1} s"));
        let (number, label, begin_s) = (trial.number, &trial.label, trial.begin_s);
        rows.push((
            "trial",
            format!("{number} {label:?}, {begin_s:.1} s to {end}: {}", trial.outcome),
        ));
    }
    rows.extend(facts.leases.iter().map(|event| ("lease", event_row(event))));
    rows.extend(
        facts
            .emergencies
            .iter()
            .map(|event| ("emergency stop", event_row(event))),
    );
    rows.extend(stop_rows(&facts.stops).into_iter().map(|row| ("stops", row)));
    rows.extend(stop_rows(&facts.holds).into_iter().map(|row| ("held", row)));
    rows.extend(gap_rows(recording).into_iter().map(|row| ("missing", row)));
    rows.extend(facts.setpoints.iter().map(|read| ("setpoints", read.row())));
    rows.extend(facts.hops.iter().map(|hop| ("latency", hop.row())));
    rows.extend(clock_rows(facts).into_iter().map(|row| ("clock", row)));
    rows.extend(facts.trouble.iter().map(|trouble| ("recorder", trouble.clone())));
    rows.extend(recording.damage.iter().map(|damage| ("damage", damage.to_string())));
    format!("{}\n\n{}", table::rows(&rows), channels(recording, facts))
}

fn events(events: &[Event]) -> Value {
    events
        .iter()
        .map(|event| json!({"at_s": event.at_s, "what": event.what}))
        .collect()
}

fn event_row(event: &Event) -> String {
    format!("{:.1} s: {}", event.at_s, event.what)
}

fn verdict_words(verdict: &Known) -> String {
    match verdict {
        Known::Noted { verdict, by } => format!("{verdict}, executed again by {by}"),
        Known::Outdated => "outdated: the file has changed since it was noted".to_owned(),
        Known::None => "not known: tandem replay --verify --note".to_owned(),
    }
}

fn dropped_words(facts: &Facts) -> String {
    match (facts.dropped, facts.is_closed) {
        (Some(number), true) => number.to_string(),
        (Some(number), false) => format!("{number} when that was last written; the file was not closed"),
        (None, _) => "unknown: the file was not closed".to_owned(),
    }
}

/// So many times are named for each reason; the rest is counted.
const TIMES: usize = 5;

/// One line for each reason, the most frequent first.
fn stop_rows(stops: &[Stop]) -> Vec<String> {
    let mut reasons: Vec<(&str, &str, Vec<f64>)> = Vec::new();
    for stop in stops {
        match reasons
            .iter_mut()
            .find(|(by, reason, _)| (*by, *reason) == (&stop.by, &stop.reason))
        {
            Some((.., times)) => times.push(stop.at_s),
            None => reasons.push((&stop.by, &stop.reason, vec![stop.at_s])),
        }
    }
    reasons.sort_by_key(|(.., times)| std::cmp::Reverse(times.len()));
    let row = |(by, reason, times): (&str, &str, Vec<f64>)| {
        let named: Vec<String> = times.iter().take(TIMES).map(|at| format!("{at:.1}")).collect();
        let more = if times.len() > TIMES { ", …" } else { "" };
        format!("{} × {by}: {reason} (at {}{more} s)", times.len(), named.join(", "))
    };
    reasons.into_iter().map(row).collect()
}

/// So many gaps of a channel are spelled out.
const GAPS: usize = 4;

/// One line for each channel of which something never came.
fn gap_rows(recording: &Recording) -> Vec<String> {
    let gaps = &recording.counts.gaps;
    let mut topics: Vec<Topic> = gaps.iter().map(|gap| gap.topic).collect();
    topics.dedup();
    let mut rows: Vec<String> = topics.into_iter().map(|topic| gap_row(gaps, topic)).collect();
    if recording.counts.gaps_forgotten > 0 {
        rows.push(format!("{} more gaps", recording.counts.gaps_forgotten));
    }
    rows
}

fn gap_row(gaps: &[Gap], topic: Topic) -> String {
    let of_topic: Vec<&Gap> = gaps.iter().filter(|gap| gap.topic == topic).collect();
    let numbers = of_topic.iter().take(GAPS).map(|gap| match gap.last - gap.first {
        0 => gap.first.to_string(),
        _ => format!("{} to {}", gap.first, gap.last),
    });
    let numbers: Vec<String> = numbers.collect();
    let what = match topic {
        Topic::Journal(_) => "entries",
        _ => "numbers",
    };
    let more = match of_topic.len().saturating_sub(GAPS) {
        0 => String::new(),
        more => format!(" and {more} more gaps"),
    };
    format!("{topic}: {what} {}{more}", numbers.join(", "))
}

fn clock_rows(facts: &Facts) -> Vec<String> {
    let ms = |nanos: i64| nanos as f64 * 1e-6;
    let row = |clock: &tandem_recorder::ClockOffset| {
        format!(
            "{} at most {:.3} ms behind the recorder's (one way, {} messages, up to {:.3} ms later)",
            clock.node,
            ms(clock.least),
            clock.messages,
            ms(clock.most.saturating_sub(clock.least)),
        )
    };
    // The recorder's own measurements; a bound from one way stands in where there is none.
    let measured: Vec<&OffsetRead> = facts
        .offsets
        .iter()
        .filter(|offset| offset.observer == "recorder")
        .collect();
    let is_measured = |node: &str| measured.iter().any(|offset| offset.node == node);
    let bounds = facts.clocks.iter().filter(|clock| !is_measured(clock.node.as_str()));
    measured
        .iter()
        .map(|offset| offset.row())
        .chain(bounds.map(row))
        .collect()
}

/// Every channel with its rate and what is missing from it.
fn channels(recording: &Recording, facts: &Facts) -> String {
    let lengths = recording.channels.iter().map(|channel| channel.topic.len());
    let width = lengths.max().unwrap_or(0);
    let number = |number: Option<u64>| number.map_or_else(|| "-".to_owned(), |number| number.to_string());
    let mut lines = vec![format!(
        "  {:width$}  {:>8}  {:>8}  {:>6}  {:>7}",
        "channel", "messages", "per s", "missed", "dropped"
    )];
    for channel in &recording.channels {
        let rate = channel
            .rate_hz()
            .map_or_else(|| "-".to_owned(), |rate| format!("{rate:.1}"));
        lines.push(format!(
            "  {:width$}  {:>8}  {rate:>8}  {:>6}  {:>7}",
            channel.topic,
            channel.messages,
            number(facts::missed(recording, &channel.topic)),
            number(facts.dropped_on(&channel.topic)),
        ));
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stops_are_counted_by_reason_and_the_most_frequent_comes_first() {
        let stop = |at_s, reason: &str| Stop {
            at_s,
            by: "arbiter".into(),
            reason: reason.into(),
        };
        let stops = [stop(1.0, "a"), stop(2.0, "b"), stop(3.0, "b")];
        assert_eq!(
            stop_rows(&stops),
            ["2 × arbiter: b (at 2.0, 3.0 s)", "1 × arbiter: a (at 1.0 s)"]
        );
    }
}
