//! Scripted timelines in real time: commands flow by themselves, and silence stops them from meaning anything.

mod robot;

use tandem_operator::{DeviceSample, Event, HumanSettings, Keys, OperatorSettings, Output};
use tandem_wire::{
    Command, Deadman, Input, Label, Lease, MILLISECOND, Malformed, MessageId, Motion, Node, Ports, Reason, Seq,
    Session, Stamp, Timing, Topic, Trial, Wish,
};

use robot::{Rig, Robot, commands, readable};

fn at(millis: u64) -> Stamp {
    Stamp(millis * MILLISECOND)
}

/// Wakes the node whenever it asks for it, up to `until`.
fn flow(rig: &mut Rig, until: u64) -> Vec<Output> {
    let mut outputs = Vec::new();
    while let Some(due) = rig.operator.deadline().filter(|due| *due <= at(until)) {
        outputs.extend(rig.step(due, Event::Wake));
        assert!(
            rig.operator.deadline().is_none_or(|next| next > due),
            "a woken node must move on"
        );
    }
    outputs
}

/// The commands that read otherwise than the one before, a line each.
fn changes(outputs: &[Output], reading: fn(&Command) -> String) -> String {
    let mut sent: Vec<_> = commands(outputs)
        .iter()
        .map(|command| (command.header.sent.0 / MILLISECOND, reading(&command.body)))
        .collect();
    sent.dedup_by(|next, before| next.1 == before.1);
    sent.iter()
        .map(|(millis, line)| format!("{millis} ms: {line}\n"))
        .collect()
}

fn show(rig: &mut Rig, now: u64, robot: &mut Robot) -> Vec<Output> {
    let state = robot.repeat();
    rig.step(at(now), Event::State(Box::new(state)))
}

fn press(rig: &mut Rig, now: u64, keys: Keys, presses: u8) -> Vec<Output> {
    let sample = DeviceSample {
        keys,
        presses,
        ..DeviceSample::default()
    };
    rig.step(at(now), Event::Device(sample))
}

#[test]
fn commands_flow_at_the_stream_period_from_the_start() {
    let mut rig = Rig::keyboard();
    let mut sent = Vec::new();
    while let Some(due) = rig.operator.deadline().filter(|due| *due < at(100)) {
        sent.extend(commands(&rig.step(due, Event::Wake)));
    }
    let stamps: Vec<_> = sent.iter().map(|command| command.header.sent.0 / MILLISECOND).collect();
    assert_eq!(stamps, [0, 20, 40, 60, 80]);
    assert!(
        sent.iter()
            .zip(1..)
            .all(|(command, seq)| command.header.seq == Seq(seq))
    );
    assert!(
        sent.iter()
            .all(|command| command.body.deadman == Deadman::Released && command.body.seen.is_none())
    );
}

#[test]
fn a_shell_that_sleeps_through_is_not_answered_with_a_burst() {
    let mut rig = Rig::keyboard();
    assert_eq!(commands(&rig.step(at(0), Event::Wake)).len(), 1);
    assert_eq!(commands(&rig.step(at(500), Event::Wake)).len(), 1);
    assert_eq!(rig.operator.deadline(), Some(at(520)));
}

