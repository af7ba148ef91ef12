//! How well each demonstration is predicted from the others, without training again.
//!
//! For the rows `D` of one demonstration and its copies, with residuals `r` and hat matrix `H`:
//! `e = (I − H_DD)⁻¹ r`, `h⁻ = diag[H_DD (I − H_DD)⁻¹]`, `s_lodo = √(mean e² / (1 + h⁻))`.
//! Rows weighted by `w` enter as `√w · z`, so `e` and `h⁻` come out times `√w` and `w`, and the mean is weighted.

use faer::linalg::matmul::matmul;
use faer::linalg::triangular_inverse::invert_lower_triangular;
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::{Accum, Mat, Par};

use crate::regression::{Factor, cholesky_in_place, own_products, product, squared_norm};
use crate::samples::Samples;
use crate::settings::Bias;

/// What is left when each demonstration in turn is predicted from the others.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// `e`, `n × Ny`, row by row: the target less the prediction of a model that never saw its demonstration.
    pub residuals: Vec<f64>,
    /// `h⁻` of each sample under that model.
    pub leverages: Vec<f64>,
    /// `s_lodo` of each output.
    pub s: Vec<f64>,
}

impl LeftOut {
    /// From the weighted residuals (`n × Ny`) and `L⁻¹ Zᵀ` (`p × n`); none when the others do not determine a model.
    pub(crate) fn new(
        samples: &Samples,
        residuals: &Mat<f64>,
        whitened: &Mat<f64>,
        lambda: f64,
        bias: Bias,
    ) -> Option<Self> {
        let (n, outputs) = (residuals.nrows(), residuals.ncols());
        let (mut errors, mut hats) = (Mat::zeros(n, outputs), vec![0.0; n]);
        for (demonstration, rows) in samples.demonstrations.iter().enumerate() {
            let whitened = whitened.as_ref().subcols(rows.start, rows.len());
            let own = residuals.as_ref().subrows(rows.start, rows.len()).to_owned();
            let (e, h) = closed_form(own_products(whitened), own)
                .or_else(|| trained_again(samples, demonstration, lambda, bias))?;
            errors.as_mut().subrows_mut(rows.start, rows.len()).copy_from(&e);
            hats[rows.clone()].copy_from_slice(&h);
        }
        Self::unweighted(&errors, &hats, &samples.weights)
    }

    fn unweighted(errors: &Mat<f64>, hats: &[f64], weights: &[f64]) -> Option<Self> {
        let leverages: Vec<f64> = hats.iter().zip(weights).map(|(h, w)| h / w).collect();
        let total: f64 = weights.iter().sum();
        let mean = |k: usize| {
            errors
                .col(k)
                .iter()
                .zip(&leverages)
                .map(|(e, h)| e * e / (1.0 + h))
                .sum::<f64>()
                / total
        };
        let s: Vec<f64> = (0..errors.ncols()).map(|k| mean(k).sqrt()).collect();
        let residual = |row: usize| (0..errors.ncols()).map(move |k| errors[(row, k)] / weights[row].sqrt());
        let residuals: Vec<f64> = (0..hats.len()).flat_map(residual).collect();
        let finite = s.iter().chain(&residuals).chain(&leverages).all(|x| x.is_finite());
        finite.then_some(Self {
            residuals,
            leverages,
            s,
        })
    }
}

/// `(I − H)⁻¹ r` and `diag (I − H)⁻¹ − 1`, from the lower half of `H`; none when `I − H` is numerically singular.
fn closed_form(hat: Mat<f64>, mut residuals: Mat<f64>) -> Option<(Mat<f64>, Vec<f64>)> {
    let m = hat.nrows();
    let mut rest = hat;
    for j in 0..m {
        for i in j..m {
            rest[(i, j)] = f64::from(u8::from(i == j)) - rest[(i, j)];
        }
    }
    // Pivots below this have no correct digit: H itself is known to about 1e-14.
    const SMALLEST_PIVOT: f64 = 1e-5;
    if !cholesky_in_place(&mut rest) || (0..m).any(|i| rest[(i, i)] < SMALLEST_PIVOT) {
        return None;
    }
    solve_lower_triangular_in_place(rest.as_ref(), residuals.as_mut(), Par::Seq);
    solve_upper_triangular_in_place(rest.transpose(), residuals.as_mut(), Par::Seq);
    let mut inverse = Mat::zeros(m, m);
    invert_lower_triangular(inverse.as_mut(), rest.as_ref(), Par::Seq);
    let gains = (0..m)
        .map(|i| squared_norm(&inverse.col_as_slice(i)[i..]) - 1.0)
        .collect();
    Some((residuals, gains))
}

/// The same two from a model trained without the demonstration: dearer, but safe where nothing else covers it.
fn trained_again(samples: &Samples, out: usize, lambda: f64, bias: Bias) -> Option<(Mat<f64>, Vec<f64>)> {
    let others = samples.without(out);
    let factor = Factor::new(&others, others.gram_matrix(), lambda, bias).ok()?;
    let (w, _) = factor.weights_and_residuals(&others, &product(&others.design, &others.targets));
    let rows = samples.demonstrations.get(out)?;
    let design = samples.design.as_ref().subcols(rows.start, rows.len()).to_owned();
    let mut errors = samples.targets.as_ref().subrows(rows.start, rows.len()).to_owned();
    matmul(&mut errors, Accum::Add, design.transpose(), &w, -1.0, Par::Seq);
    let whitened = factor.whiten(&design);
    Some((
        errors,
        (0..rows.len())
            .map(|row| squared_norm(whitened.col_as_slice(row)))
            .collect(),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{generator, signed_unit};

    #[test]
    fn the_closed_form_agrees_with_training_again_copies_and_all() {
        let mut rng = generator(8, "leave out");
        let (n, p) = (36, 9);
        let weights: Vec<f64> = (0..n).map(|i| if i % 2 == 0 { 0.5 } else { 0.25 }).collect();
        let samples = Samples {
            design: Mat::from_fn(p, n, |i, j| {
                weights[j].sqrt() * if i == 0 { 1.0 } else { signed_unit(&mut rng) }
            }),
            targets: Mat::from_fn(n, 2, |_, _| signed_unit(&mut rng)),
            weights,
            demonstrations: vec![0..12, 12..20, 20..36],
        };
        for bias in [Bias::Penalised, Bias::Free] {
            let factor = Factor::new(&samples, samples.gram_matrix(), 0.01, bias).expect("positive");
            let (_, residuals) = factor.weights_and_residuals(&samples, &product(&samples.design, &samples.targets));
            let whitened = factor.whiten(&samples.design);
            for (out, rows) in samples.demonstrations.iter().enumerate() {
                let hat = own_products(whitened.as_ref().subcols(rows.start, rows.len()));
                let own = residuals.as_ref().subrows(rows.start, rows.len()).to_owned();
                let (e, h) = closed_form(hat, own).expect("regular");
                let (expected_e, expected_h) = trained_again(&samples, out, 0.01, bias).expect("regular");
                assert!((&e - &expected_e).norm_max() < 1e-10);
                assert!(h.iter().zip(&expected_h).all(|(a, b)| (a - b).abs() < 1e-9));
            }
        }
    }
}
