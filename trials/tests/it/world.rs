//! A trial under virtual time is the trial that the shell runs over Zenoh in lockstep.

use std::ops::ControlFlow;
use std::time::Duration;

use crate::support::{configuration, model, over, replanning_model};
use tandem_link::{ClockSettings, Faults, Link, Observer, Running, ShellOptions, Sighting, SpoolOptions, spawn};
use tandem_trials::{Blueprint, Configuration, Halt, World};
use tandem_wire::{
    Forecast, NodeInfo, NodeName, Numbering, Pace, Ports, SECOND, Session, State, Topic, Trial, decode, encode,
};

const LOOP: [NodeName; 4] = [
    NodeName::Operator,
    NodeName::Predictor,
    NodeName::Arbiter,
    NodeName::RobotSim,
];
const LIMIT: Duration = Duration::from_secs(10);
/// Longer than any simulated human keeps trying.
const PATIENCE: u64 = 60 * SECOND;

fn begin() -> Trial {
    Trial::Begin {
        number: 1,
        label: "world".into(),
    }
}

type Messages = Vec<(Topic, Vec<u8>)>;

/// Everything that was said about one trial, up to its end.
fn in_the_world(blueprint: &Blueprint) -> Messages {
    let mut world = World::new(blueprint).expect("the defaults fit");
    let (mut messages, mut over) = (Messages::new(), over());
    world.mark(begin());
    let halt = world.run(PATIENCE, |_, topic, bytes| {
        if topic != Topic::Trial {
            messages.push((topic, bytes.to_vec()));
        }
        if over(topic, bytes) {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    });
    assert_eq!(halt, Halt::Watched);
    messages
}

fn start<N: Ports + Send + 'static>(link: &Link, blueprint: &Blueprint, node: N) -> Running
where
    N::Output: Send,
{
    let options = ShellOptions {
        timing: blueprint.timing(),
        info: NodeInfo {
            session: blueprint.session(),
            ..NodeInfo::default()
        },
        await_peers: LOOP.into_iter().filter(|name| *name != N::NAME).collect(),
        spool: SpoolOptions::default(),
        clocks: ClockSettings::default(),
        faults: Faults::default(),
        impairment: blueprint.configuration().impairment.clone(),
        queue: ShellOptions::QUEUE,
    };
    spawn(link, node, options, |_, _| {}).expect("a node starts")
}

/// The same through real Zenoh, the operator on its own side of a TCP connection, as in `tandem demo`.
fn over_zenoh(blueprint: &Blueprint) -> Messages {
    let (edge, remote) = Link::open_pair(&"world".parse().expect("a name")).expect("loopback");
    let observer = Observer::new(&edge, Pace::Lockstep).expect("an observer");
    let players = [
        start(&remote, blueprint, blueprint.operator()),
        start(&edge, blueprint, blueprint.predictor().expect("it fits")),
        start(&edge, blueprint, blueprint.arbiter().expect("it fits")),
        start(&edge, blueprint, blueprint.robot_sim().expect("it fits")),
    ];
    let mut missing = LOOP.to_vec();
    while !missing.is_empty() {
        if let Sighting::Presence { peer, alive: true } = observer.next(LIMIT).expect("all come up") {
            missing.retain(|name| *name != peer);
        }
    }
    let mut bytes = Vec::new();
    encode(
        &Numbering::new(Session(99)).envelope(tandem_wire::Stamp(5), 0, begin()),
        &mut bytes,
    );
    edge.publish(Topic::Trial, bytes).expect("a mark");
    let (mut messages, mut over) = (Messages::new(), over());
    loop {
        let Sighting::Sample { topic, bytes, .. } = observer.next(LIMIT).expect("the loop goes on") else {
            continue;
        };
        let ends = over(topic, &bytes);
        messages.push((topic, bytes));
        if ends {
            break;
        }
    }
    players.iter().for_each(Running::stop);
    for player in players {
        assert!(player.join().is_some(), "a node panicked");
    }
    remote.close();
    edge.close();
    messages
}

fn only(messages: &Messages, wanted: Topic) -> Vec<&[u8]> {
    let of_topic = messages.iter().filter(|(topic, _)| *topic == wanted);
    of_topic.map(|(_, bytes)| bytes.as_slice()).collect()
}

fn blueprint(configuration: Configuration) -> Blueprint {
    Blueprint::new(configuration, Session(7), Some(model())).expect("the defaults fit")
}

#[test]
fn a_trial_in_the_world_is_byte_for_byte_the_trial_over_zenoh() {
    let here = same_over_zenoh(&blueprint(configuration()));
    assert_eq!(only(&here, Topic::Forecast).len(), 1);
}

#[test]
fn so_is_one_that_is_conditioned_anew_on_every_tick_to_the_goal() {
    let mut configuration = configuration();
    configuration.human.departure_mm = 20.0;
    let blueprint = Blueprint::new(configuration, Session(7), Some(replanning_model())).expect("the defaults fit");
    let here = same_over_zenoh(&blueprint);
    let forecasts = only(&here, Topic::Forecast);
    assert!(forecasts.len() > 35, "{}", forecasts.len());
    for (number, bytes) in (1..).zip(forecasts) {
        let forecast = decode::<Forecast>(bytes).expect("ours").body;
        assert_eq!((forecast.number, forecast.context.len()), (number, 3));
    }
    let states = only(&here, Topic::State);
    let last = decode::<State>(states.last().expect("states")).expect("a state");
    let goal = tandem_wire::Vec3::new(0.5, 0.3, 0.15);
    assert!((last.body.tool.position - goal).norm() < 0.01);
}

/// Runs it in the world and over Zenoh, and compares; what was said in the world.
fn same_over_zenoh(blueprint: &Blueprint) -> Messages {
    let (here, there) = (in_the_world(blueprint), over_zenoh(blueprint));
    for topic in [
        Topic::State,
        Topic::Command,
        Topic::Proposal,
        Topic::Forecast,
        Topic::Setpoint,
        Topic::Scene,
    ] {
        let (here, there) = (only(&here, topic), only(&there, topic));
        // The last tick may have been cut off at another message of it.
        let count = here.len().min(there.len());
        assert!(here.len().abs_diff(there.len()) <= 1, "{topic}");
        assert!(here[..count] == there[..count], "{topic}");
    }
    assert!(only(&here, Topic::Setpoint).len() > 84);
    here
}

#[test]
fn the_same_blueprint_gives_the_same_trial_twice_and_another_seed_another_one() {
    let once = in_the_world(&blueprint(configuration()));
    assert!(once == in_the_world(&blueprint(configuration())));
    let mut other = configuration();
    other.rates.seed += 1;
    assert!(once != in_the_world(&blueprint(other)));
}

#[test]
fn in_real_time_virtual_deadlines_drive_the_loop_to_the_goal() {
    let mut configuration = configuration();
    configuration.rates.pace = tandem_link::config::PaceName::Real;
    let messages = in_the_world(&blueprint(configuration));
    let states = only(&messages, Topic::State);
    let last = decode::<State>(states.last().expect("states")).expect("a state");
    let goal = tandem_wire::Vec3::new(0.5, 0.3, 0.15);
    assert!((last.body.tool.position - goal).norm() < 0.01);
    assert!(states.len() > 84 * 5, "states stream at 50 Hz: {}", states.len());
}

#[test]
fn a_world_without_a_trial_falls_silent_and_one_without_time_stops() {
    let mut world = World::new(&blueprint(configuration())).expect("the defaults fit");
    assert_eq!(world.run(PATIENCE, |_, _, _| ControlFlow::Continue(())), Halt::Silence);
    world.mark(begin());
    assert_eq!(world.run(SECOND, |_, _, _| ControlFlow::Continue(())), Halt::TimeUp);
    assert!(world.now().seconds() > 0.9);
}

#[test]
fn a_bad_line_slows_the_same_way_twice_and_a_long_outage_stops_the_arm() {
    use tandem_link::Direction;
    let impaired = |outages_s: Vec<[f64; 2]>| {
        let mut configuration = configuration();
        configuration.rates.pace = tandem_link::config::PaceName::Real;
        configuration.impairment.all.streams = vec![Direction::Command, Direction::StateToOperator];
        configuration.impairment.all.delay_ms = 40.0;
        configuration.impairment.all.jitter_ms = 20.0;
        configuration.impairment.all.loss = 0.02;
        configuration.impairment.all.outages_s = outages_s;
        blueprint(configuration)
    };
    let once = in_the_world(&impaired(vec![]));
    assert!(once == in_the_world(&impaired(vec![])));
    let used = only(&once, Topic::Setpoint)
        .into_iter()
        .rev()
        .nth(100)
        .expect("setpoints");
    let used = decode::<tandem_wire::Setpoint>(used).expect("a setpoint");
    assert!(
        used.body.motion.is_permitted(),
        "60 ms either way are within the limits"
    );

    let reasons = |messages: &Messages| {
        let setpoints = only(messages, Topic::Setpoint);
        let read = setpoints
            .into_iter()
            .filter_map(|bytes| decode::<tandem_wire::Setpoint>(bytes).ok());
        read.filter_map(|setpoint| setpoint.body.motion.reason())
            .map(|reason| reason.to_string())
            .collect::<Vec<_>>()
    };
    let cut = reasons(&in_the_world(&impaired(vec![[3.0, 0.4]])));
    assert!(cut.iter().any(|reason| reason.contains("commands stopped")), "{cut:?}");
}

/// Every stream in lockstep over a bad line; some of them late by more than a period.
fn bad_lockstep(change: impl FnOnce(&mut tandem_link::ImpairmentSettings)) -> Blueprint {
    use tandem_link::Direction::{Command, Proposal, Setpoint, StateToArbiter, StateToOperator, StateToPredictor};
    let mut configuration = configuration();
    let line = &mut configuration.impairment.all;
    line.streams = vec![
        Command,
        Proposal,
        Setpoint,
        StateToOperator,
        StateToPredictor,
        StateToArbiter,
    ];
    change(line);
    blueprint(configuration)
}

#[test]
fn a_trial_over_a_bad_line_in_lockstep_is_byte_for_byte_the_one_over_zenoh() {
    let blueprint = bad_lockstep(|line| {
        line.delay_ms = 20.0;
        line.jitter_ms = 60.0;
        line.loss = 0.05;
        line.reorder = 0.05;
    });
    let (here, there) = (in_the_world(&blueprint), over_zenoh(&blueprint));
    for topic in [
        Topic::State,
        Topic::Command,
        Topic::Proposal,
        Topic::Forecast,
        Topic::Setpoint,
    ] {
        let (here, there) = (only(&here, topic), only(&there, topic));
        let count = here.len().min(there.len());
        assert!(here.len().abs_diff(there.len()) <= 1, "{topic}");
        let differs = (0..count).find(|&at| here[at] != there[at]);
        assert_eq!(differs, None, "{topic}");
    }
    assert!(only(&here, Topic::Setpoint).len() > 84);
    assert!(here != in_the_world(&bad_lockstep(|_| {})), "the line does something");
}

/// The tick of the command that each setpoint used, behind the tick that it answers.
fn command_ages(messages: &Messages) -> Vec<u32> {
    let read = only(messages, Topic::Setpoint).into_iter();
    let read = read.filter_map(|bytes| decode::<tandem_wire::Setpoint>(bytes).ok());
    let age = |setpoint: tandem_wire::Envelope<tandem_wire::Setpoint>| {
        let used = setpoint.body.command?.sent;
        let period = tandem_wire::Timing::default().period;
        u32::try_from(setpoint.header.sent.since(used) / period).ok()
    };
    read.filter_map(age).collect()
}

#[test]
fn a_streams_own_line_befalls_that_stream_in_that_direction_only() {
    let late = |direction| {
        let mut configuration = configuration();
        let delay_ms = 200.0;
        let line = tandem_link::LineSettings {
            delay_ms,
            ..Default::default()
        };
        configuration.impairment.set(direction, line);
        in_the_world(&blueprint(configuration))
    };
    let commands = late(tandem_link::Direction::Command);
    assert!(command_ages(&commands).iter().all(|age| *age == 2));
    // Whoever sees late answers in time.
    let states = late(tandem_link::Direction::StateToOperator);
    assert!(command_ages(&states).iter().all(|age| *age == 0));
    let behind = |messages: &Messages| {
        let commands = only(messages, Topic::Command).into_iter().skip(5);
        let read = commands.filter_map(|bytes| decode::<tandem_wire::Command>(bytes).ok());
        let behind: std::collections::BTreeSet<_> = read
            .map(|command| {
                i64::from(command.header.tick) - command.body.seen.map_or(0, |seen| seen.seq.0.cast_signed())
            })
            .collect();
        assert_eq!(behind.len(), 1, "as late in every tick: {behind:?}");
        behind.first().copied()
    };
    let clean = behind(&in_the_world(&blueprint(configuration())));
    assert_eq!(behind(&states), clean.map(|behind| behind + 2));
    assert_eq!(behind(&commands), clean);
}

#[test]
fn commands_lost_in_a_row_stop_the_arm_by_virtual_time_and_say_why() {
    let messages = in_the_world(&bad_lockstep(|line| {
        line.streams = vec![tandem_link::Direction::Command];
        line.outages_s = vec![[3.0, 0.5]];
    }));
    let setpoints = only(&messages, Topic::Setpoint);
    let at = |tick: u32| {
        let read = setpoints
            .iter()
            .filter_map(|bytes| decode::<tandem_wire::Setpoint>(bytes).ok());
        let mut of_tick = read.filter(|setpoint| setpoint.header.tick == tick);
        of_tick.next().expect("every tick is answered").body.motion
    };
    assert!(at(31).is_permitted(), "200 ms of silence are within the timeout");
    let reason = at(32).reason().expect("300 ms are not").to_string();
    assert!(reason.contains("commands stopped"), "{reason}");
}

#[test]
fn setpoints_lost_in_a_row_stop_the_arm_by_its_own_watchdog() {
    let messages = in_the_world(&bad_lockstep(|line| {
        line.streams = vec![tandem_link::Direction::Setpoint];
        line.outages_s = vec![[3.0, 0.5]];
    }));
    let states = only(&messages, Topic::State);
    let read = states.iter().filter_map(|bytes| decode::<State>(bytes).ok());
    let held = read.filter_map(|state| Some((state.header.tick, state.body.motion.reason()?.to_string())));
    let lost: Vec<_> = held
        .filter(|(_, reason)| reason.contains("setpoints stopped"))
        .collect();
    assert_eq!(lost.first().map(|(tick, _)| *tick), Some(32), "{lost:?}");
}
