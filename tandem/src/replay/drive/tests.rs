//! A recorded path, driven over real Zenoh with a real arbiter and a real simulated robot.

use std::time::{Duration, Instant};

use crossbeam_channel::{Sender, never, unbounded};
use tandem_trials::Configuration;
use tandem_trials::drive::{Pause, Waypoint, Wish};
use tandem_wire::{Command, Deadman, MILLISECOND, Vec3};

use super::*;

/// Where the simulated arm stands.
const START: Vec3 = Vec3::new(0.5, -0.3, 0.15);

/// After so long it hangs, however busy the machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// A bow of eight centimetres in a second and a half, beginning this far from where the arm stands.
fn bow(offset: Vec3) -> Track {
    let points = (0..=75_u32).map(|step| {
        let part = f64::from(step) / 75.0;
        let (along, across) = (0.08 * part, 0.08 * part * (1.0 - part));
        Waypoint {
            at: u64::from(step) * 20 * MILLISECOND,
            tool: START + offset + Vec3::new(-across, along, 0.0),
        }
    });
    Track::through(points).expect("many points")
}

/// Arbiter and robot at work, and the parts of the operator that drives them.
struct Rig {
    edge: Link,
    remote: Link,
    arbiter: Running,
    robot: Running,
    parts: Parts,
}

impl Rig {
    fn start(name: &str) -> Self {
        let (edge, remote) = Link::open_pair(&name.parse().expect("a name")).expect("two sessions");
        let mut configuration = Configuration::default();
        configuration.operator.source = tandem_operator::SourceKind::Replayed;
        let parts = Parts::new(configuration, None).expect("the defaults fit");
        Self {
            arbiter: parts.arbiter(&edge).expect("an arbiter"),
            robot: parts.robot_sim(&edge).expect("a robot"),
            edge,
            remote,
            parts,
        }
    }

    /// Drives along `track`; `react` sees the driver at every step and may press keys.
    fn drive(
        &self,
        track: Track,
        mut react: impl FnMut(&Driver, &Sender<DriveKey>),
    ) -> (Driver, anyhow::Result<Ending>) {
        let (sender, keys) = unbounded();
        let settings = Configuration::default().replay;
        let mut driver = Driver::new(track, settings, 1000, Clock::of_process().now());
        let limit = Instant::now() + PATIENCE;
        let ending = drive(&self.parts, &self.remote, &mut driver, &keys, &never(), &mut |driver| {
            assert!(Instant::now() < limit, "{:?}", driver.phase());
            react(driver, &sender);
        });
        (driver, ending)
    }

    fn end(self) {
        for node in [self.arbiter, self.robot] {
            node.stop();
            assert!(node.join().is_some());
        }
        self.remote.close();
        self.edge.close();
    }
}

/// Presses once, as soon as there is something to press for.
fn go_once() -> impl FnMut(&Driver, &Sender<DriveKey>) {
    let mut pressed = false;
    move |driver, keys| {
        if driver.phase() == Phase::Waiting(Pause::Ready) && !std::mem::replace(&mut pressed, true) {
            keys.send(DriveKey::Wish(Wish::Go)).expect("the driver listens");
        }
    }
}

/// Presses whenever a wait begins, as a person who wants to get there would: a busy machine may hold the arm on the way.
fn keep_going() -> impl FnMut(&Driver, &Sender<DriveKey>) {
    let mut waited = false;
    move |driver, keys| {
        let waits = matches!(driver.phase(), Phase::Waiting(_));
        if waits && !std::mem::replace(&mut waited, waits) {
            keys.send(DriveKey::Wish(Wish::Go)).expect("the driver listens");
        }
        waited = waits;
    }
}

fn arrived(ending: &anyhow::Result<Ending>) -> bool {
    matches!(ending, Ok(Ending::Ended(End::Arrived)))
}

/// The commands that were published.
fn commands(observer: &Observer) -> Vec<Command> {
    let mut commands = Vec::new();
    while let Some(sighting) = observer.next(Duration::from_millis(200)) {
        if let Sighting::Sample {
            topic: Topic::Command,
            bytes,
            ..
        } = sighting
        {
            commands.extend(decode::<Command>(&bytes).map(|command| command.body));
        } else if commands.len() > 100_000 {
            break;
        }
    }
    commands
}

#[test]
fn a_robot_that_stands_at_the_start_is_driven_along_the_path() {
    let rig = Rig::start("driven");
    let (driver, ending) = rig.drive(bow(Vec3::ZERO), keep_going());
    assert!(arrived(&ending), "{ending:?}");
    let deviation = driver.deviation();
    assert!(deviation.count > 30, "{deviation:?}");
    assert!(deviation.largest < 0.005, "{deviation:?}");
    rig.end();
}

#[test]
fn a_robot_nearby_is_eased_in_and_one_far_away_refused_without_a_command_that_moves() {
    let rig = Rig::start("eased");
    let mut eased = false;
    let mut go = keep_going();
    let (driver, ending) = rig.drive(bow(Vec3::new(-0.03, 0.0, 0.02)), |driver, keys| {
        eased |= matches!(driver.phase(), Phase::Easing(_));
        go(driver, keys);
    });
    assert!(arrived(&ending) && eased, "{ending:?}");
    assert!(driver.deviation().largest < 0.008, "{:?}", driver.deviation());

    rig.end();

    // Another robot: the first one's operator may still be seen for a moment.
    let rig = Rig::start("refused");
    let observer = Observer::new(&rig.edge, Pace::Real).expect("an observer");
    let (_, ending) = rig.drive(bow(Vec3::new(0.0, 0.3, 0.0)), go_once());
    let Ok(Ending::Ended(end @ End::TooFar { .. })) = ending else {
        panic!("{ending:?}")
    };
    assert!(end.to_string().contains(" mm from the recorded position"), "{end}");
    rig.robot.stop();
    rig.arbiter.stop();
    let commands = commands(&observer);
    assert!(!commands.is_empty());
    for command in commands {
        assert_eq!((command.deadman, command.velocity), (Deadman::Released, Vec3::ZERO));
    }
    rig.end();
}

