//! What a person wants to know of a session file.

use serde_json::{Value, json};
use tandem_recorder::{Level, Noted, Recording};
use tandem_wire::{Trial, decode, seconds};

use crate::table;

pub(super) fn print(recording: &Recording, as_json: bool) -> anyhow::Result<()> {
    if as_json {
        println!("{}", serde_json::to_string(&json(recording))?);
    } else {
        println!("{}", text(recording));
    }
    Ok(())
}

struct TrialRead {
    number: u32,
    label: String,
    begin_s: f64,
    end_s: Option<f64>,
    outcome: String,
}

/// The trials by their marks; a beginning is repeated while the trial runs.
fn trials(recording: &Recording) -> Vec<TrialRead> {
    let start = start_s(recording);
    let mut trials: Vec<TrialRead> = Vec::new();
    for message in &recording.messages {
        let Ok(mark) = decode::<Trial>(&message.bytes) else {
            continue;
        };
        let at = message.at.seconds() - start;
        match mark.body {
            Trial::Begin { number, label } => {
                if trials
                    .last()
                    .is_none_or(|last| last.number != number || last.end_s.is_some())
                {
                    trials.push(TrialRead {
                        number,
                        label,
                        begin_s: at,
                        end_s: None,
                        outcome: "not ended in this file".to_owned(),
                    });
                }
            }
            Trial::End { number, outcome } => {
                if let Some(trial) = trials.last_mut().filter(|trial| trial.number == number) {
                    trial.end_s = Some(at);
                    trial.outcome = outcome;
                }
            }
        }
    }
    trials
}

fn start_s(recording: &Recording) -> f64 {
    recording.messages.first().map_or(0.0, |first| first.at.seconds())
}

/// From the first to the last message of any channel.
fn duration_s(recording: &Recording) -> f64 {
    let used = || recording.channels.iter().filter(|channel| channel.messages > 0);
    let first = used().map(|channel| channel.first).min().unwrap_or(0);
    let last = used().map(|channel| channel.last).max().unwrap_or(0);
    seconds(last.saturating_sub(first))
}

fn stops(recording: &Recording) -> impl Iterator<Item = &Noted> {
    recording
        .notes
        .iter()
        .filter(|note| note.text.starts_with("stop: ") || note.level == Level::Error)
}

/// The first of what the nodes say of themselves; they are built alike.
fn of_nodes<'a>(
    recording: &'a Recording,
    what: impl Fn(&'a tandem_recorder::NodeRecord) -> Option<&'a str>,
) -> &'a str {
    recording.nodes.values().find_map(what).unwrap_or("unknown")
}

/// Messages dropped before the file, as its closing record says; unknown if it was not closed.
fn dropped(recording: &Recording) -> Option<u64> {
    recording.closing.get("dropped.session_file")?.parse().ok()
}

fn json(recording: &Recording) -> Value {
    let start = start_s(recording);
    let channels = recording
        .channels
        .iter()
        .map(|channel| json!({"topic": channel.topic, "messages": channel.messages, "rate_hz": channel.rate_hz()}));
    let streams = recording.counts.streams.iter().map(|count| {
        json!({"topic": count.topic.suffix(), "received": count.received, "missed": count.missed,
            "late": count.late, "repeated": count.repeated})
    });
    let journals = recording.counts.journals.iter().map(
        |count| json!({"node": count.node.as_str(), "entries": count.entries, "missing": count.lost + count.missed}),
    );
    let trials = trials(recording).into_iter().map(|trial| {
        json!({"number": trial.number, "label": trial.label, "begin_s": trial.begin_s, "end_s": trial.end_s,
            "outcome": trial.outcome})
    });
    let stops = stops(recording)
        .map(|note| json!({"at_s": note.at.seconds() - start, "by": note.about, "reason": reason(note)}));
    json!({
        "robot": recording.robot.as_ref().map(tandem_wire::RobotName::as_str),
        "duration_s": duration_s(recording),
        "began_unix_ns": recording.epoch_unix_nanos,
        "build": of_nodes(recording, |node| Some(&node.build)),
        "seed": of_nodes(recording, |node| Some(&node.seed)),
        "model_sha256": recording.nodes.values().find_map(|node| node.model_sha256.as_deref()),
        "trials": trials.collect::<Vec<_>>(),
        "channels": channels.collect::<Vec<_>>(),
        "streams": streams.collect::<Vec<_>>(),
        "journals": journals.collect::<Vec<_>>(),
        "dropped_before_file": dropped(recording),
        "stops": stops.collect::<Vec<_>>(),
        "damage": recording.damage.iter().map(ToString::to_string).collect::<Vec<_>>(),
    })
}

fn reason(note: &Noted) -> &str {
    note.text.strip_prefix("stop: ").unwrap_or(&note.text)
}

fn text(recording: &Recording) -> String {
    let model = of_nodes(recording, |node| node.model_sha256.as_deref());
    let dropped = dropped(recording).map_or_else(|| "unknown: the file was not closed".to_owned(), |n| n.to_string());
    let mut rows = vec![
        (
            "robot",
            recording
                .robot
                .as_ref()
                .map_or_else(|| "unknown".to_owned(), ToString::to_string),
        ),
        ("duration", format!("{:.1} s", duration_s(recording))),
        ("build", of_nodes(recording, |node| Some(&node.build)).to_owned()),
        ("seed", of_nodes(recording, |node| Some(&node.seed)).to_owned()),
        ("model", model.to_owned()),
        ("dropped before the file", dropped),
    ];
    for trial in trials(recording) {
        let end = trial.end_s.map_or_else(|| "…".to_owned(), |end| format!("{end:.1} s"));
        let TrialRead {
            number,
            label,
            begin_s,
            outcome,
            ..
        } = trial;
        rows.push((
            "trial",
            format!("{number} {label:?}, {begin_s:.1} s to {end}: {outcome}"),
        ));
    }
    let start = start_s(recording);
    for note in stops(recording) {
        rows.push((
            "stop",
            format!("{:.1} s, {}: {}", note.at.seconds() - start, note.about, reason(note)),
        ));
    }
    rows.extend(recording.damage.iter().map(|damage| ("damage", damage.to_string())));
    format!("{}\n\n{}", table::rows(&rows), channels(recording))
}

/// Every channel with its rate and what is missing from it.
fn channels(recording: &Recording) -> String {
    let width = recording
        .channels
        .iter()
        .map(|channel| channel.topic.len())
        .max()
        .unwrap_or(0);
    let mut lines = vec![format!(
        "  {:width$}  {:>8}  {:>8}  {:>6}",
        "channel", "messages", "per s", "missed"
    )];
    for channel in &recording.channels {
        let rate = channel
            .rate_hz()
            .map_or_else(|| "-".to_owned(), |rate| format!("{rate:.1}"));
        let missed = missed(recording, &channel.topic).map_or_else(|| "-".to_owned(), |missed| missed.to_string());
        lines.push(format!(
            "  {:width$}  {:>8}  {rate:>8}  {missed:>6}",
            channel.topic, channel.messages
        ));
    }
    lines.join("\n")
}

fn missed(recording: &Recording, key: &str) -> Option<u64> {
    let (_, topic) = tandem_wire::keys::parse(key)?;
    if let tandem_wire::Topic::Journal(node) = topic {
        let count = recording.counts.journals.iter().find(|count| count.node == node)?;
        return Some(count.lost.saturating_add(count.missed));
    }
    let count = recording.counts.streams.iter().find(|count| count.topic == topic)?;
    Some(count.missed)
}
