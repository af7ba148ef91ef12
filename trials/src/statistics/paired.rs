//! Pairs: two trials that share all but the condition, and the difference between them.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::Serialize;

use super::{Unfit, check, deviation, mean, p_of_t, p_of_z, ranks};

/// Up to this many differences, all `2ⁿ` signs are tried.
const EXACT_SIGNS: usize = 20;
/// Beyond it, this many are drawn.
const DRAWS: u32 = 20_000;
/// Up to this many differences, the signed ranks' distribution is computed exactly.
const EXACT_RANKS: usize = 100;

/// Effects of a paired comparison.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Differences {
    /// The mean difference, in the samples' unit.
    pub mean: f64,
    /// Cohen's d_z: the mean difference over the standard deviation of the differences.
    pub d_z: f64,
    /// Matched-pairs rank-biserial correlation `(W₊ − W₋)/(W₊ + W₋)`; zero differences do not count.
    pub rank_biserial: f64,
}

impl Differences {
    /// The effects of these differences.
    ///
    /// # Errors
    /// With fewer than two, with one that is not finite, or if all are the same.
    pub fn of(differences: &[f64]) -> Result<Self, Unfit> {
        check(differences, 2)?;
        let (centre, spread) = spread(differences)?;
        Ok(Self {
            mean: centre,
            d_z: centre / spread,
            rank_biserial: rank_biserial(differences),
        })
    }
}

/// The matched-pairs rank-biserial correlation; 0 if no difference differs from zero.
pub(super) fn rank_biserial(differences: &[f64]) -> f64 {
    let signed = SignedRanks::of(differences);
    let total = signed.plus + signed.minus;
    if total > 0.0 {
        (signed.plus - signed.minus) / total
    } else {
        0.0
    }
}

/// Mean and standard deviation, where there is one that rounding did not make.
fn spread(differences: &[f64]) -> Result<(f64, f64), Unfit> {
    let too_few = Unfit::TooFew {
        found: differences.len(),
        needed: 2,
    };
    let centre = mean(differences).ok_or(too_few)?;
    let spread = deviation(differences).ok_or(too_few)?;
    if !spread.is_finite() || !centre.is_finite() {
        return Err(Unfit::NotFinite);
    }
    if spread <= centre.abs() * 1e-13 {
        return Err(Unfit::NoSpread);
    }
    Ok((centre, spread))
}

/// A paired t-test.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PairedT {
    /// The statistic; its sign is that of the mean difference.
    pub t: f64,
    /// Degrees of freedom.
    pub df: f64,
    /// Two-sided.
    pub p: f64,
}

/// The t-test of paired differences against zero.
///
/// # Errors
/// With fewer than two differences, with one that is not finite, or if all are the same.
pub fn paired_t(differences: &[f64]) -> Result<PairedT, Unfit> {
    check(differences, 2)?;
    let (centre, spread) = spread(differences)?;
    let n = differences.len() as f64;
    let t = centre / (spread / n.sqrt());
    Ok(PairedT {
        t,
        df: n - 1.0,
        p: p_of_t(t, n - 1.0),
    })
}

/// A Wilcoxon signed-rank test.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Signed {
    /// The smaller one of the two sums of ranks.
    pub w: f64,
    /// Two-sided.
    pub p: f64,
    /// Differences that are not zero.
    pub n: usize,
    /// Whether `p` is exact; otherwise it is the normal approximation with the correction for ties.
    pub exact: bool,
}

/// The Wilcoxon signed-rank test of paired differences. Differences of zero are dropped; equal sizes share their mean
/// rank, and the distribution is that of these very ranks: exact with ties too, up to a hundred differences.
///
/// # Errors
/// With fewer than two differences, with one that is not finite, or if all are zero.
pub fn wilcoxon(differences: &[f64]) -> Result<Signed, Unfit> {
    check(differences, 2)?;
    let signed = SignedRanks::of(differences);
    let n = signed.ranks.len();
    if n == 0 {
        return Err(Unfit::NoSpread);
    }
    let exact = n <= EXACT_RANKS;
    Ok(Signed {
        w: signed.plus.min(signed.minus),
        p: if exact { signed.exact_p() } else { signed.normal_p() },
        n,
        exact,
    })
}

/// The ranks of the sizes of the differences that are not zero.
struct SignedRanks {
    ranks: Vec<f64>,
    plus: f64,
    minus: f64,
    ties: f64,
}

