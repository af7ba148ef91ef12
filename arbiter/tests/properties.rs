//! Whatever happens, in whatever order: no panic, and what the arbiter promises holds.

mod support;

use proptest::prelude::*;
use support::*;
use tandem_arbiter::{Arbiter, ArbiterSettings, Event, LawName, Output};
use tandem_wire::{
    Command, Deadman, Envelope, Finite, Guidance, Input, Malformed, Motion, Node, Outbox, Ports, Proposal, Reason,
    Refusal, Session, Setpoint, State, Timing, Topic, Unreadable, Vec3, decode,
};

fn velocity() -> impl Strategy<Value = Vec3> {
    let component = prop_oneof![8 => -1.0..1.0_f64, 1 => any::<f64>()];
    [component.clone(), component.clone(), component].prop_map(Vec3::from)
}

/// What the operator's hand does; an honest operator numbers its presses upwards.
#[derive(Clone, Copy, Debug)]
enum Hand {
    Opens,
    Stays,
    PressesAnew,
}

fn hand() -> impl Strategy<Value = Hand> {
    prop_oneof![2 => Just(Hand::Opens), 8 => Just(Hand::Stays), 3 => Just(Hand::PressesAnew)]
}

/// Mostly the next number of an honest sender; sometimes anything.
fn number() -> impl Strategy<Value = Option<u64>> {
    prop_oneof![12 => Just(None), 1 => (0..40_u64).prop_map(Some), 1 => any::<u64>().prop_map(Some)]
}

#[derive(Clone, Debug)]
enum Doing {
    Command(Option<u64>, bool, Hand, Vec3),
    Proposal(Option<u64>, Option<(f64, f64, Vec3)>),
    State(Option<u64>, Vec3, u32),
    /// One of the three streams, so many ticks from the newest.
    Missed(usize, u32),
    Unreadable,
    Wake,
    Presence,
    Stop,
}

fn doing() -> impl Strategy<Value = Doing> {
    let ratio = || prop_oneof![6 => 0.5..2.0_f64, 1 => any::<f64>()];
    let guidance = proptest::option::of((ratio(), ratio(), velocity()));
    prop_oneof![
        30 => (number(), proptest::bool::weighted(0.05), hand(), velocity())
            .prop_map(|(number, other, hand, velocity)| Doing::Command(number, other, hand, velocity)),
        20 => (number(), guidance).prop_map(|(number, guidance)| Doing::Proposal(number, guidance)),
        30 => (number(), velocity(), prop_oneof![9 => Just(1), 1 => 0..3_u32])
            .prop_map(|(number, tool, trial)| Doing::State(number, tool, trial)),
        8 => (0..3_usize, prop_oneof![9 => 0..2_u32, 1 => any::<u32>()]).prop_map(|(which, off)| Doing::Missed(which, off)),
        2 => Just(Doing::Unreadable),
        10 => Just(Doing::Wake),
        1 => Just(Doing::Presence),
        1 => Just(Doing::Stop),
    ]
}

fn timeline() -> impl Strategy<Value = Vec<(u64, Doing)>> {
    let pause = prop_oneof![20 => 0..25_u64, 1 => 0..700_u64];
    proptest::collection::vec((pause, doing()), 1..200)
}

fn settings() -> impl Strategy<Value = ArbiterSettings> {
    let laws = [
        LawName::Adaptive,
        LawName::Fixed,
        LawName::Human,
        LawName::Robot,
        LawName::Constant,
        LawName::Attentive,
    ];
    (
        proptest::sample::select(laws.to_vec()),
        0.0..=1.0_f64,
        0.0..2.0_f64,
        any::<bool>(),
    )
        .prop_map(|(law, floor, fall, push)| ArbiterSettings {
            law,
            constant_weight: floor,
            weight_floor: floor,
            weight_fall_per_s: fall,
            yield_to_push: push,
            ..ArbiterSettings::default()
        })
}

/// Turns what the senders do into events, numbering honestly unless told otherwise.
#[derive(Default)]
struct Senders {
    commands: u64,
    proposals: u64,
    states: u64,
    deadman: Deadman,
    presses: u32,
}

impl Senders {
    fn move_hand(&mut self, hand: Hand) -> Deadman {
        match hand {
            Hand::Opens => self.deadman = Deadman::Released,
            Hand::Stays => {}
            Hand::PressesAnew => {
                self.presses += 1;
                self.deadman = held(self.presses);
            }
        }
        self.deadman
    }

    fn event(&mut self, doing: &Doing) -> Event {
        let tick = |states: u64| u32::try_from(states / 5).expect("timelines are short");
        let next = |count: &mut u64, number: &Option<u64>| {
            *count += 1;
            number.unwrap_or(*count)
        };
        let seen = Some(id(ROBOT, self.states));
        match doing {
            Doing::Command(number, other, hand, velocity) => {
                let seq = next(&mut self.commands, number);
                let deadman = self.move_hand(*hand);
                let mut sent: Envelope<Command> = command(seq, tick(self.states), deadman, *velocity);
                sent.body.seen = seen;
                if *other {
                    sent.header.session = Session(77);
                }
                Event::Command(sent)
            }
            Doing::Proposal(number, wanted) => {
                let seq = next(&mut self.proposals, number);
                let guidance = wanted.map(|(ratio, high, velocity)| Guidance {
                    ratio_high: Finite(high),
                    ..guidance(ratio, velocity)
                });
                let mut sent: Envelope<Proposal> = proposal(seq, tick(self.states), guidance);
                sent.body.seen = seen;
                Event::Proposal(sent)
            }
            Doing::State(number, tool, trial) => {
                let seq = next(&mut self.states, number);
                let mut sent: Envelope<State> = state(seq, tick(self.states), *tool);
                sent.body.trial = *trial;
                Event::State(sent)
            }
            Doing::Missed(which, off) => Event::Missed {
                topic: [Topic::Command, Topic::Proposal, Topic::State][*which],
                tick: tick(self.states).saturating_add(*off),
            },
            Doing::Unreadable => Event::Unreadable(Unreadable {
                topic: Topic::Command,
                why: Malformed::NotFinite,
            }),
            Doing::Wake => Event::Wake,
            Doing::Presence => Event::Presence,
            Doing::Stop => Event::Stop,
        }
    }
}

