//! Quantiles of Student's t distribution, for any real number of degrees of freedom.

use statrs::distribution::{Continuous, ContinuousCDF, StudentsT};

/// The `p`-quantile of Student's t with `degrees` of freedom: `P(T ≤ t) = p`. None when `p` is outside (0, 1) or
/// `degrees` is not positive and finite.
///
/// The library's quantile starts it; Newton's steps on the *tail* probability, which loses no digits near 1,
/// bring it to 1e-11 relative; what is left is the library's incomplete beta function. Used in training only: the
/// model stores the result.
#[must_use]
pub fn student_t_quantile(degrees: f64, p: f64) -> Option<f64> {
    if !(p > 0.0 && p < 1.0 && degrees > 0.0 && degrees.is_finite()) {
        return None;
    }
    let distribution = StudentsT::new(0.0, 1.0, degrees).ok()?;
    let tail = p.min(1.0 - p);
    let mut t = -distribution.inverse_cdf(tail).abs();
    for _ in 0..4 {
        let slope = distribution.pdf(t);
        let step = (distribution.cdf(t) - tail) / slope;
        if !step.is_finite() || step.abs() > 0.5 * t.abs() + 1.0 {
            break;
        }
        t -= step;
    }
    let t = if p < 0.5 { t } else { -t };
    t.is_finite().then_some(t)
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
