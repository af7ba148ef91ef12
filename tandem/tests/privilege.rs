//! What the rules of a site let each node say and hear is what the node itself declares, no less and hardly more.

use std::collections::BTreeSet;

use tandem_site::policy::{answers, asks, hears, hears_all, says};
use tandem_site::{Role, policy};
use tandem_wire::{NodeName, Ports, Topic};

fn set(topics: impl IntoIterator<Item = Topic>) -> BTreeSet<Topic> {
    topics.into_iter().collect()
}

/// `role` runs the node.
fn check<N: Ports>(role: Role) {
    assert_eq!(role.node(), Some(N::NAME));
    let journal = (N::NAME != NodeName::Recorder).then_some(Topic::Journal(N::NAME));
    let always = [Topic::Emergency, Topic::Clock(N::NAME)];
    let mut outputs = set(N::OUTPUTS.iter().copied().chain(journal).chain(always));
    if N::NAME == NodeName::Operator {
        // What lets a robot go is said by a person, with `tandem estop`.
        outputs.insert(Topic::AllClear);
    }
    if role != Role::Supervisor {
        outputs.remove(&Topic::TakeOver);
    }
    assert_eq!(
        set(says(role)),
        outputs,
        "{role} says what it declares, its clock, and the emergency stop"
    );

    // A device is in the process itself; who a node is, is asked.
    let heard = |topic: &Topic| !matches!(topic, Topic::Device | Topic::Info(_));
    let inputs = set(N::INPUTS.iter().copied().filter(heard));
    let allowed = set(hears(role));
    assert!(
        hears_all(role) || inputs.is_subset(&allowed),
        "{role} hears {inputs:?} but may hear {allowed:?}: add it to tandem_site::policy"
    );
    // Whoever stops must hear that it was stopped.
    let everybody = set([Topic::State, Topic::Setpoint, Topic::Emergency]);
    let more = set(allowed.difference(&inputs).copied());
    assert!(
        more.is_subset(&everybody),
        "{role} may hear {more:?} and does not need it"
    );

    let asked = set(N::INPUTS
        .iter()
        .copied()
        .filter(|topic| matches!(topic, Topic::Info(_))));
    assert!(asked.is_subset(&set(asks(role))), "{role} asks for {asked:?}");
    let answered = [Topic::Info(N::NAME), Topic::Journal(N::NAME), Topic::Ping(N::NAME)];
    assert_eq!(set(answers(role)), set(answered));
}

#[test]
fn each_node_may_do_what_it_declares_and_hardly_more() {
    check::<tandem_operator::Operator>(Role::Operator);
    check::<tandem_operator::Operator>(Role::Supervisor);
    check::<tandem_predictor::Predictor>(Role::Predictor);
    check::<tandem_arbiter::Arbiter>(Role::Arbiter);
    check::<tandem_robot_sim::RobotSim>(Role::RobotSim);
    check::<tandem_recorder::Recorder>(Role::Recorder);
    assert_eq!(policy::says(Role::Viewer), [Topic::Emergency]);
}
