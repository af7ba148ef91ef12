//! A node restored from a snapshot goes on as the one that the snapshot was taken of, byte for byte; a damaged snapshot
//! is refused, or makes a node that still never panics.

use std::ops::ControlFlow;
use std::sync::{Arc, LazyLock, Mutex};

use crate::support::{model, replanning_model};
use proptest::prelude::*;
use tandem_cesn::Model;
use tandem_operator::SourceKind;
use tandem_trials::world::{Said, Seat};
use tandem_trials::{Blueprint, Configuration, Player, World};
use tandem_wire::{
    Happening, Input, Malformed, Node, NodeName, Outbox, Ports, SECOND, Session, Stamp, Topic, Trial, restore, snapshot,
};

type Script = Vec<(Stamp, Happening)>;

fn input(happening: &Happening) -> Input<'_> {
    match happening {
        Happening::Sample { topic, bytes } => Input::Sample { topic: *topic, bytes },
        Happening::Presence { peer, alive } => Input::Presence {
            peer: *peer,
            alive: *alive,
        },
        Happening::Stop => Input::Stop,
        _ => Input::Wake,
    }
}

/// A node that misses some of what it is told, and a record of the rest.
struct Faulty<N: Node> {
    seat: Seat<N>,
    script: Arc<Mutex<Script>>,
    lottery: u64,
    loss_percent: u64,
}

impl<N: Ports> Faulty<N> {
    fn new(node: N, seed: u64, loss_percent: u64) -> (Box<Self>, Arc<Mutex<Script>>) {
        let script = Arc::default();
        let faulty = Self {
            seat: Seat::new(node),
            script: Arc::clone(&script),
            lottery: seed,
            loss_percent,
        };
        (Box::new(faulty), script)
    }

    fn draw(&mut self) -> u64 {
        self.lottery = self.lottery.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (self.lottery >> 33) % 100
    }
}

impl<N> Player for Faulty<N>
where
    N: Ports + Send,
    N::Output: Send,
{
    fn name(&self) -> NodeName {
        self.seat.name()
    }

    fn hears(&self, topic: Topic) -> bool {
        self.seat.hears(topic)
    }

    fn deadline(&self) -> Option<Stamp> {
        self.seat.deadline()
    }

    fn take(&mut self, now: Stamp, input: Input<'_>, said: &mut Said) {
        if input != Input::Wake && self.draw() < self.loss_percent {
            return;
        }
        self.script
            .lock()
            .expect("one thread")
            .push((now, Happening::from(input)));
        self.seat.take(now, input, said);
    }
}

fn samples<N: Ports>(outbox: &mut Outbox<N::Output>) -> Vec<(Topic, Vec<u8>)> {
    let sample = |output| {
        let mut bytes = Vec::new();
        N::sample(&output, &mut bytes).map(|topic| (topic, bytes))
    };
    outbox.drain().filter_map(sample).collect()
}

static BLUEPRINT: LazyLock<Blueprint> = LazyLock::new(|| blueprint(SourceKind::Simulated, model()));
/// Its predictor forecasts on every tick.
static REPLANNING: LazyLock<Blueprint> = LazyLock::new(|| blueprint(SourceKind::Simulated, replanning_model()));

fn blueprint(source: SourceKind, model: Model) -> Blueprint {
    let mut configuration = Configuration::default();
    configuration.operator.source = source;
    Blueprint::new(configuration, Session(9), Some(model)).expect("the defaults fit")
}

/// What each of the four saw in the first seconds of a trial on a bad network.
fn scripts(blueprint: &Blueprint, seed: u64, loss_percent: u64) -> [Script; 4] {
    let (operator, saw_operator) = Faulty::new(blueprint.operator(), seed, loss_percent);
    let (predictor, saw_predictor) =
        Faulty::new(blueprint.predictor().expect("the defaults fit"), seed ^ 1, loss_percent);
    let (arbiter, saw_arbiter) = Faulty::new(blueprint.arbiter().expect("the defaults fit"), seed ^ 2, loss_percent);
    let (robot, saw_robot) = Faulty::new(
        blueprint.robot_sim().expect("the defaults fit"),
        seed ^ 3,
        loss_percent / 4,
    );
    let mut world = World::of(
        vec![operator, predictor, arbiter, robot],
        blueprint.timing(),
        Session(9),
    );
    for number in 1..=2 {
        let label = "snapshots".to_owned();
        world.mark(Trial::Begin { number, label });
        world.run(6 * SECOND, |_, _, _| ControlFlow::Continue(()));
    }
    [saw_operator, saw_predictor, saw_arbiter, saw_robot]
        .map(|saw| std::mem::take(&mut *saw.lock().expect("one thread")))
}

/// Steps through the script; what came out of every step.
fn play<N: Ports>(node: &mut N, script: &[(Stamp, Happening)]) -> Vec<Vec<(Topic, Vec<u8>)>> {
    let mut outbox = Outbox::default();
    let step = |(now, happening): &(Stamp, Happening)| {
        node.step(*now, N::event(input(happening)), &mut outbox);
        samples::<N>(&mut outbox)
    };
    script.iter().map(step).collect()
}

