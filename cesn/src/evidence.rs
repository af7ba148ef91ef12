//! How much ridge the data ask for: the marginal likelihood of λ, from one tridiagonal form.
//!
//! With `ZᵀZ = V diag(g) Vᵀ`, `b = Vᵀ Zᵀ y` and `q = yᵀy − Σ b² / (g + λ)`, the log evidence of one output is
//! `−(n/2)(1 + ln 2π) − (n/2) ln(q/n) − ½ Σ ln(1 + g/λ)`; outputs add up. It needs `Σ ln(g + λ)`, a determinant,
//! and `bᵀ (G + λ)⁻¹ b`, a quadratic form, both of which an orthogonal tridiagonal form `ZᵀZ = Q T Qᵀ` gives in
//! `O(p)` for each λ. So the eigenvalues are never found: 4/3 p³ operations once, against 9 p³ or so.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::tridiag::{tridiag_in_place, tridiag_in_place_scratch};
use faer::linalg::householder as reflections;
use faer::linalg::qr::no_pivoting::factor::recommended_block_size;
use faer::{Conj, Mat, Par};

use crate::settings::Bias;

/// The range in which λ is sought. Below it a Cholesky factor of real states loses all its digits.
pub const LAMBDA_RANGE: (f64, f64) = (1e-8, 1.0);
/// Grid points for each factor of ten, before the best one is refined.
const PER_DECADE: u32 = 4;
/// Golden-section steps: they shrink half a decade to about a thousandth of one.
const REFINEMENTS: u32 = 13;

/// The tridiagonal form of the Gram matrix with everything the evidence needs.
#[derive(Clone, Debug)]
pub struct Evidence {
    n: f64,
    diagonal: Vec<f64>,
    beside: Vec<f64>,
    /// `Qᵀ Zᵀ y`, for each output.
    moments: Vec<Vec<f64>>,
    /// `yᵀ y`, for each output.
    energies: Vec<f64>,
}

impl Evidence {
    /// From the lower half of `ZᵀZ`, from `ZᵀY` (`p × Ny`), from `yᵀy` of each output, and `n = Σ weights`.
    ///
    /// A free bias has a flat prior: it is eliminated first, which costs one of the `n`.
    pub(crate) fn new(gram: &Mat<f64>, moments: &Mat<f64>, energies: &[f64], n: f64, bias: Bias) -> Self {
        let (mut gram, mut moments, mut energies, mut n) = (gram.clone(), moments.clone(), energies.to_vec(), n);
        if bias == Bias::Free {
            (gram, moments) = eliminate_bias(&gram, &moments, &mut energies);
            n -= 1.0;
        }
        let rotated = tridiagonalise(&mut gram, &mut moments);
        let p = gram.nrows();
        Self {
            n,
            diagonal: (0..p).map(|i| gram[(i, i)]).collect(),
            beside: (1..p).map(|i| gram[(i, i - 1)]).collect(),
            moments: rotated,
            energies,
        }
    }

    /// The log evidence of each output at `lambda`; negative infinity where rounding has eaten the matrix.
    #[must_use]
    pub fn at(&self, lambda: f64) -> Vec<f64> {
        let Some(pivots) = self.pivots(lambda) else {
            return vec![f64::NEG_INFINITY; self.energies.len()];
        };
        let p = self.diagonal.len() as f64;
        let determinant = pivots.iter().map(|d| libm::log(*d)).sum::<f64>() - p * libm::log(lambda);
        let constant = -0.5 * self.n * (1.0 + libm::log(std::f64::consts::TAU));
        let outputs = self.moments.iter().zip(&self.energies);
        outputs
            .map(|(moments, energy)| {
                // An output that is zero throughout says nothing about λ; the floor keeps its logarithm finite.
                let floor = (energy * f64::EPSILON * f64::EPSILON).max(f64::MIN_POSITIVE);
                let q = (energy - self.quadratic(moments, &pivots)).max(floor);
                constant - 0.5 * self.n * libm::log(q / self.n) - 0.5 * determinant
            })
            .collect()
    }

    /// The λ with the largest sum over outputs, within [`LAMBDA_RANGE`]: a grid, then a golden section.
    #[must_use]
    pub fn best(&self) -> f64 {
        let total = |exponent: f64| self.at(libm::exp10(exponent)).iter().sum::<f64>();
        let (low, high) = (libm::log10(LAMBDA_RANGE.0), libm::log10(LAMBDA_RANGE.1));
        let spacing = 1.0 / f64::from(PER_DECADE);
        let mut best = (low, total(low));
        let mut exponent = low + spacing;
        while exponent < high + 0.5 * spacing {
            let value = total(exponent);
            if value > best.1 {
                best = (exponent, value);
            }
            exponent += spacing;
        }
        libm::exp10(golden_section(
            total,
            (best.0 - spacing).max(low),
            (best.0 + spacing).min(high),
        ))
    }

    /// The pivots of `T + λ = M diag(d) Mᵀ`, or none when one is not positive.
    fn pivots(&self, lambda: f64) -> Option<Vec<f64>> {
        let mut pivots = Vec::with_capacity(self.diagonal.len());
        let mut pivot = self.diagonal.first()? + lambda;
        pivots.push(pivot);
        for (diagonal, beside) in self.diagonal[1..].iter().zip(&self.beside) {
            pivot = diagonal + lambda - beside * beside / pivot;
            pivots.push(pivot);
        }
        pivots.iter().all(|d| *d > 0.0).then_some(pivots)
    }

