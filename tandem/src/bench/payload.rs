//! How long Tandem's messages are, for what carries payloads of the same length without them.

use tandem_wire::codec::{HEADER_BYTES, to_bytes};
use tandem_wire::{
    Clearance, Command, Finite, Law, Limited, MessageId, Motion, Obeyed, Pose, Reason, Refusals, Seq, Session,
    Setpoint, Stamp, State, Used, Vec3,
};

const ID: MessageId = MessageId {
    session: Session(1),
    seq: Seq(1),
};

/// As long as an operator's command.
pub(super) fn command_bytes() -> usize {
    let command = Command {
        seen: Some(ID),
        ..Command::default()
    };
    HEADER_BYTES + to_bytes(&command).len()
}

/// As long as the setpoint made of it.
pub(super) fn setpoint_bytes() -> usize {
    HEADER_BYTES + to_bytes(&setpoint()).len()
}

/// As long as the state of a robot that obeys it.
pub(super) fn state_bytes() -> usize {
    let obeyed = Obeyed {
        id: ID,
        arrived: Stamp(0),
        moved: Stamp(0),
        setpoint: setpoint(),
    };
    let state = State {
        trial: 0,
        trial_start: 0,
        joints: Default::default(),
        joint_velocities: Default::default(),
        links: Default::default(),
        tool: Pose::default(),
        tool_velocity: Vec3::ZERO,
        clearance: Some(Clearance::default()),
        closest: Some(Clearance::default()),
        motion: Motion::Held(Reason::NoTrial),
        at_rest: true,
        obeys: Some(obeyed),
        arrivals: None,
        refused: Refusals::default(),
    };
    HEADER_BYTES + to_bytes(&state).len()
}

/// A setpoint where nobody forecasts.
fn setpoint() -> Setpoint {
    let used = Used {
        id: ID,
        sent: Stamp(0),
        age: 0,
        seen: Some(ID),
    };
    Setpoint {
        velocity: Vec3::ZERO,
        motion: Motion::Held(Reason::NoTrial),
        lease: None,
        asks: None,
        law: Law::default(),
        weight: Finite(1.0),
        human: Vec3::ZERO,
        guidance: None,
        blended: Vec3::ZERO,
        limited: Limited::default(),
        command: Some(used),
        proposal: None,
        seen: Some(ID),
        refused: Refusals::default(),
    }
}
