//! What the view draws: messages become Rerun entities, alike for a live viewer, for an `.rrd` file and for replay.
//!
//! [`View::draw`] is pure: it knows no viewer, file or clock, only what it was shown before. The colours carry the
//! meaning everywhere: orange is the human, blue the robot with its forecast, what lies between is shared, grey is
//! held. An arrow ends where the tool would be in one second.
//!
//! | entities | what |
//! | --- | --- |
//! | `world/…` | the scene in the base frame, in metres |
//! | `plan/…` | the same from above: to the right is the base's y, downwards its x |
//! | `plots/…` | numbers over time |
//! | `lanes/…` | who drives, why motion is held, who holds the lease, which trial |
//! | `budget` | where the time goes: every hop of the loop, and the clocks |
//! | `now` | the situation in a line of words |
//! | `log` | the notes |

mod arm;
mod budget;
mod colours;
mod interval;
pub(crate) mod layout;
mod log;
mod meshes;
mod nearest;
mod plots;
mod status;
mod surroundings;
mod trace;
mod trials;
pub(crate) mod what_if;
mod wishes;

use rerun::external::re_sdk_types::SerializedComponentBatch;
use rerun::{AsComponents, TimeCell, TimePoint};
use tandem_wire::{Lease, MessageId, Nanos, Scene, Setpoint, Stamp, State, Timing, Trial, Vec3};

use crate::heard::{Entry, Heard, Sample};
use crate::sinks::Drops;
use crate::urdf::Urdf;
use log::Log;
pub(crate) use meshes::Meshes;
use plots::Latency;
use status::Status;
use trace::Trace;
pub(crate) use trials::Trials;
use wishes::Wished;

/// One thing to be drawn.
#[derive(Clone, Debug)]
pub struct Drawing {
    /// The entity.
    pub path: String,
    /// When; `None` for what holds at all times.
    pub moment: Option<Moment>,
    /// Its components.
    pub batches: Vec<SerializedComponentBatch>,
}

/// A place on the timelines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Moment {
    /// Timeline `tick`.
    pub tick: u32,
    /// Timeline `session_time`.
    pub session_time: Stamp,
    /// Timeline `trial_time`: since the recording's beginning, which is the trial's.
    pub trial_time: Nanos,
}

/// Turns what was heard into what is seen.
#[derive(Debug)]
pub struct View {
    timing: Timing,
    /// Where `trial_time` is zero.
    origin: Stamp,
    scene: Option<Scene>,
    /// The tool's newest position: where the arrows start.
    tool: Option<Vec3>,
    /// Whether the robot counts its setpoints.
    has_arrivals: bool,
    log: Log,
    /// The trial that is drawn, and its first tick.
    trial: Option<(u32, u32)>,
    trace: Trace,
    wished: Wished,
    status: Status,
    latency: Latency,
    lanes: Lanes,
    /// The forecast that is drawn.
    forecast: Option<MessageId>,
    /// How the arm looks, if that is known; else its collision shapes are drawn.
    meshes: Option<Meshes>,
}

/// What stands in the lanes now; drawn only when it changes.
#[derive(Debug, Default)]
struct Lanes {
    driver: Option<plots::Driver>,
    held: Option<String>,
    lease: Option<String>,
    trial: Option<String>,
}

/// Where drawings are collected.
pub(crate) struct Sheet<'a> {
    moment: Moment,
    drawings: &'a mut Vec<Drawing>,
    /// Of two runs in one picture, which: `world/path` becomes `world/<side>/path`.
    side: Option<&'static str>,
}

impl View {
    /// A view of nodes that run at this pace.
    #[must_use]
    pub fn new(timing: Timing) -> Self {
        Self {
            timing,
            origin: Stamp(0),
            scene: None,
            tool: None,
            has_arrivals: false,
            log: Log::default(),
            trial: None,
            trace: Trace::default(),
            wished: Wished::default(),
            status: Status::default(),
            latency: Latency::new(timing.pace),
            lanes: Lanes::default(),
            forecast: None,
            meshes: None,
        }
    }

    /// Draws the arm as its URDF file describes it.
    #[must_use]
    pub fn with_urdf(self, urdf: &Urdf) -> Self {
        self.with_meshes(Some(Meshes::new(urdf)))
    }

    pub(crate) fn with_meshes(self, meshes: Option<Meshes>) -> Self {
        Self { meshes, ..self }
    }

    /// What holds at all times: names, colours, which way is up.
    #[must_use]
    pub fn opening() -> Vec<Drawing> {
        let mut drawings = vec![fixed("world", &rerun::ViewCoordinates::RIGHT_HAND_Z_UP())];
        drawings.extend(plots::styles());
        drawings.extend(budget::styles());
        drawings
    }

