//! Scripted timelines in lockstep: a simulated human and a robot that is a point.

mod robot;

use tandem_operator::{Activity, Doing, Event, FamilyPath, HumanKind, HumanSettings};
use tandem_wire::{Condition, Deadman, Envelope, Header, Motion, NodeName, Reason, Session, Stamp, Storage};

use robot::{PERIOD, Rig, Robot, readable, task_velocity};

/// A human who wishes exactly the path and whose hand is steady.
fn exact(kind: HumanKind) -> HumanSettings {
    HumanSettings {
        kind,
        noise_mm: 0.0,
        deviation_mm: 0.0,
        ..HumanSettings::default()
    }
}

/// Lets the loop run for `ticks`, one line each.
fn timeline(rig: &mut Rig, robot: &mut Robot, ticks: u32) -> String {
    let mut lines = String::new();
    for _ in 0..ticks {
        let command = rig.answer(robot);
        assert_eq!(command.header.tick, robot.header.tick);
        assert_eq!(command.body.seen, Some(robot.header.id()));
        let line = format!(
            "{} {} | {}\n",
            command.header.tick,
            readable(&command.body),
            rig.doing()
        );
        lines.push_str(&line);
        robot.obey(&command.body);
    }
    lines
}

/// A rig and a robot on which trial 1 has been driven for `ticks` control periods.
fn driven(human: &HumanSettings, ticks: u32) -> (Rig, Robot) {
    let (mut rig, mut robot) = (Rig::simulated(1, human), Robot::default());
    robot.begin_trial(1);
    timeline(&mut rig, &mut robot, ticks + 1);
    (rig, robot)
}

