//! Which channels a message stands on.

use std::io::{Seek, Write};

use tandem_wire::{Claim, Emergency, Envelope, Forecast, NodeName, Scene, State, Wish};

use super::times::Times;
use super::{SessionFile, WriteError, cloud, schemas, standard};
use crate::heard::{Heard, Sample};

const fn lease_channel(claim: &Envelope<Claim>) -> &'static str {
    match claim.body.wish {
        Wish::TakeOver => "lease/take-over",
        Wish::Drive | Wish::Release => "lease",
    }
}

const fn stop_channel(emergency: &Envelope<Emergency>) -> &'static str {
    match emergency.body {
        Emergency::Stop { .. } => "estop",
        Emergency::Clear { .. } => "estop/clear",
    }
}

impl<W: Write + Seek> SessionFile<W> {
    pub(super) fn write_sample(&mut self, heard: &Heard, sample: &Sample) -> Result<(), WriteError> {
        let header = sample.header();
        let times = self.times(heard, header.sent, header.seq);
        let to = &mut self.channels;
        match sample {
            Sample::Command(message) => to.put("command", times, &schemas::Command::from(message)),
            Sample::Proposal(message) => to.put("proposal", times, &schemas::Proposal::from(message)),
            Sample::Setpoint(message) => to.put("setpoint", times, &schemas::Setpoint::from(message.as_ref())),
            Sample::Trial(message) => to.put("trial", times, &schemas::Trial::from(message)),
            Sample::Claim(message) => to.put(lease_channel(message), times, &schemas::Claim::from(message)),
            Sample::Emergency(message) => to.put(stop_channel(message), times, &schemas::Emergency::from(message)),
            Sample::Forecast(message) => self.write_forecast(times, message),
            Sample::State(message) => self.write_state(times, message),
            Sample::Scene(message) => self.write_scene(times, message),
            Sample::Journal(part) => to.put_journal(times, part),
            Sample::Info(node, message) => self.nodes.keep(to, times.log(), *node, &message.body),
            Sample::Clock(node, message) => {
                to.put(clock_channel(*node), times, &schemas::ClockReport::new(*node, message))
            }
        }
    }

    fn write_forecast(&mut self, times: Times, message: &Envelope<Forecast>) -> Result<(), WriteError> {
        let (to, forecast, time) = (&mut self.channels, &message.body, times.session);
        to.put("forecast", times, &schemas::Forecast::from(message))?;
        to.put("forecast_points", times, &cloud::of_forecast(forecast, time))?;
        to.put("forecast_path", times, &standard::forecast_path(forecast, time))?;
        to.put("shapes", times, &standard::forecast_shapes(forecast, time))
    }

    fn write_state(&mut self, times: Times, message: &Envelope<State>) -> Result<(), WriteError> {
        let (to, state, time) = (&mut self.channels, &message.body, times.session);
        to.put("state", times, &schemas::State::from(message))?;
        to.put("frames", times, &standard::frames(state, time))?;
        to.put("tool_pose", times, &standard::tool_pose(state, time))?;
        match &self.scene {
            Some(scene) => to.put("arm_points", times, &cloud::of_arm(&scene.bodies, state, time)),
            None => Ok(()),
        }
    }

    /// Every scene is written, its shapes only when they change: it is repeated every second.
    fn write_scene(&mut self, times: Times, message: &Envelope<Scene>) -> Result<(), WriteError> {
        let (to, scene, time) = (&mut self.channels, &message.body, times.session);
        to.put("scene", times, &schemas::Scene::from(message))?;
        if self.scene.as_ref() == Some(scene) {
            return Ok(());
        }
        self.scene = Some(scene.clone());
        to.put("shapes", times, &standard::scene_shapes(scene, time))?;
        to.put("scene_points", times, &cloud::of_scene(scene, time))
    }
}

/// A channel's name is known when the program is built.
const fn clock_channel(node: NodeName) -> &'static str {
    match node {
        NodeName::Operator => "clock/operator",
        NodeName::Predictor => "clock/predictor",
        NodeName::Arbiter => "clock/arbiter",
        NodeName::RobotSim => "clock/robot-sim",
        NodeName::Recorder => "clock/recorder",
    }
}
