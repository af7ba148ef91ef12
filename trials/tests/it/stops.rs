//! A robot's stops, found in a journal that is written here.

use std::collections::BTreeMap;

use tandem_recorder::{Evidence, RecordedNode, Run};
use tandem_robot_sim::RobotSim;
use tandem_trials::stops::{RobotRun, Stop, stops};
use tandem_trials::{Blueprint, Configuration};
use tandem_wire::{
    Envelope, Happening, Header, Input, JournalBatch, JournalEntry, Label, Lease, MILLISECOND, MessageId, Motion, Node,
    NodeName, Outbox, Ports, Reason, Seq, Session, Setpoint, Stamp, State, Topic, Trial, Vec3, decode, encode,
};

const RUN: Run = Run {
    node: NodeName::RobotSim,
    session: Session(7),
};

/// A robot whose journal is kept, and an arbiter that answers every state at once.
struct Bench {
    node: RobotSim,
    entries: Vec<JournalEntry>,
    now: Stamp,
    seen: Option<MessageId>,
    seq: u64,
    /// Which operator's run holds the lease, from 1.
    operator: u32,
}

impl Bench {
    /// The robot in a trial, at its start.
    fn new() -> Self {
        let blueprint = Blueprint::new(Configuration::default(), RUN.session, None).expect("the defaults fit");
        let mut bench = Self {
            node: blueprint.robot_sim().expect("the defaults fit"),
            entries: Vec::new(),
            now: Stamp(0),
            seen: None,
            seq: 0,
            operator: 1,
        };
        let begin = Trial::Begin {
            number: 1,
            label: String::new(),
        };
        bench.hear(Topic::Trial, 9, 1, begin);
        bench
    }

    fn hear<M: tandem_wire::Message>(&mut self, topic: Topic, session: u64, seq: u64, body: M) {
        let header = Header {
            session: Session(session),
            seq: Seq(seq),
            ..Header::default()
        };
        let mut bytes = Vec::new();
        encode(&Envelope { header, body }, &mut bytes);
        self.feed(Input::Sample { topic, bytes: &bytes });
    }

    fn feed(&mut self, input: Input<'_>) {
        let at = self.now;
        let mut write = |what| self.entries.push(JournalEntry { at, wall: at, what });
        write(Happening::from(input));
        let mut outbox = Outbox::default();
        self.node.step(at, RobotSim::event(input), &mut outbox);
        for output in outbox.drain() {
            let mut bytes = Vec::new();
            let Some(topic) = RobotSim::sample(&output, &mut bytes) else {
                continue;
            };
            if let Ok(state) = decode::<State>(&bytes) {
                self.seen = Some(state.header.id());
            }
            write(Happening::Output { topic, bytes });
        }
    }

    fn setpoint(&mut self, motion: Motion) {
        self.seq += 1;
        let velocity = Vec3::new(0.0, if motion.is_permitted() { 0.2 } else { 0.0 }, 0.0);
        let body = Setpoint {
            motion,
            velocity,
            seen: self.seen,
            lease: Some(Lease {
                number: self.operator,
                holder: Session(100 + u64::from(self.operator)),
                name: Label::new("ada"),
            }),
            asks: None,
            ..nothing()
        };
        self.hear(Topic::Setpoint, 3, self.seq, body);
    }

    /// Setpoints every 20 ms, a little off the grid, and the robot's own deadlines.
    fn flow(&mut self, motion: Motion, times: u32) {
        for _ in 0..times {
            self.wait(20);
            self.now = self.now.after(333);
            self.setpoint(motion);
        }
    }

    /// The robot wakes at its deadlines and hears nothing.
    fn wait(&mut self, millis: u64) {
        let until = self.now.after(millis * MILLISECOND);
        while let Some(due) = self.node.deadline().filter(|due| *due <= until) {
            self.now = due.max(self.now);
            self.feed(Input::Wake);
        }
        self.now = until;
    }

    fn found(self) -> RobotRun {
        let recorded = RecordedNode {
            config: Configuration::default().to_toml(),
            seed: 1,
            ..RecordedNode::default()
        };
        let mut evidence = Evidence::default();
        evidence.nodes.insert(RUN, recorded);
        let whole = JournalBatch {
            first: 0,
            lost: 0,
            entries: self.entries,
        };
        evidence.journals = BTreeMap::from([(RUN, vec![whole])]);
        let mut runs = stops(&evidence, |_| {});
        assert_eq!(runs.len(), 1);
        runs.remove(0)
    }
}

