//! Waiting until a simulated human has brought the tool to the goal.

use std::time::{Duration, Instant};

use tandem_link::{Link, Network};
use tandem_wire::{Scene, State, Topic, decode};

/// Nobody waits longer.
const PATIENCE: Duration = Duration::from_secs(90);

/// Watches a robot until its tool has come to rest at the goal.
pub(crate) fn wait_for_the_goal(link: &Link, robot: &str) {
    let network = Network::watch(link, &[robot.into()], &[Topic::Scene, Topic::State]).expect("a watch");
    let limit = Instant::now() + PATIENCE;
    let (mut goal, mut last) = (None, None);
    while Instant::now() < limit {
        let Some(noticed) = network.next(Duration::from_secs(5)) else {
            continue;
        };
        match noticed.topic {
            Topic::Scene => {
                goal = decode::<Scene>(&noticed.bytes)
                    .ok()
                    .map(|scene| (scene.body.goal, scene.body.goal_tolerance.0))
            }
            Topic::State => last = decode::<State>(&noticed.bytes).ok().map(|state| state.body),
            _ => {}
        }
        if let (Some((goal, tolerance)), Some(state)) = (goal, last)
            && state.at_rest
            && state.trial > 0
            && (state.tool.position - goal).norm() <= tolerance
        {
            return;
        }
    }
    panic!("{robot} is not at the goal after {PATIENCE:?}; its last state was {last:?}");
}
