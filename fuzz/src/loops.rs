//! Five real nodes that talk through a network which loses, repeats, delays and damages what they say.
//!
//! No threads and no clock: the messages that are under way stand in a list by their time of arrival, and time is
//! whatever comes next, an arrival or a node's own deadline.

use std::collections::BTreeMap;
use std::io::Cursor;

use tandem_arbiter::Arbiter;
use tandem_operator::Operator;
use tandem_predictor::Predictor;
use tandem_recorder::{Counts, Drops, Output, Provenance, Recorder, SessionFile, View};
use tandem_robot_sim::RobotSim;
use tandem_trials::Blueprint;
use tandem_wire::{
    Delivery, Envelope, Happening, Header, Input, JournalBatch, JournalEntry, MILLISECOND, Node, NodeInfo, NodeName,
    Outbox, Pace, Ports, Seq, Session, Stamp, Topic, Trial, codec, encode,
};

use crate::chance::Chance;
use crate::{Target, Tried, count, mutate, seeds};

/// Events of one case: enough for a trial to begin, the checkpoint to be passed and something to break.
const EVENTS: u64 = 1500;
/// A session of this length has a forecast in it.
const LONG_ENOUGH: Stamp = Stamp(4800 * MILLISECOND);
/// So near to the end of time no deadline lies ahead of it.
const LAST: Stamp = Stamp(u64::MAX / 4);

/// How bad the network is.
#[derive(Clone, Copy)]
struct Weather {
    /// One message in so many is lost, comes twice, is damaged, comes late; 0 for none.
    trouble: usize,
    /// One event in so many is something that nobody in the loop said.
    strangers: usize,
}

const FAIR: Weather = Weather {
    trouble: 0,
    strangers: 0,
};

/// Loops of five nodes.
pub(crate) struct Loops {
    blueprints: [Blueprint; 2],
}

impl Loops {
    pub(crate) fn new() -> Self {
        Self {
            blueprints: seeds::blueprints(),
        }
    }
}

impl Target for Loops {
    fn name(&self) -> &'static str {
        "loop"
    }

    fn run(&mut self, seed: u64, tried: &mut Tried) {
        let mut chance = Chance::new(seed);
        let blueprint = &self.blueprints[usize::from(chance.once_in(3))];
        let weather = Weather {
            trouble: *chance.pick(&[0, 6, 20, 100]),
            strangers: *chance.pick(&[0, 5, 30, 200]),
        };
        let mut stage = Stage::new(blueprint, weather, chance);
        // Drawing costs more than all the rest, so it is not always looked at.
        let is_drawn = stage.chance.once_in(8);
        for _ in 0..EVENTS {
            stage.advance();
        }
        if is_drawn {
            stage.draw();
        }
        for (node, steps) in stage.tried {
            *tried.entry(node).or_default() += steps;
        }
    }
}

/// The session file of a loop that ran in good order for a while.
pub(crate) fn recorded() -> Vec<u8> {
    let [_, lockstep] = seeds::blueprints();
    let mut stage = Stage::new(&lockstep, FAIR, Chance::new(1));
    stage.introduce();
    // Bounded as well by events, for a loop that stands still would begin trials for ever.
    for _ in 0..EVENTS {
        stage.advance();
        if stage.now > LONG_ENOUGH {
            break;
        }
    }
    assert!(stage.now > LONG_ENOUGH, "the loop stands still at {:?}", stage.now);
    stage.pass_on_journals();
    let provenance = Provenance {
        robot: "robot".parse().expect("a name"),
        build: "fuzz".to_owned(),
        epoch_unix_nanos: 1_760_000_000_000_000_000,
    };
    let mut file = SessionFile::begin(Cursor::new(Vec::new()), 16 << 10, provenance).expect("memory takes it");
    for output in &stage.heard {
        if let Output::Write(heard) = output {
            file.write(heard, Drops::default()).expect("memory takes it");
        }
    }
    let closed = file.close(&Counts::default(), Drops::default());
    closed.expect("memory takes it").1.into_inner()
}

