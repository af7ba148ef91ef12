//! The layout in which two runs of one session are compared.

use rerun::RecordingStreamResult;
use rerun::external::re_sdk_types::blueprint::components::ContainerKind;

use super::{Part, Sketch, ViewSpec};

impl Sketch<'_> {
    pub(super) fn draw_comparison(mut self) -> RecordingStreamResult<()> {
        let lanes = ViewSpec {
            class: "StateTimeline",
            name: "Who drives (double-click to fit)",
            origin: "lanes",
            share: 1.3,
            properties: &[],
        };
        let left = [
            self.now(1.5)?,
            self.world_named("Grey: as it was. Pink: as it would have been", 5.2)?,
            self.view(&lanes)?,
        ];
        let left = self.container(ContainerKind::Vertical, "the two runs", &left, 1.2)?;
        let figures = self.figures(1.9)?;
        let right = [
            self.plan_named("From above; thin: the forecasts", 4.0)?,
            self.plot("Human's weight ω", "plots/weight", Some([-0.1, 1.1]), 1.6)?,
            self.plot("How far the two tools are apart, mm", "plots/apart", None, 1.6)?,
            figures,
        ];
        let right = self.container(ContainerKind::Vertical, "what differs", &right, 1.0)?;
        self.finish(left, right)
    }

    fn figures(&mut self, share: f32) -> RecordingStreamResult<Part> {
        let tabs = [
            self.plot("Clearance, mm", "plots/clearance", None, 1.0)?,
            self.plot("Off the forecast, mm", "plots/off_forecast", None, 1.0)?,
            self.plot("Human's command, m/s", "plots/effort", None, 1.0)?,
        ];
        self.container(ContainerKind::Tabs, "margins", &tabs, share)
    }
}
