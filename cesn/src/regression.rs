//! Ridge regression with everything the intervals need: weights, degrees of freedom, leverages, residuals.
//!
//! ```text
//! A = ZᵀZ + λI       W_out = (A⁻¹ ZᵀY)ᵀ     A = L Lᵀ
//! edf = tr(Z A⁻¹ Zᵀ)     ν = n − edf     s_k = √(RSS_k / ν)     h = |L⁻¹ z|²
//! ```
//! `Z` holds `√w [1; x]` of each sample, `n = Σ w`. With λ = 0 these are the textbook formulas of ordinary least
//! squares, and `edf = p`. A free bias leaves λ out of the first diagonal element.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor as cholesky;
use faer::linalg::matmul::matmul;
use faer::linalg::qr::no_pivoting::factor as qr;
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::{Accum, Mat, MatRef, Par};

use crate::evidence::Evidence;
use crate::leave_out::LeftOut;
use crate::samples::Samples;
use crate::settings::{Bias, Ridge};

/// Below this λ the factor comes from `Z` by Householder reflections instead of from `ZᵀZ` by Cholesky.
///
/// Squaring the matrix loses everything there: on real states `cond(ZᵀZ)` is 1e20 while `cond(Z)` is 1e10.
const CHOLESKY_FROM: f64 = 1e-10;

/// Why the regression has no answer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// A sequence's rows do not fit the reservoir or the number of outputs, or its group is out of order.
    #[error("sequence {index} is empty, or its row lengths do not fit the reservoir and the outputs")]
    Sequence {
        /// Position in the list.
        index: usize,
    },
    /// A sequence holds a number that is not finite, or a weight that is not positive.
    #[error("sequence {index} holds a number that is not finite, or a weight that is not positive")]
    NotFinite {
        /// Position in the list.
        index: usize,
    },
    /// The washout leaves nothing.
    #[error("a washout of {washout} steps leaves no sample; shorten it")]
    NoSamples {
        /// Steps thrown away.
        washout: usize,
    },
    /// λ is negative, NaN or infinite.
    #[error("the ridge {lambda} is not a number from 0 up")]
    Lambda {
        /// What was asked for.
        lambda: f64,
    },
    /// Ordinary least squares with fewer samples than weights.
    #[error("ordinary least squares needs more than {columns} rows and has {rows}; choose a ridge")]
    TooFewRows {
        /// Samples.
        rows: usize,
        /// Weights for each output.
        columns: usize,
    },
    /// Ordinary least squares on states that are numerically dependent.
    #[error("the states are numerically dependent, so ordinary least squares has no answer; choose a ridge")]
    RankDeficient,
    /// Nothing is left to estimate the noise from.
    #[error("{effective_rows} rows less {edf} degrees of freedom leave none for the noise; choose a larger ridge")]
    NoDegreesOfFreedom {
        /// `n = Σ weights`.
        effective_rows: f64,
        /// `tr(Z A⁻¹ Zᵀ)`.
        edf: f64,
    },
}

/// A solved regression.
#[derive(Clone, Debug)]
pub struct Fit {
    /// λ, given or found.
    pub lambda: f64,
    /// `Ny × p`, row by row; column 0 is the bias.
    pub w_out: Vec<f64>,
    /// `n = Σ weights`.
    pub effective_rows: f64,
    /// Effective degrees of freedom, `tr(Z A⁻¹ Zᵀ)`.
    pub edf: f64,
    /// `ν = n − edf`.
    pub nu: f64,
    /// Weighted residual sum of squares of each output.
    pub rss: Vec<f64>,
    /// `s = √(RSS / ν)` of each output.
    pub s: Vec<f64>,
    /// `h = zᵀ A⁻¹ z` of each sample.
    pub leverages: Vec<f64>,
    /// Each demonstration predicted from the others, when that can be computed.
    pub left_out: Option<LeftOut>,
    /// `L`, lower triangular.
    pub(crate) factor: Factor,
}

