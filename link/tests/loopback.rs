//! One node, real Zenoh, two sessions joined by TCP over loopback.

use std::sync::mpsc::channel;
use std::time::Duration;

use tandem_link::{
    Clock, ClockSettings, Faults, Impairments, Link, Observer, ShellOptions, Sighting, SpoolOptions, fresh_session,
    measure_clocks, spawn,
};
use tandem_wire::codec::to_bytes;
use tandem_wire::{
    ClockReport, Command, Deadman, Envelope, Header, Input, JournalBatch, Malformed, Memory, Node, NodeInfo, NodeName,
    Numbering, Outbox, Pace, Ports, Remember, Seq, Session, Stamp, Timing, Topic, Trial, Turn, Vec3, decode, encode,
};

const LIMIT: Duration = Duration::from_secs(10);

fn options(session: Session) -> ShellOptions {
    ShellOptions {
        timing: Timing::default(),
        info: NodeInfo {
            session,
            build: "test".into(),
            ..NodeInfo::default()
        },
        await_peers: vec![],
        spool: SpoolOptions::default(),
        clocks: ClockSettings {
            every_ms: 20,
            ..ClockSettings::default()
        },
        faults: Faults::default(),
        impairment: Impairments::default(),
        queue: ShellOptions::QUEUE,
    }
}

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
    const TURN: Turn = Turn::OnArrival;
    const INPUTS: &'static [Topic] = &[Topic::Trial];
    const OUTPUTS: &'static [Topic] = &[Topic::Command];

    fn event(input: Input<'_>) -> Heard {
        match input {
            Input::Sample {
                topic: Topic::Trial | Topic::Device,
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

fn trial(number: u32) -> Vec<u8> {
    let header = Header {
        tick: 0,
        session: Session(1),
        seq: Seq(1),
        sent: Clock::of_process().now(),
    };
    let label = "one of several".into();
    let mut bytes = Vec::new();
    encode(
        &Envelope {
            header,
            body: Trial::Begin { number, label },
        },
        &mut bytes,
    );
    bytes
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
    let running = spawn(&remote, Echo(Numbering::new(session)), options(session), |_, _| {}).unwrap();
    let alive = std::iter::from_fn(|| observer.next(LIMIT));
    assert!(alive.into_iter().any(|sighting| matches!(
        sighting,
        Sighting::Presence {
            peer: NodeName::Operator,
            alive: true
        }
    )));

    let bytes = trial(7);
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

#[test]
fn whoever_finds_a_node_at_work_has_their_input_taken_up_all_the_same() {
    const THREADS: u32 = 4;
    const EACH: u32 = 500;
    let robot = "at-work".parse().unwrap();
    let (edge, remote) = Link::open_pair(&robot).unwrap();
    let session = fresh_session();
    let (answer, answers): (Vec<_>, Vec<_>) = (0..THREADS).map(|_| channel()).unzip();
    let local = move |_, output: Envelope<Command>| {
        if let Deadman::Held { press } = output.body.deadman {
            let _ = answer[(press / EACH) as usize].send(press);
        }
    };
    let running = spawn(&remote, Echo(Numbering::new(session)), options(session), local).unwrap();
    std::thread::scope(|scope| {
        for (thread, answers) in (0..THREADS).zip(answers) {
            let device = running.device();
            scope.spawn(move || {
                // Each input waits for the last one's answer: one that was left lying would end this.
                for number in thread * EACH..(thread + 1) * EACH {
                    assert!(device.send(trial(number)));
                    assert_eq!(answers.recv_timeout(LIMIT), Ok(number));
                }
            });
        }
    });
    running.stop();
    let report = running.join().unwrap();
    assert_eq!(report.dropped, 0);
    remote.close();
    edge.close();
}

#[test]
fn two_nodes_in_one_process_find_their_clocks_together_within_the_uncertainty() {
    let robot = "clocks".parse().unwrap();
    let (edge, remote) = Link::open_pair(&robot).unwrap();
    let observer = Observer::new(&edge, Pace::Real).unwrap();
    let sessions = [fresh_session(), fresh_session()];
    let start = |link, session| spawn(link, Echo(Numbering::new(session)), options(session), |_, _| {}).unwrap();
    let running = [start(&edge, sessions[0]), start(&remote, sessions[1])];
    // Both run under one name, as when two operators are there at once; each tells of the other.
    let mut told = Vec::new();
    while told.len() < 2 {
        let bytes = next_on(&observer, Topic::Clock(NodeName::Operator));
        let report = decode::<ClockReport>(&bytes).unwrap();
        let peers = report.body.peers.iter().map(|peer| (report.header.session, *peer));
        told.extend(
            peers
                .filter(|(by, _)| told.iter().all(|(before, _)| before != by))
                .collect::<Vec<_>>(),
        );
    }
    for (by, peer) in told {
        assert!(sessions.contains(&by) && sessions.contains(&peer.session) && by != peer.session);
        // One process has one clock, so the true offset is zero; so is the wall clocks' skew, but for when they are read.
        assert!(peer.offset.unsigned_abs() <= peer.uncertainty, "{peer:?}");
        assert!(peer.round_trip > 0 && peer.samples > 0 && !peer.is_skewed, "{peer:?}");
    }
    let seen = measure_clocks(&edge, &robot, &ClockSettings::default(), 5, Duration::from_millis(100));
    assert_eq!(seen.len(), 2, "{seen:?}");
    assert!(
        seen.iter().all(|peer| peer.offset.unsigned_abs() <= peer.uncertainty),
        "{seen:?}"
    );
    for node in running {
        node.stop();
        assert!(node.join().is_some());
    }
    remote.close();
    edge.close();
}
