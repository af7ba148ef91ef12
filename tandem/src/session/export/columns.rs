//! What stands in the rows: the columns of each kind of message, with their units.

use tandem_recorder::Recorded;
use tandem_wire::{
    Claim, Command, Deadman, Emergency, Label, Law, Proposal, Setpoint, State, Topic, Used, Wish, decode, seconds,
};

use super::context::Context;
use super::row::Row;

/// The message as a row; `None` for what has no table.
pub(super) fn row(message: &Recorded, context: &Context) -> Option<Row> {
    let mut row = Row::default();
    let header = &message.header;
    row.count("tick", u64::from(header.tick));
    row.count("sequence", header.seq.0);
    // A number beyond 2^53 that programs would round: the run's name is text.
    row.text("session", Some(format!("{:016x}", header.session.0)));
    row.number("captured_s", Some(header.sent.seconds()));
    let time = context.session_time(message);
    row.number("captured_session_s", time.map(|time| time.nanos as f64 * 1e-9));
    row.number(
        "captured_session_uncertainty_s",
        time.map(|time| seconds(time.uncertainty)),
    );
    row.number("received_s", Some(message.at.seconds()));
    row.count("received_unix_ns", context.epoch.saturating_add(message.at.0));
    match message.topic {
        Topic::State => {
            let body: State = decode(&message.bytes).ok()?.body;
            row.count("trial", u64::from(body.trial));
            row.text("trial_label", context.label(body.trial, message.at));
            state(&mut row, &body);
        }
        Topic::Setpoint => setpoint(&mut row, &decode(&message.bytes).ok()?.body),
        Topic::Command => command(&mut row, &decode(&message.bytes).ok()?.body),
        Topic::Proposal => {
            let proposal: Proposal = decode(&message.bytes).ok()?.body;
            row.seen(proposal.seen);
            row.guidance(proposal.guidance);
        }
        Topic::Lease | Topic::TakeOver => {
            let claim: Claim = decode(&message.bytes).ok()?.body;
            let wish = match claim.wish {
                Wish::Drive => "drive",
                Wish::Release => "release",
                Wish::TakeOver => "take over",
            };
            row.text("wish", Some(wish.to_owned()));
            row.text("name", name(claim.name));
        }
        Topic::Emergency | Topic::AllClear => emergency(&mut row, &decode(&message.bytes).ok()?.body),
        _ => return None,
    }
    Some(row)
}

/// Nothing for somebody who has not said it.
fn name(label: Label) -> Option<String> {
    (!label.is_empty()).then(|| label.to_string())
}

fn emergency(row: &mut Row, emergency: &Emergency) {
    let (says, clears, by) = match emergency {
        Emergency::Stop { by } => ("stop", None, *by),
        Emergency::Clear { stop, by } => ("clear", Some(*stop), *by),
    };
    row.text("says", Some(says.to_owned()));
    row.text("by", name(by));
    row.text("cleared_session", clears.map(|stop| format!("{:016x}", stop.session.0)));
    row.count("cleared_sequence", clears.map(|stop| stop.seq.0));
}

fn command(row: &mut Row, command: &Command) {
    row.vector("human_velocity", "m_s", Some(command.velocity));
    let press = match command.deadman {
        Deadman::Held { press } => Some(u64::from(press)),
        Deadman::Released => None,
    };
    row.flag("deadman_held", press.is_some());
    row.count("deadman_press", press);
    row.seen(command.seen);
}

fn setpoint(row: &mut Row, setpoint: &Setpoint) {
    row.vector("velocity", "m_s", Some(setpoint.velocity));
    row.motion(setpoint.motion);
    let law = match setpoint.law {
        Law::Adaptive => "adaptive",
        Law::Fixed => "fixed",
        Law::Human => "human",
        Law::Robot => "robot",
        Law::Constant(_) => "constant",
        Law::Attentive => "attentive",
    };
    row.text("law", Some(law.to_owned()));
    row.number("human_weight", Some(setpoint.weight.0));
    row.vector("human_velocity", "m_s", Some(setpoint.human));
    row.vector("blended_velocity", "m_s", Some(setpoint.blended));
    row.guidance(setpoint.guidance);
    row.flag("limited_by_workspace", setpoint.limited.workspace);
    row.flag("limited_by_speed", setpoint.limited.speed);
    row.flag("limited_by_acceleration", setpoint.limited.acceleration);
    let sequence = |used: Option<Used>| used.map(|used| used.id.seq.0);
    row.count("used_command_sequence", sequence(setpoint.command));
    row.number("used_command_age_s", setpoint.command.map(|used| seconds(used.age)));
    row.count("used_proposal_sequence", sequence(setpoint.proposal));
    row.number("used_proposal_age_s", setpoint.proposal.map(|used| seconds(used.age)));
    row.seen(setpoint.seen);
    row.count("lease_number", setpoint.lease.map(|lease| lease.number.into()));
    row.text(
        "lease_session",
        setpoint.lease.map(|lease| format!("{:016x}", lease.holder.0)),
    );
    row.text("lease_name", setpoint.lease.and_then(|lease| name(lease.name)));
}

fn state(row: &mut Row, state: &State) {
    for (joint, angle) in (1..).zip(state.joints) {
        row.number(&format!("joint_{joint}_rad"), Some(angle.0));
    }
    for (joint, speed) in (1..).zip(state.joint_velocities) {
        row.number(&format!("joint_{joint}_velocity_rad_s"), Some(speed.0));
    }
    row.pose("tool", &state.tool);
    row.vector("tool_velocity", "m_s", Some(state.tool_velocity));
    row.number("clearance_m", state.clearance.map(|clearance| clearance.distance.0));
    row.number("closest_since_last_m", state.closest.map(|closest| closest.distance.0));
    row.motion(state.motion);
    row.flag("at_rest", state.at_rest);
    row.count("obeyed_setpoint_sequence", state.obeys.map(|obeys| obeys.id.seq.0));
    row.number("setpoint_arrived_s", state.obeys.map(|obeys| obeys.arrived.seconds()));
    row.number("setpoint_moved_s", state.obeys.map(|obeys| obeys.moved.seconds()));
    let arrivals = state.arrivals;
    row.number(
        "setpoint_success_rate",
        arrivals.map(|arrivals| arrivals.success_rate.0),
    );
    row.count("setpoints_missed", arrivals.map(|arrivals| arrivals.missed.into()));
}
