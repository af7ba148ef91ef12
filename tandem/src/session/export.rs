//! Tables of a session: one row per message, true times, units in the names of the columns.
//!
//! `captured_s` is the sender's own stamp, on the sender's clock (in lockstep `tick · period`); `received_s` is the
//! arrival on the recorder's clock. What does not exist in a row, such as guidance before the first forecast, is left
//! empty, never zero.

use std::io::{BufWriter, Write};
use std::path::Path;

use anyhow::Context as _;
use tandem_recorder::{Recorded, Recording};
use tandem_wire::{
    Command, Deadman, Guidance, Law, MessageId, Motion, Pose, Proposal, Setpoint, State, Topic, Vec3, decode, seconds,
};

/// A row that is being written: names and values grow together, so that no column can be forgotten.
#[derive(Default)]
struct Row {
    names: Vec<String>,
    values: Vec<String>,
}

impl Row {
    fn text(&mut self, name: &str, value: impl ToString) {
        self.names.push(name.to_owned());
        self.values.push(value.to_string());
    }

    fn number(&mut self, name: &str, value: Option<f64>) {
        self.text(name, value.map(|value| value.to_string()).unwrap_or_default());
    }

    fn vector(&mut self, name: &str, unit: &str, value: Option<Vec3>) {
        for (axis, part) in [
            ("x", value.map(|v| v.x)),
            ("y", value.map(|v| v.y)),
            ("z", value.map(|v| v.z)),
        ] {
            self.number(&format!("{name}_{axis}_{unit}"), part);
        }
    }

    fn pose(&mut self, name: &str, pose: &Pose) {
        self.vector(name, "m", Some(pose.position));
        for (part, value) in ["qx", "qy", "qz", "qw"].iter().zip(pose.orientation) {
            self.number(&format!("{name}_{part}"), Some(value.0));
        }
    }

    fn motion(&mut self, motion: Motion) {
        self.text("motion_permitted", motion.is_permitted());
        self.text(
            "held_because",
            motion.reason().map(|reason| reason.to_string()).unwrap_or_default(),
        );
    }

    fn seen(&mut self, id: Option<MessageId>) {
        self.text(
            "seen_state_sequence",
            id.map(|id| id.seq.0.to_string()).unwrap_or_default(),
        );
    }

    fn guidance(&mut self, guidance: Option<Guidance>) {
        self.text("forecast", guidance.map(|g| g.forecast.to_string()).unwrap_or_default());
        self.number("phase_steps", guidance.map(|g| g.phase.0));
        self.vector("robot_velocity", "m_s", guidance.map(|g| g.velocity));
        self.vector("forecast_position", "m", guidance.map(|g| g.position));
        self.vector("half_width", "m", guidance.map(|g| g.half_width));
        self.number("width_ratio_to_training", guidance.map(|g| g.ratio.0));
    }

    fn line(cells: &[String]) -> String {
        cells.iter().map(|cell| quoted(cell)).collect::<Vec<_>>().join(",")
    }
}

/// A cell as RFC 4180 writes it.
fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", cell.replace('"', "\"\""))
    } else {
        cell.to_owned()
    }
}

/// Writes `state.csv`, `setpoint.csv`, `command.csv` and `proposal.csv` into `folder`.
pub(super) fn write(recording: &Recording, folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    for topic in [Topic::State, Topic::Setpoint, Topic::Command, Topic::Proposal] {
        let path = folder.join(format!("{topic}.csv"));
        let rows = table(recording, topic, &path).with_context(|| format!("cannot write {}", path.display()))?;
        println!("{}: {rows} rows", path.display());
    }
    Ok(())
}

