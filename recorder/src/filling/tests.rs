//! Journals with gaps, and the questions and answers that fill them.

use tandem_wire::{Header, SECOND, Seq};

use super::*;

fn part(first: u64, entries: u64) -> JournalPart {
    part_of(NodeName::Arbiter, first, entries)
}

fn part_of(node: NodeName, first: u64, entries: u64) -> JournalPart {
    JournalPart {
        node,
        header: Header {
            tick: 0,
            session: Session(5),
            seq: Seq(0),
            sent: Stamp(0),
        },
        first,
        entries,
        lost: 0,
        bytes: Vec::new(),
    }
}

/// The questions that hearing, or being answered, leads to.
fn after(filling: &mut Filling, step: impl FnOnce(&mut Filling, &mut Outbox<Output>)) -> Vec<(u64, u64)> {
    let mut outbox = Outbox::default();
    step(filling, &mut outbox);
    let question = |output| match output {
        Output::Ask(question) => Some((question.first, question.last)),
        _ => None,
    };
    outbox.drain().filter_map(question).collect()
}

fn hear(filling: &mut Filling, at: u64, first: u64, entries: u64) -> Vec<(u64, u64)> {
    after(filling, |filling, outbox| {
        filling.hear(Stamp(at), &part(first, entries), outbox)
    })
}

/// A node says how far its journal goes; if everything is there, the counts are passed on and a look is taken.
fn end(filling: &mut Filling, at: u64, first: u64) -> Vec<(u64, u64)> {
    after(filling, |filling, outbox| {
        if filling.hear_end(Stamp(at), &part(first, 0), outbox).is_whole {
            filling.expect_look();
            filling.look(false, outbox);
        }
    })
}

fn answer(filling: &mut Filling, at: u64, first: u64, entries: u64) -> (bool, Vec<(u64, u64)>) {
    let mut take = false;
    let asked = after(filling, |filling, outbox| {
        take = filling.answer(Stamp(at), &part(first, entries), outbox).take;
    });
    (take, asked)
}

#[test]
fn a_late_start_and_a_gap_are_asked_for_one_after_the_other_until_they_are_there() {
    let mut filling = Filling::default();
    assert_eq!(hear(&mut filling, 0, 100, 10), [(0, 99)]);
    assert_eq!(hear(&mut filling, 1, 120, 10), []);
    assert_eq!(answer(&mut filling, 2, 0, 60), (true, vec![(60, 99)]));
    assert_eq!(answer(&mut filling, 3, 60, 40), (true, vec![(110, 119)]));
    assert_eq!(answer(&mut filling, 4, 110, 10), (true, vec![]));
    assert_eq!(filling.deadline(), None);
}

#[test]
fn journals_take_turns_and_one_that_is_not_answered_holds_the_others_up_for_a_while() {
    let (arbiter, robot) = (NodeName::Arbiter, NodeName::RobotSim);
    let mut filling = Filling::default();
    let mut hear = |at, node| {
        after(&mut filling, |filling, outbox| {
            filling.hear(Stamp(at), &part_of(node, 100, 10), outbox)
        })
    };
    assert_eq!(hear(1, arbiter), [(0, 99)]);
    assert_eq!(hear(2, robot), []);
    // The arbiter answers in part; it is the robot's turn.
    let mut outbox = Outbox::default();
    filling.answer(Stamp(3), &part_of(arbiter, 0, 60), &mut outbox);
    let asked = |outbox: &Outbox<Output>| match outbox.as_slice() {
        [Output::Ask(question)] => Some((question.node, question.first)),
        _ => None,
    };
    assert_eq!(asked(&outbox), Some((robot, 0)));
    // The robot does not: the arbiter has its turn once the robot had enough time.
    let held = filling.deadline().expect("a turn");
    let mut outbox = Outbox::default();
    filling.ask(Stamp(held.0 - 1), &mut outbox);
    assert_eq!(asked(&outbox), None);
    filling.ask(held, &mut outbox);
    assert_eq!(asked(&outbox), Some((arbiter, 60)));
    assert!(filling.deadline().is_some_and(|next| next > held));
}

#[test]
fn what_was_not_asked_for_is_not_taken() {
    let mut filling = Filling::default();
    assert_eq!(answer(&mut filling, 0, 0, 10), (false, vec![]));
    hear(&mut filling, 0, 50, 10);
    for (first, entries) in [(60, 5), (40, 11), (u64::MAX, 2)] {
        assert!(!answer(&mut filling, 1, first, entries).0, "{first} {entries}");
    }
    assert!(answer(&mut filling, 1, 0, 50).0);
}