impl Fit {
    /// Solves the regression, in about `n p² (1 + ½) + p³/3` products.
    ///
    /// # Errors
    /// When there is no unique answer, or no degree of freedom is left for the noise.
    pub fn new(samples: &Samples, ridge: Ridge, bias: Bias) -> Result<Self, FitError> {
        let gram = samples.gram_matrix();
        let moments = product(&samples.design, &samples.targets);
        let lambda = match ridge {
            Ridge::None => 0.0,
            Ridge::Fixed { lambda } => lambda,
            Ridge::Evidence => evidence_of(samples, &gram, &moments, bias).best(),
        };
        let factor = Factor::new(samples, gram, lambda, bias)?;
        let (w_out, residuals) = factor.weights_and_residuals(samples, &moments);
        let whitened = factor.whiten(&samples.design);
        let hat: Vec<f64> = (0..samples.rows())
            .map(|row| squared_norm(whitened.col_as_slice(row)))
            .collect();
        let (effective_rows, edf) = (samples.effective_rows(), hat.iter().sum::<f64>());
        let nu = effective_rows - edf;
        if nu.is_nan() || nu <= 1e-9 * effective_rows {
            return Err(FitError::NoDegreesOfFreedom { effective_rows, edf });
        }
        let rss: Vec<f64> = (0..residuals.ncols())
            .map(|k| squared_norm(residuals.col_as_slice(k)))
            .collect();
        Ok(Self {
            lambda,
            w_out: w_out
                .col_iter()
                .flat_map(|column| column.iter().copied().collect::<Vec<_>>())
                .collect(),
            effective_rows,
            edf,
            nu,
            s: rss.iter().map(|rss| (rss / nu).sqrt()).collect(),
            rss,
            leverages: hat.iter().zip(&samples.weights).map(|(h, w)| h / w).collect(),
            left_out: LeftOut::new(samples, &residuals, &whitened, lambda, bias),
            factor,
        })
    }
}

impl Fit {
    /// `h = zᵀ A⁻¹ z` of a state of `N` activations; none when it has another length.
    #[must_use]
    pub fn leverage(&self, activations: &[f64]) -> Option<f64> {
        let p = self.factor.lower.nrows();
        let z = |i: usize| if i == 0 { 1.0 } else { activations[i - 1] };
        let fits = activations.len() + 1 == p;
        fits.then(|| squared_norm(self.factor.whiten(&Mat::from_fn(p, 1, |i, _| z(i))).col_as_slice(0)))
    }
}

impl Samples {
    /// The evidence for λ in these samples.
    #[must_use]
    pub fn evidence(&self, bias: Bias) -> Evidence {
        evidence_of(self, &self.gram_matrix(), &product(&self.design, &self.targets), bias)
    }
}

fn evidence_of(samples: &Samples, gram: &Mat<f64>, moments: &Mat<f64>, bias: Bias) -> Evidence {
    let targets = &samples.targets;
    let energies: Vec<f64> = (0..targets.ncols())
        .map(|k| squared_norm(targets.col_as_slice(k)))
        .collect();
    Evidence::new(gram, moments, &energies, samples.effective_rows(), bias)
}

/// `L` with `L Lᵀ = ZᵀZ + λI`.
#[derive(Clone, Debug)]
pub(crate) struct Factor {
    pub(crate) lower: Mat<f64>,
    lambda: f64,
    bias: Bias,
}

impl Factor {
    /// From the Gram matrix by Cholesky, or, where λ is too small for that, from the samples themselves.
    pub(crate) fn new(samples: &Samples, gram: Mat<f64>, lambda: f64, bias: Bias) -> Result<Self, FitError> {
        if !lambda.is_finite() || lambda < 0.0 {
            return Err(FitError::Lambda { lambda });
        }
        let mut lower = gram;
        if lambda >= CHOLESKY_FROM {
            for i in first_penalised(bias)..lower.nrows() {
                lower[(i, i)] += lambda;
            }
            if cholesky_in_place(&mut lower) {
                return Ok(Self { lower, lambda, bias });
            }
        }
        Ok(Self {
            lower: reflect(samples, lambda, bias)?,
            lambda,
            bias,
        })
    }

    /// `L⁻¹ M`.
    pub(crate) fn whiten(&self, m: &Mat<f64>) -> Mat<f64> {
        let mut whitened = m.clone();
        solve_lower_triangular_in_place(self.lower.as_ref(), whitened.as_mut(), Par::Seq);
        whitened
    }

    /// `A⁻¹ M`.
    fn solve(&self, m: &Mat<f64>) -> Mat<f64> {
        let mut solved = self.whiten(m);
        solve_upper_triangular_in_place(self.lower.transpose(), solved.as_mut(), Par::Seq);
        solved
    }

