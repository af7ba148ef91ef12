//! Where cases start from.

use std::sync::OnceLock;

use tandem_cesn::{Demonstration, Model, Settings};
use tandem_trials::{Blueprint, Configuration};
use tandem_wire::{NodeName, Session, Topic, keys};

use crate::loops;

/// One message of every kind, with every field set: the bytes that pin the wire's layout.
const GOLDEN: &str = include_str!("../../wire/tests/golden.txt");
/// The shipped task.
const DEMONSTRATIONS: [&str; 3] = [
    include_str!("../../examples/demonstrations/planar_a08.csv"),
    include_str!("../../examples/demonstrations/planar_a11.csv"),
    include_str!("../../examples/demonstrations/planar_a14.csv"),
];

/// The run that every node here belongs to.
pub(crate) const SESSION: Session = Session(41);

/// Every golden message with its topic.
pub(crate) fn messages() -> &'static [(Topic, Vec<u8>)] {
    static READ: OnceLock<Vec<(Topic, Vec<u8>)>> = OnceLock::new();
    READ.get_or_init(|| GOLDEN.split("\n\n").filter_map(message).collect())
}

fn message(paragraph: &str) -> Option<(Topic, Vec<u8>)> {
    let (name, digits) = paragraph.trim().split_once('\n')?;
    let topic = match name {
        "journal" => Topic::Journal(NodeName::Arbiter),
        "info" => Topic::Info(NodeName::Predictor),
        "clock" => Topic::Clock(NodeName::Recorder),
        "ping" => Topic::Ping(NodeName::RobotSim),
        name => keys::parse(&format!("tandem/robot/{name}"))?.1,
    };
    let digits: Vec<u32> = digits.chars().filter_map(|digit| digit.to_digit(16)).collect();
    let byte = |pair: &[u32]| u8::try_from(pair[0] * 16 + pair[1]).unwrap_or(0);
    Some((topic, digits.chunks_exact(2).map(byte).collect()))
}

/// A small model of the shipped task: quick to train, and as able to forecast as a large one.
pub(crate) fn model() -> &'static Model {
    static TRAINED: OnceLock<Model> = OnceLock::new();
    TRAINED.get_or_init(|| {
        let read = |text: &&str| Demonstration::from_csv("planar", text);
        let demonstrations: Result<Vec<_>, _> = DEMONSTRATIONS.iter().map(read).collect();
        let settings = Settings {
            units: 40,
            ..Settings::default()
        };
        let demonstrations = demonstrations.expect("what ships can be read");
        Model::train(&demonstrations, &settings).expect("and learnt")
    })
}

/// The default configuration of everything, as a file.
pub(crate) fn configuration() -> String {
    Configuration::default().to_toml()
}

/// What the nodes are built from: in real time and in lockstep.
pub(crate) fn blueprints() -> [Blueprint; 2] {
    ["real", "max"].map(|pace| {
        let mut document = tandem_settings::Document::default();
        document.set("loop.pace", pace);
        let configuration = Configuration::from_document(&document).expect("two settings that exist");
        Blueprint::new(configuration, SESSION, Some(model().clone())).expect("the defaults fit together")
    })
}

/// The session file of a loop that ran in good order for some ticks, sharing control at the end.
pub(crate) fn session() -> &'static [u8] {
    static WRITTEN: OnceLock<Vec<u8>> = OnceLock::new();
    WRITTEN.get_or_init(loops::recorded)
}
