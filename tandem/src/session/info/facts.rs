//! What a session file says, put together for whoever prints it.

use std::collections::BTreeMap;

use tandem_recorder::{ClockOffset, Level, NodeRecord, Noted, Recording};
use tandem_wire::{Pace, Topic, Trial, decode, keys, seconds};

use super::arrivals::ArrivalsRead;
use super::latency::{self, HopRead, OffsetRead};
use crate::session::timing;

pub(super) struct Facts {
    pub(super) duration_s: f64,
    pub(super) build: String,
    pub(super) seed: String,
    pub(super) model: Option<String>,
    pub(super) trials: Vec<TrialRead>,
    pub(super) stops: Vec<Stop>,
    /// When motion was held in the course of things: the deadman was released, no trial ran.
    pub(super) holds: Vec<Stop>,
    /// Who was given the lease when.
    pub(super) leases: Vec<Event>,
    /// Emergency stops and their ends.
    pub(super) emergencies: Vec<Event>,
    /// What the recorder said of its own file and views.
    pub(super) trouble: Vec<String>,
    /// Nothing in lockstep, where stamps are no times.
    pub(super) clocks: Vec<ClockOffset>,
    /// The clocks as measured both ways.
    pub(super) offsets: Vec<OffsetRead>,
    /// At a robot that expects a setpoint every millisecond.
    pub(super) setpoints: Option<ArrivalsRead>,
    /// Where the time went.
    pub(super) hops: Vec<HopRead>,
    /// Whether the counts were written at the end.
    pub(super) is_closed: bool,
    /// Messages dropped before the file, as its last counts say.
    pub(super) dropped: Option<u64>,
    dropped_by_channel: BTreeMap<String, u64>,
}

pub(super) struct TrialRead {
    pub(super) number: u32,
    pub(super) label: String,
    pub(super) begin_s: f64,
    pub(super) end_s: Option<f64>,
    pub(super) outcome: String,
}

pub(super) struct Stop {
    pub(super) at_s: f64,
    pub(super) by: String,
    pub(super) reason: String,
}

/// Something that people did.
pub(super) struct Event {
    pub(super) at_s: f64,
    pub(super) what: String,
}

/// What stands before a channel in the names of the closing counts.
const DROPPED: &str = "dropped.session_file";

impl Facts {
    pub(super) fn of(recording: &Recording) -> Self {
        let of_nodes = |what: fn(&NodeRecord) -> &str| {
            let said = recording.nodes.values().next().map(what);
            said.unwrap_or("unknown").to_owned()
        };
        let is_paced = timing(recording).pace == Pace::Real;
        let (stops, holds) = stops(recording);
        Self {
            duration_s: duration_s(recording),
            build: of_nodes(|node| &node.build),
            seed: of_nodes(|node| &node.seed),
            model: recording.nodes.values().find_map(|node| node.model_sha256.clone()),
            trials: trials(recording),
            stops,
            holds,
            leases: events(recording, "arbiter", "the lease"),
            emergencies: events(recording, "operator", "emergency stop"),
            trouble: trouble(recording),
            clocks: recording.counts.clocks.iter().filter(|_| is_paced).copied().collect(),
            offsets: latency::offsets(&recording.closing),
            setpoints: ArrivalsRead::of(recording),
            hops: latency::hops(&recording.closing),
            is_closed: recording.closing.get("closed").is_some_and(|closed| closed == "true"),
            dropped: recording.closing.get(DROPPED).and_then(|number| number.parse().ok()),
            dropped_by_channel: dropped_by_channel(recording),
        }
    }

    /// What was dropped of a channel, if the file says what was dropped at all.
    pub(super) fn dropped_on(&self, key: &str) -> Option<u64> {
        self.dropped?;
        let (_, topic) = keys::parse(key)?;
        Some(self.dropped_by_channel.get(&topic.suffix()).copied().unwrap_or(0))
    }
}

fn dropped_by_channel(recording: &Recording) -> BTreeMap<String, u64> {
    let named = recording.closing.iter().filter_map(|(name, number)| {
        let channel = name.strip_prefix(DROPPED)?.strip_prefix('.')?;
        Some((channel.to_owned(), number.parse().ok()?))
    });
    named.collect()
}

