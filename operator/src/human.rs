//! The simulated human: when it drives, and when it lets go.
//!
//! It is patient and predictable. It waits until a trial runs and the tool is at its path's start, presses, and steers
//! to its [`Wish`] as its [`policy`](crate::policy) says. If the robot stops, it lets go for one control period and
//! presses anew, but not for ever; when the path is done it lets go for good, and that is how others know.
//!
//! ```text
//!           at the start            the last step is reached and the tool rests: Arrived
//!  Waiting ─────────────▶ Driving ─────────────────────────────────────────────────────▶ Done
//!     ▲                               too long: TimeUp; too many presses: GaveUp          │
//!     └─────────────────────── another trial, another robot ──────────────────────────────┘
//!
//!  within Driving:
//!               the robot moves                the robot stops
//!   Pressing ────────────────────▶ Moving ─────────────────────▶ LetGo
//!     ▲  └──── it does not, for half a second ─────────────────▶   │
//!     └──────────────────── a control period later ────────────────┘
//! ```

use std::collections::VecDeque;

use bincode::{Decode, Encode};
use tandem_wire::{Deadman, Malformed, Memory, Reason, Remember, Vec3};

use crate::config::HumanConfig;
use crate::family::LAST_STEP;
use crate::policy::{Percept, each, velocity};
use crate::random::{Draws, Stream};
use crate::sight::Sight;
use crate::wish::Wish;

/// It starts only with the tool this near to its path's start, in metres.
const START_TOLERANCE: f64 = 0.05;
/// The tool counts as resting below this speed, in metres per second: far below any speed on the path's middle.
const RESTING: f64 = 0.05;
/// Noise alone moves the tool by this many standard deviations in a period and still counts as rest.
const NOISE_AT_REST: f64 = 4.0;
/// The tool must rest for this many control periods on end.
const REST_TICKS: u32 = 5;
/// Presses in one trial; a robot that stops more often than this has something that patience will not cure.
pub(crate) const MAX_PRESSES: u32 = 20;

/// Why the simulated human waits.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub enum Waiting {
    /// No trial runs.
    NoTrial,
    /// A trial has just begun; it drives from the next control period on.
    TrialBegun,
    /// The tool is too far from its path's start.
    NotAtStart {
        /// How far, in metres.
        distance: f64,
    },
}

/// Why the simulated human let go for good.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub enum Ended {
    /// The path's last step was reached and the tool came to rest.
    Arrived,
    /// The time limit passed.
    TimeUp,
    /// The robot stopped again and again.
    GaveUp,
    /// The robot says that the trial is over.
    TrialOver,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
enum Hand {
    Pressing { since: u32 },
    Moving,
    LetGo,
}

#[derive(Clone, Debug, PartialEq, Encode, Decode)]
enum Stage {
    Waiting(Waiting),
    Driving(Drive),
    Done(Ended),
}

/// What the simulated human is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Doing {
    /// Waiting, for the reason given.
    Waiting(Waiting),
    /// Driving, at this step of its path.
    Driving {
        /// The step that is now.
        step: f64,
    },
    /// Letting go for a moment because the robot stopped.
    PressingAnew,
    /// Done, for the reason given.
    Done(Ended),
}

/// A simulated human.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SimulatedHuman {
    config: HumanConfig,
    trial: u32,
    /// The control period in which the trial began.
    trial_start: u32,
    wish: Wish,
    stage: Stage,
    /// The last press: they count through all trials.
    press: u32,
    velocity: Vec3,
}

impl SimulatedHuman {
    pub(crate) fn new(config: HumanConfig) -> Self {
        Self {
            trial: 0,
            trial_start: 0,
            wish: Wish::new(config.path, config.spread, Draws::new(config.seed, 0)),
            stage: Stage::Waiting(Waiting::NoTrial),
            press: 0,
            velocity: Vec3::ZERO,
            config,
        }
    }