#[test]
fn what_cannot_be_had_any_more_is_said_and_not_asked_for_again() {
    let mut filling = Filling::default();
    hear(&mut filling, 0, 100, 10);
    let mut outbox = Outbox::default();
    let worth = filling.answer(Stamp(1), &part(70, 30), &mut outbox);
    let words = worth.note.map(|note| note.text).unwrap_or_default();
    assert!(worth.take && words.starts_with("70 entries"), "{words}");
    assert_eq!((outbox.as_slice().len(), filling.deadline()), (0, None));
}

#[test]
fn silence_is_asked_thrice() {
    let mut filling = Filling::default();
    assert_eq!(hear(&mut filling, 0, 10, 10), [(0, 9)]);
    let mut now = 0;
    for _ in 1..journal::TRIES {
        assert_eq!(answer(&mut filling, now, 0, 0), (false, vec![]));
        now = filling.deadline().expect("another try").0;
        assert_eq!(
            after(&mut filling, |filling, outbox| filling.ask(Stamp(now), outbox)),
            [(0, 9)]
        );
    }
    answer(&mut filling, now, 0, 0);
    assert_eq!(filling.deadline(), None);
}

#[test]
fn whoever_ends_hears_that_everything_is_there_only_once_it_is() {
    let mut filling = Filling::default();
    hear(&mut filling, 0, 0, 10);
    assert_eq!(end(&mut filling, 1, 20), [(10, 19)]);
    assert_eq!(end(&mut filling, 2, 20), []);
    answer(&mut filling, 3, 10, 10);
    assert_eq!(end(&mut filling, 4, 20), [(20, 20)]);
}

#[test]
fn whoever_ends_does_not_hear_that_everything_is_there_when_the_recorder_has_given_up() {
    let mut filling = Filling::default();
    hear(&mut filling, 0, 10, 10);
    give_up(&mut filling);
    assert_eq!(end(&mut filling, 9, 20), []);
    // Nor by the question for the tail.
    let later = Stamp(0).after(2 * SECOND);
    let asked = after(&mut filling, |filling, outbox| filling.close(later, outbox));
    assert_eq!(asked, [(19, u64::MAX)]);
}

#[test]
fn entries_that_nobody_gave_out_and_those_of_a_node_that_vanished_are_told() {
    let told = |filling: &mut Filling| {
        filling
            .take_notes()
            .into_iter()
            .map(|note| note.text)
            .collect::<Vec<_>>()
    };
    let mut overdue = Filling::default();
    hear(&mut overdue, 0, 10, 10);
    for _ in 0..2 * journal::TRIES {
        let until = overdue.deadline().unwrap_or_default();
        after(&mut overdue, |filling, outbox| filling.ask(until, outbox));
    }
    let in_vain = "10 entries of its journal are missing: asked for 3 times, nobody answered";
    assert_eq!(told(&mut overdue), [in_vain]);
    let mut vanished = Filling::default();
    hear(&mut vanished, 0, 10, 10);
    for _ in 0..2 {
        vanished.presence(NodeName::Arbiter, false);
    }
    let gone = "10 entries of its journal are missing: it vanished before they were fetched";
    assert_eq!(told(&mut vanished), [gone]);
}

/// Nobody answers the question for the first ten entries.
fn give_up(filling: &mut Filling) {
    for _ in 0..journal::TRIES {
        answer(filling, 0, 0, 0);
        let again = filling.deadline().unwrap_or_default();
        after(filling, |filling, outbox| filling.ask(again, outbox));
    }
}

#[test]
fn at_the_end_each_journal_that_is_still_written_is_asked_for_its_tail_once() {
    let mut filling = Filling::default();
    hear(&mut filling, 0, 0, 10);
    assert!(!filling.is_settled());
    let close = |filling: &mut Filling| after(filling, |filling, outbox| filling.close(Stamp(1), outbox));
    assert_eq!(close(&mut filling), [(10, u64::MAX)]);
    assert!(!filling.is_settled());
    assert_eq!(answer(&mut filling, 2, 10, 4), (true, vec![]));
    assert!(filling.is_settled());
    let mut vanished = Filling::default();
    hear(&mut vanished, 0, 0, 10);
    vanished.presence(NodeName::Arbiter, false);
    assert_eq!(close(&mut vanished), []);
    assert!(vanished.is_settled());
}
