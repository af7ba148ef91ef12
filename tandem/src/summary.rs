//! How far a trial is, in one line.

use tandem_trials::Tracer;
use tandem_wire::Motion;

/// One line on where the trial is.
pub(crate) fn progress(tracer: &Tracer) -> String {
    let Some(setpoint) = tracer.newest_setpoint() else {
        return "waiting for the first setpoint".into();
    };
    let phase = setpoint.guidance.map_or_else(String::new, |guidance| {
        format!(
            ", step {:.0} of {}",
            guidance.phase.0.min(f64::from(guidance.last_step)),
            guidance.last_step
        )
    });
    match setpoint.motion {
        Motion::Permitted { .. } if setpoint.guidance.is_none() => "human alone, before the checkpoint".into(),
        Motion::Permitted { .. } => format!("shared, ω = {:.2}{phase}", setpoint.weight.0),
        Motion::Held(reason) => format!("held: {reason}"),
    }
}