    /// `W_outᵀ` (`p × Ny`) and the residuals (`n × Ny`), after one step of refinement on explicit residuals.
    ///
    /// The step turns the normal equations into something as accurate as an orthogonal solution, for the price of
    /// two passes over the samples.
    pub(crate) fn weights_and_residuals(&self, samples: &Samples, moments: &Mat<f64>) -> (Mat<f64>, Mat<f64>) {
        let mut w = self.solve(moments);
        let residuals = residuals(samples, &w);
        let mut gradient = product(&samples.design, &residuals);
        for k in 0..w.ncols() {
            for i in first_penalised(self.bias)..w.nrows() {
                gradient[(i, k)] -= self.lambda * w[(i, k)];
            }
        }
        w += self.solve(&gradient);
        let refined = self::residuals(samples, &w);
        (w, refined)
    }
}

/// The first row of the diagonal that λ is added to.
pub(crate) fn first_penalised(bias: Bias) -> usize {
    match bias {
        Bias::Penalised => 0,
        Bias::Free => 1,
    }
}

/// Overwrites the lower half of `a` with its Cholesky factor and clears the rest; false when `a` is not positive.
pub(crate) fn cholesky_in_place(a: &mut Mat<f64>) -> bool {
    let n = a.nrows();
    let scratch = cholesky::cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default());
    let mut memory = MemBuffer::new(scratch);
    let stack = MemStack::new(&mut memory);
    cholesky::cholesky_in_place(a.as_mut(), Default::default(), Par::Seq, stack, Default::default()).is_ok()
        && (0..n).all(|i| a[(i, i)].is_finite() && a[(i, i)] > 0.0)
}

/// `L = Rᵀ` of the QR factorisation of `[Z; √λ I]`, rows turned so that the diagonal is positive.
fn reflect(samples: &Samples, lambda: f64, bias: Bias) -> Result<Mat<f64>, FitError> {
    let (p, n) = (samples.columns(), samples.rows());
    if lambda <= 0.0 && n <= p {
        return Err(FitError::TooFewRows { rows: n, columns: p });
    }
    let (root, free) = (lambda.sqrt(), first_penalised(bias));
    let mut tall = Mat::from_fn(n + p, p, |i, j| match i {
        i if i < n => samples.design[(j, i)],
        i if i - n == j && j >= free => root,
        _ => 0.0,
    });
    let block = qr::recommended_block_size::<f64>(n + p, p);
    let mut factors = Mat::zeros(block, p);
    let mut memory = MemBuffer::new(qr::qr_in_place_scratch::<f64>(
        n + p,
        p,
        block,
        Par::Seq,
        Default::default(),
    ));
    qr::qr_in_place(
        tall.as_mut(),
        factors.as_mut(),
        Par::Seq,
        MemStack::new(&mut memory),
        Default::default(),
    );
    let largest = (0..p).map(|i| tall[(i, i)].abs()).fold(0.0, f64::max);
    let smallest = (0..p).map(|i| tall[(i, i)].abs()).fold(f64::INFINITY, f64::min);
    if smallest.is_nan() || smallest <= largest * f64::EPSILON * p as f64 {
        return Err(FitError::RankDeficient);
    }
    Ok(Mat::from_fn(p, p, |i, j| {
        if i < j {
            0.0
        } else {
            tall[(j, i)] * tall[(j, j)].signum()
        }
    }))
}

fn residuals(samples: &Samples, w: &Mat<f64>) -> Mat<f64> {
    let mut residuals = samples.targets.clone();
    matmul(
        &mut residuals,
        Accum::Add,
        samples.design.transpose(),
        w,
        -1.0,
        Par::Seq,
    );
    residuals
}

pub(crate) fn product(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    let mut product = Mat::zeros(a.nrows(), b.ncols());
    matmul(&mut product, Accum::Replace, a.as_ref(), b.as_ref(), 1.0, Par::Seq);
    product
}

/// `AᵀA` of some columns, its lower half.
pub(crate) fn own_products(a: MatRef<'_, f64>) -> Mat<f64> {
    use faer::linalg::matmul::triangular::{self, BlockStructure};
    let mut products = Mat::zeros(a.ncols(), a.ncols());
    let (whole, lower) = (BlockStructure::Rectangular, BlockStructure::TriangularLower);
    triangular::matmul(
        &mut products,
        lower,
        Accum::Replace,
        a.transpose(),
        whole,
        a,
        whole,
        1.0,
        Par::Seq,
    );
    products
}

/// `|v|²` in eight running sums.
pub(crate) fn squared_norm(v: &[f64]) -> f64 {
    let (lanes, rest) = v.as_chunks::<8>();
    let mut totals = [0.0; 8];
    for lane in lanes {
        for (total, x) in totals.iter_mut().zip(lane) {
            *total += x * x;
        }
    }
    totals.iter().sum::<f64>() + rest.iter().map(|x| x * x).sum::<f64>()
}
