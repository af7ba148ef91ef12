//! From messages to a [`Trace`]: pure, and the same at any pace.
//!
//! One tick counts once, with the last setpoint that was decided in it. A trial is over when motion has been permitted
//! and then held for [`QUIET_TICKS`] ticks, or when the robot says that another trial, or none, runs.

use std::collections::BTreeMap;

use tandem_wire::{
    Envelope, Forecast, Header, JournalBatch, Malformed, MessageId, Motion, NodeName, Refusals, Scene, Session,
    Setpoint, State, Topic, Trial, Vec3, decode,
};

use crate::latency::Latency;
use crate::trace::{Decision, Drops, ForecastMade, Stand, Stop, Stopper, Surroundings, Tick, Trace};

/// After this many ticks without motion the human has finished: a stop that the human answers is shorter.
const QUIET_TICKS: u32 = 10;

/// Follows one trial.
#[derive(Debug, Default)]
pub struct Tracer {
    wanted: Option<u32>,
    began: Option<Began>,
    labels: BTreeMap<u32, String>,
    scene: Option<Surroundings>,
    /// By the robot's own ticks.
    ticks: BTreeMap<u32, Tick>,
    forecasts: Vec<(u32, ForecastMade)>,
    stops: Vec<(u32, Stop)>,
    newest_state: u32,
    newest_setpoint: Option<Setpoint>,
    last_motion: Option<u32>,
    /// The robot went on to something else.
    left: bool,
    motion: [Option<Motion>; 2],
    latency: Latency,
    by_arbiter: Dropped,
    by_robot: Dropped,
    heard: [Heard; 2],
    unreadable: u64,
}

/// The trial's identity, by the first state that belongs to it.
#[derive(Clone, Copy, Debug)]
struct Began {
    trial: u32,
    tick: u32,
    robot: Session,
}

impl Tracer {
    /// Follows the trial of this number; [`Tracer::default`] follows the first one it hears of.
    #[must_use]
    pub fn of_trial(number: u32) -> Self {
        Self {
            wanted: Some(number),
            ..Self::default()
        }
    }

    /// Takes in what was published on `topic`. Bytes that are no message are counted; other topics do not matter.
    pub fn see(&mut self, topic: Topic, bytes: &[u8]) {
        let read = match topic {
            Topic::State => decode(bytes).map(|state| self.see_state(&state)),
            Topic::Setpoint => decode(bytes).map(|setpoint| self.see_setpoint(&setpoint)),
            Topic::Forecast => decode(bytes).map(|forecast| self.see_forecast(&forecast)),
            Topic::Scene => decode::<Scene>(bytes).map(|scene| self.see_scene(&scene.body)),
            Topic::Trial => decode::<Trial>(bytes).map(|mark| self.see_mark(&mark.body)),
            Topic::Journal(node) => decode::<JournalBatch>(bytes).map(|batch| self.see_journal(node, &batch.body)),
            _ => Ok::<(), Malformed>(()),
        };
        if read.is_err() {
            self.unreadable = self.unreadable.saturating_add(1);
        }
    }

    /// Takes in the surroundings.
    pub fn see_scene(&mut self, scene: &Scene) {
        self.scene = Some(scene.into());
    }

    /// Takes in that a trial begins; its label is kept.
    pub fn see_mark(&mut self, mark: &Trial) {
        if let Trial::Begin { number, label } = mark {
            self.labels.insert(*number, label.clone());
        }
    }

    /// Takes in a part of a node's journal, which tells the latency.
    pub fn see_journal(&mut self, node: NodeName, batch: &JournalBatch) {
        self.latency.see_journal(node, batch);
    }

    /// Takes in a state of the robot.
    pub fn see_state(&mut self, state: &Envelope<State>) {
        if !self.belongs(state) {
            return;
        }
        let (tick, body) = (state.header.tick, &state.body);
        self.newest_state = self.newest_state.max(tick);
        if self.is_past(tick) {
            return;
        }
        self.latency.see_state(body);
        self.by_robot.see(&body.refused);
        self.heard[0].see(&state.header);
        match &mut self.tick(tick).state {
            Some(stand) => stand.refresh(body),
            empty => *empty = Some(body.into()),
        }
        self.note_stop(Stopper::RobotSim, tick, body.motion);
    }

    /// Takes in a decision of the arbiter.
    pub fn see_setpoint(&mut self, setpoint: &Envelope<Setpoint>) {
        let tick = setpoint.header.tick;
        if self.began.is_none_or(|began| tick < began.tick) || self.is_past(tick) {
            return;
        }
        self.newest_setpoint = Some(setpoint.body);
        self.by_arbiter.see(&setpoint.body.refused);
        self.heard[1].see(&setpoint.header);
        self.tick(tick).decision = Some(Decision::from(&setpoint.body));
        if setpoint.body.motion.is_permitted() {
            self.last_motion = self.last_motion.max(Some(tick));
        } else if self.last_motion == Some(tick) {
            let mut before = self.ticks.iter().rev().filter(|(_, tick)| tick.is_moving());
            self.last_motion = before.next().map(|(tick, _)| *tick);
        }
        self.note_stop(Stopper::Arbiter, tick, setpoint.body.motion);
    }

    /// Takes in a forecast.
    pub fn see_forecast(&mut self, forecast: &Envelope<Forecast>) {
        let tick = forecast.header.tick;
        if let Some(began) = self.began
            && tick >= began.tick
            && !self.is_past(tick)
        {
            let made = ForecastMade::new(tick.saturating_sub(began.tick), &forecast.body);
            self.forecasts.push((tick, made));
        }
    }

