//! The plane that a planar task is drawn in, seen from the robot's base.

use crate::Vec3;

/// `base_from_task`: where task coordinates `(x, y)` lie in the base frame, `origin + x·x_axis + y·y_axis`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TaskFrame {
    /// Task coordinates (0, 0) in the base frame, in metres.
    pub origin: Vec3,
    /// Direction of the task's x in the base frame; unit length.
    pub x_axis: Vec3,
    /// Direction of the task's y in the base frame; unit length, at right angles to `x_axis`.
    pub y_axis: Vec3,
}

impl Default for TaskFrame {
    /// The shipped task, in front of the arm: `base = (0.5 − y, x − 0.3, 0.15)`.
    fn default() -> Self {
        Self {
            origin: Vec3::new(0.5, -0.3, 0.15),
            x_axis: Vec3::new(0.0, 1.0, 0.0),
            y_axis: Vec3::new(-1.0, 0.0, 0.0),
        }
    }
}

impl TaskFrame {
    /// A point of the task, in the base frame.
    #[must_use]
    pub fn to_base(&self, point: [f64; 2]) -> Vec3 {
        self.origin + self.vector_to_base(point)
    }

    /// A direction, velocity or offset of the task, in the base frame.
    #[must_use]
    pub fn vector_to_base(&self, vector: [f64; 2]) -> Vec3 {
        self.x_axis * vector[0] + self.y_axis * vector[1]
    }

    /// A point in the base frame, in task coordinates; its height above the plane is dropped.
    #[must_use]
    pub fn to_task(&self, point: Vec3) -> [f64; 2] {
        let offset = point - self.origin;
        [offset.dot(self.x_axis), offset.dot(self.y_axis)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_task_lies_in_front_of_the_arm() {
        let frame = TaskFrame::default();
        assert_eq!(frame.to_base([0.25, 0.125]), Vec3::new(0.375, -0.3 + 0.25, 0.15));
        let there = frame.to_task(frame.to_base([0.25, 0.125]));
        assert!((there[0] - 0.25).abs() < 1e-15 && (there[1] - 0.125).abs() < 1e-15);
    }
}