#[test]
fn it_stops_when_told_and_goes_on_only_when_pressed_again() {
    let rig = Rig::start("stopped");
    let mut go = keep_going();
    let mut stopped: Option<(Nanos, Stamp)> = None;
    let mut waited = false;
    let (driver, ending) = rig.drive(bow(Vec3::ZERO), |driver, keys| {
        let now = Clock::of_process().now();
        match (driver.phase(), stopped) {
            (Phase::Following, _) if driver.position() > SECOND / 2 && !waited => {
                assert!(stopped.is_none(), "it went on by itself");
                keys.send(DriveKey::Wish(Wish::Stop)).expect("the driver listens");
            }
            (Phase::Waiting(Pause::Stopped), None) => stopped = Some((driver.position(), now)),
            (Phase::Waiting(Pause::Stopped), Some((at, since))) => {
                assert_eq!(driver.position(), at, "the path waits");
                if now.since(since) > SECOND && !std::mem::replace(&mut waited, true) {
                    keys.send(DriveKey::Wish(Wish::Go)).expect("the driver listens");
                }
            }
            _ => go(driver, keys),
        }
    });
    assert!(arrived(&ending) && waited, "{ending:?}");
    assert!(driver.deviation().largest < 0.008, "{:?}", driver.deviation());
    rig.end();
}

#[test]
fn when_the_arbiter_vanishes_it_lets_go_and_stays_so() {
    let rig = Rig::start("held");
    let mut go = keep_going();
    let mut is_gone = false;
    let mut held: Option<Stamp> = None;
    let arbiter = &rig.arbiter;
    let (_, ending) = rig.drive(bow(Vec3::ZERO), |driver, keys| {
        let now = Clock::of_process().now();
        match (driver.phase(), held) {
            (Phase::Following, None) if driver.position() > SECOND / 2 => {
                is_gone = true;
                arbiter.stop();
            }
            (Phase::Waiting(Pause::Held(_)), None) if is_gone => held = Some(now),
            (phase, Some(since)) => {
                assert!(matches!(phase, Phase::Waiting(Pause::Held(_))), "{phase:?}");
                if now.since(since) > SECOND {
                    keys.send(DriveKey::Quit).expect("the driver listens");
                }
            }
            _ => go(driver, keys),
        }
    });
    assert!(matches!(ending, Ok(Ending::Left)), "{ending:?}");
    assert!(held.is_some());
    rig.end();
}

#[test]
fn a_robot_that_vanishes_ends_it_in_words() {
    let rig = Rig::start("gone");
    let mut go = keep_going();
    let robot = &rig.robot;
    let (_, ending) = rig.drive(bow(Vec3::ZERO), |driver, keys| {
        go(driver, keys);
        if driver.position() > SECOND / 2 {
            robot.stop();
        }
    });
    let Ok(Ending::Ended(end @ End::Silent { ever: true, .. })) = ending else {
        panic!("{ending:?}")
    };
    assert!(end.to_string().contains("has said nothing"), "{end}");
    rig.end();
}

#[test]
fn a_terminal_that_vanishes_lets_go_and_ends_it() {
    let rig = Rig::start("hung-up");
    let (sender, keys) = unbounded();
    let mut sender = Some(sender);
    let settings = Configuration::default().replay;
    let mut driver = Driver::new(bow(Vec3::ZERO), settings, 1000, Clock::of_process().now());
    let observer = Observer::new(&rig.edge, Pace::Real).expect("an observer");
    let mut go = keep_going();
    let limit = Instant::now() + PATIENCE;
    let ending = drive(&rig.parts, &rig.remote, &mut driver, &keys, &never(), &mut |driver| {
        assert!(Instant::now() < limit, "{:?}", driver.phase());
        if let Some(keys) = &sender {
            go(driver, keys);
        }
        if driver.position() > SECOND / 2 {
            sender = None;
        }
    });
    let gone = ending.expect_err("nobody holds it").to_string();
    assert!(gone.contains("the terminal has gone"), "{gone}");
    rig.robot.stop();
    rig.arbiter.stop();
    let commands = commands(&observer);
    assert!(commands.iter().any(|command| command.deadman != Deadman::Released));
    let last = commands.last().expect("commands");
    assert_eq!(last.deadman, Deadman::Released);
    rig.end();
}

#[test]
fn another_operator_is_not_talked_over() {
    let rig = Rig::start("taken");
    let other = rig.parts.operator(&rig.edge, |_| {}).expect("an operator");
    let (_, ending) = rig.drive(bow(Vec3::ZERO), go_once());
    let refused = ending.expect_err("it is taken").to_string();
    assert!(refused.contains("an operator is alive"), "{refused}");
    other.stop();
    assert!(other.join().is_some());
    rig.end();
}