    /// Takes in where a simulated human wishes to be in this tick of the robot: only whoever runs the human knows.
    pub fn see_wish(&mut self, tick: u32, wish: Vec3) {
        if self.began.is_some_and(|began| tick >= began.tick) && !self.is_past(tick) {
            self.tick(tick).wish = Some(wish.to_array());
        }
    }

    /// Whether the human has finished or given up, or the robot went on to something else.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.left || self.is_past(self.newest_state)
    }

    /// Control periods since the trial began.
    #[must_use]
    pub fn elapsed_ticks(&self) -> u32 {
        self.began
            .map_or(0, |began| self.newest_state.saturating_sub(began.tick))
    }

    /// The newest decision, for whoever shows how far the trial is.
    #[must_use]
    pub const fn newest_setpoint(&self) -> Option<&Setpoint> {
        self.newest_setpoint.as_ref()
    }

    /// The trial so far. Once it is over, later ticks change nothing.
    #[must_use]
    pub fn trace(&self) -> Trace {
        let Some(began) = self.began else {
            return Trace {
                scene: self.scene.clone(),
                drops: self.drops(),
                ..Trace::default()
            };
        };
        let since = |tick: u32| tick.saturating_sub(began.tick);
        // A release that nobody takes back is how a trial ends, not a stop in it.
        let counts = |tick: u32| self.last_motion.is_none_or(|last| tick <= last);
        Trace {
            trial: began.trial,
            label: self.labels.get(&began.trial).cloned().unwrap_or_default(),
            began_at: began.tick,
            over: self.is_over(),
            scene: self.scene.clone(),
            ticks: self
                .ticks
                .iter()
                .filter(|(tick, _)| !self.is_past(**tick))
                .map(|(tick, heard)| Tick {
                    tick: since(*tick),
                    ..heard.clone()
                })
                .collect(),
            forecasts: self.forecasts.iter().map(|(_, made)| made.clone()).collect(),
            stops: self
                .stops
                .iter()
                .filter(|(tick, _)| counts(*tick))
                .map(|(_, stop)| stop.clone())
                .collect(),
            latency: self.latency.quantiles(),
            drops: self.drops(),
        }
    }

    fn drops(&self) -> Drops {
        Drops {
            by_arbiter: self.by_arbiter.during(),
            by_robot: self.by_robot.during(),
            unheard: self.heard.iter().map(|stream| stream.missing).sum(),
            unreadable: self.unreadable,
        }
    }

    /// Whether a state is one of the trial; the first one begins it.
    fn belongs(&mut self, state: &Envelope<State>) -> bool {
        let body = &state.body;
        let Some(began) = self.began else {
            if body.trial == 0 || self.wanted.is_some_and(|wanted| wanted != body.trial) {
                return false;
            }
            self.began = Some(Began {
                trial: body.trial,
                tick: body.trial_start.min(state.header.tick),
                robot: state.header.session,
            });
            self.newest_state = state.header.tick;
            return true;
        };
        if body.trial == began.trial && state.header.session == began.robot {
            return state.header.tick >= began.tick;
        }
        self.left |= state.header.tick >= self.newest_state || state.header.session != began.robot;
        false
    }

    /// Whether this tick lies behind the trial's end.
    fn is_past(&self, tick: u32) -> bool {
        self.last_motion
            .is_some_and(|last| tick > last.saturating_add(QUIET_TICKS))
    }

    fn tick(&mut self, tick: u32) -> &mut Tick {
        self.ticks.entry(tick).or_default()
    }

    fn note_stop(&mut self, by: Stopper, tick: u32, is: Motion) {
        let was = self.motion[by as usize].replace(is);
        if let (Some(Motion::Permitted { .. }), Motion::Held(reason)) = (was, is) {
            let began = self.began.map_or(tick, |began| began.tick);
            let stop = Stop {
                tick: tick.saturating_sub(began),
                by,
                reason: reason.to_string(),
            };
            self.stops.push((tick, stop));
        }
    }
}

/// A node's own count of what it dropped, at the first and at the last word of the trial.
#[derive(Clone, Copy, Debug, Default)]
struct Dropped {
    first: Option<u64>,
    last: u64,
}

impl Dropped {
    fn see(&mut self, refused: &Refusals) {
        self.first.get_or_insert(refused.count);
        self.last = refused.count;
    }

    /// A node that was restarted counts anew.
    fn during(self) -> u64 {
        self.last.saturating_sub(self.first.unwrap_or(self.last))
    }
}

/// One stream's numbers.
#[derive(Clone, Copy, Debug, Default)]
struct Heard {
    newest: Option<MessageId>,
    missing: u64,
}

impl Heard {
    fn see(&mut self, header: &Header) {
        let id = header.id();
        match self.newest {
            Some(newest) if newest.session == id.session => {
                if id.seq > newest.seq {
                    let skipped = id.seq.0 - newest.seq.0 - 1;
                    self.missing = self.missing.saturating_add(skipped);
                    self.newest = Some(id);
                }
            }
            _ => self.newest = Some(id),
        }
    }
}

impl Stand {
    /// The distance that counts: the smallest one known of the tick.
    pub(crate) fn nearest_m(&self) -> Option<f64> {
        match (self.closest_m, self.clearance_m) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        }
    }
}
