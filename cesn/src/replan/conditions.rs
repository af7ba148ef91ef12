//! The conditions that a model was taught under, and what a context is compared with.

use crate::demonstration::Demonstration;

/// Conditions for each demonstration; fewer if it has fewer steps after the checkpoint.
pub const CONDITIONS: usize = 10;

/// What a context `[time, position]` is compared with.
#[derive(Clone, Debug, PartialEq, bincode::Encode, bincode::Decode)]
pub(crate) struct Conditions {
    /// The first condition's step: the checkpoint.
    pub(crate) first: usize,
    /// The last one's.
    pub(crate) last: usize,
    /// The demonstrations' mean, `T × Ny`, row by row.
    pub(crate) mean_path: Vec<f64>,
    /// `h_train`: for every step from the first condition's to the last one's a row of `T`; before the condition, what
    /// holds at it.
    pub(crate) training_leverages: Vec<f64>,
}

impl Conditions {
    pub(super) fn of(demonstrations: &[Demonstration], checkpoint: usize, steps: usize) -> Self {
        let mut mean_path = Vec::new();
        for demonstration in demonstrations {
            let numbers = demonstration.rows().flatten();
            mean_path.resize(demonstration.steps() * demonstration.output_columns().len(), 0.0);
            for (mean, number) in mean_path.iter_mut().zip(numbers) {
                *mean += number / demonstrations.len() as f64;
            }
        }
        let last = steps.saturating_sub(3).max(checkpoint);
        Self {
            first: checkpoint,
            last,
            mean_path,
            training_leverages: Vec::new(),
        }
    }

    /// The largest leverage of the demonstrations at `step` under conditions at `time`, in steps.
    pub(crate) fn training_leverage(&self, time: f64, step: usize) -> Option<f64> {
        let rows = self.last - self.first + 1;
        let steps = self.training_leverages.len() / rows;
        let within = (time - self.first as f64).clamp(0.0, (rows - 1) as f64);
        let row = floor(within);
        let at = |row: usize| {
            let place = row.min(rows - 1) * steps + step.min(steps.checked_sub(1)?);
            self.training_leverages.get(place).copied()
        };
        let (low, high) = (at(row)?, at(row + 1)?);
        Some(low + (high - low) * (within - row as f64))
    }

    /// The steps of the conditions, ascending.
    pub(super) fn steps(&self) -> Vec<usize> {
        let span = self.last - self.first;
        let mut steps: Vec<usize> = (0..CONDITIONS)
            .map(|index| self.first + (2 * index * span + CONDITIONS - 1) / (2 * (CONDITIONS - 1)))
            .collect();
        steps.dedup();
        steps
    }

    /// The time of a condition, −1 at the first and 1 at the last.
    pub(super) fn time(&self, step: f64) -> f64 {
        let (first, last) = (self.first as f64, self.last as f64);
        (2.0 * step - first - last) / (last - first).max(1.0)
    }

    /// `[time · unit, position − mean path then]` of a context whose time is in seconds; lengths fit.
    ///
    /// `unit` is the positions' scale, so that one division later serves both.
    pub(crate) fn relative(&self, context: &[f64], period_s: f64, unit: f64, relative: &mut [f64]) {
        let (Some((time, position)), Some((held, offsets))) = (context.split_first(), relative.split_first_mut())
        else {
            return;
        };
        let step = time / period_s;
        *held = self.time(step) * unit;
        for (k, (offset, position)) in offsets.iter_mut().zip(position).enumerate() {
            *offset = position - self.mean_at(step, k, context.len() - 1);
        }
    }

    /// The mean path's number `k` of `outputs`, linear between steps, constant outside of them.
    pub(super) fn mean_at(&self, step: f64, k: usize, outputs: usize) -> f64 {
        let last = (self.mean_path.len() / outputs.max(1)).saturating_sub(1);
        let within = step.clamp(0.0, last as f64);
        let index = floor(within);
        let at = |row: usize| self.mean_path.get(row.min(last) * outputs + k).copied().unwrap_or(0.0);
        at(index) + (at(index + 1) - at(index)) * (within - index as f64)
    }

    /// Whether it fits a model of so many steps and outputs.
    pub(crate) fn fits(&self, checkpoint: usize, steps: usize, outputs: usize) -> bool {
        self.first == checkpoint
            && (self.first..steps.saturating_sub(1)).contains(&self.last)
            && self.mean_path.len() == steps * outputs
            && self.mean_path.iter().all(|number| number.is_finite())
            && self.training_leverages.len() == (self.last - self.first + 1) * steps
            && self
                .training_leverages
                .iter()
                .all(|leverage| (0.0..f64::INFINITY).contains(leverage))
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a step; what is no number, negative or larger than any step is clamped by the caller"
)]
pub(super) fn floor(step: f64) -> usize {
    step as usize
}
