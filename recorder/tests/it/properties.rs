//! Any events in any order: no panic, and what is promised holds.

use crate::script::session;
use proptest::collection::vec;
use proptest::prelude::*;
use tandem_recorder::{Drops, Entry, Event, Output, Recorder, View};
use tandem_wire::{Input, Node, NodeName, Outbox, Ports, Stamp, Timing, Topic};

/// What may happen: a sample of the session, perhaps damaged, bytes from nowhere, and everything else.
#[derive(Clone, Debug)]
enum Happens {
    Sample {
        index: usize,
        damage: Option<(usize, u8)>,
        cut: usize,
    },
    Noise {
        topic: usize,
        bytes: Vec<u8>,
    },
    Wake,
    Presence(bool),
    Stop,
}

fn happens() -> impl Strategy<Value = Happens> {
    let damage = proptest::option::weighted(0.3, (any::<usize>(), any::<u8>()));
    prop_oneof![
        20 => (any::<usize>(), damage, prop_oneof![9 => Just(0_usize), 1 => 0_usize..64])
            .prop_map(|(index, damage, cut)| Happens::Sample { index, damage, cut }),
        4 => (any::<usize>(), vec(any::<u8>(), 0..200)).prop_map(|(topic, bytes)| Happens::Noise { topic, bytes }),
        2 => Just(Happens::Wake),
        1 => any::<bool>().prop_map(Happens::Presence),
        1 => Just(Happens::Stop),
    ]
}

fn event(what: &Happens, samples: &[crate::script::Sample]) -> Event {
    match what {
        Happens::Sample { index, damage, cut } => {
            let sample = &samples[index % samples.len()];
            let mut bytes = sample.bytes.clone();
            bytes.truncate(bytes.len().saturating_sub(*cut));
            if let Some((at, flip)) = damage
                && !bytes.is_empty()
            {
                let at = at % bytes.len();
                bytes[at] ^= flip;
            }
            Recorder::event(Input::Sample {
                topic: sample.topic,
                bytes: &bytes,
            })
        }
        Happens::Noise { topic, bytes } => {
            let topic = Recorder::INPUTS[topic % Recorder::INPUTS.len()];
            Recorder::event(Input::Sample { topic, bytes })
        }
        Happens::Wake => Recorder::event(Input::Wake),
        Happens::Presence(alive) => Recorder::event(Input::Presence {
            peer: NodeName::Arbiter,
            alive: *alive,
        }),
        Happens::Stop => Recorder::event(Input::Stop),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_readable_sample_is_written_once_and_everything_can_be_drawn(
        story in vec((happens(), 0_u64..2_000_000_000), 1..120),
    ) {
        let samples = session();
        let timing = Timing::default();
        let (mut recorder, mut view) = (Recorder::new(timing), View::new(timing));
        let (mut outbox, mut drawings) = (Outbox::default(), Vec::new());
        let (mut now, mut readable, mut written, mut stopped) = (Stamp(0), 0, 0, false);
        for (what, later) in &story {
            now = now.after(*later);
            let event = event(what, &samples);
            let ended = stopped && !recorder.lingers();
            if matches!(event, Event::Sample(_)) && !ended {
                readable += 1;
            }
            stopped |= event == Event::Stop;
            recorder.step(now, event, &mut outbox);
            for output in outbox.drain() {
                match output {
                    Output::Write(heard) => written += usize::from(matches!(heard.entry, Entry::Sample(_))),
                    Output::Show(heard) => view.draw(&heard, Drops::default(), &mut drawings),
                    Output::Ask(_) => {}
                    Output::Say(_) => {}
                }
            }
            prop_assert!(recorder.deadline().is_none_or(|due| due > now || stopped));
        }
        prop_assert_eq!(written, readable);
        prop_assert!(drawings.iter().all(|drawing| !drawing.batches.is_empty()));
    }

    #[test]
    fn the_same_events_give_the_same_outputs(story in vec((happens(), 0_u64..1_000_000_000), 1..60)) {
        let samples = session();
        let run = || {
            let mut recorder = Recorder::new(Timing::default().lockstep());
            let (mut outbox, mut outputs, mut now) = (Outbox::default(), Vec::new(), Stamp(0));
            for (what, later) in &story {
                now = now.after(*later);
                recorder.step(now, event(what, &samples), &mut outbox);
                outputs.extend(outbox.drain());
            }
            outputs
        };
        prop_assert_eq!(run(), run());
    }

    #[test]
    fn any_bytes_on_any_topic_become_an_event(bytes in vec(any::<u8>(), 0..400), node in 0_usize..5) {
        let node = NodeName::ALL[node];
        for topic in [Topic::State, Topic::Alive(node), Topic::Journal(node), Topic::Info(node), Topic::Device] {
            let _ = Recorder::event(Input::Sample { topic, bytes: &bytes });
        }
    }
}