fn nothing() -> Setpoint {
    Setpoint {
        velocity: Vec3::ZERO,
        motion: Motion::Held(Reason::NoCommandYet),
        lease: None,
        asks: None,
        law: tandem_wire::Law::Human,
        weight: tandem_wire::Finite(1.0),
        human: Vec3::ZERO,
        guidance: None,
        blended: Vec3::ZERO,
        limited: tandem_wire::Limited::default(),
        command: None,
        proposal: None,
        seen: None,
        refused: tandem_wire::Refusals::default(),
    }
}

const RELEASED: Motion = Motion::Held(Reason::DeadmanReleased);

const fn pressed(press: u32) -> Motion {
    Motion::Permitted { press }
}

fn only(run: &RobotRun) -> Stop {
    assert_eq!(run.stops.len(), 1, "{:?}", run.stops);
    run.stops[0]
}

#[test]
fn a_silence_is_timed_from_the_last_setpoint_to_the_standing_arm() {
    let mut bench = Bench::new();
    bench.flow(RELEASED, 5);
    bench.flow(pressed(1), 30);
    let heard = bench.now;
    bench.wait(600);
    let run = bench.found();
    let stop = only(&run);
    assert_eq!((stop.heard, stop.press), (heard, 1));
    assert!(matches!(stop.reason, Reason::SetpointLost { .. }));
    let (noticed, began) = (stop.noticed.since(heard), stop.began.expect("it braked").since(heard));
    assert!((100 * MILLISECOND..=101 * MILLISECOND).contains(&noticed), "{noticed}");
    assert!((noticed..=110 * MILLISECOND).contains(&began), "{began}");
    let rest = stop.at_rest.expect("it stood").since(heard);
    assert!((began..400 * MILLISECOND).contains(&rest), "{rest}");
    assert!((0.19..0.21).contains(&stop.speed_m_s), "{stop:?}");
    assert!((0.001..0.05).contains(&stop.way_m) && !stop.drove_on, "{stop:?}");
    assert_eq!(stop.again, None);
    assert_eq!((run.setpoints, run.setpoints_missed, run.refused), (35, 0, 0));
}

#[test]
fn motion_by_a_press_that_was_made_after_the_stop_is_fresh() {
    let mut bench = Bench::new();
    bench.flow(RELEASED, 5);
    bench.flow(pressed(1), 20);
    bench.wait(300);
    // A press held since before does not move it; the next one does.
    bench.flow(pressed(1), 5);
    bench.flow(pressed(2), 10);
    bench.flow(RELEASED, 5);
    bench.flow(pressed(3), 5);
    let run = bench.found();
    let first = run.first.expect("it moved");
    assert!(first.fresh && first.press == 1);
    let [silence, release] = run.stops[..] else {
        panic!("two stops: {:?}", run.stops)
    };
    let again = silence.again.expect("it moved again");
    assert!(again.fresh && again.press == 2, "{again:?}");
    assert_eq!(release.reason, Reason::DeadmanReleased);
    assert!(release.began.expect("it braked").since(release.noticed) < 10 * MILLISECOND);
    assert!(release.again.is_some_and(|again| again.fresh && again.press == 3));
}

#[test]
fn another_operators_first_press_is_not_the_last_ones() {
    let mut bench = Bench::new();
    bench.flow(RELEASED, 5);
    bench.flow(pressed(1), 20);
    bench.flow(
        Motion::Held(Reason::CommandLost {
            silent: 100 * MILLISECOND,
        }),
        5,
    );
    bench.operator = 2;
    bench.flow(pressed(1), 5);
    let again = only(&bench.found()).again.expect("it moved again");
    assert!(again.fresh && again.press == 1, "{again:?}");
}

#[test]
fn numbers_that_never_came_are_counted() {
    let mut bench = Bench::new();
    bench.flow(RELEASED, 5);
    bench.seq += 3;
    bench.flow(RELEASED, 5);
    let run = bench.found();
    assert_eq!((run.setpoints, run.setpoints_missed), (10, 3));
    assert_eq!((run.stops.len(), run.first), (0, None));
}
