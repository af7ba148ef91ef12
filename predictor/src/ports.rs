//! The predictor's edge: inputs become events, proposals and forecasts become bytes.

use tandem_wire::{Input, Malformed, NodeName, Ports, Topic, Turn, Unreadable, decode, encode};

use crate::node::{Event, Output, Predictor};

impl Ports for Predictor {
    const NAME: NodeName = NodeName::Predictor;
    const TURN: Turn = Turn::Own;
    const INPUTS: &'static [Topic] = &[Topic::State];
    const OUTPUTS: &'static [Topic] = &[Topic::Proposal, Topic::Forecast];

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
        match output {
            Output::Proposal(proposal) => {
                encode(proposal, bytes);
                Some(Topic::Proposal)
            }
            Output::Forecast(forecast) => {
                encode(forecast, bytes);
                Some(Topic::Forecast)
            }
        }
    }
}

fn read(topic: Topic, bytes: &[u8]) -> Event {
    let event = match topic {
        Topic::State => decode(bytes).map(Event::State),
        _ => Err(Malformed::Topic),
    };
    event.unwrap_or_else(|why| Event::Unreadable(Unreadable { topic, why }))
}