    /// `bᵀ (T + λ)⁻¹ b`.
    fn quadratic(&self, moments: &[f64], pivots: &[f64]) -> f64 {
        let mut forward = moments[0];
        let mut total = forward * forward / pivots[0];
        for i in 1..pivots.len() {
            forward = moments[i] - self.beside[i - 1] / pivots[i - 1] * forward;
            total += forward * forward / pivots[i];
        }
        total
    }
}

/// Maximises `f` on an interval that holds one maximum.
fn golden_section(f: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let (mut a, mut b) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
    let (mut f_a, mut f_b) = (f(a), f(b));
    for _ in 0..REFINEMENTS {
        if f_a >= f_b {
            (high, b, f_b) = (b, a, f_a);
            a = high - GOLDEN * (high - low);
            f_a = f(a);
        } else {
            (low, a, f_a) = (a, b, f_b);
            b = low + GOLDEN * (high - low);
            f_b = f(b);
        }
    }
    0.5 * (low + high)
}

/// Takes the first column out of the regression: the Schur complements of the Gram matrix, moments and energies.
fn eliminate_bias(gram: &Mat<f64>, moments: &Mat<f64>, energies: &mut [f64]) -> (Mat<f64>, Mat<f64>) {
    let (p, weight) = (gram.nrows(), gram[(0, 0)]);
    let share = |i: usize| gram[(i + 1, 0)] / weight;
    let rest = |i: usize, j: usize| {
        if i < j {
            0.0
        } else {
            gram[(i + 1, j + 1)] - share(i) * gram[(j + 1, 0)]
        }
    };
    for (k, energy) in energies.iter_mut().enumerate() {
        *energy -= moments[(0, k)] * moments[(0, k)] / weight;
    }
    let rest_moments = |i: usize, k: usize| moments[(i + 1, k)] - share(i) * moments[(0, k)];
    (
        Mat::from_fn(p - 1, p - 1, rest),
        Mat::from_fn(p - 1, moments.ncols(), rest_moments),
    )
}

/// `gram ← T` (its diagonal and what lies just below), and `Qᵀ moments`, column by column.
fn tridiagonalise(gram: &mut Mat<f64>, moments: &mut Mat<f64>) -> Vec<Vec<f64>> {
    let (p, outputs) = (gram.nrows(), moments.ncols());
    if p > 1 {
        let block = recommended_block_size::<f64>(p, p);
        let mut factors = Mat::zeros(block, p - 1);
        let scratch = tridiag_in_place_scratch::<f64>(p, Par::Seq, Default::default());
        let apply = reflections::apply_block_householder_sequence_transpose_on_the_left_in_place_scratch::<f64>;
        let mut memory = MemBuffer::new(scratch.or(apply(p - 1, block, outputs)));
        let stack = MemStack::new(&mut memory);
        tridiag_in_place(gram.as_mut(), factors.as_mut(), Par::Seq, stack, Default::default());
        reflections::apply_block_householder_sequence_transpose_on_the_left_in_place_with_conj(
            gram.as_ref().submatrix(1, 0, p - 1, p - 1),
            factors.as_ref(),
            Conj::No,
            moments.as_mut().subrows_mut(1, p - 1),
            Par::Seq,
            stack,
        );
    }
    moments
        .col_iter()
        .map(|column| column.iter().copied().collect())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{generator, signed_unit};

    #[test]
    fn it_agrees_with_the_eigenvalue_formula() {
        let mut rng = generator(4, "evidence");
        let z = Mat::from_fn(30, 12, |_, _| signed_unit(&mut rng));
        let y = Mat::from_fn(30, 1, |i, _| z[(i, 3)] - 0.5 * z[(i, 0)] + 0.1 * signed_unit(&mut rng));
        let (gram, moments) = (z.transpose() * &z, z.transpose() * &y);
        let energy = (y.transpose() * &y)[(0, 0)];
        let evidence = Evidence::new(&gram, &moments, &[energy], 30.0, Bias::Penalised);
        let eigen = gram.self_adjoint_eigen(faer::Side::Lower).expect("symmetric");
        let b = eigen.U().transpose() * &moments;
        for lambda in [1e-6, 1e-3, 0.7] {
            let g = |i: usize| eigen.S()[i];
            let q = energy - (0..12).map(|i| b[(i, 0)] * b[(i, 0)] / (g(i) + lambda)).sum::<f64>();
            let determinant: f64 = (0..12).map(|i| libm::log1p(g(i) / lambda)).sum();
            let expected = -15.0 * (1.0 + libm::log(std::f64::consts::TAU) + libm::log(q / 30.0)) - 0.5 * determinant;
            assert!((evidence.at(lambda)[0] - expected).abs() < 1e-9 * expected.abs());
        }
        let best = evidence.best();
        let total = |lambda: f64| evidence.at(lambda)[0];
        assert!(
            total(best) >= total(best * 1.05) && total(best) >= total(best / 1.05),
            "{best} is no maximum"
        );
    }
}
