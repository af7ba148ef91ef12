//! Quantiles of Student's t distribution, for any real number of degrees of freedom.

use statrs::distribution::{Continuous, ContinuousCDF, StudentsT};

/// Newton's steps before giving up: a normal tail of 1e-16 takes forty, and below one degree of freedom each step
/// multiplies the quantile by more than two.
const MAX_STEPS: u32 = 400;

/// The `p`-quantile of Student's t with `degrees` of freedom: `P(T ≤ t) = p`. None when `p` is outside (0, 1),
/// `degrees` is not positive and finite, or the quantile is too large for a double.
///
/// Newton's method on the *lower tail*, which loses no digits near 1. There the distribution function is convex, so
/// that the steps from the median come down on the quantile from one side and cannot miss it. (The library's own
/// quantile need not end.) Good to 1e-11 relative; what is left is the library's incomplete beta function. Used in
/// training only: the model stores the result.
#[must_use]
pub fn student_t_quantile(degrees: f64, p: f64) -> Option<f64> {
    if !(p > 0.0 && p < 1.0 && degrees > 0.0 && degrees.is_finite()) {
        return None;
    }
    let distribution = StudentsT::new(0.0, 1.0, degrees).ok()?;
    let tail = p.min(1.0 - p);
    let mut t = 0.0_f64;
    for _ in 0..MAX_STEPS {
        let step = (distribution.cdf(t) - tail) / distribution.pdf(t);
        if !step.is_finite() {
            return None;
        }
        t -= step;
        if step <= 4.0 * f64::EPSILON * t.abs() {
            return Some(if p < 0.5 { t } else { -t });
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::student_t_quantile;

    #[test]
    fn known_quantiles_come_out() {
        let t = student_t_quantile(1.0, 0.75).expect("legal");
        assert!((t - 1.0).abs() < 1e-12, "Cauchy's upper quartile is 1, not {t}");
        let t = student_t_quantile(2.5, 0.05).expect("legal");
        assert!((t + 2.558_218_614_135_914_6).abs() < 1e-11);
    }

    #[test]
    fn senseless_arguments_give_nothing() {
        for (degrees, p) in [
            (0.0, 0.9),
            (f64::NAN, 0.9),
            (3.0, 1.0),
            (3.0, 0.0),
            (f64::INFINITY, 0.9),
        ] {
            assert_eq!(student_t_quantile(degrees, p), None);
        }
    }
}
