//! Whatever happens, in whatever order: no panic, and these promises hold.

mod robot;

use proptest::prelude::*;
use tandem_operator::{DeviceSample, Event, HumanKind, HumanSettings, Operator, OperatorSettings, Output, SourceKind};
use tandem_wire::{
    Command, Deadman, Envelope, Input, Motion, NodeName, Pace, Ports, Reason, Seq, Session, Stamp, Timing, Topic, Vec3,
};

use robot::{Rig, Robot, commands};

/// One thing that happens, and how long after the one before, in milliseconds.
#[derive(Clone, Debug)]
enum Happening {
    /// The state of a tick so far from the newest does not come.
    Missed(u32),
    State(Glimpse),
    Bytes(Topic, Vec<u8>),
    Wake,
    Presence(bool),
    Stop,
}

/// A state, as wild as a broken robot could send it.
#[derive(Clone, Debug)]
struct Glimpse {
    session: u64,
    ticks: u32,
    trial: u32,
    tool: [f64; 2],
    motion: Motion,
    guidance: Option<(f64, [f64; 2])>,
    weight: f64,
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![8 => -0.7..0.7, 1 => any::<f64>(), 1 => Just(f64::NAN), 1 => Just(0.0)]
}

fn motion() -> impl Strategy<Value = Motion> {
    prop_oneof![
        4 => (0..5_u32).prop_map(|press| Motion::Permitted { press }),
        1 => Just(Motion::Held(Reason::AwaitingPress)),
        1 => Just(Motion::Held(Reason::TrialOver)),
        1 => Just(Motion::Held(Reason::CommandLost { silent: 1 })),
    ]
}

fn glimpse() -> impl Strategy<Value = Glimpse> {
    let place = prop_oneof![3 => Just([0.0; 2]), 1 => [number(), number()]];
    let guidance = proptest::option::of((prop_oneof![0.0..100.0, number()], [number(), number()]));
    let when = (
        prop_oneof![20 => Just(1_u64), 1 => Just(2)],
        prop_oneof![6 => 0..3_u32, 1 => any::<u32>()],
    );
    (
        when,
        prop_oneof![9 => Just(1_u32), 1 => 0..3_u32],
        place,
        motion(),
        guidance,
        number(),
    )
        .prop_map(|((session, ticks), trial, tool, motion, guidance, weight)| Glimpse {
            session,
            ticks,
            trial,
            tool,
            motion,
            guidance,
            weight,
        })
}

fn sample() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![keys(), played()]
}

fn played() -> impl Strategy<Value = Vec<u8>> {
    (0..3_u8, 0..3_u8, any::<[f64; 3]>()).prop_map(|(held, presses, velocity)| {
        let numbers = velocity.into_iter().flat_map(f64::to_le_bytes);
        [2, held, presses].into_iter().chain(numbers).collect()
    })
}

fn keys() -> impl Strategy<Value = Vec<u8>> {
    (
        prop_oneof![9 => Just(2_u8), 1 => any::<u8>()],
        0..0x80_u8,
        0..3_u8,
        0..2_u8,
        0..2_u8,
    )
        .prop_map(|(v, k, p, r, a)| vec![v, k, p, r, a, 1 - a, r])
}

fn happening() -> impl Strategy<Value = (u64, Happening)> {
    let what = prop_oneof![
        8 => glimpse().prop_map(Happening::State),
        6 => sample().prop_map(|bytes| Happening::Bytes(Topic::Device, bytes)),
        4 => Just(Happening::Wake),
        1 => proptest::collection::vec(any::<u8>(), 0..80).prop_map(|bytes| Happening::Bytes(Topic::State, bytes)),
        1 => any::<bool>().prop_map(Happening::Presence),
        2 => prop_oneof![9 => 0..3_u32, 1 => any::<u32>()].prop_map(Happening::Missed),
    ];
    let last = prop_oneof![60 => what, 1 => Just(Happening::Stop)];
    (prop_oneof![6 => 0..30_u64, 1 => 0..400_u64], last)
}

fn settings() -> impl Strategy<Value = (bool, OperatorSettings, HumanSettings)> {
    let source = prop_oneof![
        Just(SourceKind::Simulated),
        Just(SourceKind::Keyboard),
        Just(SourceKind::Replayed)
    ];
    let kinds = [
        HumanKind::Pursuit,
        HumanKind::Intermittent,
        HumanKind::Lagged,
        HumanKind::Compensating,
    ];
    (any::<bool>(), source, 0..kinds.len(), 0..300_u32).prop_map(move |(real, source, kind, reaction_ms)| {
        let operator = OperatorSettings {
            source,
            ..OperatorSettings::default()
        };
        let human = HumanSettings {
            kind: kinds[kind],
            reaction_ms,
            ..HumanSettings::default()
        };
        (real, operator, human)
    })
}

/// A run of the node, and what it is checked against.
struct Run {
    rig: Rig,
    robot: Robot,
    pace: Pace,
    sent: Vec<Envelope<Command>>,
    missed: Option<u32>,
    stopped: bool,
}

impl Run {
    fn new(real: bool, operator: &OperatorSettings, human: &HumanSettings) -> Self {
        let timing = Timing::default();
        let timing = if real { timing } else { timing.lockstep() };
        Self {
            rig: Rig::new(timing, 1, operator, human),
            robot: Robot::default(),
            pace: timing.pace,
            sent: Vec::new(),
            missed: None,
            stopped: false,
        }
    }

