//! A configuration in lockstep, a model of the shipped task, and when a trial is over.

use tandem_cesn::{Demonstration, Model, Settings};
use tandem_link::config::PaceName;
use tandem_trials::Configuration;
use tandem_wire::{Setpoint, Topic, decode};

/// The defaults, as fast as messages travel.
pub(crate) fn configuration() -> Configuration {
    let mut configuration = Configuration::default();
    configuration.rates.pace = PaceName::Max;
    configuration
}

/// The model of the demonstrations that ship.
pub(crate) fn model() -> Model {
    Model::train(&demonstrations(), &Settings::default()).expect("they fit")
}

/// One that is conditioned anew on every tick; small, since it is asked so often.
pub(crate) fn replanning_model() -> Model {
    let settings = Settings {
        units: 200,
        ..Settings::replanning()
    };
    Model::train_replanning(&demonstrations(), &settings).expect("they fit")
}

fn demonstrations() -> [Demonstration; 3] {
    [
        include_str!("../../../../examples/demonstrations/planar_a08.csv"),
        include_str!("../../../../examples/demonstrations/planar_a11.csv"),
        include_str!("../../../../examples/demonstrations/planar_a14.csv"),
    ]
    .map(|text| Demonstration::from_csv("shipped", text).expect("they ship"))
}

/// Says of each message in turn whether the human has let go for good: a second without motion after some.
pub(crate) fn over() -> impl FnMut(Topic, &[u8]) -> bool {
    let mut moved: Option<u32> = None;
    move |topic, bytes| {
        let Some(setpoint) = (topic == Topic::Setpoint)
            .then(|| decode::<Setpoint>(bytes).ok())
            .flatten()
        else {
            return false;
        };
        let tick = setpoint.header.tick;
        if setpoint.body.motion.is_permitted() {
            moved = Some(tick);
        }
        moved.is_some_and(|moved| tick > moved + 10)
    }
}
