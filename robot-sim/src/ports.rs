//! The robot's edge: inputs become events, states and scenes become bytes.

use tandem_wire::{
    Emergency, Envelope, Input, Malformed, NodeName, Ports, Scene, Topic, Turn, Unreadable, decode, encode,
};

use crate::node::{Event, Output, RobotSim};

impl Ports for RobotSim {
    const NAME: NodeName = NodeName::RobotSim;
    const TURN: Turn = Turn::OnArrival;
    const INPUTS: &'static [Topic] = &[Topic::Setpoint, Topic::Trial, Topic::Emergency, Topic::AllClear];
    const OUTPUTS: &'static [Topic] = &[Topic::State, Topic::Scene];

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
            Output::State(state) => {
                encode(state, bytes);
                Some(Topic::State)
            }
            Output::Scene(scene) => {
                let body = Scene::clone(&scene.body);
                encode(
                    &Envelope {
                        header: scene.header,
                        body,
                    },
                    bytes,
                );
                Some(Topic::Scene)
            }
        }
    }
}

fn read(topic: Topic, bytes: &[u8]) -> Event {
    let event = match topic {
        Topic::Setpoint => decode(bytes).map(Event::Setpoint),
        Topic::Trial => decode(bytes).map(Event::Trial),
        Topic::Emergency | Topic::AllClear => Emergency::read(topic, bytes).map(Event::Emergency),
        _ => Err(Malformed::Topic),
    };
    event.unwrap_or_else(|why| Event::Unreadable(Unreadable { topic, why }))
}
