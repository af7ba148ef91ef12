//! The one factorisation that inverse kinematics needs, and the smallest singular value that comes with it.

use nalgebra::{Matrix6, Vector6};

/// No pivot is smaller, whatever rounding made of it. Half the smallest shift that is ever used.
const PIVOT_MIN: f64 = 5e-10;

/// `M + λ² I = L Lᵀ` for a symmetric 6×6 matrix. Written out because it must never fail: a pivot that rounding
/// made too small is replaced, where a library would return nothing. Keeps the reciprocal of the diagonal.
pub(crate) struct Cholesky {
    lower: [[f64; 6]; 6],
    inverse_diagonal: [f64; 6],
    shift: f64,
}

impl Cholesky {
    /// Factors `matrix + shift · I`.
    pub(crate) fn of(matrix: &Matrix6<f64>, shift: f64) -> Self {
        let mut lower = [[0.0; 6]; 6];
        let mut inverse_diagonal = [0.0; 6];
        for row in 0..6 {
            for column in 0..=row {
                let mut sum = matrix[(row, column)];
                for (left, right) in std::iter::zip(&lower[row][..column], &lower[column][..column]) {
                    sum -= left * right;
                }
                if row == column {
                    let pivot = (sum + shift).max(PIVOT_MIN).sqrt();
                    lower[row][row] = pivot;
                    inverse_diagonal[row] = 1.0 / pivot;
                } else {
                    lower[row][column] = sum * inverse_diagonal[column];
                }
            }
        }
        Self {
            lower,
            inverse_diagonal,
            shift,
        }
    }

    /// `Lᵀ x = b`.
    fn solve_upper(&self, b: &Vector6<f64>) -> Vector6<f64> {
        let mut x = *b;
        for row in (0..6).rev() {
            for k in row + 1..6 {
                x[row] -= self.lower[k][row] * x[k];
            }
            x[row] *= self.inverse_diagonal[row];
        }
        x
    }

    /// `(M + λ² I) x = b`.
    pub(crate) fn solve(&self, b: &Vector6<f64>) -> Vector6<f64> {
        let mut x = *b;
        for row in 0..6 {
            for k in 0..row {
                x[row] -= self.lower[row][k] * x[k];
            }
            x[row] *= self.inverse_diagonal[row];
        }
        self.solve_upper(&x)
    }

    /// σ of the weakest direction of `J`, where `M = J Jᵀ`, by inverse iteration.
    ///
    /// Starts from the direction that the smallest pivot points at, which is close already. Six rounds approach σ
    /// from above: within two percent near a singularity, where it counts, and within a quarter where two singular
    /// values nearly coincide.
    pub(crate) fn smallest_singular_value(&self) -> f64 {
        let mut weakest_pivot = 0;
        for row in 1..6 {
            if self.lower[row][row] < self.lower[weakest_pivot][weakest_pivot] {
                weakest_pivot = row;
            }
        }
        let mut unit = Vector6::zeros();
        unit[weakest_pivot] = 1.0;
        let mut direction = self.solve_upper(&unit);
        let mut growth = 1.0;
        for _ in 0..6 {
            let grown = self.solve(&(direction / direction.norm()));
            growth = grown.norm();
            direction = grown;
        }
        (1.0 / growth - self.shift).max(0.0).sqrt()
    }
}
