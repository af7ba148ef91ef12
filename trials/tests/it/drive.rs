//! A driver and a robot of one point, over scripted time: who may move when, and what is said of it.

use tandem_trials::drive::{DriveSettings, Driver, End, Hand, Pause, Phase, Track, Waypoint, Wish};
use tandem_wire::{
    Envelope, Finite, Header, MILLISECOND, Motion, Nanos, Pose, Reason, Refusals, SECOND, Stamp, State, Vec3,
};

/// Half a second to the right at 0.1 m/s.
fn track() -> Track {
    let point = |at: Nanos, x| Waypoint {
        at,
        tool: Vec3::new(x, 0.0, 0.0),
    };
    Track::through([point(0, 0.5), point(SECOND / 2, 0.55)]).expect("two points")
}

/// A robot that does what its hand says, without delay, while it permits motion.
struct Rig {
    driver: Driver,
    now: Stamp,
    tool: Vec3,
    motion: Motion,
    press: u32,
    hand: Hand,
}

const STEP: Nanos = 20 * MILLISECOND;
const RELEASED: Motion = Motion::Held(Reason::DeadmanReleased);

impl Rig {
    fn at(x: f64, per_mille: u32) -> Self {
        let mut rig = Self {
            driver: Driver::new(track(), DriveSettings::default(), per_mille, Stamp(0)),
            now: Stamp(0),
            tool: Vec3::new(x, 0.0, 0.0),
            motion: RELEASED,
            press: 0,
            hand: Hand::default(),
        };
        rig.see();
        rig
    }

    fn see(&mut self) {
        let body = State {
            trial: 0,
            trial_start: 0,
            joints: [Finite(0.0); 7],
            joint_velocities: [Finite(0.0); 7],
            links: [Pose::default(); 8],
            tool: Pose {
                position: self.tool,
                ..Pose::default()
            },
            tool_velocity: Vec3::ZERO,
            clearance: None,
            closest: None,
            motion: self.motion,
            at_rest: false,
            obeys: None,
            arrivals: None,
            refused: Refusals::default(),
        };
        let header = Header::default();
        self.driver.see(self.now, &Envelope { header, body });
    }

    /// One period; the robot permits motion while the hand holds, as arbiter and robot do.
    fn step(&mut self) -> Phase {
        self.now = self.now.after(STEP);
        let before = self.hand;
        self.hand = self.driver.step(self.now);
        self.motion = match (self.hand.held, self.motion) {
            (false, _) => RELEASED,
            (true, Motion::Permitted { .. }) if before.presses == self.hand.presses => self.motion,
            (true, _) => {
                self.press += 1;
                Motion::Permitted { press: self.press }
            }
        };
        if self.motion.is_permitted() {
            self.tool = self.tool + self.hand.velocity * 0.02;
        }
        self.see();
        self.driver.phase()
    }

    fn steps(&mut self, count: usize) -> Phase {
        (0..count).for_each(|_| {
            self.step();
        });
        self.driver.phase()
    }

    fn wish(&mut self, wish: Wish) {
        self.driver.wish(self.now, wish);
    }
}

#[test]
fn nothing_moves_before_somebody_holds_the_deadman() {
    let mut rig = Rig::at(0.5, 1000);
    assert_eq!(rig.steps(200), Phase::Waiting(Pause::Ready));
    assert_eq!(rig.hand, Hand::default());
    assert_eq!(rig.tool.x, 0.5);
}

#[test]
fn a_robot_at_the_start_follows_the_path_to_its_end() {
    let mut rig = Rig::at(0.502, 1000);
    rig.wish(Wish::Go);
    assert_eq!(rig.steps(2), Phase::Following);
    assert_eq!(rig.steps(100), Phase::Ended(End::Arrived));
    assert!((rig.tool.x - 0.55).abs() < 0.002, "{}", rig.tool.x);
    assert!(!rig.hand.held, "and lets go");
    let deviation = rig.driver.deviation();
    assert!(deviation.count > 20 && deviation.largest < 0.003, "{deviation:?}");
}

#[test]
fn at_half_the_speed_it_takes_twice_as_long() {
    let took = |per_mille| {
        let mut rig = Rig::at(0.5, per_mille);
        rig.wish(Wish::Go);
        (0..500_i32)
            .find(|_| matches!(rig.step(), Phase::Ended(_)))
            .expect("it ends")
    };
    let (whole, half) = (took(1000), took(500));
    assert!((2 * whole).abs_diff(half) < 10, "{whole} and {half} steps");
}

#[test]
fn a_robot_nearby_is_eased_in_no_faster_than_allowed() {
    let mut rig = Rig::at(0.43, 1000);
    rig.wish(Wish::Go);
    rig.steps(2);
    let mut eased = 0;
    while let Phase::Easing(_) = rig.step() {
        eased += 1;
        assert!(rig.hand.velocity.norm() <= 0.05 + 1e-12);
        assert!(eased < 500, "it gets there");
    }
    assert!(eased > 50, "70 mm at 50 mm/s take over a second");
    assert_eq!(rig.steps(100), Phase::Ended(End::Arrived));
}