/// What is under way.
struct Parcel {
    to: NodeName,
    topic: Topic,
    bytes: Vec<u8>,
}

struct Stage<'a> {
    blueprint: &'a Blueprint,
    chance: Chance,
    weather: Weather,
    now: Stamp,
    operator: Operator,
    predictor: Predictor,
    arbiter: Arbiter,
    robot: RobotSim,
    recorder: Recorder,
    /// By arrival; equal arrivals in the order in which they were sent.
    under_way: BTreeMap<(Stamp, u64), Parcel>,
    sent: u64,
    steps: u64,
    tried: Tried,
    heard: Vec<Output>,
    journals: BTreeMap<NodeName, Vec<JournalEntry>>,
}

impl<'a> Stage<'a> {
    fn new(blueprint: &'a Blueprint, weather: Weather, chance: Chance) -> Self {
        let mut stage = Self {
            operator: blueprint.operator(),
            predictor: blueprint.predictor().expect("the shipped model fits"),
            arbiter: blueprint.arbiter().expect("the defaults fit together"),
            robot: blueprint.robot_sim().expect("the defaults fit together"),
            recorder: Recorder::new(blueprint.timing()),
            blueprint,
            chance,
            weather,
            now: Stamp(0),
            under_way: BTreeMap::new(),
            sent: 0,
            steps: 0,
            tried: Tried::new(),
            heard: Vec::new(),
            journals: BTreeMap::new(),
        };
        for node in NodeName::ALL {
            stage.deliver(node, Input::Wake);
        }
        stage.begin_trial(1);
        stage
    }

    fn begin_trial(&mut self, number: u32) {
        let label = "fuzz".to_owned();
        let trial = Trial::Begin { number, label };
        let bytes = bytes_of(u64::from(number), trial);
        self.post(Topic::Trial, &bytes);
    }

    /// The next thing that happens: a stranger's doing, an arrival, a deadline.
    fn advance(&mut self) {
        if self.weather.strangers > 0 && self.chance.once_in(self.weather.strangers) {
            return self.be_strange();
        }
        let arrival = self.under_way.first_key_value().map(|((at, _), _)| *at);
        let due = self.due();
        match (arrival, due) {
            (Some(at), due) if due.is_none_or(|(due, _)| at <= due) => {
                self.now = self.now.max(at);
                if let Some((_, parcel)) = self.under_way.pop_first() {
                    let Parcel { to, topic, bytes } = parcel;
                    self.deliver(to, Input::Sample { topic, bytes: &bytes });
                }
            }
            (_, Some((due, node))) => {
                self.now = self.now.max(due);
                self.deliver(node, Input::Wake);
                let next = self.deadline(node);
                assert!(
                    self.now > LAST || next.is_none_or(|next| next > self.now),
                    "{node} was woken at {:?} and wants to be woken at {next:?}: it would spin",
                    self.now
                );
            }
            // In lockstep a lost message stops everything, until somebody begins anew.
            (_, None) => {
                let number = u32::try_from(self.steps).unwrap_or(1);
                self.now = self.now.after(MILLISECOND);
                self.begin_trial(number);
            }
        }
    }

    fn due(&self) -> Option<(Stamp, NodeName)> {
        let due = NodeName::ALL
            .into_iter()
            .filter_map(|node| Some((self.deadline(node)?, node)));
        due.min()
    }

    fn deadline(&self, node: NodeName) -> Option<Stamp> {
        match node {
            NodeName::Operator => self.operator.deadline(),
            NodeName::Predictor => self.predictor.deadline(),
            NodeName::Arbiter => self.arbiter.deadline(),
            NodeName::RobotSim => self.robot.deadline(),
            NodeName::Recorder => self.recorder.deadline(),
        }
    }

