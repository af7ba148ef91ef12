//! From a state to a prediction: `y = W_out [1; x]`.

use crate::update::LANES;

/// The trained weights, `Ny × p`, row by row, the bias first.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Readout {
    outputs: usize,
    weights: Vec<f64>,
}

impl Readout {
    /// None when the weights do not make whole rows.
    pub(crate) fn new(outputs: usize, weights: Vec<f64>) -> Option<Self> {
        let rows = weights.len().checked_div(outputs)?;
        (rows > 0 && rows * outputs == weights.len()).then_some(Self { outputs, weights })
    }

    pub(crate) fn outputs(&self) -> usize {
        self.outputs
    }

    pub(crate) fn columns(&self) -> usize {
        self.weights.len() / self.outputs
    }

    pub(crate) fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// `y` of one state `x` (`N` activations), each output summed from the bias on, left to right.
    pub(crate) fn read(&self, x: &[f64], y: &mut [f64]) {
        for (y, weights) in y.iter_mut().zip(self.weights.chunks_exact(self.columns())) {
            let mut total = weights[0];
            for (weight, x) in weights[1..].iter().zip(x) {
                total += weight * x;
            }
            *y = total;
        }
    }

    /// One output of eight states at a time, `z[i][s]` being element `i` of `[1; x]` of state `s`. Same bits.
    pub(crate) fn read_tile(&self, output: usize, z: &[[f64; LANES]]) -> [f64; LANES] {
        let weights = &self.weights[output * self.columns()..(output + 1) * self.columns()];
        let mut totals = [weights[0]; LANES];
        for (weight, z) in weights[1..].iter().zip(&z[1..]) {
            for s in 0..LANES {
                totals[s] += weight * z[s];
            }
        }
        totals
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_state_and_a_tile_of_the_same_give_the_same_bits() {
        let readout = Readout::new(2, vec![0.1, 0.7, -0.3, 1.0, 1e-3, 4.0]).expect("two rows of three");
        let mut y = [0.0; 2];
        readout.read(&[0.2, -0.9], &mut y);
        for (k, y) in y.iter().enumerate() {
            let tile = readout.read_tile(k, &[[1.0; LANES], [0.2; LANES], [-0.9; LANES]]);
            assert!(tile.iter().all(|t| t.to_bits() == y.to_bits()));
        }
        assert_eq!(Readout::new(2, vec![1.0; 3]), None);
        assert_eq!(Readout::new(0, vec![]), None);
    }
}