#[test]
fn a_key_moves_the_robot_until_the_keyboard_falls_silent() {
    let (mut rig, mut robot) = (Rig::keyboard(), Robot::default());
    let mut outputs = Vec::new();
    for now in (0..400).step_by(20) {
        outputs.extend(flow(&mut rig, now));
        outputs.extend(show(&mut rig, now, &mut robot));
        outputs.extend(match now {
            0..100 => press(&mut rig, now, Keys::default(), 0),
            100..150 => press(&mut rig, now, Keys::RIGHT, 1),
            150..170 => press(&mut rig, now, Keys::RIGHT.and(Keys::BACK), 1),
            _ => Vec::new(),
        });
    }
    insta::assert_snapshot!(changes(&outputs, readable), @r"
    0 ms: released
    100 ms: held 1 +100.0 +0.0 mm/s
    180 ms: held 1 +70.7 -70.7 mm/s
    310 ms: released
    ");
    assert_eq!(rig.doing(), "keyboard silent");
}

#[test]
fn letting_go_does_not_wait_for_the_stream() {
    let (mut rig, mut robot) = (Rig::keyboard(), Robot::default());
    show(&mut rig, 0, &mut robot);
    press(&mut rig, 1, Keys::default(), 0);
    assert_eq!(
        commands(&press(&mut rig, 2, Keys::HOLD, 1))[0].body.deadman,
        Deadman::Held { press: 1 }
    );
    assert_eq!(
        commands(&press(&mut rig, 3, Keys::default(), 1))[0].body.deadman,
        Deadman::Released
    );
    assert!(commands(&press(&mut rig, 4, Keys::default(), 1)).is_empty());
}

#[test]
fn without_a_picture_nobody_drives_until_keys_are_pressed_anew() {
    let (mut rig, mut robot) = (Rig::keyboard(), Robot::default());
    show(&mut rig, 0, &mut robot);
    press(&mut rig, 1, Keys::default(), 0);
    for now in (2..200).step_by(20) {
        press(&mut rig, now, Keys::LEFT, 1);
        flow(&mut rig, now);
    }
    // The last state was at 0, the timeout is 100 ms.
    assert_eq!(rig.status.unwrap().deadman, Deadman::Released);
    assert!(rig.status.unwrap().to_string().contains("no picture of the robot"));
    show(&mut rig, 200, &mut robot);
    press(&mut rig, 201, Keys::LEFT, 1);
    assert_eq!(rig.doing(), "let go of all keys first");
    press(&mut rig, 202, Keys::default(), 1);
    press(&mut rig, 203, Keys::LEFT, 2);
    assert_eq!(rig.status.unwrap().deadman, Deadman::Held { press: 2 });
}

#[test]
fn a_simulated_human_who_lost_the_picture_presses_anew() {
    let mut rig = Rig::new(
        Timing::default(),
        1,
        &OperatorSettings::default(),
        &HumanSettings::default(),
    );
    let mut robot = Robot::default();
    robot.begin_trial(1);
    let mut outputs = Vec::new();
    for now in (0..1000).step_by(20) {
        let lost = (400..700).contains(&now);
        let mut fresh = flow(&mut rig, now);
        if !lost {
            robot.header.tick = u32::try_from(now / 100).unwrap();
            fresh.extend(show(&mut rig, now, &mut robot));
        }
        if let Some(command) = commands(&fresh).last() {
            robot.motion = match command.body.deadman {
                Deadman::Held { press } if !lost => Motion::Permitted { press },
                _ => Motion::Held(Reason::DeadmanReleased),
            };
        }
        outputs.extend(fresh);
    }
    let deadmen = changes(&outputs, |command| format!("{:?}", command.deadman));
    insta::assert_snapshot!(deadmen, @r"
    0 ms: Released
    100 ms: Held { press: 1 }
    480 ms: Released
    700 ms: Held { press: 2 }
    ");
}

#[test]
fn a_simulated_humans_velocity_holds_for_the_whole_control_period() {
    let mut rig = Rig::new(
        Timing::default(),
        1,
        &OperatorSettings::default(),
        &HumanSettings::default(),
    );
    let mut robot = Robot::default();
    robot.begin_trial(1);
    show(&mut rig, 0, &mut robot);
    robot.header.tick = 1;
    let first = commands(&show(&mut rig, 100, &mut robot))[0].body;
    assert_ne!(first.velocity, tandem_wire::Vec3::ZERO);
    for now in (120..200).step_by(20) {
        robot.tool[0] += 0.001;
        show(&mut rig, now, &mut robot);
        for command in commands(&rig.step(at(now), Event::Wake)) {
            assert_eq!(command.body.velocity, first.velocity);
            assert_eq!(command.header.tick, 1);
        }
    }
}

#[test]
fn a_key_asks_for_the_trial_after_the_newest_one() {
    let (mut rig, mut robot) = (Rig::keyboard(), Robot::default());
    let ask = |rig: &mut Rig, now, requests| {
        let sample = DeviceSample {
            requests,
            ..DeviceSample::default()
        };
        let outputs = rig.step(at(now), Event::Device(sample));
        outputs.iter().find_map(|output| match output {
            Output::Trial(trial) => Some(trial.body.clone()),
            _ => None,
        })
    };
    assert_eq!(ask(&mut rig, 0, 0), None);
    assert_eq!(ask(&mut rig, 1, 1), None, "without a picture there is nothing to begin");
    robot.trial = 4;
    show(&mut rig, 2, &mut robot);
    robot.trial = 0;
    show(&mut rig, 3, &mut robot);
    assert_eq!(ask(&mut rig, 4, 1), None);
    let label = "keyboard".to_owned();
    assert_eq!(ask(&mut rig, 5, 2), Some(Trial::Begin { number: 5, label }));
}

#[test]
fn the_end_is_a_released_command_and_then_silence() {
    let (mut rig, mut robot) = (Rig::keyboard(), Robot::default());
    show(&mut rig, 0, &mut robot);
    press(&mut rig, 1, Keys::default(), 0);
    press(&mut rig, 2, Keys::LEFT, 1);
    let last = commands(&rig.step(at(3), Event::Stop));
    assert_eq!(
        last.iter().map(|command| command.body.deadman).collect::<Vec<_>>(),
        [Deadman::Released]
    );
    assert_eq!(rig.operator.deadline(), None);
    assert!(commands(&rig.step(at(500), Event::Wake)).is_empty());
    assert!(commands(&show(&mut rig, 501, &mut robot)).is_empty());
}

#[test]
fn what_cannot_be_read_and_what_comes_late_is_counted_and_nothing_else() {
    let (mut rig, mut robot) = (Rig::keyboard(), Robot::default());
    show(&mut rig, 0, &mut robot);
    let stale = robot.state();
    rig.step(at(1), Event::State(Box::new(stale)));
    for (topic, bytes) in [
        (Topic::State, &[1, 5, 0][..]),
        (Topic::Device, &[9, 0, 0, 0, 0, 0, 0]),
        (Topic::Command, &[]),
    ] {
        rig.step(at(2), tandem_operator::Operator::event(Input::Sample { topic, bytes }));
    }
    assert_eq!(rig.status.unwrap().refused.count, 4);
    let event = tandem_operator::Operator::event(Input::Sample {
        topic: Topic::Device,
        bytes: &[],
    });
    assert!(matches!(event, Event::Unreadable(unreadable) if unreadable.why == Malformed::Truncated(0)));
}

#[test]
fn the_status_line_says_who_drives_or_why_nobody_does() {
    let (mut rig, mut robot) = (Rig::keyboard(), Robot::default());
    robot.trial = 2;
    robot.stop(Reason::DeadmanReleased);
    show(&mut rig, 0, &mut robot);
    press(&mut rig, 1, Keys::default(), 0);
    let line = rig.status.unwrap().to_string();
    insta::assert_snapshot!(line, @"no key held · robot holds: the deadman is released · tool 0.500 -0.300 0.150 m · trial 2");
}

/// How many emergency stops are among them.
fn stops(outputs: &[Output]) -> usize {
    let stop = |output: &&Output| matches!(output, Output::Emergency(_));
    outputs.iter().filter(stop).count()
}

/// What a robot tells of one; the operator's own session is 5.
fn emergency_stop(session: u64) -> Reason {
    let (session, seq) = (Session(session), Seq(1));
    Reason::EmergencyStop {
        stop: MessageId { session, seq },
        by: Label::new("operator"),
    }
}

#[test]
fn an_emergency_stop_is_called_again_to_a_robot_that_is_started_anew_without_it() {
    let (mut rig, mut robot) = (Rig::keyboard(), Robot::default());
    robot.stop(emergency_stop(99));
    show(&mut rig, 0, &mut robot);
    assert_eq!(stops(&flow(&mut rig, 300)), 0, "the robot obeys it");
    robot.header.session = Session(78);
    robot.stop(Reason::NoSetpointYet);
    show(&mut rig, 301, &mut robot);
    assert_eq!(stops(&flow(&mut rig, 340)), 0, "the arbiter may know of it");
    robot.stop(Reason::AwaitingPress);
    show(&mut rig, 341, &mut robot);
    assert!(stops(&flow(&mut rig, 400)) >= 2, "it was lost with both of them");
    robot.stop(emergency_stop(5));
    show(&mut rig, 401, &mut robot);
    assert_eq!(stops(&flow(&mut rig, 440)), 0, "heard");
    robot.stop(Reason::AwaitingPress);
    show(&mut rig, 441, &mut robot);
    assert_eq!(
        stops(&flow(&mut rig, 500)),
        0,
        "the same robot was told that it is over"
    );
}

#[test]
fn keys_stop_give_up_and_take_over_and_a_stop_is_repeated_until_it_is_heard() {
    let (mut rig, mut robot) = (Rig::keyboard(), Robot::default());
    robot.trial = 1;
    show(&mut rig, 0, &mut robot);
    let sample = |stops, releases, take_overs| {
        let sample = DeviceSample {
            stops,
            releases,
            take_overs,
            ..DeviceSample::default()
        };
        Event::Device(sample)
    };
    let wishes = |outputs: &[Output]| {
        let wish = |output: &Output| match output {
            Output::Claim(claim) => Some(claim.body.wish),
            _ => None,
        };
        outputs.iter().filter_map(wish).collect::<Vec<_>>()
    };
    rig.step(at(1), sample(0, 0, 0));
    assert_eq!(wishes(&rig.step(at(2), sample(0, 1, 0))), [Wish::Release]);
    assert_eq!(wishes(&rig.step(at(3), sample(0, 1, 1))), [Wish::TakeOver]);
    assert_eq!(stops(&rig.step(at(4), sample(1, 1, 1))), 1);
    assert!(stops(&flow(&mut rig, 60)) >= 2, "nobody has answered");
    robot.stop(emergency_stop(99));
    show(&mut rig, 61, &mut robot);
    assert!(
        stops(&flow(&mut rig, 10_000)) >= 400,
        "somebody else's stop is none of ours, and a line may be down for long"
    );
    assert!(
        rig.status
            .unwrap()
            .to_string()
            .starts_with("EMERGENCY STOP NOT ACKNOWLEDGED")
    );
    robot.stop(emergency_stop(5));
    show(&mut rig, 10_001, &mut robot);
    assert_eq!(stops(&flow(&mut rig, 10_060)), 0, "the robot has heard it");
    assert!(rig.status.unwrap().to_string().contains("emergency stop by operator"));
    assert_eq!(
        wishes(&rig.step(at(10_061), Event::Stop)),
        [Wish::Release],
        "whoever leaves gives the lease up"
    );
}

#[test]
fn a_press_says_its_name_and_the_status_says_who_drives() {
    let (mut rig, mut robot) = (Rig::keyboard(), Robot::default());
    robot.trial = 1;
    show(&mut rig, 0, &mut robot);
    press(&mut rig, 1, Keys::default(), 0);
    let outputs = press(&mut rig, 2, Keys::LEFT, 1);
    let claims = outputs.iter().filter(|output| matches!(output, Output::Claim(_)));
    assert_eq!(claims.count(), 1);
    let command = *commands(&outputs).last().unwrap();
    robot.obey(&command.body);
    let mut state = robot.repeat();
    let mut told = |holder| {
        state.header.seq.advance();
        let obeyed = state.body.obeys.as_mut().unwrap();
        obeyed.setpoint.lease = Some(Lease {
            number: 1,
            holder,
            name: Label::new("ada"),
        });
        obeyed.setpoint.asks = Some(Label::new("bob"));
        rig.step(at(3), Event::State(Box::new(state)));
        rig.status.unwrap().to_string()
    };
    assert!(told(Session(5)).contains("you hold the lease, bob asks for it: L gives it up"));
    assert!(told(Session(99)).contains("ada holds the lease"));
}
