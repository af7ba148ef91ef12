//! One row of a table: names and cells grow together, so that no column can be forgotten.

use tandem_wire::{Guidance, MessageId, Motion, Pose, Vec3};

/// One value and what kind of value its column holds. What does not exist is nothing, never zero.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Cell {
    Count(Option<u64>),
    Number(Option<f64>),
    Flag(Option<bool>),
    Text(Option<String>),
}

impl Cell {
    /// The same kind with nothing in it.
    pub(super) const fn emptied(&self) -> Self {
        match self {
            Self::Count(_) => Self::Count(None),
            Self::Number(_) => Self::Number(None),
            Self::Flag(_) => Self::Flag(None),
            Self::Text(_) => Self::Text(None),
        }
    }

    /// As it stands in a CSV file, unquoted.
    pub(super) fn words(&self) -> String {
        match self {
            Self::Count(value) => value.map(|value| value.to_string()),
            Self::Number(value) => value.map(|value| value.to_string()),
            Self::Flag(value) => value.map(|value| value.to_string()),
            Self::Text(value) => value.clone(),
        }
        .unwrap_or_default()
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Row {
    pub(super) names: Vec<String>,
    pub(super) cells: Vec<Cell>,
}

impl Row {
    /// The same columns with nothing in them.
    pub(super) fn emptied(&self) -> Self {
        Self {
            names: self.names.clone(),
            cells: self.cells.iter().map(Cell::emptied).collect(),
        }
    }

    /// Puts another row's columns behind, their names after `prefix`.
    pub(super) fn append(&mut self, prefix: &str, other: Self) {
        self.names
            .extend(other.names.into_iter().map(|name| format!("{prefix}_{name}")));
        self.cells.extend(other.cells);
    }

    fn put(&mut self, name: &str, cell: Cell) {
        self.names.push(name.to_owned());
        self.cells.push(cell);
    }

    pub(super) fn count(&mut self, name: &str, value: impl Into<Option<u64>>) {
        self.put(name, Cell::Count(value.into()));
    }

    pub(super) fn number(&mut self, name: &str, value: Option<f64>) {
        self.put(name, Cell::Number(value));
    }

    pub(super) fn flag(&mut self, name: &str, value: bool) {
        self.put(name, Cell::Flag(Some(value)));
    }

    pub(super) fn text(&mut self, name: &str, value: Option<String>) {
        self.put(name, Cell::Text(value));
    }

    pub(super) fn vector(&mut self, name: &str, unit: &str, value: Option<Vec3>) {
        for (axis, part) in [
            ("x", value.map(|v| v.x)),
            ("y", value.map(|v| v.y)),
            ("z", value.map(|v| v.z)),
        ] {
            self.number(&format!("{name}_{axis}_{unit}"), part);
        }
    }

    pub(super) fn pose(&mut self, name: &str, pose: &Pose) {
        self.vector(name, "m", Some(pose.position));
        for (part, value) in ["qx", "qy", "qz", "qw"].iter().zip(pose.orientation) {
            self.number(&format!("{name}_{part}"), Some(value.0));
        }
    }

    pub(super) fn motion(&mut self, motion: Motion) {
        self.flag("motion_permitted", motion.is_permitted());
        self.text("held_because", motion.reason().map(|reason| reason.to_string()));
    }

    pub(super) fn seen(&mut self, id: Option<MessageId>) {
        self.count("seen_state_sequence", id.map(|id| id.seq.0));
    }

    pub(super) fn guidance(&mut self, guidance: Option<Guidance>) {
        self.count("forecast", guidance.map(|g| g.forecast.into()));
        self.number("phase_steps", guidance.map(|g| g.phase.0));
        self.vector("robot_velocity", "m_s", guidance.map(|g| g.velocity));
        self.vector("forecast_position", "m", guidance.map(|g| g.position));
        self.vector("half_width", "m", guidance.map(|g| g.half_width));
        self.number("width_ratio_to_training", guidance.map(|g| g.ratio.0));
    }
}
