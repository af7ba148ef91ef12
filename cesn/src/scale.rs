//! One common scale for all dimensions of a context.
//!
//! The mean of the demonstrations' contexts is subtracted, and *one* factor divides every dimension: half the
//! largest range. Dividing each dimension by its own range looks tidier and is a trap: a dimension that hardly
//! varied is blown up, and 3 mm of noise on a checkpoint became metres of error.

/// Subtract a mean, divide by one number.
#[derive(Clone, Debug, PartialEq, bincode::Encode, bincode::Decode)]
pub struct Scale {
    /// What is subtracted, dimension by dimension.
    pub mean: Vec<f64>,
    /// What every dimension is divided by, above 0.
    pub half_range: f64,
}

impl Scale {
    /// From rows of equal length; none when nothing varies.
    pub(crate) fn of<'a>(rows: impl Iterator<Item = &'a [f64]> + Clone) -> Option<Self> {
        let dimensions = rows.clone().next()?.len();
        let count = rows.clone().count() as f64;
        let column = |d: usize| rows.clone().map(move |row| row[d]);
        let mean = (0..dimensions).map(|d| column(d).sum::<f64>() / count).collect();
        let range = |d: usize| column(d).fold(f64::NEG_INFINITY, f64::max) - column(d).fold(f64::INFINITY, f64::min);
        let half_range = 0.5 * (0..dimensions).map(range).fold(0.0, f64::max);
        (half_range > 0.0 && half_range.is_finite()).then_some(Self { mean, half_range })
    }

    /// `(value − mean) / half-range`, dimension by dimension.
    pub(crate) fn apply(&self, values: &[f64], normalised: &mut [f64]) {
        for ((normalised, value), mean) in normalised.iter_mut().zip(values).zip(&self.mean) {
            *normalised = (value - mean) / self.half_range;
        }
    }
}

/// The two points at the mean ± `reach` half-ranges of `rows` along their first principal axis.
///
/// The axis is the eigenvector of the largest eigenvalue of the covariance, found by squaring the matrix; the
/// half-range is half the spread of the rows' projections onto it.
pub(crate) fn ends_of_principal_axis(rows: &[&[f64]], mean: &[f64], reach: f64) -> [Vec<f64>; 2] {
    let axis = principal_axis(rows, mean);
    let project = |row: &&[f64]| {
        row.iter()
            .zip(mean)
            .zip(&axis)
            .map(|((x, m), a)| (x - m) * a)
            .sum::<f64>()
    };
    let largest = rows.iter().map(project).fold(f64::NEG_INFINITY, f64::max);
    let smallest = rows.iter().map(project).fold(f64::INFINITY, f64::min);
    let half_range = 0.5 * (largest - smallest);
    let at = |factor: f64| {
        mean.iter()
            .zip(&axis)
            .map(|(m, a)| m + factor * half_range * a)
            .collect()
    };
    [at(-reach), at(reach)]
}

fn principal_axis(rows: &[&[f64]], mean: &[f64]) -> Vec<f64> {
    let d = mean.len();
    let entry = |i: usize, j: usize| {
        rows.iter()
            .map(|row| (row[i] - mean[i]) * (row[j] - mean[j]))
            .sum::<f64>()
    };
    let mut power: Vec<f64> = (0..d * d).map(|k| entry(k / d, k % d)).collect();
    for _ in 0..30 {
        let largest = power.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        if largest <= 0.0 {
            break;
        }
        power.iter_mut().for_each(|x| *x /= largest);
        let square = |k: usize| (0..d).map(|j| power[k / d * d + j] * power[j * d + k % d]).sum();
        power = (0..d * d).map(square).collect();
    }
    let longest = (0..d).fold(0, |best, i| {
        if power[i * d + i] > power[best * d + best] {
            i
        } else {
            best
        }
    });
    let axis = &power[longest * d..(longest + 1) * d];
    let norm = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    let unit = |x: &f64| if norm > 0.0 { x / norm } else { 0.0 };
    axis.iter().map(unit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_widest_dimension_sets_the_scale_of_all() {
        let rows: [&[f64]; 3] = [&[0.29, 0.08], &[0.30, 0.11], &[0.31, 0.14]];
        let scale = Scale::of(rows.into_iter()).expect("it varies");
        assert!((scale.half_range - 0.03).abs() < 1e-15);
        let mut normalised = [0.0; 2];
        scale.apply(&[0.303, 0.14], &mut normalised);
        assert!((normalised[0] - 0.1).abs() < 1e-12 && (normalised[1] - 1.0).abs() < 1e-12);
        assert_eq!(Scale::of([&[1.0][..], &[1.0][..]].into_iter()), None);
    }

    #[test]
    fn the_principal_axis_follows_a_slanted_line() {
        let rows: [&[f64]; 3] = [&[0.0, 0.0], &[3.0, 4.0], &[6.0, 8.0]];
        let [low, high] = ends_of_principal_axis(&rows, &[3.0, 4.0], 2.0);
        let expected = [[-3.0, -4.0], [9.0, 12.0]];
        let close = |found: &[f64], expected: &[f64]| found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9);
        let matches = close(&low, &expected[0]) && close(&high, &expected[1]);
        assert!(matches || close(&low, &expected[1]) && close(&high, &expected[0]));
    }
}