    /// Begins a recording of its own at `heard`: all is forgotten but the surroundings, which are drawn again.
    pub fn begin_recording(&mut self, heard: &Heard, drawings: &mut Vec<Drawing>) {
        let scene = self.scene.take();
        *self = Self::new(self.timing).with_meshes(self.meshes.take());
        if let Some(meshes) = &self.meshes {
            drawings.extend_from_slice(meshes.opening());
        }
        self.origin = heard.session_time;
        let moment = self.moment(heard);
        if let Some(scene) = scene {
            self.draw_scene(&scene, &mut Sheet::new(moment, drawings));
        }
    }

    /// What a layout has to fit, once that is known: a robot says where it is at once, and what is around it every second.
    pub(crate) fn fit(&self) -> Option<layout::Fit> {
        self.tool?;
        let framing = layout::Framing::of(self.scene.as_ref()?);
        Some(layout::Fit {
            framing,
            has_arrivals: self.has_arrivals,
        })
    }

    fn moment(&self, heard: &Heard) -> Moment {
        Moment {
            tick: heard.tick,
            session_time: heard.session_time,
            trial_time: heard.session_time.since(self.origin),
        }
    }

    /// Draws one thing that was heard; `drops` so far go with the counts.
    pub fn draw(&mut self, heard: &Heard, drops: Drops, drawings: &mut Vec<Drawing>) {
        let moment = self.moment(heard);
        let mut sheet = Sheet::new(moment, drawings);
        match &heard.entry {
            Entry::Note(note) => self.log.draw(heard.at, note, &mut sheet),
            Entry::Counts(counts) => {
                plots::draw_counts(counts, drops, &mut sheet);
                budget::draw(counts, &mut sheet);
            }
            Entry::Sample(sample) => self.draw_sample(heard.at, sample, &mut sheet),
        }
    }

    fn draw_sample(&mut self, at: Stamp, sample: &Sample, sheet: &mut Sheet<'_>) {
        match sample {
            Sample::Command(message) => self.latency.commanded(message.header.id(), at),
            Sample::Setpoint(message) => self.draw_setpoint(&message.body, sheet),
            Sample::State(message) => {
                self.draw_state(&message.body, sheet);
                if let Some(nanos) = self.latency.moved(at, message) {
                    plots::draw_latency(nanos, sheet);
                }
            }
            Sample::Forecast(message) => {
                if self.forecast.replace(message.header.id()) != Some(message.header.id()) {
                    interval::draw_forecast(&message.body, sheet);
                }
            }
            Sample::Scene(message) => self.draw_scene(&message.body, sheet),
            Sample::Trial(message) => self.draw_trial(at, &message.body, sheet),
            // A lease shows in setpoints, an emergency stop in the reasons for which motion is held; both in the log.
            Sample::Claim(_) | Sample::Emergency(_) => {}
            Sample::Proposal(_) | Sample::Journal(_) | Sample::Info(..) | Sample::Clock(..) => {}
        }
    }

    /// The scene is repeated every second for those who come late, and drawn only when it changes.
    fn draw_scene(&mut self, scene: &Scene, sheet: &mut Sheet<'_>) {
        if self.scene.as_ref() != Some(scene) {
            surroundings::draw(scene, sheet);
            self.scene = Some(scene.clone());
        }
    }

    fn draw_state(&mut self, state: &State, sheet: &mut Sheet<'_>) {
        // Between trials everything stays, so that one can look at what happened.
        let trial = (state.trial, state.trial_start);
        if state.trial != 0 && self.trial.replace(trial) != Some(trial) {
            self.begin_trial(sheet);
        }
        let tool = state.tool.position;
        self.tool = Some(tool);
        self.has_arrivals = state.arrivals.is_some();
        match (&self.meshes, &self.scene) {
            (Some(meshes), _) => meshes.draw(state, sheet),
            (None, Some(scene)) => arm::draw(&scene.bodies, state, sheet),
            (None, None) => {}
        }
        arm::draw_tool(colours::TOOL, state, sheet);
        if let Some(scene) = &self.scene {
            nearest::draw(scene, state, sheet);
        }
        self.trace.draw(tool, trace::colour(state), sheet);
        self.status.hear_state(state, sheet);
        plots::draw_state(state, sheet);
    }

    /// A trial starts with a clean sheet: no path, no forecast.
    fn begin_trial(&mut self, sheet: &mut Sheet<'_>) {
        self.trace = Trace::default();
        self.wished = Wished::default();
        self.status.begin_trial();
        self.forecast = None;
        for path in SHEET {
            sheet.draw(path, &rerun::Clear::recursive());
        }
    }

