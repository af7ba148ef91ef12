//! Trials that several senders begin, each repeating its marks for those who come late.

mod support;

use support::*;
use tandem_robot_sim::Event;
use tandem_wire::{Envelope, Header, Session, Trial};

fn begin_from(session: u64, number: u32) -> Event {
    let header = Header {
        session: Session(session),
        ..Header::default()
    };
    let label = String::from("a trial");
    Event::Trial(Envelope {
        header,
        body: Trial::Begin { number, label },
    })
}

#[test]
fn a_repeated_mark_of_an_earlier_sender_does_not_begin_its_trial_again() {
    let mut stage = Stage::real();
    stage.pass(at(50));
    stage.step(begin_from(9, 1));
    stage.pass(at(250));
    stage.step(begin_from(10, 1));
    stage.pass(at(450));
    let running = (stage.state().body.trial, stage.state().body.trial_start);
    assert_eq!(running, (1, 2));
    for millis in (500..3000).step_by(500) {
        stage.pass(at(millis));
        stage.step(begin_from(9, 1));
        stage.step(begin_from(10, 1));
        stage.pass(at(millis + 100));
        assert_eq!((stage.state().body.trial, stage.state().body.trial_start), running);
    }
    stage.step(begin_from(9, 2));
    stage.pass(at(3200));
    assert_eq!(stage.state().body.trial, 2, "its next trial is news");
}

#[test]
fn the_first_of_many_senders_is_forgotten_and_nothing_else_breaks() {
    let mut stage = Stage::real();
    for session in 1..=100 {
        stage.step(begin_from(session, u32::MAX));
        stage.pass(at(session * 40));
        assert_eq!(stage.state().body.trial, u32::MAX);
    }
}
