//! Where two messages differ, field by field, for people to read.
//!
//! A message's debug print, laid out over lines, names every field with its value, and prints each number so that it
//! reads back the same. Its lines become paths (`body.velocity.x`), so no message needs a second description of itself.

use std::collections::BTreeMap;
use std::fmt::Debug;

use tandem_wire::{
    Claim, ClockReport, Command, Emergency, Envelope, Forecast, Message, NodeInfo, Pong, Proposal, Scene, Setpoint,
    State, Storage, Topic, Trial, decode,
};

/// Two numbers count as equal when they differ by no more than this, or by this share of the larger one.
///
/// A nanometre, a nanometre per second, a nanoradian: far below what any limit or decision distinguishes, and a
/// thousand times what a different order of additions does to numbers of this size.
pub const EPSILON: f64 = 1e-9;

/// A field with its two values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldDifference {
    /// Where, as in `weight` or `header.tick`.
    pub path: String,
    /// What was recorded.
    pub recorded: String,
    /// What came out when executed again.
    pub again: String,
}

/// How two messages of one topic relate.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Comparison {
    /// No number is further than [`EPSILON`] from the other, and all else is the same.
    Close { largest: f64, path: String },
    /// These fields differ.
    Differ(Vec<FieldDifference>),
    /// At least one of them cannot be read.
    Opaque,
}

/// Compares two messages that are not the same bytes.
pub(crate) fn compare(topic: Topic, recorded: &[u8], again: &[u8]) -> Comparison {
    match (print(topic, recorded), print(topic, again)) {
        (Some(recorded), Some(again)) => compare_fields(&flatten(&recorded), &flatten(&again)),
        _ => Comparison::Opaque,
    }
}

fn print(topic: Topic, bytes: &[u8]) -> Option<String> {
    fn of<M: Message>(bytes: &[u8]) -> Option<String>
    where
        Envelope<M>: Debug,
    {
        decode::<M>(bytes).ok().map(|message| format!("{message:#?}"))
    }
    match topic {
        Topic::Command => of::<Command>(bytes),
        Topic::Proposal => of::<Proposal>(bytes),
        Topic::Forecast => of::<Forecast>(bytes),
        Topic::Setpoint => of::<Setpoint>(bytes),
        Topic::State => of::<State>(bytes),
        Topic::Scene => of::<Scene>(bytes),
        Topic::Trial => of::<Trial>(bytes),
        Topic::Lease | Topic::TakeOver => of::<Claim>(bytes),
        Topic::Emergency | Topic::AllClear => of::<Emergency>(bytes),
        Topic::Info(_) => of::<NodeInfo>(bytes),
        Topic::Storage => of::<Storage>(bytes),
        Topic::Clock(_) => of::<ClockReport>(bytes),
        Topic::Ping(_) => of::<Pong>(bytes),
        Topic::Journal(_) | Topic::Alive(_) | Topic::Device => None,
    }
}

fn compare_fields(recorded: &[(String, String)], again: &[(String, String)]) -> Comparison {
    let found: BTreeMap<&str, &str> = pairs(again).collect();
    let known: BTreeMap<&str, &str> = pairs(recorded).collect();
    let (mut largest, mut at) = (0.0, "");
    let mut differences: Vec<FieldDifference> = Vec::new();
    for (path, value) in pairs(recorded) {
        let other = found.get(path).copied();
        match other.and_then(|other| distance(value, other)) {
            Some((off, true)) if off >= largest && other != Some(value) => (largest, at) = (off, path),
            Some((_, true)) => {}
            _ => note(&mut differences, path, value, other.unwrap_or(NOTHING)),
        }
    }
    for (path, value) in pairs(again).filter(|(path, _)| !known.contains_key(path)) {
        note(&mut differences, path, NOTHING, value);
    }
    if differences.is_empty() {
        let path = at.to_owned();
        Comparison::Close { largest, path }
    } else {
        Comparison::Differ(differences)
    }
}

/// What stands for a field that one of the two does not have.
const NOTHING: &str = "nothing";

fn pairs(fields: &[(String, String)]) -> impl Iterator<Item = (&str, &str)> {
    fields.iter().map(|(path, value)| (path.as_str(), value.as_str()))
}

/// Adds a difference, unless it follows from one that is there: what is inside of a field that one of the two lacks.
fn note(differences: &mut Vec<FieldDifference>, path: &str, recorded: &str, again: &str) {
    let inside = |outer: &FieldDifference| path.starts_with(&format!("{}.", outer.path));
    if (recorded == NOTHING || again == NOTHING) && differences.iter().any(inside) {
        return;
    }
    differences.push(FieldDifference {
        path: path.to_owned(),
        recorded: recorded.to_owned(),
        again: again.to_owned(),
    });
}

/// How far apart two values are, and whether that is close enough. Only numbers with a fraction can be close.
fn distance(one: &str, other: &str) -> Option<(f64, bool)> {
    if one == other {
        return Some((0.0, true));
    }
    let number = |text: &str| text.contains(['.', 'e']).then(|| text.parse::<f64>().ok()).flatten();
    let (one, other) = (number(one)?, number(other)?);
    let off = (one - other).abs();
    Some((off, off <= EPSILON * one.abs().max(other.abs()).max(1.0)))
}

/// An opened bracket of a debug print.
struct Frame {
    path: String,
    kind: Kind,
    /// How many of its children came by.
    children: usize,
}