/// Runs a timeline; every setpoint with the event that caused it.
fn run(timing: Timing, settings: &ArbiterSettings, timeline: &[(u64, Doing)]) -> Vec<(Event, Envelope<Setpoint>)> {
    let mut arbiter = Arbiter::new(Session(3), timing, settings).expect("the workspace is not turned over");
    let (mut senders, mut outbox, mut millis, mut told) = (Senders::default(), Outbox::default(), 0, Vec::new());
    for (pause, doing) in timeline {
        millis += pause;
        let event = senders.event(doing);
        arbiter.step(at(millis), event.clone(), &mut outbox);
        told.extend(
            outbox
                .drain()
                .map(|Output::Setpoint(setpoint)| (event.clone(), setpoint)),
        );
    }
    told
}

/// Presses that must not count, told from the setpoints alone: after a stop, the press that was held then.
#[derive(Default)]
struct Spent {
    last: Option<u32>,
    spent: Option<u32>,
}

impl Spent {
    fn check(&mut self, motion: Motion) -> Result<(), TestCaseError> {
        match motion {
            Motion::Permitted { press } => {
                prop_assert_ne!(Some(press), self.spent);
                (self.last, self.spent) = (Some(press), None);
            }
            Motion::Held(Reason::DeadmanReleased) => *self = Self::default(),
            Motion::Held(_) => self.spent = self.spent.or(self.last),
        }
        Ok(())
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_setpoint_keeps_the_promises(settings in settings(), timeline in timeline(), lockstep in any::<bool>()) {
        let timing = if lockstep { Timing::default().lockstep() } else { Timing::default() };
        let (mut spent, mut bytes, mut closed) = (Spent::default(), Vec::new(), false);
        for (index, (event, setpoint)) in run(timing, &settings, &timeline).iter().enumerate() {
            prop_assert!(!closed, "a closed arbiter speaks");
            Arbiter::sample(&Output::Setpoint(*setpoint), &mut bytes);
            prop_assert_eq!(decode::<Setpoint>(&bytes), Ok(*setpoint));
            prop_assert_eq!(setpoint.header.seq.0, index as u64 + 1);
            let body = &setpoint.body;
            prop_assert!((0.0..=1.0).contains(&body.weight.0));
            prop_assert!(body.guidance.is_some() || body.weight.0 == 1.0, "shared without guidance");
            prop_assert!(body.velocity.norm() <= settings.tool_speed_m_s + 1e-9);
            prop_assert!(body.motion.is_permitted() || body.velocity == Vec3::ZERO);
            if !lockstep {
                spent.check(body.motion)?;
            }
            if let (Motion::Permitted { press }, Event::Command(command)) = (body.motion, event) {
                prop_assert!(lockstep || command.body.deadman == held(press));
            }
            closed = body.motion == Motion::Held(Reason::ShuttingDown);
        }
    }

    #[test]
    fn only_an_admitted_command_permits_motion(settings in settings(), timeline in timeline()) {
        let mut permitted = false;
        for (event, setpoint) in run(Timing::default(), &settings, &timeline) {
            let now = setpoint.body.motion.is_permitted();
            prop_assert!(permitted || !now || matches!(event, Event::Command(_)));
            permitted = now;
        }
    }

    #[test]
    fn waking_at_the_deadlines_always_moves_them_on(timeline in timeline()) {
        let mut stage = Stage::new(Timing::default(), &ArbiterSettings::default());
        let (mut senders, mut millis) = (Senders::default(), 0);
        for (pause, doing) in &timeline {
            millis += pause;
            stage.step(at(millis), senders.event(doing));
        }
        let silent = |gap: &&[Envelope<Setpoint>]| gap[1].header.sent.since(gap[0].header.sent) > 121 * 1_000_000;
        prop_assert_eq!(stage.setpoints.windows(2).filter(silent).count(), 0);
    }

    #[test]
    fn any_bytes_on_any_topic_are_an_event(bytes in proptest::collection::vec(any::<u8>(), 0..300), topic in 0..8_usize) {
        let topics = [
            Topic::Command, Topic::Proposal, Topic::State, Topic::Setpoint, Topic::Forecast, Topic::Scene, Topic::Trial,
            Topic::Device,
        ];
        let event = Arbiter::event(Input::Sample { topic: topics[topic], bytes: &bytes });
        prop_assert!(matches!(event, Event::Unreadable(_)));
        let settings = ArbiterSettings::default();
        let mut arbiter = Arbiter::new(Session(3), Timing::default(), &settings).unwrap();
        let mut outbox = Outbox::default();
        arbiter.step(at(1), event, &mut outbox);
        arbiter.step(at(2), Event::Wake, &mut outbox);
        let Output::Setpoint(setpoint) = outbox.as_slice()[0];
        prop_assert_eq!(setpoint.body.refused.last, Some(Refusal::Unreadable));
    }
}