/// The trials by their marks; a beginning is repeated while the trial runs.
fn trials(recording: &Recording) -> Vec<TrialRead> {
    let start = start_s(recording);
    let mut trials: Vec<TrialRead> = Vec::new();
    for message in recording
        .messages
        .iter()
        .filter(|message| message.topic == Topic::Trial)
    {
        let Ok(mark) = decode::<Trial>(&message.bytes) else {
            continue;
        };
        let at = message.at.seconds() - start;
        match mark.body {
            Trial::Begin { number, label } => {
                let is_known = |last: &TrialRead| last.number == number && last.end_s.is_none();
                if !trials.last().is_some_and(is_known) {
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

/// Stops with their reasons, and contact, which is worse; what merely held motion in the course of things is told apart,
/// as the recorder told it.
fn stops(recording: &Recording) -> (Vec<Stop>, Vec<Stop>) {
    let start = start_s(recording);
    // Who pressed an emergency stop is told apart from the nodes that obeyed it.
    let is_contact = |note: &Noted| note.level == Level::Error && note.about == "robot-sim";
    let is_stop = |note: &&Noted| note.text.starts_with("stop: ") || is_contact(note);
    let stop = |note: &Noted| Stop {
        at_s: note.at.seconds() - start,
        by: note.about.clone(),
        reason: note.text.strip_prefix("stop: ").unwrap_or(&note.text).to_owned(),
    };
    let (held, stopped): (Vec<_>, Vec<_>) = recording
        .notes
        .iter()
        .filter(is_stop)
        .partition(|note| note.level == Level::Info);
    let all = |notes: Vec<&Noted>| notes.into_iter().map(stop).collect();
    (all(stopped), all(held))
}

/// The notes about a node that speak of this.
fn events(recording: &Recording, about: &str, of: &str) -> Vec<Event> {
    let start = start_s(recording);
    let is_meant = |note: &&Noted| note.about == about && note.text.contains(of) && !note.text.starts_with("stop: ");
    let event = |note: &Noted| Event {
        at_s: note.at.seconds() - start,
        what: note.text.clone(),
    };
    recording.notes.iter().filter(is_meant).map(event).collect()
}

fn is_own(note: &Noted) -> bool {
    note.about == "recorder"
}

/// What the recorder said about its file and views; that single messages were missed stands in the counts.
fn trouble(recording: &Recording) -> Vec<String> {
    let start = start_s(recording);
    let is_trouble = |note: &&Noted| is_own(note) && !note.text.ends_with("missed") && note.text != "appeared";
    let line = |note: &Noted| format!("{:.1} s: {}", note.at.seconds() - start, note.text);
    recording.notes.iter().filter(is_trouble).map(line).collect()
}

/// What never came of a channel.
pub(super) fn missed(recording: &Recording, key: &str) -> Option<u64> {
    let (_, topic) = keys::parse(key)?;
    if let Topic::Journal(node) = topic {
        let count = recording.counts.journals.iter().find(|count| count.node == node)?;
        return Some(count.lost.saturating_add(count.missed));
    }
    let count = recording.counts.streams.iter().find(|count| count.topic == topic)?;
    Some(count.missed)
}

#[cfg(test)]
mod tests {
    use tandem_wire::Stamp;

    use super::*;

    #[test]
    fn letting_go_of_the_deadman_is_no_stop() {
        let note = |level, text: &str| Noted {
            at: Stamp(0),
            level,
            about: "arbiter".into(),
            text: text.into(),
        };
        let recording = Recording {
            notes: vec![
                note(Level::Info, "stop: the deadman is released"),
                note(Level::Warning, "stop: the operator's commands stopped 300 ms ago"),
                note(Level::Error, "stop: emergency stop"),
                note(Level::Info, "motion is permitted by press 1"),
            ],
            ..Recording::default()
        };
        let (stops, holds) = stops(&recording);
        let reasons = |stops: Vec<Stop>| stops.into_iter().map(|stop| stop.reason).collect::<Vec<_>>();
        assert_eq!(
            reasons(stops),
            ["the operator's commands stopped 300 ms ago", "emergency stop"]
        );
        assert_eq!(reasons(holds), ["the deadman is released"]);
    }
}