    fn draw_setpoint(&mut self, setpoint: &Setpoint, sheet: &mut Sheet<'_>) {
        if let Some(tool) = self.tool {
            wishes::draw(setpoint, tool, sheet);
            self.wished.draw(setpoint, tool, sheet);
        }
        self.status.hear_setpoint(setpoint, sheet);
        let across = self.scene.as_ref().map_or(plots::ACROSS, plots::across);
        plots::draw_setpoint(setpoint, self.tool, across, sheet);
        let driver = plots::Driver::of(setpoint);
        if self.lanes.driver.replace(driver) != Some(driver) {
            sheet.draw("lanes/driver", &rerun::StateChange::single(driver.name()));
        }
        let held = setpoint.motion.reason().map(|reason| reason.to_string());
        draw_lane("lanes/held", held, &mut self.lanes.held, sheet);
        let lease = setpoint.lease.map(|lease| lease_words(&lease));
        draw_lane("lanes/lease", lease, &mut self.lanes.lease, sheet);
    }

    fn draw_trial(&mut self, at: Stamp, trial: &Trial, sheet: &mut Sheet<'_>) {
        let label = match trial {
            Trial::Begin { number, label } => Some(format!("{number}: {label}")),
            Trial::End { .. } => None,
        };
        self.log.hear(at, trial);
        self.status.hear_trial(trial, sheet);
        draw_lane("lanes/trial", label, &mut self.lanes.trial, sheet);
    }
}

/// What a trial starts without.
const SHEET: [&str; 6] = [
    "world/path",
    "plan/path",
    "world/forecast",
    "plan/forecast",
    "world/wished",
    "plan/wished",
];

/// Who holds the lease; the grant tells two of one name apart.
fn lease_words(lease: &Lease) -> String {
    match lease.name.is_empty() {
        true => format!("lease {}", lease.number),
        false => format!("{}, lease {}", lease.name, lease.number),
    }
}

fn draw_lane(path: &str, now: Option<String>, before: &mut Option<String>, sheet: &mut Sheet<'_>) {
    if *before != now {
        // An empty state ends the lane's bar.
        sheet.draw(path, &rerun::StateChange::single(now.clone().unwrap_or_default()));
        *before = now;
    }
}

fn fixed(path: &str, what: &dyn AsComponents) -> Drawing {
    Drawing {
        path: path.to_owned(),
        moment: None,
        batches: what.as_serialized_batches(),
    }
}

impl<'a> Sheet<'a> {
    const fn new(moment: Moment, drawings: &'a mut Vec<Drawing>) -> Self {
        Self {
            moment,
            drawings,
            side: None,
        }
    }

    /// Draws an entity of this side.
    fn draw(&mut self, path: &str, what: &dyn AsComponents) {
        let path = match (self.side, path.split_once('/')) {
            (Some(side), Some((tree, entity))) => format!("{tree}/{side}/{entity}"),
            _ => path.to_owned(),
        };
        self.put(path, what);
    }

    fn put(&mut self, path: String, what: &dyn AsComponents) {
        self.drawings.push(Drawing {
            path,
            moment: Some(self.moment),
            batches: what.as_serialized_batches(),
        });
    }

    /// A number over time, under this very path.
    fn plot(&mut self, path: &str, value: f64) {
        self.put(path.to_owned(), &rerun::Scalars::single(value));
    }
}

impl From<Moment> for TimePoint {
    fn from(moment: Moment) -> Self {
        let lasting = |nanos| TimeCell::from_duration_nanos(i64::try_from(nanos).unwrap_or(i64::MAX));
        Self::from([
            (layout::TICK, TimeCell::from_sequence(i64::from(moment.tick))),
            (layout::SESSION_TIME, lasting(moment.session_time.0)),
            (layout::TRIAL_TIME, lasting(moment.trial_time)),
        ])
    }
}

/// Rerun's coordinates are single precision: a tenth of a micrometre at one metre.
#[expect(clippy::cast_possible_truncation, reason = "rounding is what is wanted")]
const fn single(value: f64) -> f32 {
    value as f32
}

const fn xyz(v: Vec3) -> [f32; 3] {
    [single(v.x), single(v.y), single(v.z)]
}

/// A point or direction seen from above, with the arm's base at the top: the path from left to right, as it is drawn
/// in task coordinates.
const fn plan(v: Vec3) -> [f32; 2] {
    [single(v.y), single(v.x)]
}
