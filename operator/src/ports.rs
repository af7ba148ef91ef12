//! Bytes ⇄ events and outputs. Pure and total.

use tandem_wire::{Input, Malformed, NodeName, Ports, Topic, Turn, Unreadable, decode, encode};

use crate::device::DeviceSample;
use crate::node::{Event, Operator, Output};
use crate::played::{self, PlayedSample};

impl Ports for Operator {
    const NAME: NodeName = NodeName::Operator;
    const TURN: Turn = Turn::OnArrival;
    const INPUTS: &'static [Topic] = &[Topic::State, Topic::Device, Topic::Storage];
    const OUTPUTS: &'static [Topic] = &[
        Topic::Command,
        Topic::Trial,
        Topic::Lease,
        Topic::TakeOver,
        Topic::Emergency,
    ];

    fn event(input: Input<'_>) -> Event {
        match input {
            Input::Sample { topic, bytes } => {
                read(topic, bytes).unwrap_or_else(|why| Event::Unreadable(Unreadable { topic, why }))
            }
            Input::Wake => Event::Wake,
            Input::Presence { peer, alive } => Event::Presence { peer, alive },
            Input::Stop => Event::Stop,
            Input::Missed { topic, tick } => Event::Missed { topic, tick },
        }
    }

    fn sample(output: &Output, bytes: &mut Vec<u8>) -> Option<Topic> {
        match output {
            Output::Command(command) => {
                encode(command, bytes);
                Some(Topic::Command)
            }
            Output::Trial(trial) => {
                encode(trial, bytes);
                Some(Topic::Trial)
            }
            Output::Claim(claim) => {
                encode(claim, bytes);
                Some(claim.body.topic())
            }
            Output::Emergency(emergency) => {
                encode(emergency, bytes);
                Some(emergency.body.topic())
            }
            Output::Status(_) => {
                bytes.clear();
                None
            }
        }
    }
}

fn read(topic: Topic, bytes: &[u8]) -> Result<Event, Malformed> {
    match topic {
        Topic::State => decode(bytes).map(|state| Event::State(Box::new(state))),
        Topic::Device if bytes.first() == Some(&played::VERSION) => PlayedSample::from_bytes(bytes).map(Event::Played),
        Topic::Device => DeviceSample::from_bytes(bytes).map(Event::Device),
        Topic::Storage => decode(bytes).map(Event::Storage),
        _ => Err(Malformed::Topic),
    }
}
