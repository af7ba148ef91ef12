//! The step machine: a state comes in, a proposal goes out, and at the checkpoint a forecast.

use std::sync::Arc;

use bincode::{Decode, Encode};
use tandem_cesn::{Forecaster, Model};
use tandem_wire::{
    Envelope, Forecast, Guidance, Header, Malformed, Memory, Node, Numbering, Outbox, Pace, Proposal, Refusal,
    Refusals, Remember, Session, Stamp, State, StateGuard, TaskFrame, Timing, Topic, Unreadable,
};

use crate::checkpoint::{Crossing, Lookout, Plane};
use crate::config::{PredictorSettings, UnfitModel, check_all};
use crate::forecast::{Course, Following};

/// Everything that can happen to the predictor.
#[derive(Clone, Debug, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "states are nearly all that happens; a box would allocate for every one of them"
)]
pub enum Event {
    /// The robot's state.
    State(Envelope<State>),
    /// Bytes that are no message.
    Unreadable(Unreadable),
    /// A deadline has come; the predictor has none.
    Wake,
    /// Somebody's token appeared or vanished.
    Presence,
    /// The process is about to end.
    Stop,
    /// In lockstep: the sample of a tick does not come now.
    Missed {
        /// Whose sample.
        topic: Topic,
        /// Which tick's.
        tick: u32,
    },
}

/// Everything that the predictor can cause.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// The answer to a state.
    Proposal(Envelope<Proposal>),
    /// A new condition's forecast.
    Forecast(Envelope<Forecast>),
}

/// The predictor; see the [crate's page](crate) for its states.
pub struct Predictor {
    timing: Timing,
    frame: TaskFrame,
    following: Following,
    /// One for each checkpoint, in the order in which a movement passes them.
    models: Vec<Arc<Model>>,
    forecaster: Forecaster,
    proposals: Numbering,
    forecasts: Numbering,
    states: StateGuard,
    refused: Refusals,
    lookout: Lookout,
    course: Option<Course>,
    /// Forecasts made so far.
    made: u32,
    tick: Option<Tick>,
    /// In lockstep: the newest tick whose state did not come in time; it is answered already.
    missed: Option<u32>,
}

/// The newest tick, and what was decided in it.
#[derive(Clone, Copy, Debug, Encode, Decode)]
struct Tick {
    number: u32,
    trial: (Session, u32, u32),
    guidance: Option<Guidance>,
}

impl Predictor {
    /// A predictor that numbers its messages in `session` and sees the task's plane at `frame`.
    ///
    /// # Errors
    /// When `model` does not map a point of the task's plane to positions in it, one per control period.
    pub fn new(
        session: Session,
        timing: Timing,
        frame: TaskFrame,
        model: impl Into<Arc<Model>>,
        settings: &PredictorSettings,
    ) -> Result<Self, UnfitModel> {
        Self::with_models(session, timing, frame, vec![model.into()], settings)
    }

    /// The same with several checkpoints, a model for each, in any order: every crossing is forecast anew, by its own.
    ///
    /// # Errors
    /// When there is no model, one does not map a point of the task's plane to positions in it, one per control period,
    /// or two checkpoints do not follow each other.
    pub fn with_models(
        session: Session,
        timing: Timing,
        frame: TaskFrame,
        mut models: Vec<Arc<Model>>,
        settings: &PredictorSettings,
    ) -> Result<Self, UnfitModel> {
        check_all(&mut models, &timing)?;
        let planes = models.iter().map(|model| Plane {
            x: model.checkpoint_plane(),
            step: model.checkpoint_step() as f64,
        });
        let largest = models.iter().max_by_key(|model| model.reservoir().units());
        let forecaster = Forecaster::new(largest.ok_or(UnfitModel::None)?);
        Ok(Self {
            timing,
            frame,
            following: settings.following(&timing),
            forecaster,
            proposals: Numbering::new(session),
            forecasts: Numbering::new(session),
            states: StateGuard::new(&timing),
            refused: Refusals::default(),
            lookout: Lookout::new(planes.collect()),
            models,
            course: None,
            made: 0,
            tick: None,
            missed: None,
        })
    }

    /// What was dropped so far.
    #[must_use]
    pub fn refused(&self) -> Refusals {
        self.refused
    }

    fn on_state(&mut self, now: Stamp, state: &Envelope<State>, outbox: &mut Outbox<Output>) {
        if let Err(why) = self.states.admit(now, &state.header) {
            return self.refused.add(why);
        }
        let (number, trial) = (state.header.tick, trial(&state.header, &state.body));
        let ticks = match self.tick {
            Some(tick) if tick.trial == trial => number.saturating_sub(tick.number),
            _ => self.begin_trial(),
        };
        let guidance = match self.tick {
            Some(tick) if ticks == 0 => tick.guidance,
            _ => self.decide(now, ticks, state, outbox),
        };
        let number = self.tick.map_or(number, |tick| tick.number.max(number));
        self.tick = Some(Tick {
            number,
            trial,
            guidance,
        });
        if self.missed.is_none_or(|missed| state.header.tick > missed) {
            self.propose(now, state.header.tick, guidance, outbox);
        }
    }

