//! What the player is held to.

use super::*;

const MS: u64 = MILLISECOND;

fn plan(speed: u32) -> Plan {
    Plan {
        from: 0,
        until: u64::MAX,
        speed: Speed::PerMille(speed),
        repeats: false,
        paused: false,
    }
}

fn player(plan: Plan) -> Player {
    Player::new(vec![0, 10 * MS, 10 * MS, 30 * MS], plan, Stamp(1000 * MS))
}

/// Follows the deadlines until the player stops asking, and says what was played when, in milliseconds.
fn played(player: &mut Player, most: usize) -> Vec<(usize, u64)> {
    let mut told = Vec::new();
    while told.len() < most
        && let Some(now) = player.deadline()
    {
        let mut outputs = Vec::new();
        player.step(now, Event::Wake, &mut outputs);
        told.extend(outputs.into_iter().filter_map(|output| match output {
            Output::Play { index, due } => {
                assert!(due <= now, "never early");
                Some((index, due.0 / MS - 1000))
            }
            _ => None,
        }));
    }
    told
}

#[test]
fn messages_come_at_their_instants_and_in_their_order() {
    assert_eq!(played(&mut player(plan(1000)), 9), [(0, 0), (1, 10), (2, 10), (3, 30)]);
    assert_eq!(played(&mut player(plan(500)), 9), [(0, 0), (1, 20), (2, 20), (3, 60)]);
    assert_eq!(played(&mut player(plan(10_000)), 9), [(0, 0), (1, 1), (2, 1), (3, 3)]);
}

#[test]
fn every_speed_from_a_tenth_to_a_hundred_keeps_its_absolute_instants() {
    for speed in STEPS {
        let mut player = player(plan(speed));
        let mut outputs = Vec::new();
        while let Some(due) = player.deadline() {
            player.step(due, Event::Wake, &mut outputs);
        }
        let dues = outputs.iter().filter_map(|output| match output {
            Output::Play { due, .. } => Some(due.0),
            _ => None,
        });
        let wanted = [0, 10, 10, 30].map(|at: u64| 1000 * MS + at * MS * 1000 / u64::from(speed));
        assert_eq!(dues.collect::<Vec<_>>(), wanted, "{speed} thousandths");
    }
}

#[test]
fn equal_instants_keep_their_order_at_every_speed() {
    for speed in [Speed::PerMille(100), Speed::PerMille(100_000), Speed::Max] {
        let mut player = Player::new(vec![5 * MS; 300], Plan { speed, ..plan(1000) }, Stamp(0));
        let mut outputs = Vec::new();
        while let Some(due) = player.deadline() {
            player.step(due, Event::Wake, &mut outputs);
        }
        let order = outputs.iter().filter_map(|output| match output {
            Output::Play { index, .. } => Some(*index),
            _ => None,
        });
        assert!(order.eq(0..300), "{speed:?}");
    }
}

#[test]
fn seeking_beyond_the_end_while_it_runs_plays_the_last_instant_and_ends() {
    let mut player = player(plan(1000));
    let mut outputs = Vec::new();
    let now = Stamp(1001 * MS);
    player.step(now, Event::SeekBy(i64::MAX), &mut outputs);
    player.step(now, Event::Wake, &mut outputs);
    let last = Output::Play { index: 3, due: now };
    assert_eq!(outputs, [Output::Jumped { to: 3 }, last, Output::Ended]);
    assert_eq!(player.deadline(), None);
}

#[test]
fn a_late_wake_does_not_shift_what_follows() {
    let mut player = player(plan(1000));
    let mut outputs = Vec::new();
    player.step(Stamp(1025 * MS), Event::Wake, &mut outputs);
    assert_eq!(outputs.len(), 3);
    assert_eq!(player.deadline(), Some(Stamp(1030 * MS)));
}

