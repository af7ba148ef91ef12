//! One node, real Zenoh, two sessions joined by TCP over loopback.

use std::time::Duration;

use tandem_link::{
    Clock, Faults, Impairments, Link, Observer, ShellOptions, Sighting, SpoolOptions, fresh_session, spawn,
};
use tandem_wire::codec::to_bytes;
use tandem_wire::{
    Command, Deadman, Envelope, Header, Input, JournalBatch, Malformed, Memory, Node, NodeInfo, NodeName, Numbering,
    Outbox, Pace, Ports, Remember, Seq, Session, Stamp, Timing, Topic, Trial, Vec3, decode, encode,
};

const LIMIT: Duration = Duration::from_secs(10);

/// Answers every trial's mark with a command that carries its number, and says goodbye with a released deadman.
struct Echo(Numbering);

enum Heard {
    Trial(u32),
    Stop,
    Other,
}

impl Node for Echo {
    type Event = Heard;
    type Output = Envelope<Command>;

    fn step(&mut self, now: Stamp, event: Heard, outbox: &mut Outbox<Self::Output>) {
        let deadman = match event {
            Heard::Trial(number) => Deadman::Held { press: number },
            Heard::Stop => Deadman::Released,
            Heard::Other => return,
        };
        let velocity = Vec3::new(0.25, -0.5, 0.0);
        outbox.push(self.0.envelope(
            now,
            3,
            Command {
                velocity,
                deadman,
                seen: None,
            },
        ));
    }

    fn deadline(&self) -> Option<Stamp> {
        None
    }

    fn trial(&self) -> u32 {
        0
    }
}

impl Remember for Echo {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        self.0.remember(memory)
    }
}

impl Ports for Echo {
    const NAME: NodeName = NodeName::Operator;
    const INPUTS: &'static [Topic] = &[Topic::Trial];
    const OUTPUTS: &'static [Topic] = &[Topic::Command];

    fn event(input: Input<'_>) -> Heard {
        match input {
            Input::Sample {
                topic: Topic::Trial,
                bytes,
            } => match decode::<Trial>(bytes).map(|trial| trial.body) {
                Ok(Trial::Begin { number, .. }) => Heard::Trial(number),
                _ => Heard::Other,
            },
            Input::Stop => Heard::Stop,
            _ => Heard::Other,
        }
    }

    fn sample(output: &Self::Output, bytes: &mut Vec<u8>) -> Option<Topic> {
        encode(output, bytes);
        Some(Topic::Command)
    }
}

fn next_on(observer: &Observer, wanted: Topic) -> Vec<u8> {
    loop {
        match observer.next(LIMIT).expect("a message within ten seconds") {
            Sighting::Sample { topic, bytes, .. } if topic == wanted => return bytes,
            _ => {}
        }
    }
}

#[test]
fn a_node_answers_over_real_zenoh_and_its_journal_says_so() {
    let robot = "loopback".parse().unwrap();
    let (edge, remote) = Link::open_pair(&robot).unwrap();
    let observer = Observer::new(&edge, Pace::Real).unwrap();
    let session = fresh_session();
    let options = ShellOptions {
        timing: Timing::default(),
        info: NodeInfo {
            session,
            build: "test".into(),
            ..NodeInfo::default()
        },
        await_peers: vec![],
        spool: SpoolOptions::default(),
        faults: Faults::default(),
        impairment: Impairments::default(),
        queue: ShellOptions::QUEUE,
    };
    let running = spawn(&remote, Echo(Numbering::new(session)), options, |_, _| {}).unwrap();
    let alive = std::iter::from_fn(|| observer.next(LIMIT));
    assert!(alive.into_iter().any(|sighting| matches!(
        sighting,
        Sighting::Presence {
            peer: NodeName::Operator,
            alive: true
        }
    )));

    let mut bytes = Vec::new();
    let header = Header {
        tick: 0,
        session: Session(1),
        seq: Seq(1),
        sent: Clock::of_process().now(),
    };
    encode(
        &Envelope {
            header,
            body: Trial::Begin {
                number: 7,
                label: "seven".into(),
            },
        },
        &mut bytes,
    );
    edge.publish(Topic::Trial, bytes.clone()).unwrap();
    let command = decode::<Command>(&next_on(&observer, Topic::Command)).unwrap();
    assert_eq!(command.body.deadman, Deadman::Held { press: 7 });
    assert_eq!(
        (command.header.session, command.header.seq, command.header.tick),
        (session, Seq(1), 3)
    );

    running.stop();
    assert_eq!(
        decode::<Command>(&next_on(&observer, Topic::Command))
            .unwrap()
            .body
            .deadman,
        Deadman::Released
    );
    let report = running.join().unwrap();
    assert_eq!((report.dropped, report.journal.lost), (0, 0));

    let mut entries = Vec::new();
    while (entries.len() as u64) < report.journal.entries {
        let batch = decode::<JournalBatch>(&next_on(&observer, Topic::Journal(NodeName::Operator)))
            .unwrap()
            .body;
        assert_eq!(batch.first, entries.len() as u64);
        entries.extend(batch.entries);
    }
    assert!(
        entries
            .iter()
            .any(|entry| to_bytes(&entry.what).windows(bytes.len()).any(|window| window == bytes))
    );
    remote.close();
    edge.close();
}