fn table(recording: &Recording, topic: Topic, path: &Path) -> std::io::Result<u64> {
    let mut file = BufWriter::new(std::fs::File::create(path)?);
    let mut rows = 0;
    for message in recording.messages.iter().filter(|message| message.topic == topic) {
        // What was heard was decodable; a journal that says otherwise has nothing for a table.
        let Some(row) = row(message, recording.epoch_unix_nanos) else {
            continue;
        };
        if rows == 0 {
            writeln!(file, "{}", Row::line(&row.names))?;
        }
        writeln!(file, "{}", Row::line(&row.values))?;
        rows += 1;
    }
    file.flush()?;
    Ok(rows)
}

fn row(message: &Recorded, epoch: u64) -> Option<Row> {
    let mut row = Row::default();
    let header = &message.header;
    row.text("tick", header.tick);
    row.text("sequence", header.seq.0);
    // A number beyond 2^53 that programs would round: the run's name is text.
    row.text("session", format!("{:016x}", header.session.0));
    row.text("captured_s", header.sent.seconds());
    row.text("received_s", message.at.seconds());
    row.text("received_unix_ns", epoch.saturating_add(message.at.0));
    match message.topic {
        Topic::State => state(&mut row, &decode(&message.bytes).ok()?.body),
        Topic::Setpoint => setpoint(&mut row, &decode(&message.bytes).ok()?.body),
        Topic::Command => command(&mut row, &decode(&message.bytes).ok()?.body),
        Topic::Proposal => {
            let proposal: Proposal = decode(&message.bytes).ok()?.body;
            row.seen(proposal.seen);
            row.guidance(proposal.guidance);
        }
        _ => return None,
    }
    Some(row)
}

fn command(row: &mut Row, command: &Command) {
    row.vector("human_velocity", "m_s", Some(command.velocity));
    let press = match command.deadman {
        Deadman::Held { press } => press.to_string(),
        Deadman::Released => String::new(),
    };
    row.text("deadman_held", !press.is_empty());
    row.text("deadman_press", press);
    row.seen(command.seen);
}

fn setpoint(row: &mut Row, setpoint: &Setpoint) {
    row.vector("velocity", "m_s", Some(setpoint.velocity));
    row.motion(setpoint.motion);
    row.text(
        "law",
        match setpoint.law {
            Law::Adaptive => "adaptive",
            Law::Fixed => "fixed",
            Law::Human => "human",
            Law::Robot => "robot",
            Law::Constant(_) => "constant",
            Law::Attentive => "attentive",
        },
    );
    row.number("human_weight", Some(setpoint.weight.0));
    row.vector("human_velocity", "m_s", Some(setpoint.human));
    row.vector("blended_velocity", "m_s", Some(setpoint.blended));
    row.guidance(setpoint.guidance);
    row.text("limited_by_workspace", setpoint.limited.workspace);
    row.text("limited_by_speed", setpoint.limited.speed);
    row.text("limited_by_acceleration", setpoint.limited.acceleration);
    let sequence = |used: Option<tandem_wire::Used>| used.map(|used| used.id.seq.0.to_string()).unwrap_or_default();
    row.text("used_command_sequence", sequence(setpoint.command));
    row.number("used_command_age_s", setpoint.command.map(|used| seconds(used.age)));
    row.text("used_proposal_sequence", sequence(setpoint.proposal));
    row.number("used_proposal_age_s", setpoint.proposal.map(|used| seconds(used.age)));
    row.seen(setpoint.seen);
}

fn state(row: &mut Row, state: &State) {
    row.text("trial", state.trial);
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
    row.text("at_rest", state.at_rest);
    let obeys = state.obeys.map(|obeys| obeys.id.seq.0.to_string());
    row.text("obeyed_setpoint_sequence", obeys.unwrap_or_default());
    row.number("setpoint_arrived_s", state.obeys.map(|obeys| obeys.arrived.seconds()));
    row.number("setpoint_moved_s", state.obeys.map(|obeys| obeys.moved.seconds()));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_with_a_comma_or_a_quote_is_quoted() {
        let cells = ["1.5".to_owned(), "a, \"b\"".to_owned(), String::new()];
        assert_eq!(Row::line(&cells), "1.5,\"a, \"\"b\"\"\",");
    }
}