#[test]
fn from_and_until_bound_what_is_played() {
    let bounded = Plan {
        from: 5 * MS,
        until: 10 * MS,
        ..plan(1000)
    };
    assert_eq!(played(&mut player(bounded), 9), [(1, 5), (2, 5)]);
    let beyond = Plan {
        from: 99 * MS,
        ..plan(1000)
    };
    assert_eq!(played(&mut player(beyond), 9), []);
    let turned = Plan {
        from: 20 * MS,
        until: 5 * MS,
        ..plan(1000)
    };
    assert_eq!(played(&mut player(turned), 9), []);
    assert_eq!(played(&mut Player::new(vec![], plan(1000), Stamp(0)), 9), []);
}

#[test]
fn a_loop_begins_again_where_the_last_pass_was_due_to_end() {
    let mut player = player(Plan {
        repeats: true,
        ..plan(1000)
    });
    let told = played(&mut player, 8);
    assert_eq!(told[4..], [(0, 30), (1, 40), (2, 40), (3, 60)]);
}

#[test]
fn a_loop_of_one_instant_still_lets_time_pass() {
    let mut player = Player::new(
        vec![7],
        Plan {
            repeats: true,
            ..plan(1000)
        },
        Stamp(1000 * MS),
    );
    assert_eq!(played(&mut player, 3), [(0, 0), (0, 1), (0, 2)]);
}

#[test]
fn the_highest_speed_waits_for_nothing_and_looks_for_keys_between() {
    let mut player = Player::new(
        (0..200).map(|i| i * MS).collect(),
        Plan {
            speed: Speed::Max,
            ..plan(1)
        },
        Stamp(5),
    );
    let mut outputs = Vec::new();
    player.step(Stamp(6), Event::Wake, &mut outputs);
    assert_eq!(outputs.len(), BURST);
    while player.deadline().is_some() {
        player.step(Stamp(6), Event::Wake, &mut outputs);
    }
    assert_eq!((outputs.len(), outputs.last()), (201, Some(&Output::Ended)));
}

#[test]
fn a_pause_takes_no_time_from_the_session() {
    let mut player = player(plan(1000));
    let mut outputs = Vec::new();
    player.step(Stamp(1004 * MS), Event::Toggle, &mut outputs);
    assert_eq!(player.deadline(), None);
    player.step(Stamp(9000 * MS), Event::Toggle, &mut outputs);
    assert_eq!(player.position(Stamp(9001 * MS)), 5 * MS);
}

#[test]
fn a_step_plays_one_instant_and_a_step_back_returns_to_it() {
    let mut player = player(plan(1000));
    let mut outputs = Vec::new();
    let now = Stamp(1000 * MS);
    player.step(now, Event::Step, &mut outputs);
    player.step(now, Event::Step, &mut outputs);
    assert_eq!(outputs.len(), 3, "the second instant has two messages");
    assert_eq!(player.position(now), 10 * MS);
    outputs.clear();
    player.step(now, Event::StepBack, &mut outputs);
    assert_eq!(outputs, [Output::Jumped { to: 1 }]);
    for _ in 0..9 {
        player.step(now, Event::Step, &mut outputs);
    }
    assert_eq!(player.position(now), 30 * MS, "stepping beyond the end stays there");
}

#[test]
fn seeking_stays_inside_the_session() {
    let mut player = player(plan(1000));
    let mut outputs = Vec::new();
    let now = Stamp(1002 * MS);
    for (event, to) in [
        (Event::SeekBy(i64::MAX), 3),
        (Event::SeekBy(i64::MIN), 0),
        (Event::End, 3),
        (Event::Home, 0),
    ] {
        outputs.clear();
        player.step(now, event, &mut outputs);
        assert_eq!(outputs, [Output::Jumped { to }], "{event:?}");
    }
    assert!(player.is_paused(), "the end pauses, so that one can look at it");
}