    /// Something that nobody in the loop said or did.
    fn be_strange(&mut self) {
        let node = *self.chance.pick(&NodeName::ALL);
        match self.chance.below(40) {
            0 => self.now = self.now.after(self.chance.next() % 10_000_000_000),
            1 if self.chance.once_in(50) => self.now = self.now.after(self.chance.number()),
            2 if self.chance.once_in(50) => self.deliver(node, Input::Stop),
            3..6 => {
                let peer = *self.chance.pick(&NodeName::ALL);
                let alive = self.chance.once_in(2);
                self.deliver(node, Input::Presence { peer, alive });
            }
            6..9 => {
                let keys = [
                    3,
                    self.chance.byte() % 128,
                    self.chance.byte() % 4,
                    self.chance.byte() % 3,
                    u8::from(self.chance.once_in(50)),
                    self.chance.byte() % 2,
                    self.chance.byte() % 2,
                ];
                let topic = Topic::Device;
                self.deliver(NodeName::Operator, Input::Sample { topic, bytes: &keys });
            }
            9 => self.deliver(node, Input::Wake),
            10 => self.begin_trial(2),
            _ => {
                let (topic, golden) = self.chance.pick(seeds::messages());
                let mut bytes = golden.clone();
                self.relabel(&mut bytes);
                if self.chance.once_in(2) {
                    mutate::damage(&mut bytes, 3, &mut self.chance);
                }
                self.deliver(
                    node,
                    Input::Sample {
                        topic: *topic,
                        bytes: &bytes,
                    },
                );
            }
        }
    }

    /// Makes a golden message one that a receiver may take for the next of a sender that it knows.
    fn relabel(&mut self, bytes: &mut [u8]) {
        let Some(head) = bytes.get_mut(4..32) else { return };
        let tick = u32::try_from(self.now.0 / (100 * MILLISECOND)).unwrap_or(u32::MAX);
        head[..4].copy_from_slice(&tick.to_le_bytes());
        if self.chance.once_in(2) {
            head[4..12].copy_from_slice(&seeds::SESSION.0.to_le_bytes());
        }
        head[12..20].copy_from_slice(&(1 + self.chance.next() % 4000).to_le_bytes());
        head[20..28].copy_from_slice(&self.now.0.to_le_bytes());
    }

    fn deliver(&mut self, node: NodeName, input: Input<'_>) {
        self.steps += 1;
        count(&mut self.tried, node.as_str());
        let now = self.time_of(input);
        let mut entries = vec![entry(now, Happening::from(input))];
        let said = match node {
            NodeName::Operator => step(&mut self.operator, now, input),
            NodeName::Predictor => step(&mut self.predictor, now, input),
            NodeName::Arbiter => step(&mut self.arbiter, now, input),
            NodeName::RobotSim => step(&mut self.robot, now, input),
            NodeName::Recorder => return self.record(now, input),
        };
        for (topic, bytes) in said {
            self.post(topic, &bytes);
            entries.push(entry(now, Happening::Output { topic, bytes }));
        }
        self.journals.entry(node).or_default().extend(entries);
    }

    /// What the shell would step it with: the time, or in lockstep the newest tick that a message spoke of.
    fn time_of(&mut self, input: Input<'_>) -> Stamp {
        if self.blueprint.timing().pace == Pace::Lockstep
            && let Input::Sample { topic, bytes } = input
            && topic.delivery() != Delivery::Bulk
            && let Ok((_, header)) = codec::peek(bytes)
        {
            let at = Stamp::of_tick(header.tick, self.blueprint.timing().period);
            self.now = self.now.max(at);
        }
        self.now
    }

    fn record(&mut self, now: Stamp, input: Input<'_>) {
        let mut outbox = Outbox::default();
        self.recorder.step(now, Recorder::event(input), &mut outbox);
        self.heard.extend(outbox.drain());
    }

    /// Sends a message to whoever listens, through the weather.
    fn post(&mut self, topic: Topic, bytes: &[u8]) {
        const LISTENERS: [(NodeName, &[Topic]); 5] = [
            (NodeName::Operator, Operator::INPUTS),
            (NodeName::Predictor, Predictor::INPUTS),
            (NodeName::Arbiter, Arbiter::INPUTS),
            (NodeName::RobotSim, RobotSim::INPUTS),
            (NodeName::Recorder, Recorder::INPUTS),
        ];
        for (to, _) in LISTENERS.iter().filter(|(_, inputs)| inputs.contains(&topic)) {
            self.send(*to, topic, bytes.to_vec());
        }
    }