    /// In lockstep every tick is answered: without its state, with the proposal made from the newest one that was seen,
    /// until states are lost.
    fn on_missed(&mut self, now: Stamp, topic: Topic, tick: u32, outbox: &mut Outbox<Output>) {
        if topic != Topic::State || self.timing.pace != Pace::Lockstep {
            return;
        }
        self.missed = Some(tick);
        self.states.miss(tick);
        let newest = self.tick.filter(|_| !self.states.is_lost(now));
        self.propose(now, tick, newest.and_then(|newest| newest.guidance), outbox);
    }

    fn propose(&mut self, now: Stamp, tick: u32, guidance: Option<Guidance>, outbox: &mut Outbox<Output>) {
        let proposal = Proposal {
            seen: self.states.newest(),
            guidance,
        };
        outbox.push(Output::Proposal(self.proposals.envelope(now, tick, proposal)));
    }

    /// Forgets the trial before; the state at hand opens a tick.
    fn begin_trial(&mut self) -> u32 {
        self.lookout.reset();
        self.course = None;
        self.tick = None;
        1
    }

    /// Once per tick: looks for the checkpoint, or moves on along the course; says what the robot wants.
    ///
    /// The phase is the movement's own clock, so it stands still for as long as the robot is held.
    fn decide(
        &mut self,
        now: Stamp,
        ticks: u32,
        state: &Envelope<State>,
        outbox: &mut Outbox<Output>,
    ) -> Option<Guidance> {
        let tool = state.body.tool.position;
        let here = self.frame.to_task(tool);
        let crossing = self.lookout.pass(here, ticks);
        match (crossing, &mut self.course) {
            (Some(crossing), _) => {
                self.course = None;
                self.forecast(now, state.header.tick, &crossing, outbox);
            }
            (None, Some(course)) if state.body.motion.is_permitted() => {
                course.advance(ticks);
                let phase = course.phase();
                self.condition_anew(now, state.header.tick, here, phase, outbox);
            }
            (None, _) => {}
        }
        let course = self.course.as_ref()?;
        Some(course.guidance(tool, &self.frame, &self.following))
    }

    /// Runs the model for a new condition. A condition that it cannot take leaves the human alone.
    fn forecast(&mut self, now: Stamp, tick: u32, crossing: &Crossing, outbox: &mut Outbox<Output>) {
        if let Some(model) = self.models.get(crossing.plane).cloned() {
            let context = model.context_at(model.checkpoint_step() as f64, &crossing.point);
            self.take_course(now, tick, &model, &context, crossing.phase, outbox);
        }
    }

    /// Where the model in use takes another condition at any time: the tool's position now. Its forecast begins with
    /// the step under way. Past its last condition, and when it cannot take this one, the forecast at hand stands.
    fn condition_anew(&mut self, now: Stamp, tick: u32, here: [f64; 2], phase: f64, outbox: &mut Outbox<Output>) {
        let in_use = self.lookout.last().and_then(|plane| self.models.get(plane));
        let still = |model: &&Arc<Model>| model.last_condition_step().is_some_and(|last| phase <= last as f64);
        if let Some(model) = in_use.filter(still).cloned() {
            let context = model.context_at(phase, &here);
            self.take_course(now, tick, &model, &context, phase, outbox);
        }
    }

    /// Forecasts, follows that and says so; nothing changes if the model cannot take the context.
    fn take_course(
        &mut self,
        now: Stamp,
        tick: u32,
        model: &Model,
        context: &[f64],
        phase: f64,
        outbox: &mut Outbox<Output>,
    ) {
        let number = self.made.saturating_add(1);
        let first = model.first_step(context);
        let forecast = self.forecaster.forecast(model, context, first).ok();
        let course = forecast.and_then(|forecast| Course::new(number, model, forecast, &self.frame, phase));
        if let Some(course) = course {
            self.made = number;
            let message = course.message(context, model, self.timing.period);
            self.course = Some(course);
            outbox.push(Output::Forecast(self.forecasts.envelope(now, tick, message)));
        }
    }
}

/// What tells one trial from another: a robot that was started again begins anew, too.
fn trial(header: &Header, state: &State) -> (Session, u32, u32) {
    (header.session, state.trial, state.trial_start)
}

impl Remember for Predictor {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            timing: _,
            frame: _,
            following: _,
            models: _,
            // Starts from rest for every forecast.
            forecaster: _,
            proposals,
            forecasts,
            states,
            refused,
            lookout,
            course,
            made,
            tick,
            missed,
        } = self;
        proposals.remember(memory)?;
        forecasts.remember(memory)?;
        states.remember(memory)?;
        memory.part(refused)?;
        lookout.remember(memory)?;
        memory.part(course)?;
        memory.check(course.as_ref().is_none_or(Course::is_possible))?;
        memory.part(made)?;
        memory.part(tick)?;
        memory.part(missed)
    }
}

impl Node for Predictor {
    type Event = Event;
    type Output = Output;

    fn step(&mut self, now: Stamp, event: Event, outbox: &mut Outbox<Output>) {
        match event {
            Event::State(state) => self.on_state(now, &state, outbox),
            Event::Unreadable(_) => self.refused.add(Refusal::Unreadable),
            Event::Missed { topic, tick } => self.on_missed(now, topic, tick, outbox),
            Event::Wake | Event::Presence | Event::Stop => {}
        }
    }

    fn deadline(&self) -> Option<Stamp> {
        None
    }

    fn trial(&self) -> u32 {
        self.tick.map_or(0, |tick| tick.trial.1)
    }
}