#[test]
fn a_change_of_speed_goes_on_from_where_it_is() {
    let mut player = player(plan(1000));
    let now = Stamp(1004 * MS);
    player.step(now, Event::Faster, &mut Vec::new());
    assert_eq!((player.speed(), player.position(now)), (Speed::PerMille(2000), 4 * MS));
    assert_eq!(player.position(Stamp(1005 * MS)), 6 * MS);
    for _ in 0..20 {
        player.step(now, Event::Faster, &mut Vec::new());
    }
    assert_eq!(player.speed(), Speed::Max);
    for _ in 0..20 {
        player.step(now, Event::Slower, &mut Vec::new());
    }
    assert_eq!(player.speed(), Speed::PerMille(100));
}

#[test]
fn begun_paused_it_plays_nothing_until_somebody_wants_it() {
    let mut player = player(Plan {
        paused: true,
        ..plan(1000)
    });
    player.begin(Stamp(2000 * MS));
    assert_eq!((player.is_paused(), player.deadline()), (true, None));
    player.step(Stamp(3000 * MS), Event::Toggle, &mut Vec::new());
    assert_eq!(player.deadline(), Some(Stamp(3000 * MS)));
}

#[test]
fn a_loop_can_be_begun_and_left_while_it_plays() {
    let mut player = player(plan(1000));
    player.step(Stamp(1000 * MS), Event::ToggleLoop, &mut Vec::new());
    assert_eq!(played(&mut player, 5)[4], (0, 30), "it begins again");
    player.step(Stamp(1031 * MS), Event::ToggleLoop, &mut Vec::new());
    assert_eq!(played(&mut player, 9), [(1, 40), (2, 40), (3, 60)], "and then no more");
}

#[test]
fn from_here_and_until_here_leave_a_part_and_the_whole_comes_back() {
    let mut player = Player::new((0..10).map(|i| i * 10 * MS).collect(), plan(1000), Stamp(0));
    let mut outputs = Vec::new();
    player.step(Stamp(25 * MS), Event::FromHere, &mut outputs);
    player.step(Stamp(61 * MS), Event::UntilHere, &mut outputs);
    assert_eq!(player.part(), Some((25 * MS, 61 * MS)));
    assert!(player.is_paused(), "so that one can look at it, and it does not end");
    player.step(Stamp(70 * MS), Event::Home, &mut outputs);
    player.step(Stamp(70 * MS), Event::End, &mut outputs);
    assert_eq!(outputs, [Output::Jumped { to: 3 }, Output::Jumped { to: 7 }]);
    player.step(Stamp(80 * MS), Event::Whole, &mut outputs);
    assert_eq!(player.part(), None);
}

#[test]
fn a_loop_until_here_begins_again_at_once() {
    let mut player = Player::new((0..10).map(|i| i * 10 * MS).collect(), plan(1000), Stamp(0));
    let mut outputs = Vec::new();
    player.step(Stamp(15 * MS), Event::Wake, &mut outputs);
    player.step(Stamp(15 * MS), Event::ToggleLoop, &mut outputs);
    player.step(Stamp(15 * MS), Event::UntilHere, &mut outputs);
    outputs.clear();
    player.step(Stamp(15 * MS), Event::Wake, &mut outputs);
    assert_eq!(outputs, [Output::Jumped { to: 0 }]);
}

#[test]
fn a_part_without_any_message_is_not_chosen() {
    let mut player = player(plan(1000));
    let now = Stamp(1015 * MS);
    player.step(now, Event::FromHere, &mut Vec::new());
    player.step(now, Event::UntilHere, &mut Vec::new());
    assert_eq!(player.part(), Some((15 * MS, 30 * MS)));
}

#[test]
fn digits_go_to_the_tenths_of_what_is_played() {
    let mut player = Player::new((0..=100).map(|i| i * MS).collect(), plan(1000), Stamp(0));
    let mut outputs = Vec::new();
    player.step(Stamp(0), Event::Tenth(7), &mut outputs);
    player.step(Stamp(0), Event::FromHere, &mut outputs);
    player.step(Stamp(0), Event::Tenth(5), &mut outputs);
    assert_eq!(outputs, [Output::Jumped { to: 70 }, Output::Jumped { to: 85 }]);
}
