//! What is noted for people, and how much each thing matters.

use std::mem::discriminant;

use tandem_wire::{Motion, NodeName, Reason, seconds};

use crate::heard::{Level, Note};

pub(super) fn motion_note(about: NodeName, before: Option<Motion>, motion: Motion) -> Option<Note> {
    if before.is_some_and(|before| same_motion(before, motion)) {
        return None;
    }
    Some(match motion {
        Motion::Held(reason) => Note {
            level: level_of(reason),
            about,
            is_routine: true,
            text: format!("stop: {reason}"),
        },
        Motion::Permitted { press } => info(about, format!("motion is permitted by press {press}")),
    })
}

/// Waiting for the human is the course of things; losing something is not.
pub(super) const fn level_of(reason: Reason) -> Level {
    match reason {
        Reason::NoCommandYet
        | Reason::NoSetpointYet
        | Reason::DeadmanReleased
        | Reason::AwaitingPress
        | Reason::TrialOver
        | Reason::NoTrial => Level::Info,
        Reason::CommandLost { .. }
        | Reason::SetpointLost { .. }
        | Reason::StateLost { .. }
        | Reason::LoopTooOld
        | Reason::ShuttingDown
        | Reason::SecondOperator
        | Reason::SetpointsMissed { .. }
        | Reason::NoLease => Level::Warning,
        Reason::EmergencyStop { .. } => Level::Error,
    }
}

/// Whether two motions are the same but for how long a silence has lasted.
pub(super) fn same_motion(one: Motion, other: Motion) -> bool {
    match (one, other) {
        (Motion::Held(one), Motion::Held(other)) => discriminant(&one) == discriminant(&other),
        _ => one == other,
    }
}

pub(super) fn forecast_note(forecast: &tandem_wire::Forecast) -> Note {
    let widest = |axis: fn(&tandem_wire::Vec3) -> f64| {
        forecast
            .points
            .iter()
            .map(|point| axis(&point.half_width))
            .fold(0.0, f64::max)
    };
    let millimetres = widest(|w| w.x).max(widest(|w| w.y)).max(widest(|w| w.z)) * 1e3;
    let ratio = forecast.points.iter().map(|point| point.ratio.0).fold(0.0, f64::max);
    let ahead = seconds(forecast.period) * forecast.points.len() as f64;
    let text = format!(
        "forecast {}: {ahead:.1} s ahead, at worst ±{millimetres:.1} mm and {ratio:.2} times as unsure as in training",
        forecast.number,
    );
    info(NodeName::Predictor, text)
}

pub(super) fn info(about: NodeName, text: String) -> Note {
    Note {
        level: Level::Info,
        about,
        is_routine: true,
        text,
    }
}

pub(super) fn warning(about: NodeName, text: String) -> Note {
    Note {
        level: Level::Warning,
        about,
        is_routine: false,
        text,
    }
}