    fn event(&mut self, happening: Happening) -> Event {
        match happening {
            Happening::State(glimpse) => Event::State(Box::new(self.state(&glimpse))),
            Happening::Bytes(topic, bytes) => Operator::event(Input::Sample { topic, bytes: &bytes }),
            Happening::Wake => Event::Wake,
            Happening::Presence(alive) => Event::Presence {
                peer: NodeName::Arbiter,
                alive,
            },
            Happening::Stop => Event::Stop,
            Happening::Missed(off) => Event::Missed {
                topic: Topic::State,
                tick: self.robot.header.tick.saturating_add(off),
            },
        }
    }

    fn state(&mut self, glimpse: &Glimpse) -> Envelope<tandem_wire::State> {
        let robot = &mut self.robot;
        // What it obeys was made from the state before.
        (robot.guidance, robot.weight) = (glimpse.guidance, glimpse.weight);
        robot.obey(&Command::default());
        robot.header.session = Session(glimpse.session);
        robot.header.tick = robot.header.tick.wrapping_sub(1).wrapping_add(glimpse.ticks);
        (robot.trial, robot.tool, robot.motion) = (glimpse.trial, glimpse.tool, glimpse.motion);
        robot.state()
    }

    fn step(&mut self, now: Stamp, event: Event) -> Vec<Output> {
        let stop = event == Event::Stop;
        // Every tick is answered once: by its state, or when that is known not to come.
        let asked = match &event {
            Event::State(state) => {
                Some(state.header.tick).filter(|tick| self.missed.is_none_or(|missed| *tick > missed))
            }
            Event::Missed { tick, .. } => Some(*tick),
            _ => None,
        };
        if let Event::Missed { tick, .. } = event {
            self.missed = Some(tick);
        }
        let refused = |rig: &Rig| rig.status.map_or(0, |status| status.refused.count);
        let before = refused(&self.rig);
        let outputs = self.rig.step(now, event);
        let commands = commands(&outputs);
        if self.pace == Pace::Lockstep {
            let answers = asked.filter(|_| refused(&self.rig) == before && !self.stopped);
            let ticks: Vec<_> = commands.iter().map(|command| command.header.tick).collect();
            assert_eq!(ticks, answers.into_iter().collect::<Vec<_>>());
        } else if self.stopped {
            assert!(commands.is_empty(), "silent after the end");
        }
        self.stopped |= stop;
        self.sent.extend(commands);
        outputs
    }
}

/// The promises that every stream of commands keeps.
fn check(sent: &[Envelope<Command>]) {
    let mut press_before = 0;
    for (command, seq) in sent.iter().zip(1..) {
        assert_eq!(command.header.seq, Seq(seq), "numbered without a gap");
        let Command {
            velocity,
            deadman,
            seen,
        } = command.body;
        assert!(velocity.is_finite() && velocity.norm() <= 0.5 + 1e-12, "{velocity:?}");
        match deadman {
            Deadman::Released => assert_eq!(velocity, Vec3::ZERO, "released and moving"),
            Deadman::Held { press } => {
                assert!(seen.is_some(), "driving blind");
                assert!(press >= press_before.max(1), "presses count up");
                press_before = press;
            }
        }
    }
    if let Some(first) = sent.first() {
        assert_eq!(first.body.deadman, Deadman::Released, "the first command is released");
    }
}

proptest! {
    #[test]
    fn any_sequence_of_events_keeps_the_promises(
        (real, operator, human) in settings(),
        happenings in proptest::collection::vec(happening(), 0..200),
    ) {
        let mut run = Run::new(real, &operator, &human);
        let mut now = 0;
        for (later, happening) in happenings {
            now += later * 1_000_000;
            let event = run.event(happening);
            run.step(Stamp(now), event);
        }
        check(&run.sent);
    }

    #[test]
    fn the_same_events_give_the_same_bytes(
        (real, operator, human) in settings(),
        happenings in proptest::collection::vec(happening(), 0..60),
    ) {
        let bytes = || {
            let mut run = Run::new(real, &operator, &human);
            let mut bytes = Vec::new();
            for (at, (later, happening)) in happenings.iter().cloned().enumerate() {
                let event = run.event(happening);
                for output in run.step(Stamp(at as u64 * 20_000_000 + later), event) {
                    let mut one = Vec::new();
                    if Operator::sample(&output, &mut one).is_some() {
                        bytes.push(one);
                    }
                }
            }
            bytes
        };
        prop_assert_eq!(bytes(), bytes());
    }

    #[test]
    fn a_silent_robot_or_keyboard_is_never_driven(
        presses in proptest::collection::vec((0..0x80_u8, 0..4_u8, 0..40_u64), 1..60),
        silence in 151_u64..1000,
    ) {
        let mut rig = Rig::keyboard();
        let (mut robot, mut now) = (Robot::default(), 0);
        for (keys, presses, later) in presses {
            now += later;
            let bytes = [3, keys, presses, 0, 0, 0, 0];
            let sample = DeviceSample::from_bytes(&bytes).expect("all seven keys are known");
            rig.step(Stamp(now * 1_000_000), Event::Device(sample));
            rig.step(Stamp(now * 1_000_000), Event::State(Box::new(robot.repeat())));
        }
        let after = Stamp((now + silence) * 1_000_000);
        for command in commands(&rig.step(after, Event::Wake)) {
            prop_assert_eq!(command.body.deadman, Deadman::Released);
        }
        // The robot speaks again, the keyboard does not.
        for command in commands(&rig.step(after, Event::State(Box::new(robot.repeat())))) {
            prop_assert_eq!(command.body.deadman, Deadman::Released);
        }
    }
}
