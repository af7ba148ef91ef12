//! A hyperbolic tangent that gives the same bits on every machine and vectorises.
//!
//! The standard library's `tanh` is whatever the platform ships, and `libm::tanh` branches, which keeps a loop
//! over five hundred units scalar. This kernel is a straight line of basic operations: the compiler turns a
//! loop over it into SSE2 or AVX code, and rounding does not depend on which.

/// From here on `tanh` rounds to ±1 in double precision (it does so at 19.07; the margin costs nothing).
const SATURATION: f64 = 20.0;
/// `1.5 · 2^52`: adding it rounds to the nearest integer and leaves that integer in the low bits.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// `ln 2` in two parts; the first has 21 trailing zero bits, so `k · LN2_HI` is exact for every `k` used here.
const LN2_HI: f64 = 6.931_471_803_691_238e-1;
const LN2_LO: f64 = 1.908_214_929_270_587_7e-10;
/// `1/n!` for `n = 2 … 13`. On `|r| ≤ ln 2 / 2` the first term left out is below `2e-17` of the sum.
const INVERSE_FACTORIALS: [f64; 12] = [
    1.0 / 2.0,
    1.0 / 6.0,
    1.0 / 24.0,
    1.0 / 120.0,
    1.0 / 720.0,
    1.0 / 5_040.0,
    1.0 / 40_320.0,
    1.0 / 362_880.0,
    1.0 / 3_628_800.0,
    1.0 / 39_916_800.0,
    1.0 / 479_001_600.0,
    1.0 / 6_227_020_800.0,
];

/// `tanh x`, within 3 units in the last place of `libm::tanh`; odd, monotone at the ends, NaN stays NaN.
///
/// `e = expm1(2|x|)`, `tanh |x| = e / (e + 2)`. With `k = round(2|x| / ln 2)` and `r = 2|x| − k ln 2` the
/// exponential is `e = 2^k · expm1(r) + (2^k − 1)`, where `expm1(r)` is its Taylor polynomial of degree 13,
/// summed from the smallest term. Costs 16 products, 17 sums and one division; no branch.
#[inline(always)]
pub(crate) fn tanh(x: f64) -> f64 {
    let magnitude = x.abs();
    let magnitude = if magnitude > SATURATION { SATURATION } else { magnitude };
    let doubled = magnitude + magnitude;
    let rounded = doubled * std::f64::consts::LOG2_E + ROUND;
    let k = rounded - ROUND;
    let r = (doubled - k * LN2_HI) - k * LN2_LO;
    let mut tail = INVERSE_FACTORIALS[11];
    for n in (0..11).rev() {
        tail = tail * r + INVERSE_FACTORIALS[n];
    }
    let reduced = r + r * r * tail;
    let power = f64::from_bits(rounded.to_bits().wrapping_add(1023) << 52);
    let e = power * reduced + (power - 1.0);
    (e / (e + 2.0)).copysign(x)
}

#[cfg(test)]
mod tests {
    use super::tanh;

    fn units_in_the_last_place(a: f64, b: f64) -> u64 {
        a.to_bits().abs_diff(b.to_bits())
    }

    #[test]
    fn it_stays_within_three_units_of_libm_over_the_whole_range() {
        let mut worst = 0;
        for i in 0..400_000_u32 {
            let x = f64::from(i) * 5.5e-5;
            worst = worst.max(units_in_the_last_place(tanh(x), libm::tanh(x)));
        }
        for exponent in -300..2 {
            for i in 0..200_u32 {
                let x = libm::exp10(f64::from(exponent)) * (1.0 + f64::from(i) * 0.045);
                worst = worst.max(units_in_the_last_place(tanh(x), libm::tanh(x)));
            }
        }
        assert!(worst <= 3, "{worst} units in the last place");
    }

    #[test]
    fn it_is_odd_and_its_ends_are_exact() {
        for x in [0.0, 1e-310, 1e-8, 0.3, 1.0, 7.0, 19.0, 25.0, f64::MAX, f64::INFINITY] {
            assert_eq!(tanh(-x).to_bits(), (-tanh(x)).to_bits());
        }
        assert_eq!(tanh(f64::INFINITY).to_bits(), 1.0_f64.to_bits());
        assert_eq!(tanh(-0.0).to_bits(), (-0.0_f64).to_bits());
        assert!(tanh(f64::NAN).is_nan());
    }
}