#[test]
fn the_human_waits_for_a_trial_and_starts_a_tick_after_it_began() {
    let (mut rig, mut robot) = (Rig::simulated(1, &HumanSettings::default()), Robot::default());
    let mut lines = timeline(&mut rig, &mut robot, 2);
    robot.begin_trial(1);
    lines.push_str(&timeline(&mut rig, &mut robot, 5));
    insta::assert_snapshot!(lines, @r"
    0 released | waiting for a trial
    1 released | waiting for a trial
    2 released | about to start
    3 held 1 +18.5 +1.4 mm/s | driving, step 0
    4 held 1 -16.6 +25.6 mm/s | driving, step 1
    5 held 1 +26.3 +4.4 mm/s | driving, step 2
    6 held 1 -15.8 +1.7 mm/s | driving, step 3
    ");
}

#[test]
fn the_human_does_not_start_away_from_the_start() {
    let (mut rig, mut robot) = (Rig::simulated(1, &HumanSettings::default()), Robot::default());
    robot.begin_trial(1);
    robot.tool = [0.1, 0.0];
    let mut lines = timeline(&mut rig, &mut robot, 3);
    robot.tool = [0.03, 0.03];
    lines.push_str(&timeline(&mut rig, &mut robot, 1));
    insta::assert_snapshot!(lines, @r"
    0 released | about to start
    1 released | waiting: the tool is 100 mm from its path's start
    2 released | waiting: the tool is 100 mm from its path's start
    3 held 1 -161.5 -178.6 mm/s | driving, step 0
    ");
}

#[test]
fn a_stopped_robot_makes_the_human_press_anew() {
    let (mut rig, mut robot) = driven(&exact(HumanKind::Pursuit), 3);
    robot.stop(Reason::SetpointLost { silent: 250_000_000 });
    let lines = timeline(&mut rig, &mut robot, 4);
    insta::assert_snapshot!(lines, @r"
    4 released | pressing anew
    5 held 2 +0.5 +0.0 mm/s | driving, step 2
    6 held 2 +2.4 +0.0 mm/s | driving, step 3
    7 held 2 +4.4 +0.0 mm/s | driving, step 4
    ");
}

#[test]
fn a_robot_that_ignores_the_press_is_pressed_anew_after_half_a_second() {
    let (mut rig, mut robot) = driven(&exact(HumanKind::Pursuit), 3);
    let mut lines = String::new();
    for _ in 0..9 {
        robot.stop(Reason::AwaitingPress);
        let command = rig.answer(&robot);
        lines.push_str(&format!("{} {}\n", command.header.tick, readable(&command.body)));
        robot.obey(&command.body);
    }
    insta::assert_snapshot!(lines, @r"
    4 released
    5 held 2 +0.5 +0.0 mm/s
    6 held 2 +0.5 +0.0 mm/s
    7 held 2 +0.5 +0.0 mm/s
    8 held 2 +0.5 +0.0 mm/s
    9 held 2 +0.5 +0.0 mm/s
    10 released
    11 held 3 +0.5 +0.0 mm/s
    12 held 3 +0.5 +0.0 mm/s
    ");
}

#[test]
fn a_robot_that_never_moves_is_given_up() {
    let settings = HumanSettings {
        time_limit_s: 3600,
        ..HumanSettings::default()
    };
    let (mut rig, mut robot) = (Rig::simulated(1, &settings), Robot::default());
    robot.begin_trial(1);
    let mut press = 0;
    for _ in 0..400 {
        robot.stop(Reason::LoopTooOld);
        let command = rig.answer(&robot).body;
        if let Deadman::Held { press: this } = command.deadman {
            press = this;
        }
        robot.obey(&command);
    }
    assert_eq!(
        (press, rig.doing().as_str()),
        (20, "done: gave up on a robot that keeps stopping")
    );
}

#[test]
fn every_kind_of_human_reaches_the_goal_alone_and_lets_go_for_good() {
    for kind in [
        HumanKind::Pursuit,
        HumanKind::Intermittent,
        HumanKind::Lagged,
        HumanKind::Compensating,
    ] {
        for seed in 1..=5 {
            let settings = HumanSettings {
                kind,
                ..HumanSettings::default()
            };
            let (mut rig, mut robot) = (Rig::simulated(seed, &settings), Robot::default());
            robot.begin_trial(1);
            let mut clearance = f64::INFINITY;
            while rig.doing() != "done: arrived" {
                assert!(robot.header.tick < 110, "{kind:?} {seed}: {}", rig.doing());
                let command = rig.answer(&robot).body;
                robot.obey(&command);
                let [x, y] = robot.tool;
                let near = length(x - 0.28, y).min(length(x - 0.46, y)) - 0.025;
                clearance = clearance.min(near);
            }
            let [x, y] = robot.tool;
            assert!(length(x - 0.6, y) < 0.01, "{kind:?} {seed} ends at {x} {y}");
            assert!(clearance > 0.0, "{kind:?} {seed} comes within {clearance}");
            assert!(
                timeline(&mut rig, &mut robot, 30)
                    .lines()
                    .all(|line| line.contains("released"))
            );
        }
    }
}

#[test]
fn a_second_trial_is_driven_with_the_next_press_and_another_wish() {
    let (mut rig, mut robot) = (Rig::simulated(1, &HumanSettings::default()), Robot::default());
    robot.begin_trial(1);
    let first = timeline(&mut rig, &mut robot, 120);
    robot.begin_trial(2);
    let second = timeline(&mut rig, &mut robot, 20);
    let of = |lines: &str, i: usize| lines.lines().nth(i).map(str::to_owned).unwrap();
    assert!(of(&second, 0).contains("released") && of(&second, 1).contains("held 2"));
    let motion = |line: String| line.split("mm/s").next().unwrap()[line.find("held").unwrap() + 7..].to_owned();
    assert_ne!(motion(of(&first, 15)), motion(of(&second, 15)));
}

#[test]
fn the_wish_of_seed_1_is_the_same_on_every_run() {
    let run = |seed| {
        let (mut rig, mut robot) = (Rig::simulated(seed, &HumanSettings::default()), Robot::default());
        robot.begin_trial(1);
        timeline(&mut rig, &mut robot, 100)
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
    let every_tenth: String = run(1).lines().step_by(10).map(|line| format!("{line}\n")).collect();
    insta::assert_snapshot!(every_tenth, @r"
    0 released | about to start
    10 held 1 +26.9 +6.5 mm/s | driving, step 9
    20 held 1 +81.3 -0.6 mm/s | driving, step 19
    30 held 1 +149.4 +33.5 mm/s | driving, step 29
    40 held 1 +149.6 +62.5 mm/s | driving, step 39
    50 held 1 +117.9 -189.2 mm/s | driving, step 49
    60 held 1 +125.2 +97.7 mm/s | driving, step 59
    70 held 1 +39.2 +0.3 mm/s | driving, step 69
    80 held 1 +7.9 -22.2 mm/s | driving, step 79
    90 released | done: arrived
    ");
}

#[test]
fn before_a_forecast_the_wish_follows_the_time_and_afterwards_the_phase() {
    let (mut rig, mut robot) = driven(&exact(HumanKind::Pursuit), 10);
    let path = FamilyPath::new(0.12);
    let pursuit = |step: f64, tool: [f64; 2]| {
        let [x, y] = path.at(step + 1.0);
        [0.6 * (x - tool[0]) / PERIOD, 0.6 * (y - tool[1]) / PERIOD]
    };
    let check = |rig: &mut Rig, robot: &Robot, step: f64| {
        let command = rig.answer(robot).body;
        let (found, expected) = (task_velocity(command.velocity), pursuit(step, robot.tool));
        let same = (0..2).all(|i| (found[i] - expected[i]).abs() < 1e-9);
        assert!(same, "step {step}: {found:?}, not {expected:?}");
        command
    };
    let command = check(&mut rig, &robot, 10.0);
    // The setpoint of this tick is made at phase 41.3; a tick later it is 42.3.
    robot.guidance = Some((41.3, [0.0; 2]));
    robot.tool = path.at(41.3);
    robot.obey(&command);
    let command = check(&mut rig, &robot, 42.3);
    // The predictor is lost: time goes on from there.
    robot.guidance = None;
    robot.obey(&command);
    let command = check(&mut rig, &robot, 43.3);
    robot.obey(&command);
    check(&mut rig, &robot, 44.3);
}

#[test]
fn a_setpoint_that_comes_late_is_brought_forward_by_as_many_ticks() {
    let (mut rig, mut robot) = driven(&exact(HumanKind::Pursuit), 10);
    let command = rig.answer(&robot).body;
    robot.guidance = Some((41.5, [0.0; 2]));
    robot.obey(&command);
    for later in [42.5, 43.5, 44.5] {
        rig.answer(&robot);
        let doing = rig.status.map(|status| status.activity);
        assert_eq!(doing, Some(Activity::Simulated(Doing::Driving { step: later })));
        // Still the same setpoint.
        robot.header.tick += 1;
        robot.header.seq.advance();
    }
}

#[test]
fn guidance_from_the_trial_before_guides_no_more() {
    let (mut rig, mut robot) = driven(&exact(HumanKind::Pursuit), 10);
    let command = rig.answer(&robot).body;
    robot.guidance = Some((80.0, [0.0; 2]));
    robot.obey(&command);
    robot.begin_trial(2);
    rig.answer(&robot);
    robot.header.tick += 1;
    robot.header.seq.advance();
    rig.answer(&robot);
    assert_eq!(rig.doing(), "driving, step 0");
}

#[test]
fn a_compensating_human_leads_the_blend_to_its_wish() {
    let (mut rig, mut robot) = driven(&exact(HumanKind::Compensating), 10);
    let command = rig.answer(&robot).body;
    (robot.guidance, robot.weight) = (Some((10.0, [0.05, -0.05])), 0.5);
    robot.obey(&command);
    for step in 11..20 {
        let command = rig.answer(&robot).body;
        robot.guidance = Some((f64::from(step), [0.05, -0.05]));
        robot.obey(&command);
        let [x, y] = FamilyPath::new(0.12).at(f64::from(step) + 1.0);
        assert!(
            (robot.tool[0] - x).abs() < 1e-9 && (robot.tool[1] - y).abs() < 1e-9,
            "{step}"
        );
    }
}

#[test]
fn a_slow_reaction_begins_late_and_still_arrives() {
    let settings = HumanSettings {
        reaction_ms: 100,
        ..HumanSettings::default()
    };
    let (mut rig, mut robot) = (Rig::simulated(1, &settings), Robot::default());
    robot.begin_trial(1);
    let lines = timeline(&mut rig, &mut robot, 110);
    let nth = |i: usize| lines.lines().nth(i).unwrap();
    assert!(nth(1).starts_with("1 held 1 +0.0 +0.0"), "{}", nth(1));
    assert!(!nth(2).contains("+0.0 +0.0"), "{}", nth(2));
    assert_eq!(rig.doing(), "done: arrived");
    assert!((robot.tool[0] - 0.6).abs() < 0.01 && robot.tool[1].abs() < 0.01);
}

#[test]
fn the_human_gives_up_at_the_time_limit() {
    let (mut rig, mut robot) = (Rig::simulated(1, &HumanSettings::default()), Robot::default());
    robot.begin_trial(1);
    for _ in 0..160 {
        let command = rig.answer(&robot).body;
        robot.obey(&command);
        // Something holds the tool near the start, and the forecast's phase with it.
        robot.guidance = Some((20.0, [0.0; 2]));
        robot.tool = [0.03, 0.0];
    }
    assert_eq!(rig.doing(), "done: out of time");
}

#[test]
fn a_trial_that_ends_in_between_releases_at_once() {
    let (mut rig, mut robot) = driven(&HumanSettings::default(), 20);
    robot.trial = 0;
    assert!(
        timeline(&mut rig, &mut robot, 2)
            .lines()
            .all(|line| line.contains("released | waiting for a trial"))
    );
}

#[test]
fn a_robot_that_started_anew_is_not_driven_on() {
    let (mut rig, mut robot) = driven(&HumanSettings::default(), 20);
    let before = robot.header;
    robot.header.tick += 10;
    robot.header.session = Session(78);
    let command = rig.answer(&robot);
    assert_eq!(command.body.deadman, Deadman::Released);
    assert!(before.tick < command.header.tick);
}

#[test]
fn the_hand_trembles_by_as_much_as_it_shall() {
    let (steady, trembling) = (
        exact(HumanKind::Pursuit),
        HumanSettings {
            deviation_mm: 0.0,
            ..HumanSettings::default()
        },
    );
    let (mut one, mut other) = (Rig::simulated(1, &steady), Rig::simulated(1, &trembling));
    let mut robot = Robot::default();
    let mut noise = Vec::new();
    for trial in 1..=30 {
        robot.begin_trial(trial);
        for _ in 0..60 {
            let (plain, noisy) = (one.answer(&robot).body, other.answer(&robot).body);
            robot.obey(&plain);
            if robot.motion == (Motion::Permitted { press: trial }) {
                let (a, b) = (task_velocity(plain.velocity), task_velocity(noisy.velocity));
                noise.extend([(b[0] - a[0]) * PERIOD, (b[1] - a[1]) * PERIOD]);
            }
        }
    }
    let count = noise.len() as f64;
    let mean = noise.iter().sum::<f64>() / count;
    let sd = (noise.iter().map(|n| n * n).sum::<f64>() / count).sqrt();
    assert!(
        count > 3000.0 && mean.abs() < 0.0001 && (sd - 0.0015).abs() < 0.00005,
        "{mean} {sd}"
    );
}

fn length(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

#[test]
fn the_recorders_trouble_stands_in_the_status_line_until_it_is_over() {
    let mut rig = Rig::simulated(1, &HumanSettings::default());
    let mut say = |event| {
        rig.step(Stamp(0), event);
        rig.status.map(|status| status.to_string()).unwrap_or_default()
    };
    let told = |condition, dropped| {
        let body = Storage { condition, dropped };
        let header = Header::default();
        Event::Storage(Envelope { header, body })
    };
    let presence = |alive| Event::Presence {
        peer: NodeName::Recorder,
        alive,
    };
    assert!(!say(presence(true)).contains("recorded"), "all is well");
    let full = say(told(Condition::NoSpace, 12));
    assert!(
        full.ends_with("NOT recorded, the recorder's disk is full, 12 messages lost"),
        "{full}"
    );
    let again = say(told(Condition::Kept, 12));
    assert!(
        again.ends_with("the session is recorded, 12 messages lost"),
        "what was lost stays said: {again}"
    );
    let gone = say(presence(false));
    assert!(gone.ends_with("NOT recorded, the recorder is gone"), "{gone}");
    assert!(!say(presence(true)).contains("recorded"));
}
