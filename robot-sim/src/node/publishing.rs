//! What the robot says by itself: its state at a steady rate, its scene now and then.

use std::sync::Arc;

use tandem_wire::{MILLISECOND, Outbox, Pace, Stamp};

use super::{Output, RobotSim};
use crate::report::{Situation, report};

/// How often the scene is repeated in real time, for those who come late.
const SCENE_PERIOD: u64 = 1000 * MILLISECOND;

impl RobotSim {
    pub(super) fn publish_due(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        if self.timing.pace == Pace::Lockstep {
            return;
        }
        if now >= self.next_scene {
            self.publish_scene(now, outbox);
        }
        if now >= self.next_state {
            self.publish_state(now, outbox);
        }
    }

    pub(super) fn publish_scene(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        self.next_scene = next_multiple(now, SCENE_PERIOD);
        let scene = Arc::clone(&self.surroundings.scene);
        outbox.push(Output::Scene(self.scenes.envelope(now, self.tick, scene)));
    }

    pub(super) fn publish_state(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        self.next_state = next_multiple(now, self.timing.stream_period);
        self.untold = None;
        let situation = Situation {
            trial: self.trial.number,
            trial_start: self.trial.start,
            motion: self.motion,
            arrivals: self.is_pulsed().then(|| self.pulse.report()),
            refused: self.hearing.refused(),
        };
        let state = report(&mut self.inner, &self.surroundings.scene.obstacles, situation);
        let state = self.states.envelope(now, self.tick, state);
        self.hearing.note_state(now, state.header.id());
        outbox.push(Output::State(state));
    }
}

/// The first multiple of `period` after `now`: late steps skip states instead of sending them in a burst.
fn next_multiple(now: Stamp, period: u64) -> Stamp {
    let period = period.max(1);
    Stamp((now.0 / period).saturating_add(1).saturating_mul(period))
}
