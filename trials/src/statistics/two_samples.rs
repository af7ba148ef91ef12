//! Two independent samples: what the paper tests.

use serde::Serialize;

use super::{Unfit, check, mean, p_of_t, p_of_z, ranks, squares};

/// A two-sample t-test.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TwoSampleT {
    /// The statistic; negative if the first sample's mean is the smaller one.
    pub t: f64,
    /// Degrees of freedom.
    pub df: f64,
    /// Two-sided.
    pub p: f64,
}

/// A Mann–Whitney U test.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RankSum {
    /// Pairs in which the first sample's value is the larger one, ties counting half.
    pub u: f64,
    /// Its normal approximation.
    pub z: f64,
    /// Two-sided, from the normal approximation with the correction for ties.
    pub p: f64,
    /// Rank-biserial correlation `2U/(n₁n₂) − 1`: −1 if every value of the first sample is the smaller one.
    pub rank_biserial: f64,
}

/// Mean, sum of squared deviations, and count.
struct Moments {
    mean: f64,
    squares: f64,
    n: f64,
}

impl Moments {
    fn of(samples: &[f64]) -> Result<Self, Unfit> {
        check(samples, 2)?;
        let centre = mean(samples).ok_or(Unfit::TooFew { found: 0, needed: 2 })?;
        Ok(Self {
            mean: centre,
            squares: squares(samples, centre),
            n: samples.len() as f64,
        })
    }

    fn variance(&self) -> f64 {
        self.squares / (self.n - 1.0)
    }

    fn pooled(&self, other: &Self) -> f64 {
        (self.squares + other.squares) / (self.n + other.n - 2.0)
    }
}

/// Student's t-test of two independent samples with one pooled variance.
///
/// # Errors
/// With fewer than two values in either sample, with a value that is not finite, or without any spread.
pub fn student_t(first: &[f64], second: &[f64]) -> Result<TwoSampleT, Unfit> {
    let (a, b) = (Moments::of(first)?, Moments::of(second)?);
    let error = (a.pooled(&b) * (1.0 / a.n + 1.0 / b.n)).sqrt();
    finished((a.mean - b.mean) / spread(error, &a, &b)?, a.n + b.n - 2.0)
}

/// Welch's t-test of two independent samples with a variance each, and Satterthwaite's degrees of freedom.
///
/// # Errors
/// As [`student_t`].
pub fn welch_t(first: &[f64], second: &[f64]) -> Result<TwoSampleT, Unfit> {
    let (a, b) = (Moments::of(first)?, Moments::of(second)?);
    let (u, v) = (a.variance() / a.n, b.variance() / b.n);
    let df = (u + v) * (u + v) / (u * u / (a.n - 1.0) + v * v / (b.n - 1.0));
    finished((a.mean - b.mean) / spread((u + v).sqrt(), &a, &b)?, df)
}

/// A spread that rounding alone could have made is none.
fn spread(error: f64, a: &Moments, b: &Moments) -> Result<f64, Unfit> {
    if !error.is_finite() {
        Err(Unfit::NotFinite)
    } else if error <= a.mean.abs().max(b.mean.abs()) * 1e-13 {
        Err(Unfit::NoSpread)
    } else {
        Ok(error)
    }
}

/// Numbers near the ends of what a double holds overflow on the way; they are no measurements.
fn finished(t: f64, df: f64) -> Result<TwoSampleT, Unfit> {
    if t.is_finite() && df.is_finite() {
        Ok(TwoSampleT {
            t,
            df,
            p: p_of_t(t, df),
        })
    } else {
        Err(Unfit::NotFinite)
    }
}

/// Cohen's d of two independent samples: the difference of the means over the pooled standard deviation.
///
/// # Errors
/// As [`student_t`].
pub fn cohen_d(first: &[f64], second: &[f64]) -> Result<f64, Unfit> {
    let (a, b) = (Moments::of(first)?, Moments::of(second)?);
    Ok((a.mean - b.mean) / spread(a.pooled(&b).sqrt(), &a, &b)?)
}

/// The Mann–Whitney U test, by the normal approximation with ties; `continuity` moves U half a unit towards its mean.
///
/// # Errors
/// As [`student_t`], though one value in each sample would do to compute it.
pub fn mann_whitney(first: &[f64], second: &[f64], continuity: bool) -> Result<RankSum, Unfit> {
    check(first, 2)?;
    check(second, 2)?;
    let all: Vec<f64> = first.iter().chain(second).copied().collect();
    let (ranks, ties) = ranks(&all);
    let (n, m) = (first.len() as f64, second.len() as f64);
    let u = ranks[..first.len()].iter().sum::<f64>() - n * (n + 1.0) / 2.0;
    let z = z_of_u(u, n, m, ties, continuity).ok_or(Unfit::NoSpread)?;
    Ok(RankSum {
        u,
        z,
        p: p_of_z(z),
        rank_biserial: 2.0 * u / (n * m) - 1.0,
    })
}

/// The standard normal z of a U from samples of `n` and `m` values; `ties` is `Σ (t³ − t)` over groups of ties.
/// `None` if all values are tied.
#[must_use]
pub fn z_of_u(u: f64, n: f64, m: f64, ties: f64, continuity: bool) -> Option<f64> {
    let all = n + m;
    let variance = n * m / 12.0 * ((all + 1.0) - ties / (all * (all - 1.0)));
    let away = u - n * m / 2.0;
    let away = if continuity {
        (away.abs() - 0.5).max(0.0).copysign(away)
    } else {
        away
    };
    (variance > 0.0).then(|| away / variance.sqrt())
}