    /// Takes in a state. A new trial shows at once; all else is decided once per control period.
    pub(crate) fn see(&mut self, sight: &Sight) {
        if sight.new_robot || (sight.trial, sight.trial_start) != (self.trial, self.trial_start) {
            self.begin(sight);
        } else if sight.passed > 0 {
            self.advance(sight);
        }
    }

    /// There is no picture any more: nobody drives blind.
    pub(crate) fn go_blind(&mut self) {
        self.velocity = Vec3::ZERO;
        if let Stage::Driving(drive) = &mut self.stage {
            drive.hand = Hand::LetGo;
        }
    }

    pub(crate) fn velocity(&self) -> Vec3 {
        self.velocity
    }

    pub(crate) fn deadman(&self) -> Deadman {
        match &self.stage {
            Stage::Driving(drive) if drive.hand != Hand::LetGo => Deadman::Held { press: self.press },
            _ => Deadman::Released,
        }
    }

    /// Where it wishes the tool to be by now, while it drives.
    pub(crate) fn wish(&self) -> Option<Vec3> {
        match &self.stage {
            Stage::Driving(drive) => Some(self.config.frame.to_base(self.wish.at(drive.step))),
            Stage::Waiting(_) | Stage::Done(_) => None,
        }
    }

    pub(crate) fn doing(&self) -> Doing {
        match &self.stage {
            Stage::Waiting(why) => Doing::Waiting(*why),
            Stage::Driving(drive) if drive.hand == Hand::LetGo => Doing::PressingAnew,
            Stage::Driving(drive) => Doing::Driving { step: drive.step },
            Stage::Done(why) => Doing::Done(*why),
        }
    }

    fn begin(&mut self, sight: &Sight) {
        let trial = sight.trial;
        let draws = self.config.draws(trial);
        self.trial = trial;
        self.trial_start = sight.trial_start;
        self.wish = Wish::new(self.config.path, self.config.spread, draws);
        self.velocity = Vec3::ZERO;
        self.stage = Stage::Waiting(if trial == 0 {
            Waiting::NoTrial
        } else {
            Waiting::TrialBegun
        });
    }

    fn advance(&mut self, sight: &Sight) {
        match &mut self.stage {
            Stage::Waiting(_) => self.start(sight),
            Stage::Driving(drive) => match drive.advance(sight, &self.config, &mut self.press) {
                Ok(()) => self.velocity = drive.velocity(sight, &self.config, &self.wish),
                Err(ended) => {
                    self.velocity = Vec3::ZERO;
                    self.stage = Stage::Done(ended);
                }
            },
            Stage::Done(_) => {}
        }
    }

    fn start(&mut self, sight: &Sight) {
        if self.trial == 0 {
            return;
        }
        let start = self.wish.start();
        let distance = libm::hypot(sight.tool[0] - start[0], sight.tool[1] - start[1]);
        self.stage = if distance <= START_TOLERANCE {
            self.press = self.press.wrapping_add(1);
            let mut drive = Drive::begin(sight);
            self.velocity = drive.velocity(sight, &self.config, &self.wish);
            Stage::Driving(drive)
        } else {
            Stage::Waiting(Waiting::NotAtStart { distance })
        };
    }
}

impl Remember for SimulatedHuman {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            config,
            trial,
            trial_start,
            // Drawn anew from the seed and the trial's number.
            wish,
            stage,
            press,
            velocity,
        } = self;
        memory.part(trial)?;
        memory.part(trial_start)?;
        *wish = Wish::new(config.path, config.spread, config.draws(*trial));
        memory.part(stage)?;
        memory.part(press)?;
        memory.part(velocity)
    }
}

/// One trial's driving.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
struct Drive {
    trial: u32,
    hand: Hand,
    presses: u32,
    began: u32,
    step: f64,
    tool: [f64; 2],
    moved: [f64; 2],
    rested: u32,
    /// What was seen, oldest first, as far back as the reaction takes.
    memory: VecDeque<Percept>,
}