#[test]
fn a_robot_farther_away_is_refused_with_the_distance_in_words() {
    let mut rig = Rig::at(0.3, 1000);
    rig.wish(Wish::Go);
    let Phase::Ended(end) = rig.steps(5) else {
        panic!("{:?}", rig.driver.phase())
    };
    assert!(end.to_string().contains("200 mm"), "{end}");
    assert_eq!(rig.hand, Hand::default());
}

#[test]
fn another_posture_is_refused_by_joint() {
    let mut rig = Rig::at(0.5, 1000);
    let end = End::OtherPosture {
        joint: 4,
        by: 1.5,
        limit: 0.6,
    };
    assert!(end.to_string().contains("joint 4 differs by 1.50 rad"), "{end}");
    // A track without joints has nothing to compare.
    assert_eq!(rig.step(), Phase::Waiting(Pause::Ready));
}

#[test]
fn after_a_stop_only_another_press_goes_on_and_the_path_has_waited() {
    let mut rig = Rig::at(0.5, 1000);
    rig.wish(Wish::Go);
    rig.steps(12);
    rig.wish(Wish::Stop);
    assert_eq!(rig.step(), Phase::Waiting(Pause::Stopped));
    let (position, tool) = (rig.driver.position(), rig.tool);
    assert_eq!(rig.steps(200), Phase::Waiting(Pause::Stopped));
    assert_eq!((rig.driver.position(), rig.tool), (position, tool));
    rig.wish(Wish::Go);
    assert_eq!(rig.steps(100), Phase::Ended(End::Arrived));
}

#[test]
fn after_a_hold_it_does_not_go_on_by_itself() {
    let mut rig = Rig::at(0.5, 1000);
    rig.wish(Wish::Go);
    rig.steps(12);
    rig.motion = Motion::Held(Reason::SetpointLost { silent: 1 });
    rig.see();
    let held = Phase::Waiting(Pause::Held(Reason::SetpointLost { silent: 1 }));
    assert_eq!(rig.driver.phase(), held);
    // Whatever the robot permits from now on, the hand is open.
    rig.motion = Motion::Permitted { press: 99 };
    rig.see();
    assert_eq!(rig.steps(200), held);
    assert!(!rig.hand.held);
}

#[test]
fn a_press_that_nobody_answers_is_let_go_of() {
    let mut rig = Rig::at(0.5, 1000);
    rig.wish(Wish::Go);
    for _ in 0..60 {
        rig.now = rig.now.after(STEP);
        rig.hand = rig.driver.step(rig.now);
        rig.see();
    }
    assert_eq!(rig.driver.phase(), Phase::Waiting(Pause::Held(Reason::DeadmanReleased)));
}

#[test]
fn the_permission_of_the_press_before_is_not_taken_for_ours() {
    let mut rig = Rig::at(0.5, 1000);
    rig.motion = Motion::Permitted { press: 3 };
    rig.see();
    rig.wish(Wish::Go);
    rig.see();
    assert_eq!(rig.driver.phase(), Phase::Asking);
    rig.motion = Motion::Permitted { press: 4 };
    rig.see();
    assert_eq!(rig.driver.phase(), Phase::Following);
}

#[test]
fn a_tool_that_is_led_astray_is_stopped() {
    let mut rig = Rig::at(0.5, 1000);
    rig.wish(Wish::Go);
    rig.steps(5);
    rig.tool.y = 0.06;
    rig.see();
    let Phase::Waiting(Pause::Astray(distance)) = rig.driver.phase() else {
        panic!("{:?}", rig.driver.phase())
    };
    assert!((0.055..0.07).contains(&distance), "{distance}");
}

#[test]
fn a_robot_that_falls_silent_ends_it_and_so_does_one_that_never_speaks() {
    let mut rig = Rig::at(0.5, 1000);
    rig.wish(Wish::Go);
    rig.steps(5);
    let mut now = rig.now;
    for _ in 0..60 {
        now = now.after(STEP);
        rig.hand = rig.driver.step(now);
    }
    assert!(matches!(
        rig.driver.phase(),
        Phase::Ended(End::Silent { ever: true, .. })
    ));
    assert!(!rig.hand.held);
    let mut alone = Driver::new(track(), DriveSettings::default(), 1000, Stamp(0));
    assert_eq!(alone.step(Stamp(5 * SECOND)), Hand::default());
    assert_eq!(alone.phase(), Phase::Looking);
    alone.step(Stamp(5 * SECOND + 1));
    assert!(matches!(alone.phase(), Phase::Ended(End::Silent { ever: false, .. })));
}

#[test]
fn time_in_which_the_process_slept_does_not_carry_the_path_on() {
    let mut rig = Rig::at(0.5, 1000);
    rig.wish(Wish::Go);
    rig.steps(3);
    let before = rig.driver.position();
    rig.now = rig.now.after(900 * MILLISECOND);
    rig.driver.step(rig.now);
    assert!(rig.driver.position() <= before + 100 * MILLISECOND);
}