    fn send(&mut self, to: NodeName, topic: Topic, mut bytes: Vec<u8>) {
        let mut delay = match self.blueprint.timing().pace {
            Pace::Real => self.chance.next() % (3 * MILLISECOND),
            Pace::Lockstep => 0,
        };
        if self.weather.trouble > 0 && self.chance.once_in(self.weather.trouble) {
            match self.chance.below(4) {
                0 => return,
                1 => self.send(to, topic, bytes.clone()),
                2 => mutate::damage(&mut bytes, 3, &mut self.chance),
                _ => delay += self.chance.next() % (1000 * MILLISECOND),
            }
        }
        self.sent += 1;
        let place = (self.now.after(delay), self.sent);
        self.under_way.insert(place, Parcel { to, topic, bytes });
    }

    /// Tells the recorder how the nodes can be built again.
    fn introduce(&mut self) {
        for node in NodeName::ALL {
            let info = NodeInfo {
                session: seeds::SESSION,
                config: self.blueprint.configuration().to_toml(),
                seed: self.blueprint.configuration().rates.seed,
                build: "fuzz".to_owned(),
                model: match node {
                    NodeName::Predictor => seeds::model().to_bytes(),
                    _ => Vec::new(),
                },
            };
            let bytes = bytes_of(1, info);
            let topic = Topic::Info(node);
            self.deliver(NodeName::Recorder, Input::Sample { topic, bytes: &bytes });
        }
    }

    fn pass_on_journals(&mut self) {
        for (node, entries) in std::mem::take(&mut self.journals) {
            for (number, part) in entries.chunks(50).enumerate() {
                let batch = JournalBatch {
                    first: 50 * number as u64,
                    lost: 0,
                    entries: part.to_vec(),
                };
                let bytes = bytes_of(number as u64 + 1, batch);
                let topic = Topic::Journal(node);
                self.deliver(NodeName::Recorder, Input::Sample { topic, bytes: &bytes });
            }
        }
    }

    /// Everything that was heard can be drawn.
    fn draw(&self) {
        let mut view = View::new(self.blueprint.timing());
        let mut drawings = View::opening();
        for output in &self.heard {
            if let Output::Show(heard) = output {
                drawings.clear();
                view.draw(heard, Drops::default(), &mut drawings);
            }
        }
    }
}

/// Steps a node; what it says can be read by whoever hears it.
fn step<N: Ports>(node: &mut N, now: Stamp, input: Input<'_>) -> Vec<(Topic, Vec<u8>)> {
    let mut outbox = Outbox::default();
    node.step(now, N::event(input), &mut outbox);
    let mut said = Vec::new();
    for output in outbox.drain() {
        let mut bytes = Vec::new();
        if let Some(topic) = N::sample(&output, &mut bytes) {
            assert!(N::OUTPUTS.contains(&topic), "{} says {topic}", N::NAME);
            let heard = Recorder::event(Input::Sample { topic, bytes: &bytes });
            let is_read = matches!(heard, tandem_recorder::Event::Sample(_));
            assert!(is_read, "{} said on {topic} what cannot be read: {heard:?}", N::NAME);
            said.push((topic, bytes));
        }
    }
    said
}

fn entry(at: Stamp, what: Happening) -> JournalEntry {
    JournalEntry { at, wall: at, what }
}

fn bytes_of<M: tandem_wire::Message>(seq: u64, body: M) -> Vec<u8> {
    let header = Header {
        tick: 0,
        session: Session(seeds::SESSION.0),
        seq: Seq(seq),
        sent: Stamp(0),
    };
    let mut bytes = Vec::new();
    encode(&Envelope { header, body }, &mut bytes);
    bytes
}