impl Drive {
    fn begin(sight: &Sight) -> Self {
        Self {
            trial: sight.trial,
            hand: Hand::Pressing { since: sight.tick },
            presses: 1,
            began: sight.tick,
            step: sight.guide.map_or(0.0, |guide| guide.phase),
            tool: sight.tool,
            moved: [0.0; 2],
            rested: 0,
            memory: VecDeque::new(),
        }
    }

    /// One control period; an error says why driving ends.
    fn advance(&mut self, sight: &Sight, config: &HumanConfig, press: &mut u32) -> Result<(), Ended> {
        self.moved = each(|i| sight.tool[i] - self.tool[i]);
        self.tool = sight.tool;
        self.move_on(sight);
        if self.rests(sight, config) {
            return Err(Ended::Arrived);
        }
        if sight.tick.saturating_sub(self.began) >= config.limit_ticks {
            return Err(Ended::TimeUp);
        }
        self.move_hand(sight, config, press)
    }

    /// Before there is a forecast the path's step is the time for which the robot has moved; afterwards it is the
    /// forecast's phase.
    fn move_on(&mut self, sight: &Sight) {
        match sight.guide {
            Some(guide) => self.step = guide.phase,
            None if sight.motion.is_permitted() => self.step += f64::from(sight.passed),
            None => {}
        }
    }

    fn rests(&mut self, sight: &Sight, config: &HumanConfig) -> bool {
        let rest = (RESTING * config.period_s()).max(NOISE_AT_REST * config.noise);
        let [x, y] = self.moved;
        let rests = sight.motion.is_permitted() && self.step >= LAST_STEP && libm::hypot(x, y) < rest;
        self.rested = if rests { self.rested.saturating_add(1) } else { 0 };
        self.rested >= REST_TICKS
    }

    fn move_hand(&mut self, sight: &Sight, config: &HumanConfig, press: &mut u32) -> Result<(), Ended> {
        let moves = sight.motion.is_permitted();
        match self.hand {
            Hand::Pressing { .. } if moves => self.hand = Hand::Moving,
            Hand::Pressing { since } if sight.tick.saturating_sub(since) >= config.patience_ticks => {
                self.hand = Hand::LetGo;
            }
            Hand::Moving if sight.motion.reason() == Some(Reason::TrialOver) => return Err(Ended::TrialOver),
            Hand::Moving if !moves => self.hand = Hand::LetGo,
            Hand::LetGo if self.presses >= MAX_PRESSES => return Err(Ended::GaveUp),
            Hand::LetGo => {
                *press = press.wrapping_add(1);
                self.presses = self.presses.saturating_add(1);
                self.hand = Hand::Pressing { since: sight.tick };
            }
            Hand::Pressing { .. } | Hand::Moving => {}
        }
        Ok(())
    }

    /// The velocity for this control period, in the base frame. Its height does not change: the task lies in a plane.
    fn velocity(&mut self, sight: &Sight, config: &HumanConfig, wish: &Wish) -> Vec3 {
        self.memory.push_back(Percept {
            tool: self.tool,
            moved: self.moved,
            step: self.step,
            robot: sight.guide.map_or([0.0; 2], |guide| guide.velocity),
            weight: sight.weight,
        });
        let period = config.period_s();
        let wanted = self
            .perceived(config)
            .and_then(|seen| velocity(config.kind, config.gain, wish, &seen, period));
        let (Some(wanted), false) = (wanted, self.hand == Hand::LetGo) else {
            return Vec3::ZERO;
        };
        let draws = config.draws(self.trial);
        let noise = draws.normal_pair(Stream::Noise, sight.tick.saturating_sub(self.began));
        let trembling = each(|i| wanted[i] + config.noise * noise[i] / period);
        config.frame.vector_to_base(trembling).capped(config.speed_cap)
    }
    /// What was seen one reaction ago, forgetting what lies before; nothing while driving is younger than that.
    fn perceived(&mut self, config: &HumanConfig) -> Option<Percept> {
        while self.memory.len() > config.reaction_ticks + 1 {
            self.memory.pop_front();
        }
        self.memory
            .front()
            .copied()
            .filter(|_| self.memory.len() > config.reaction_ticks)
    }
}
