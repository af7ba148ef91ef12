//! The graphs on the right: how sure, how fast, how close, how late.

use rerun::RecordingStreamResult;
use rerun::external::re_sdk_types::blueprint::archetypes::{PlotLegend, ScalarAxis, TimeAxis};
use rerun::external::re_sdk_types::blueprint::components::{ContainerKind, Corner2D};
use rerun::external::re_sdk_types::datatypes::{TimeRange, TimeRangeBoundary};

use super::{Part, Sketch, ViewSpec};

impl Sketch<'_> {
    pub(super) fn weight(&mut self, share: f32) -> RecordingStreamResult<Part> {
        self.plot(
            "Human's weight ω, in the colour of who drives",
            "plots/weight",
            Some([-0.1, 1.1]),
            share,
        )
    }

    pub(super) fn confidence(&mut self, share: f32) -> RecordingStreamResult<Part> {
        let tabs = [
            self.plot("Half-width of the interval, mm", "plots/interval", None, 1.0)?,
            self.plot("Interval ÷ training", "plots/ratio", None, 1.0)?,
            self.plot("Across the path, m: tool in the interval", "plots/across", None, 1.0)?,
        ];
        self.container(ContainerKind::Tabs, "How sure", &tabs, share)
    }

    pub(super) fn margins(&mut self, share: f32) -> RecordingStreamResult<Part> {
        let mut tabs = vec![self.plot("Speeds, m/s", "plots/effort", None, 1.0)?];
        if self.fit.has_arrivals {
            // In front, for this is what such a robot stops by.
            let (rate, missed) = ("plots/arrivals/success_rate", "plots/arrivals/missed");
            tabs.push(self.plot("Setpoints in time, share of 100 ms", rate, Some([-0.05, 1.05]), 1.0)?);
            tabs.push(self.plot("Setpoints missed in a row", missed, None, 1.0)?);
        }
        tabs.extend([
            self.plot("Clearance, mm", "plots/clearance", None, 1.0)?,
            self.plot("Command to motion, ms", "plots/latency", None, 1.0)?,
            self.plot("Hops, p95, ms", "plots/hops", None, 1.0)?,
            self.budget(1.0)?,
            self.plot("Lost messages", "plots/lost", None, 1.0)?,
        ]);
        self.container(ContainerKind::Tabs, "Effort and margins", &tabs, share)
    }

    /// A plot over the whole session, so that all of them share their time axis.
    pub(super) fn plot(
        &mut self,
        name: &str,
        origin: &str,
        range: Option<[f64; 2]>,
        share: f32,
    ) -> RecordingStreamResult<Part> {
        // The lane of drivers is named in its title: a legend would lie on its bars.
        let legend = PlotLegend::new()
            .with_corner(free_corner(origin))
            .with_visible(origin != "plots/driver");
        let time = whole_session();
        let mut values = ScalarAxis::new();
        if let Some(range) = range {
            values = values.with_range(range);
        }
        self.view(&ViewSpec {
            class: "TimeSeries",
            name,
            origin,
            share,
            properties: &[("PlotLegend", &legend), ("TimeAxis", &time), ("ScalarAxis", &values)],
        })
    }
}

/// Where a plot's names hide least: what a forecast brings begins late, the others end low.
fn free_corner(origin: &str) -> Corner2D {
    match origin {
        "plots/interval" | "plots/ratio" | "plots/across" | "plots/latency" | "plots/hops" | "plots/lost" => {
            Corner2D::LeftTop
        }
        _ => Corner2D::RightTop,
    }
}

/// All plots show the whole session, so that they line up.
fn whole_session() -> TimeAxis {
    TimeAxis::new().with_view_range(TimeRange {
        start: TimeRangeBoundary::Absolute(0.into()),
        end: TimeRangeBoundary::Infinite,
    })
}
