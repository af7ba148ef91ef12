//! What an operator says, and with it whoever stops a robot or marks a trial.

use tandem_wire as wire;

use super::super::schemas::{Claim, Command, Emergency, Trial, Wish};
use super::super::standard::vector;

impl From<&wire::Envelope<wire::Command>> for Command {
    fn from(message: &wire::Envelope<wire::Command>) -> Self {
        let command = &message.body;
        let press = match command.deadman {
            wire::Deadman::Released => 0,
            wire::Deadman::Held { press } => press,
        };
        Self {
            header: (&message.header).into(),
            velocity_m_s: vector(command.velocity),
            deadman_held: command.deadman != wire::Deadman::Released,
            deadman_press: press,
            seen_state: command.seen.map(Into::into),
        }
    }
}

impl From<&wire::Envelope<wire::Claim>> for Claim {
    fn from(message: &wire::Envelope<wire::Claim>) -> Self {
        Self {
            header: (&message.header).into(),
            wish: match message.body.wish {
                wire::Wish::Drive => Wish::Drive,
                wire::Wish::Release => Wish::Release,
                wire::Wish::TakeOver => Wish::TakeOver,
            },
            name: message.body.name.to_string(),
        }
    }
}

impl From<&wire::Envelope<wire::Emergency>> for Emergency {
    fn from(message: &wire::Envelope<wire::Emergency>) -> Self {
        let (clears, by) = match message.body {
            wire::Emergency::Stop { by } => (None, by),
            wire::Emergency::Clear { stop, by } => (Some(stop.into()), by),
        };
        Self {
            header: (&message.header).into(),
            clears,
            by: by.to_string(),
        }
    }
}

impl From<&wire::Envelope<wire::Trial>> for Trial {
    fn from(message: &wire::Envelope<wire::Trial>) -> Self {
        let (number, begins, label, outcome) = match &message.body {
            wire::Trial::Begin { number, label } => (*number, true, label.clone(), String::new()),
            wire::Trial::End { number, outcome } => (*number, false, String::new(), outcome.clone()),
        };
        Self {
            header: (&message.header).into(),
            number,
            begins,
            label,
            outcome,
        }
    }
}
