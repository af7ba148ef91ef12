//! What the robot carries from step to step.

use tandem_wire::{Malformed, Memory, Remember};

use super::RobotSim;

impl Remember for RobotSim {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            timing: _,
            surroundings: _,
            states,
            scenes,
            hearing,
            inner,
            motion,
            untold,
            latch,
            pulse,
            trial,
            tick,
            in_step,
            next_state,
            next_scene,
            closed,
        } = self;
        states.remember(memory)?;
        scenes.remember(memory)?;
        hearing.remember(memory)?;
        inner.remember(memory)?;
        memory.part(motion)?;
        memory.part(untold)?;
        memory.part(latch)?;
        memory.part(pulse)?;
        memory.part(trial)?;
        memory.part(tick)?;
        memory.part(in_step)?;
        memory.part(next_state)?;
        memory.part(next_scene)?;
        memory.part(closed)
    }
}