enum Kind {
    Struct,
    List,
    /// A tuple is transparent: the path of its first child is its own, its name stands around the child's value.
    Tuple(String),
}

/// Path and value of every line of a pretty debug print.
fn flatten(text: &str) -> Vec<(String, String)> {
    let mut fields = Vec::new();
    let mut frames: Vec<Frame> = Vec::new();
    for line in text.lines().map(str::trim) {
        let line = line.strip_suffix(',').unwrap_or(line);
        if matches!(line, "}" | ")" | "]") {
            frames.pop();
            continue;
        }
        let (path, value) = place(frames.last_mut(), line);
        match opened(value) {
            Some((name, kind)) => {
                if matches!(kind, Kind::Struct) && !path.is_empty() {
                    fields.push((path.clone(), wrapped(frames.last(), name)));
                }
                frames.push(Frame {
                    path,
                    kind,
                    children: 0,
                });
            }
            None => fields.push((path, wrapped(frames.last(), value))),
        }
    }
    fields
}

/// Where a line stands, and what it says there.
fn place<'a>(frame: Option<&mut Frame>, line: &'a str) -> (String, &'a str) {
    let Some(frame) = frame else {
        return (String::new(), line);
    };
    let child = frame.children;
    frame.children += 1;
    match &frame.kind {
        Kind::Struct => {
            let (name, value) = line.split_once(": ").unwrap_or((line, ""));
            // The body is what people talk about.
            let path = match frame.path.as_str() {
                "" | "body" => name.to_owned(),
                path => format!("{path}.{name}"),
            };
            (path, value)
        }
        Kind::List => (format!("{}.{child}", frame.path), line),
        Kind::Tuple(_) if child == 0 => (frame.path.clone(), line),
        Kind::Tuple(_) => (format!("{}.{child}", frame.path), line),
    }
}

fn opened(value: &str) -> Option<(&str, Kind)> {
    if value.starts_with('"') {
        return None;
    }
    if let Some(name) = value.strip_suffix('{') {
        return Some((name.trim_end(), Kind::Struct));
    }
    if let Some(name) = value.strip_suffix('(') {
        return Some((name, Kind::Tuple(name.to_owned())));
    }
    value.strip_suffix('[').map(|name| (name, Kind::List))
}

/// A value within its tuple's name, but for numbers, whose wrapper says nothing.
fn wrapped(frame: Option<&Frame>, value: &str) -> String {
    match frame.map(|frame| &frame.kind) {
        Some(Kind::Tuple(name)) if !name.is_empty() && value.parse::<f64>().is_err() => format!("{name}({value})"),
        _ => value.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::{Finite, Guidance, Header, Vec3, encode};

    fn bytes(change: impl FnOnce(&mut Envelope<Proposal>)) -> Vec<u8> {
        let guidance = Guidance {
            velocity: Vec3::new(0.1, 0.2, 0.3),
            ..Guidance::default()
        };
        let mut message = Envelope {
            header: Header::default(),
            body: Proposal {
                seen: None,
                guidance: Some(guidance),
            },
        };
        change(&mut message);
        let mut bytes = Vec::new();
        encode(&message, &mut bytes);
        bytes
    }

    fn differing(change: impl FnOnce(&mut Envelope<Proposal>)) -> Vec<(String, String, String)> {
        match compare(Topic::Proposal, &bytes(|_| {}), &bytes(change)) {
            Comparison::Differ(differences) => differences
                .into_iter()
                .map(|field| (field.path, field.recorded, field.again))
                .collect(),
            other => panic!("{other:?}"),
        }
    }

    fn one(path: &str, recorded: &str, again: &str) -> Vec<(String, String, String)> {
        vec![(path.into(), recorded.into(), again.into())]
    }

    #[test]
    fn a_field_deep_inside_is_named_with_both_values() {
        let change = |message: &mut Envelope<Proposal>| {
            message.body.guidance.as_mut().unwrap().velocity.y = 0.25;
        };
        assert_eq!(differing(change), one("guidance.velocity.y", "0.2", "0.25"));
        assert_eq!(
            differing(|message| message.header.tick = 7),
            one("header.tick", "0", "7")
        );
    }

    #[test]
    fn what_one_of_the_two_lacks_is_named_once() {
        assert_eq!(
            differing(|message| message.body.guidance = None),
            one("guidance", "Some(Guidance)", "None")
        );
    }

    #[test]
    fn numbers_a_hair_apart_are_close_and_counters_never_are() {
        let off = |by: f64| {
            let again = bytes(|message| message.body.guidance.as_mut().unwrap().phase = Finite(by));
            compare(Topic::Proposal, &bytes(|_| {}), &again)
        };
        let Comparison::Close { largest, path } = off(1e-10) else {
            panic!("{:?}", off(1e-10));
        };
        assert_eq!((largest, path.as_str()), (1e-10, "guidance.phase"));
        assert!(matches!(off(1e-8), Comparison::Differ(_)));
        assert_eq!(
            differing(|message| message.body.guidance.as_mut().unwrap().forecast = 1),
            one("guidance.forecast", "0", "1")
        );
    }

    #[test]
    fn bytes_that_are_no_message_are_opaque() {
        assert_eq!(
            compare(Topic::Proposal, &bytes(|_| {}), b"nonsense"),
            Comparison::Opaque
        );
    }
}
