//! Whatever happens, in whatever order: no panic, and what the predictor promises holds.

mod support;

use proptest::prelude::*;
use support::*;
use tandem_predictor::{Event, Output, Predictor};
use tandem_wire::{Forecast, Input, Malformed, Motion, Ports, Proposal, Session, Timing, Topic, Unreadable, decode};

#[derive(Clone, Debug)]
enum Doing {
    /// The tool moves on by so much, so many ticks later; sometimes anywhere.
    Moves([f64; 2], u32, bool),
    Jumps([f64; 2]),
    Trial(u32),
    /// A state with any number, of any run.
    Odd(u64, u64, u32),
    /// The state of a tick so far from the newest does not come.
    Missed(u32),
    Other(u8),
}

fn doing() -> impl Strategy<Value = Doing> {
    let step = [-0.01..0.03_f64, -0.01..0.01_f64];
    prop_oneof![
        30 => (step, 0..3_u32, proptest::bool::weighted(0.9)).prop_map(|(by, ticks, moving)| Doing::Moves(by, ticks, moving)),
        1 => [any::<f64>(), any::<f64>()].prop_map(Doing::Jumps),
        1 => [0.0..0.6_f64, -0.2..0.2_f64].prop_map(Doing::Jumps),
        1 => (0..4_u32).prop_map(Doing::Trial),
        2 => (any::<u64>(), 0..3_u64, any::<u32>()).prop_map(|(seq, session, tick)| Doing::Odd(seq, session, tick)),
        4 => prop_oneof![9 => 0..3_u32, 1 => any::<u32>()].prop_map(Doing::Missed),
        2 => (0..4_u8).prop_map(Doing::Other),
    ]
}

/// The place of the tool, as events change it.
struct World {
    seq: u64,
    tick: u32,
    at: [f64; 2],
    motion: Motion,
    trial: u32,
}

impl World {
    fn event(&mut self, doing: &Doing) -> Event {
        match doing {
            Doing::Moves(by, ticks, moving) => {
                self.tick += ticks;
                self.at = [self.at[0] + by[0], self.at[1] + by[1]];
                self.motion = if *moving { MOVING } else { HELD };
            }
            Doing::Jumps(to) => self.at = *to,
            Doing::Trial(number) => self.trial = *number,
            Doing::Odd(seq, session, tick) => {
                let mut odd = state(*seq, *tick, self.at, self.motion);
                odd.header.session = Session(*session);
                return Event::State(odd);
            }
            Doing::Missed(off) => {
                let (topic, tick) = (Topic::State, self.tick.saturating_add(*off));
                return Event::Missed { topic, tick };
            }
            Doing::Other(which) => {
                let (topic, why) = (Topic::State, Malformed::Body);
                let unreadable = Event::Unreadable(Unreadable { topic, why });
                return [unreadable, Event::Wake, Event::Presence, Event::Stop][usize::from(*which)].clone();
            }
        }
        self.seq += 1;
        let mut next = state(self.seq, self.tick, self.at, self.motion);
        next.body.trial = self.trial;
        Event::State(next)
    }
}

fn check(output: &Output) -> Result<(), TestCaseError> {
    let mut bytes = Vec::new();
    let topic = Predictor::sample(output, &mut bytes);
    match output {
        Output::Forecast(forecast) => {
            prop_assert_eq!(topic, Some(Topic::Forecast));
            prop_assert_eq!(&decode::<Forecast>(&bytes).expect("it is ours"), forecast);
            prop_assert!(!forecast.body.points.is_empty());
        }
        Output::Proposal(proposal) => {
            prop_assert_eq!(topic, Some(Topic::Proposal));
            prop_assert_eq!(&decode::<Proposal>(&bytes).expect("it is ours"), proposal);
            if let Some(guidance) = proposal.body.guidance {
                prop_assert!(guidance.velocity.norm() <= 0.5 + 1e-12);
                prop_assert!((41.0..=83.0).contains(&guidance.phase.0));
            }
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_admitted_state_and_in_lockstep_every_missed_one_has_one_finite_answer(
        anew in any::<bool>(), lockstep in any::<bool>(), timeline in proptest::collection::vec(doing(), 1..150),
    ) {
        let model = if anew { replanning_model() } else { model() };
        let timing = if lockstep { Timing::default().lockstep() } else { Timing::default() };
        let mut stage = Stage::with(timing, model);
        let mut world = World { seq: 0, tick: 0, at: [0.2, 0.1], motion: MOVING, trial: 1 };
        let (mut proposals, mut phase, mut missed) = (0, None, None);
        for (index, doing) in timeline.iter().enumerate() {
            let event = world.event(doing);
            let (refused, said) = (stage.predictor.refused().count, stage.said.len());
            stage.event(20 * index as u64, event.clone());
            let admitted = matches!(event, Event::State(_)) && stage.predictor.refused().count == refused;
            let answers = &stage.said[said..];
            let asked = match &event {
                Event::State(state) => admitted && missed.is_none_or(|missed| state.header.tick > missed),
                Event::Missed { tick, .. } if lockstep => {
                    missed = Some(*tick);
                    true
                }
                _ => false,
            };
            prop_assert_eq!(matches!(answers.last(), Some(Output::Proposal(_))), asked);
            if admitted && !asked {
                // A late state may have moved the phase on, unseen from here.
                phase = None;
            }
            prop_assert!(answers.len() <= 2);
            answers.iter().try_for_each(check)?;
            if let Some(Output::Proposal(proposal)) = answers.last() {
                proposals += 1;
                prop_assert_eq!(proposal.header.seq.0, proposals);
            }
            if let (Some(Output::Proposal(proposal)), Event::State(state)) = (answers.last(), &event) {
                prop_assert_eq!(proposal.body.seen, Some(state.header.id()));
                let now = proposal.body.guidance.map(|guidance| (guidance.forecast, guidance.phase.0));
                if let (Some((before, then)), Some((forecast, phase))) = (phase, now) && before == forecast {
                    prop_assert!(phase >= then, "the phase went back");
                    prop_assert!(phase == then || state.body.motion.is_permitted(), "the phase moved on while held");
                }
                phase = now;
            }
        }
    }

    #[test]
    fn any_bytes_on_any_topic_are_an_event(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        for topic in [Topic::State, Topic::Command, Topic::Proposal, Topic::Device] {
            let event = Predictor::event(Input::Sample { topic, bytes: &bytes });
            prop_assert!(matches!(event, Event::Unreadable(_)));
        }
    }
}
