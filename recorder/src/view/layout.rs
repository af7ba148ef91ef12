//! Where on the screen everything is: the blueprint.
//!
//! Written entity by entity, for the SDK's own builder can neither place the camera nor bound an axis.

mod comparison;
mod framing;
mod graphs;

use rerun::external::re_log_types::{BlueprintActivationCommand, LogMsg};
use rerun::external::re_sdk_types::blueprint::archetypes::{
    Background, ContainerBlueprint, EyeControls3D, LineGrid3D, PanelBlueprint, SpatialInformation, TextLogColumns,
    TimePanelBlueprint, ViewBlueprint, ViewContents, ViewportBlueprint, VisualBounds2D,
};
use rerun::external::re_sdk_types::blueprint::components::{
    BackgroundKind, ContainerKind, Eye3DKind, GridSpacing, PanelState, PlayState, ViewClass, VisualBounds2D as Bounds,
};
use rerun::external::re_sdk_types::blueprint::datatypes::{TextLogColumn, TextLogColumnKind, TimelineColumn};
use rerun::external::re_sdk_types::datatypes::{Range2D, Uuid};
use rerun::{AsComponents, RecordingStream, RecordingStreamBuilder, RecordingStreamResult};

use super::colours;
use crate::config::Purpose;
pub(crate) use framing::Framing;

/// The timeline of control periods.
pub(crate) const TICK: &str = "tick";
/// The timeline of seconds since the session began.
pub(crate) const SESSION_TIME: &str = "session_time";

/// The timeline of seconds since the trial began: what the layout shows.
pub(crate) const TRIAL_TIME: &str = "trial_time";

/// An axis has numbers, never names: these are [`plots::Driver::level`](super::plots::Driver)'s.
const DRIVERS: &str = "Who drives: 3 human, 2 shared, 1 robot, 0 held";

/// What is laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Layout {
    /// One run.
    Watching(Purpose),
    /// Two runs of the same session side by side.
    Comparing,
}

/// What a layout has to fit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Fit {
    pub(crate) framing: Framing,
    /// Whether the robot counts its setpoints.
    pub(crate) has_arrivals: bool,
}

/// How a layout reaches the eye.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Arrives {
    /// At once, whatever was there.
    AtOnce,
    /// When the viewer is asked to reset its layout: what a person has moved stays.
    OnReset,
}

/// Makes this the layout of `recording`, in whatever it streams to.
pub(crate) fn send(
    recording: &RecordingStream,
    layout: Layout,
    fit: Fit,
    arrives: Arrives,
) -> RecordingStreamResult<()> {
    let Some(info) = recording.store_info() else {
        return Ok(());
    };
    let application = info.application_id().clone();
    let (blueprint, storage) = RecordingStreamBuilder::new(application).blueprint().memory()?;
    blueprint.set_time_sequence("blueprint", 0);
    let sketch = Sketch {
        blueprint: &blueprint,
        fit,
        made: 0,
    };
    match layout {
        Layout::Watching(purpose) => sketch.draw(purpose)?,
        Layout::Comparing => sketch.draw_comparison()?,
    }
    blueprint.flush_blocking().ok();
    let messages = storage.take();
    let Some(first) = messages.first().map(LogMsg::store_id) else {
        return Ok(());
    };
    let activation = BlueprintActivationCommand {
        blueprint_id: first.clone(),
        make_active: arrives == Arrives::AtOnce,
        make_default: true,
    };
    recording.send_blueprint(messages, activation);
    Ok(())
}

/// A layout being drawn; views and containers are numbered as they are made.
struct Sketch<'a> {
    blueprint: &'a RecordingStream,
    fit: Fit,
    made: u16,
}

/// A view or container, and its share of its container.
struct Part {
    path: String,
    share: f32,
}

/// What a view is and shows.
struct ViewSpec<'a> {
    class: &'a str,
    name: &'a str,
    origin: &'a str,
    share: f32,
    properties: &'a [(&'a str, &'a dyn AsComponents)],
}

