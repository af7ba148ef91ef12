//! Four nodes of a loop as processes on loopback, and somebody who watches them.

#![allow(dead_code, reason = "every test uses another part")]

use std::collections::BTreeMap;
use std::net::TcpListener;
use std::time::{Duration, Instant};

use tandem_link::{Link, LinkSettings, Observer, Sighting};
use tandem_wire::{Envelope, Message, Motion, NodeName, Pace, Reason, State, Topic, decode};

use super::Process;

/// Nobody waits longer for anything.
const PATIENCE: Duration = Duration::from_secs(120);
/// Far above what a hand at rest trembles by, in metres per second.
const MOVING: f64 = 0.03;

/// The processes by name, and what is seen of them from the robot's side.
pub(crate) struct Loop {
    pub(crate) endpoint: String,
    robot: String,
    pub(crate) nodes: BTreeMap<&'static str, Process>,
    pub(crate) watch: Watch,
}

impl Loop {
    /// The robot, which routes, the predictor and the arbiter; the operator comes when it is started.
    pub(crate) fn without_operator(robot: &str) -> Self {
        let endpoint = format!("tcp/127.0.0.1:{}", free_port());
        let robot_sim = start_robot(robot, &endpoint);
        let watch = Watch::new(robot, &endpoint);
        let mut this = Self {
            endpoint,
            robot: robot.to_owned(),
            nodes: BTreeMap::from([("robot-sim", robot_sim)]),
            watch,
        };
        this.start("predictor");
        // One that comes when the human is past the checkpoint forecasts nothing.
        this.watch.until_alive(NodeName::Predictor);
        this.start("arbiter");
        this
    }

    /// All four, until the tool moves.
    pub(crate) fn moving(robot: &str) -> Self {
        let mut this = Self::without_operator(robot);
        this.start("operator");
        this.watch.until_moving();
        this
    }

    pub(crate) fn start(&mut self, node: &'static str) {
        let endpoint = self.endpoint.clone();
        self.start_through(node, &endpoint);
    }

    /// Starts a node that dials this endpoint.
    pub(crate) fn start_through(&mut self, node: &'static str, endpoint: &str) {
        let process = Process::start(&[node, "--robot", &self.robot, "--connect", endpoint]);
        self.nodes.insert(node, process);
    }

    /// Starts another robot where the first one was; who watches dials again by itself.
    pub(crate) fn restart_robot(&mut self) {
        self.nodes.insert("robot-sim", start_robot(&self.robot, &self.endpoint));
    }

    /// Kills a node as a power cut would.
    pub(crate) fn kill(&mut self, node: &str) {
        self.nodes.remove(node).expect("it was started").kill();
    }
}

/// Who watches, on the robot's side.
pub(crate) struct Watch {
    observer: Observer,
    /// Closes when nobody has it any more.
    _link: Link,
}

impl Watch {
    pub(crate) fn new(robot: &str, endpoint: &str) -> Self {
        let settings = LinkSettings {
            robot: robot.into(),
            connect: vec![endpoint.into()],
            ..LinkSettings::default()
        };
        let link = Link::open(&settings).expect("whoever listens answers");
        Self {
            observer: Observer::new(&link, Pace::Real).expect("an observer"),
            _link: link,
        }
    }

    /// Waits until a node is there.
    pub(crate) fn until_alive(&self, node: NodeName) {
        let limit = Instant::now() + PATIENCE;
        let is_there = |sighting| matches!(sighting, Sighting::Presence { peer, alive: true } if peer == node);
        while !self.observer.next(Duration::from_secs(1)).is_some_and(is_there) {
            assert!(Instant::now() < limit, "no {}", node.as_str());
        }
    }

    /// The next message of any kind.
    pub(crate) fn next(&self) -> (Topic, Vec<u8>) {
        let limit = Instant::now() + PATIENCE;
        while Instant::now() < limit {
            if let Some(Sighting::Sample { topic, bytes, .. }) = self.observer.next(Duration::from_secs(1)) {
                return (topic, bytes);
            }
        }
        panic!("nothing is said any more");
    }

    /// Waits for a message on a topic that is wanted.
    pub(crate) fn until<M: Message>(
        &self,
        what: &str,
        wanted: Topic,
        mut found: impl FnMut(&Envelope<M>) -> bool,
    ) -> Envelope<M> {
        let limit = Instant::now() + PATIENCE;
        while Instant::now() < limit {
            let (topic, bytes) = self.next();
            if let Some(message) = (topic == wanted).then(|| decode::<M>(&bytes).ok()).flatten()
                && found(&message)
            {
                return message;
            }
        }
        panic!("{what} does not come");
    }

    /// Waits until the tool moves, and says by which press.
    pub(crate) fn until_moving(&self) -> u32 {
        let moves =
            |state: &Envelope<State>| state.body.motion.is_permitted() && state.body.tool_velocity.norm() > MOVING;
        let state = self.until("motion", Topic::State, moves);
        match state.body.motion {
            Motion::Permitted { press } => press,
            Motion::Held(reason) => panic!("it moves although {reason}"),
        }
    }

    /// Waits until an emergency stop by this name is in force, and gives that state.
    pub(crate) fn until_stopped_by(&self, name: &str) -> State {
        let is_so = |state: &Envelope<State>| matches!(state.body.motion.reason(), Some(Reason::EmergencyStop { by, .. }) if by.to_string() == name);
        self.until("the emergency stop", Topic::State, is_so).body
    }

    /// Waits until the arm stands, and gives that state.
    pub(crate) fn until_standing(&self) -> State {
        let stands = |state: &Envelope<State>| !state.body.motion.is_permitted() && state.body.at_rest;
        self.until("rest", Topic::State, stands).body
    }
}

fn start_robot(robot: &str, endpoint: &str) -> Process {
    Process::start(&["robot-sim", "--robot", robot, "--listen", endpoint])
}

/// A port that was free a moment ago.
pub(crate) fn free_port() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    listener.local_addr().expect("an address").port()
}
