//! The arbiter's edge: inputs become events, setpoints become bytes.

use tandem_wire::{Claim, Emergency, Input, NodeName, Ports, Topic, Turn, Unreadable, decode, encode};

use crate::node::{Arbiter, Event, Output};

impl Ports for Arbiter {
    const NAME: NodeName = NodeName::Arbiter;
    const TURN: Turn = Turn::OnArrival;
    const INPUTS: &'static [Topic] = &[
        Topic::Command,
        Topic::Proposal,
        Topic::State,
        Topic::Lease,
        Topic::TakeOver,
        Topic::Emergency,
        Topic::AllClear,
    ];
    const OUTPUTS: &'static [Topic] = &[Topic::Setpoint];

    fn event(input: Input<'_>) -> Event {
        match input {
            Input::Sample { topic, bytes } => read(topic, bytes),
            Input::Wake => Event::Wake,
            Input::Presence { .. } => Event::Presence,
            Input::Stop => Event::Stop,
            Input::Missed { topic, tick } => Event::Missed { topic, tick },
        }
    }

    fn sample(output: &Output, bytes: &mut Vec<u8>) -> Option<Topic> {
        let Output::Setpoint(setpoint) = output;
        encode(setpoint, bytes);
        Some(Topic::Setpoint)
    }
}

fn read(topic: Topic, bytes: &[u8]) -> Event {
    let event = match topic {
        Topic::Command => decode(bytes).map(Event::Command),
        Topic::Proposal => decode(bytes).map(Event::Proposal),
        Topic::State => decode(bytes).map(Event::State),
        Topic::Lease | Topic::TakeOver => Claim::read(topic, bytes).map(Event::Claim),
        Topic::Emergency | Topic::AllClear => Emergency::read(topic, bytes).map(Event::Emergency),
        _ => Err(tandem_wire::Malformed::Topic),
    };
    event.unwrap_or_else(|why| Event::Unreadable(Unreadable { topic, why }))
}
