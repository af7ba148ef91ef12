//! A stage for the predictor: the planar task's paths, a small model of them, and states made by hand.

#![allow(dead_code, reason = "every test file uses some of it")]

use std::sync::{Arc, OnceLock};

use tandem_cesn::{Demonstration, Model, Settings};
use tandem_predictor::{Event, Output, Predictor, PredictorSettings};
use tandem_wire::{
    Envelope, Forecast, Header, MILLISECOND, Motion, Node, Outbox, Pose, Proposal, Reason, Refusals, Seq, Session,
    Stamp, State, TaskFrame, Timing, Vec3,
};

pub(crate) const STEPS: u32 = 84;
pub(crate) const HELD: Motion = Motion::Held(Reason::DeadmanReleased);
pub(crate) const MOVING: Motion = Motion::Permitted { press: 1 };

/// The path of amplitude `a` at step `t`: over the first obstacle, under the second.
pub(crate) fn path(a: f64, t: f64) -> [f64; 2] {
    let tau = (t / f64::from(STEPS - 1)).clamp(0.0, 1.0);
    let s = tau * tau * tau * (10.0 + tau * (6.0 * tau - 15.0));
    let x = 0.6 * s;
    let bell = |centre: f64, width: f64| libm::exp(-((x - centre) / width) * ((x - centre) / width));
    let y = a * bell(0.28, 0.07) - a * (0.8 + 2.0 * (a - 0.11)) * bell(0.46, 0.06);
    [x + 0.12 * (a - 0.11) * libm::sin(std::f64::consts::TAU * s), y]
}

pub(crate) fn demonstrations() -> Vec<Demonstration> {
    [0.08, 0.11, 0.14].map(|a| demonstration_at(a, 41)).to_vec()
}

/// The path of amplitude `a`, with where it is at step `checkpoint` as its context.
pub(crate) fn demonstration_at(a: f64, checkpoint: u32) -> Demonstration {
    let [x, y] = path(a, f64::from(checkpoint));
    let outputs = (0..STEPS).flat_map(|step| path(a, f64::from(step))).collect();
    let context = [("context_x_m", x), ("context_y_m", y)];
    Demonstration::new("planar", &context, &["x_m", "y_m"], outputs, Some(0.1)).expect("numbers are finite")
}

/// A model of the planar task: small, so that a test does not wait for it.
pub(crate) fn model() -> Arc<Model> {
    static MODEL: OnceLock<Arc<Model>> = OnceLock::new();
    let train = || {
        let settings = Settings {
            units: 120,
            ..Settings::default()
        };
        Arc::new(Model::train(&demonstrations(), &settings).expect("the planar task can be learnt"))
    };
    MODEL.get_or_init(train).clone()
}

/// The same, conditioned anew on every tick.
pub(crate) fn replanning_model() -> Arc<Model> {
    static MODEL: OnceLock<Arc<Model>> = OnceLock::new();
    let train = || {
        let settings = Settings {
            units: 120,
            ..Settings::replanning()
        };
        let trained = Model::train_replanning(&demonstrations(), &settings);
        Arc::new(trained.expect("the planar task can be learnt"))
    };
    MODEL.get_or_init(train).clone()
}

pub(crate) fn state(seq: u64, tick: u32, at: [f64; 2], motion: Motion) -> Envelope<State> {
    let header = Header {
        tick,
        session: Session(4),
        seq: Seq(seq),
        sent: Stamp(0),
    };
    let tool = Pose {
        position: TaskFrame::default().to_base(at),
        ..Pose::default()
    };
    let body = State {
        trial: 1,
        trial_start: 0,
        joints: Default::default(),
        joint_velocities: Default::default(),
        links: Default::default(),
        tool,
        tool_velocity: Vec3::ZERO,
        clearance: None,
        closest: None,
        motion,
        at_rest: false,
        obeys: None,
        arrivals: None,
        refused: Refusals::default(),
    };
    Envelope { header, body }
}

/// A predictor and everything it said.
pub(crate) struct Stage {
    pub(crate) predictor: Predictor,
    outbox: Outbox<Output>,
    pub(crate) said: Vec<Output>,
    seq: u64,
}

impl Stage {
    pub(crate) fn new(timing: Timing) -> Self {
        Self::with(timing, model())
    }

    pub(crate) fn with(timing: Timing, model: Arc<Model>) -> Self {
        let (frame, settings) = (TaskFrame::default(), PredictorSettings::default());
        Self::of(Predictor::new(Session(2), timing, frame, model, &settings).expect("the model fits"))
    }

    pub(crate) fn of(predictor: Predictor) -> Self {
        Self {
            predictor,
            outbox: Outbox::default(),
            said: Vec::new(),
            seq: 0,
        }
    }

    pub(crate) fn lockstep() -> Self {
        Self::new(Timing::default().lockstep())
    }

    pub(crate) fn replanning() -> Self {
        Self::with(Timing::default().lockstep(), replanning_model())
    }

    pub(crate) fn event(&mut self, millis: u64, event: Event) {
        self.predictor
            .step(Stamp(millis * MILLISECOND), event, &mut self.outbox);
        self.said.extend(self.outbox.drain());
    }

    /// The next state; the proposal that answers it.
    pub(crate) fn state(&mut self, tick: u32, at: [f64; 2], motion: Motion) -> Proposal {
        self.seq += 1;
        self.event(u64::from(tick) * 100, Event::State(state(self.seq, tick, at, motion)));
        match self.said.last() {
            Some(Output::Proposal(proposal)) => proposal.body,
            other => panic!("a state is answered by a proposal, not {other:?}"),
        }
    }

    pub(crate) fn forecasts(&self) -> usize {
        self.forecast_messages().count()
    }

    pub(crate) fn forecast_messages(&self) -> impl Iterator<Item = &Forecast> {
        self.said.iter().filter_map(|output| match output {
            Output::Forecast(forecast) => Some(&forecast.body),
            Output::Proposal(_) => None,
        })
    }

    /// What it said, a line each; proposals that repeat the one before are counted, not shown.
    pub(crate) fn told(&self) -> String {
        let mut lines: Vec<(String, usize)> = Vec::new();
        for output in &self.said {
            let line = line(output);
            match lines.last_mut() {
                Some((last, times)) if *last == line => *times += 1,
                _ => lines.push((line, 1)),
            }
        }
        let shown = lines.iter().map(|(line, times)| match times {
            1 => format!("{line}\n"),
            _ => format!("{line}  ×{times}\n"),
        });
        shown.collect()
    }
}

fn line(output: &Output) -> String {
    // Two digits: a model trained on another processor differs in its last bits.
    let vector = |v: Vec3| format!("({:.2} {:.2} {:.2})", v.x, v.y, v.z);
    match output {
        Output::Forecast(forecast) => {
            let forecast = &forecast.body;
            let (first, steps) = (forecast.first_step, forecast.points.len());
            let [x, y] = [0, 1].map(|i| forecast.context[i].0);
            format!(
                "forecast {} from ({x:.3} {y:.3}): {steps} steps from {first}",
                forecast.number
            )
        }
        Output::Proposal(proposal) => match proposal.body.guidance {
            None => "proposal without guidance".to_owned(),
            Some(guidance) => format!(
                "proposal on forecast {}: phase {:.2}, at {}, velocity {}",
                guidance.forecast,
                guidance.phase.0,
                vector(guidance.position),
                vector(guidance.velocity),
            ),
        },
    }
}
