//! What an arbiter says: the setpoint with all that it was made of, and the lease in it.

use tandem_wire as wire;

use super::super::schemas::{Law, Lease, Setpoint, Used};
use super::super::standard::vector;

impl From<&wire::Envelope<wire::Setpoint>> for Setpoint {
    fn from(message: &wire::Envelope<wire::Setpoint>) -> Self {
        let setpoint = &message.body;
        let (law, constant_weight) = match setpoint.law {
            wire::Law::Adaptive => (Law::Adaptive, None),
            wire::Law::Fixed => (Law::Fixed, None),
            wire::Law::Human => (Law::Human, None),
            wire::Law::Robot => (Law::Robot, None),
            wire::Law::Constant(weight) => (Law::Constant, Some(weight.0)),
            wire::Law::Attentive => (Law::Attentive, None),
        };
        Self {
            header: (&message.header).into(),
            velocity_m_s: vector(setpoint.velocity),
            motion: setpoint.motion.into(),
            law,
            constant_weight,
            human_weight: setpoint.weight.0,
            human_velocity_m_s: vector(setpoint.human),
            guidance: setpoint.guidance.map(Into::into),
            blended_velocity_m_s: vector(setpoint.blended),
            limited_by_workspace: setpoint.limited.workspace,
            limited_by_speed: setpoint.limited.speed,
            limited_by_acceleration: setpoint.limited.acceleration,
            used_command: setpoint.command.map(Into::into),
            used_proposal: setpoint.proposal.map(Into::into),
            seen_state: setpoint.seen.map(Into::into),
            refused: (&setpoint.refused).into(),
            lease: setpoint.lease.map(Into::into),
            asked_by: setpoint.asks.map(|name| name.to_string()),
        }
    }
}

impl From<wire::Used> for Used {
    fn from(used: wire::Used) -> Self {
        Self {
            session: used.id.session.0,
            sequence: used.id.seq.0,
            sent_ns: used.sent.0,
            age_ms: wire::seconds(used.age) * 1e3,
            seen_state: used.seen.map(Into::into),
        }
    }
}

impl From<wire::Lease> for Lease {
    fn from(lease: wire::Lease) -> Self {
        Self {
            number: lease.number,
            holder_session: lease.holder.0,
            name: lease.name.to_string(),
        }
    }
}