impl Sketch<'_> {
    fn draw(mut self, purpose: Purpose) -> RecordingStreamResult<()> {
        // The lanes need more height than the plot that stands in front of them live.
        let (lanes, log) = match purpose {
            Purpose::Live => (1.7, 2.5),
            Purpose::Replay => (2.6, 2.2),
        };
        let left = [
            self.now(0.75)?,
            self.world(5.0)?,
            self.lanes(lanes, purpose)?,
            self.log(log)?,
        ];
        let left = self.container(ContainerKind::Vertical, "who drives", &left, 1.25)?;
        let right = [
            self.plan(4.2)?,
            self.weight(1.6)?,
            self.confidence(1.9)?,
            self.margins(1.9)?,
        ];
        let right = self.container(ContainerKind::Vertical, "why", &right, 1.0)?;
        self.finish(left, right)
    }

    /// Two columns, and the panels hidden.
    fn finish(mut self, left: Part, right: Part) -> RecordingStreamResult<()> {
        let root = self.container(ContainerKind::Horizontal, "Tandem", &[left, right], 1.0)?;
        let root = Uuid {
            bytes: uuid_bytes(&root.path),
        };
        let viewport = ViewportBlueprint::new()
            .with_root_container(root)
            .with_auto_layout(false)
            .with_auto_views(false);
        self.blueprint.log("viewport", &viewport)?;
        self.panels()
    }

    fn panels(&self) -> RecordingStreamResult<()> {
        let hidden = PanelBlueprint::new().with_state(PanelState::Collapsed);
        self.blueprint.log("blueprint_panel", &hidden)?;
        self.blueprint.log("selection_panel", &hidden)?;
        let time = TimePanelBlueprint::new()
            .with_state(PanelState::Collapsed)
            .with_timeline(TRIAL_TIME)
            .with_play_state(PlayState::Following);
        self.blueprint.log("time_panel", &time)
    }

    fn now(&mut self, share: f32) -> RecordingStreamResult<Part> {
        self.view(&ViewSpec {
            class: "TextDocument",
            name: "Now",
            origin: "now",
            share,
            properties: &[],
        })
    }

    fn world(&mut self, share: f32) -> RecordingStreamResult<Part> {
        self.world_named(
            "Orange: human's wish. Blue: robot's wish, forecast, interval. Path: who drove",
            share,
        )
    }

    fn world_named(&mut self, name: &str, share: f32) -> RecordingStreamResult<Part> {
        let eye = EyeControls3D::new()
            .with_kind(Eye3DKind::Orbital)
            .with_position(super::xyz(self.fit.framing.eye))
            .with_look_target(super::xyz(self.fit.framing.target))
            .with_eye_up([0.0, 0.0, 1.0]);
        let grid = LineGrid3D::new()
            .with_spacing(GridSpacing(0.1.into()))
            .with_color(colours::WORKSPACE);
        let background = Background::new(BackgroundKind::SolidColor).with_color(colours::BACKGROUND);
        let information = SpatialInformation::new("tf#/world").with_show_axes(false);
        self.view(&ViewSpec {
            class: "3D",
            name,
            origin: "world",
            share,
            properties: &[
                ("EyeControls3D", &eye),
                ("LineGrid3D", &grid),
                ("Background", &background),
                ("SpatialInformation", &information),
            ],
        })
    }

    fn plan(&mut self, share: f32) -> RecordingStreamResult<Part> {
        self.plan_named("From above: path in the colour of who drove", share)
    }

    fn plan_named(&mut self, name: &str, share: f32) -> RecordingStreamResult<Part> {
        let bounds = VisualBounds2D::new(Bounds(Range2D {
            x_range: self.fit.framing.across.into(),
            y_range: self.fit.framing.down.into(),
        }));
        self.view(&ViewSpec {
            class: "2D",
            name,
            origin: "plan",
            share,
            properties: &[("VisualBounds2D", &bounds)],
        })
    }

    /// The lanes say most, but their view keeps the range of time that it had when it opened, which in a live view is
    /// nothing yet. So a plot that follows stands in front of them.
    fn lanes(&mut self, share: f32, purpose: Purpose) -> RecordingStreamResult<Part> {
        let lanes = ViewSpec {
            class: "StateTimeline",
            name: "Lanes: driver, reason, lease, trial (double-click to fit)",
            origin: "lanes",
            share: 1.0,
            properties: &[],
        };
        let levels = Some([-0.6, 3.6]);
        let mut tabs = [self.plot(DRIVERS, "plots/driver", levels, 1.0)?, self.view(&lanes)?];
        if purpose == Purpose::Replay {
            // What is over has its whole range when the view opens.
            tabs.reverse();
        }
        self.container(ContainerKind::Tabs, "Who drives", &tabs, share)
    }

    fn log(&mut self, share: f32) -> RecordingStreamResult<Part> {
        let column = |kind| TextLogColumn {
            visible: true.into(),
            kind,
        };
        let columns = TextLogColumns::new()
            .with_timeline_columns([TimelineColumn {
                visible: true.into(),
                timeline: TRIAL_TIME.into(),
            }])
            .with_text_log_columns([column(TextLogColumnKind::LogLevel), column(TextLogColumnKind::Body)]);
        self.view(&ViewSpec {
            class: "TextLog",
            name: "Trials and stops",
            origin: "log",
            share,
            properties: &[("TextLogColumns", &columns)],
        })
    }

    fn budget(&mut self, share: f32) -> RecordingStreamResult<Part> {
        self.view(&ViewSpec {
            class: "TextDocument",
            name: "Latency budget",
            origin: "budget",
            share,
            properties: &[],
        })
    }

    fn view(&mut self, spec: &ViewSpec<'_>) -> RecordingStreamResult<Part> {
        let path = format!("view/{}", self.uuid());
        let view = ViewBlueprint::new(ViewClass(spec.class.into()))
            .with_display_name(spec.name)
            .with_space_origin(spec.origin);
        self.blueprint.log(path.as_str(), &view)?;
        let contents = ViewContents::new(["$origin/**"]);
        self.blueprint.log(format!("{path}/ViewContents"), &contents)?;
        for (name, property) in spec.properties {
            self.blueprint.log(format!("{path}/{name}"), *property)?;
        }
        Ok(Part {
            path,
            share: spec.share,
        })
    }

    fn container(
        &mut self,
        kind: ContainerKind,
        name: &str,
        parts: &[Part],
        share: f32,
    ) -> RecordingStreamResult<Part> {
        let path = format!("container/{}", self.uuid());
        let shares = || parts.iter().map(|part| part.share);
        let container = ContainerBlueprint::new(kind)
            .with_display_name(name)
            .with_contents(parts.iter().map(|part| part.path.as_str()));
        let container = match kind {
            ContainerKind::Horizontal => container.with_col_shares(shares()),
            ContainerKind::Vertical => container.with_row_shares(shares()),
            ContainerKind::Tabs => container.with_active_tab(parts[0].path.as_str()),
            ContainerKind::Grid => container,
        };
        self.blueprint.log(path.as_str(), &container)?;
        Ok(Part { path, share })
    }

    fn uuid(&mut self) -> String {
        self.made += 1;
        format!("{UUID_HEAD}{:012x}", self.made)
    }
}

/// The blueprint wants identifiers in this form; only the end has to differ.
const UUID_HEAD: &str = "74616e64-656d-4000-8000-";

/// The sixteen bytes of the identifier at the end of `path`.
fn uuid_bytes(path: &str) -> [u8; 16] {
    let digits: Vec<u32> = path
        .rsplit('/')
        .next()
        .unwrap_or(path)
        .chars()
        .filter_map(|c| c.to_digit(16))
        .collect();
    let mut bytes = [0; 16];
    for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
        *byte = u8::try_from(pair[0] * 16 + pair[1]).expect("two hexadecimal digits make a byte");
    }
    bytes
}