fn taken<N: Ports>(node: &mut N) -> Vec<u8> {
    let mut bytes = Vec::new();
    snapshot(node, &mut bytes);
    bytes
}

/// Cuts the script at `share`, and damages the snapshot taken there.
fn check<N: Ports>(fresh: impl Fn() -> N, script: &[(Stamp, Happening)], share: f64, damage: (usize, u8)) {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a share of a length"
    )]
    let cut = (share * script.len() as f64) as usize;
    let (before, after) = script.split_at(cut);
    let mut one = fresh();
    play(&mut one, before);
    let bytes = taken(&mut one);

    let mut other = fresh();
    restore(&mut other, &bytes).expect("its own snapshot");
    assert_eq!((other.deadline(), other.trial()), (one.deadline(), one.trial()));
    assert_eq!(taken(&mut other), bytes, "a snapshot says everything");
    assert_eq!(play(&mut other, after), play(&mut one, after));
    assert_eq!(taken(&mut other), taken(&mut one));

    assert!(
        restore(&mut fresh(), &bytes[..damage.0 % bytes.len()]).is_err(),
        "cut short"
    );
    let longer = [&bytes[..], &[0]].concat();
    assert_eq!(restore(&mut fresh(), &longer), Err(Malformed::Trailing(1)));
    let mut damaged = bytes;
    let at = damage.0 % damaged.len();
    damaged[at] ^= damage.1.max(1);
    let mut odd = fresh();
    if restore(&mut odd, &damaged).is_ok() {
        play(&mut odd, &after[..after.len().min(300)]);
    }
}

/// The same states, and somebody at the keyboard who presses at random.
fn with_keyboard(script: &Script, seed: u64) -> Script {
    let mut lottery = seed;
    let mut draw = || {
        lottery = lottery.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        lottery.to_be_bytes()
    };
    let mut pressing = [3, 0, 0, 0, 0, 0, 0];
    let mut with = Script::new();
    for (now, happening) in script {
        with.push((*now, happening.clone()));
        let [change, keys, more, ..] = draw();
        if change > 240 {
            pressing[1] = keys & 0x7f;
            pressing[2] = u8::wrapping_add(pressing[2], more & 1);
            for (bit, count) in (1..).zip(&mut pressing[3..]) {
                *count = count.wrapping_add((more >> bit) & 1);
            }
        }
        let bytes = pressing.to_vec();
        let topic = Topic::Device;
        with.push((*now, Happening::Sample { topic, bytes }));
    }
    with
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_node_goes_on_from_a_snapshot_as_if_nothing_had_been(
        seed in any::<u64>(), loss in 0..40_u64, shares in prop::collection::vec(0.0..1.0_f64, 4),
        damages in prop::collection::vec((any::<usize>(), any::<u8>()), 4),
    ) {
        let [operator, predictor, arbiter, robot] = scripts(&BLUEPRINT, seed, loss);
        for (share, damage) in shares.into_iter().zip(damages) {
            check(|| BLUEPRINT.operator(), &operator, share, damage);
            check(|| BLUEPRINT.predictor().expect("the defaults fit"), &predictor, share, damage);
            check(|| BLUEPRINT.arbiter().expect("the defaults fit"), &arbiter, share, damage);
            check(|| BLUEPRINT.robot_sim().expect("the defaults fit"), &robot, share, damage);
        }
    }

    #[test]
    fn so_does_a_predictor_that_is_conditioned_anew_on_every_tick(
        seed in any::<u64>(), loss in 0..40_u64, share in 0.0..1.0_f64, damage in (any::<usize>(), any::<u8>()),
    ) {
        let [_, predictor, ..] = scripts(&REPLANNING, seed, loss);
        check(|| REPLANNING.predictor().expect("the model fits"), &predictor, share, damage);
    }

    #[test]
    fn so_does_an_operator_at_the_keyboard(
        seed in any::<u64>(), share in 0.0..1.0_f64, damage in (any::<usize>(), any::<u8>()),
    ) {
        static KEYBOARD: LazyLock<Blueprint> = LazyLock::new(|| blueprint(SourceKind::Keyboard, model()));
        let [operator, ..] = scripts(&BLUEPRINT, seed, 3);
        check(|| KEYBOARD.operator(), &with_keyboard(&operator, seed), share, damage);
    }
}

#[test]
fn a_snapshot_of_another_node_or_of_nothing_is_refused() {
    let mut arbiter = BLUEPRINT.arbiter().expect("the defaults fit");
    let bytes = taken(&mut BLUEPRINT.robot_sim().expect("the defaults fit"));
    let refused = restore(&mut arbiter, &bytes);
    assert!(matches!(refused, Err(Malformed::Kind { .. })), "{refused:?}");
    assert_eq!(restore(&mut arbiter, &[]), Err(Malformed::Truncated(0)));
    assert!(matches!(restore(&mut arbiter, &[0, 2]), Err(Malformed::Version(0))));
}