impl SignedRanks {
    fn of(differences: &[f64]) -> Self {
        let kept: Vec<f64> = differences.iter().copied().filter(|value| *value != 0.0).collect();
        let sizes: Vec<f64> = kept.iter().map(|value| value.abs()).collect();
        let (ranks, ties) = ranks(&sizes);
        let sum = |positive: bool| -> f64 {
            let signed = ranks.iter().zip(&kept);
            signed
                .filter(|(_, value)| (**value > 0.0) == positive)
                .map(|(rank, _)| rank)
                .sum()
        };
        let (plus, minus) = (sum(true), sum(false));
        Self {
            ranks,
            plus,
            minus,
            ties,
        }
    }

    /// Every sign is as likely as its opposite: the sums' distribution by adding one rank after the other. Twice a
    /// mean rank is a whole number.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "twice a rank is a whole number up to twice the count of ranks"
    )]
    fn exact_p(&self) -> f64 {
        let doubled: Vec<usize> = self.ranks.iter().map(|rank| (2.0 * rank).round() as usize).collect();
        let total: usize = doubled.iter().sum();
        let mut chance = vec![0.0; total + 1];
        chance[0] = 1.0;
        let mut reach = 0;
        for rank in doubled {
            reach += rank;
            for sum in (0..=reach).rev() {
                let with = if sum >= rank { chance[sum - rank] } else { 0.0 };
                chance[sum] = 0.5 * (chance[sum] + with);
            }
        }
        let smaller = (2.0 * self.plus.min(self.minus)).round() as usize;
        let tail: f64 = chance[..=smaller.min(total)].iter().sum();
        (2.0 * tail).min(1.0)
    }

    fn normal_p(&self) -> f64 {
        let n = self.ranks.len() as f64;
        let expected = n * (n + 1.0) / 4.0;
        let variance = n * (n + 1.0) * (2.0 * n + 1.0) / 24.0 - self.ties / 48.0;
        p_of_z((self.plus - expected) / variance.sqrt())
    }
}

/// A permutation test of paired differences.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Permutation {
    /// Two-sided.
    pub p: f64,
    /// Whether all signs were tried; otherwise 20 000 were drawn, and what was observed counts as one more.
    pub exact: bool,
}

/// The sign-flip permutation test of the mean of paired differences: the share of all choices of signs under which the
/// mean is at least as far from zero as it is. Exact up to twenty differences; then drawn from `seed`.
///
/// # Errors
/// With fewer than two differences, with one that is not finite, or if all are zero.
pub fn permutation(differences: &[f64], seed: u64) -> Result<Permutation, Unfit> {
    check(differences, 2)?;
    let size: f64 = differences.iter().map(|value| value.abs()).sum();
    if size == 0.0 {
        return Err(Unfit::NoSpread);
    }
    // Sums in another order differ by rounding; what is equal counts.
    let bar = differences.iter().sum::<f64>().abs() - 1e-10 * size;
    let exact = differences.len() <= EXACT_SIGNS;
    let p = if exact {
        share_of_signs(differences, bar)
    } else {
        share_of_drawn_signs(differences, bar, seed)
    };
    Ok(Permutation { p, exact })
}

/// Goes through all signs, turning one at a time (a Gray code). The last sign stays: the opposite choice is as far.
fn share_of_signs(differences: &[f64], bar: f64) -> f64 {
    let mut flipped = differences.to_vec();
    let mut sum: f64 = flipped.iter().sum();
    let choices = 1_u32 << (differences.len() - 1);
    let mut as_far = u32::from(sum.abs() >= bar);
    for choice in 1..choices {
        let turned = &mut flipped[choice.trailing_zeros() as usize];
        sum -= 2.0 * *turned;
        *turned = -*turned;
        as_far += u32::from(sum.abs() >= bar);
    }
    f64::from(as_far) / f64::from(choices)
}

fn share_of_drawn_signs(differences: &[f64], bar: f64, seed: u64) -> f64 {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut as_far = 1_u32;
    for _ in 0..DRAWS {
        let mut sum = 0.0;
        for part in differences.chunks(64) {
            let signs = generator.next_u64();
            for (place, value) in part.iter().enumerate() {
                sum += if (signs >> place) & 1 == 1 { *value } else { -*value };
            }
        }
        as_far += u32::from(sum.abs() >= bar);
    }
    f64::from(as_far) / f64::from(DRAWS + 1)
}
