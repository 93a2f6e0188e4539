//! Computes functions of one lane, without a branch or a call, so that a loop over lanes vectorises.

use crate::constants::EXP2_SERIES;
use crate::math::normal::ERFC_SERIES;

/// Returns a b + c, fused if the instruction set supports it.
#[inline(always)]
pub(crate) fn madd<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// Adding this to y leaves round(y) + 127 in the low bits: the exponent field of 2^round(y).
const ROUND_TO_EXPONENT: f32 = 12_582_912.0 + 127.0;

/// 2^y as 2^n (1 + f s), with n the nearest integer to y, f the rest of y and s a series: [`EXP2_SERIES`].
///
/// The terms of the series are added in pairs, so that few operations depend on one another: a loop over lanes takes as
/// long as its longest chain of operations.
struct Exp2 {
    power: f32,
    f: f32,
    series: f32,
}

impl Exp2 {
    /// Returns 2^(x scale) for products in \[-126, 0\].
    #[inline(always)]
    fn of<const FMA: bool>(x: f32, scale: f32) -> Self {
        let shifted = madd::<FMA>(x, scale, ROUND_TO_EXPONENT);
        let f = madd::<FMA>(x, scale, ROUND_TO_EXPONENT - shifted);
        let [c0, c1, c2, c3] = EXP2_SERIES;
        let low = madd::<FMA>(c1, f, c0);
        let high = madd::<FMA>(c3, f, c2);
        let series = madd::<FMA>(f * f, high, low);
        Self {
            power: f32::from_bits(shifted.to_bits() << 23),
            f,
            series: madd::<FMA>(series, f, std::f32::consts::LN_2),
        }
    }
}

/// Returns exp(-q/2) for q in \[0, 49\].
#[inline(always)]
pub(crate) fn exp_minus_half<const FMA: bool>(q: f32) -> f32 {
    let Exp2 { power, f, series } = Exp2::of::<FMA>(q, -0.5 * std::f32::consts::LOG2_E);
    // Factors belong outside, where lanes beyond the cut-off are masked: subnormal products are slow.
    madd::<FMA>(power * f, series, power)
}

/// Returns Phi(x), the integral of the unit Gaussian up to x, like [`normal_cdf`](crate::math::normal_cdf), in
/// vectorisable form. Beyond 6.8 the tail stays at 1e-12.
#[inline(always)]
pub(crate) fn cdf<const FMA: bool>(x: f32) -> f32 {
    let z = x.abs() * std::f32::consts::FRAC_1_SQRT_2;
    let t = 1.0 / madd::<FMA>(0.5, z, 1.0);
    let [c0, higher @ ..] = ERFC_SERIES;
    let mut poly = 0.0;
    for c in higher.iter().rev() {
        poly = t * (c + poly);
    }
    let q = 2.0 * (madd::<FMA>(z, z, -c0) - poly);
    let tail = 0.5 * t * exp_minus_half::<FMA>(q.clamp(0.0, 49.0));
    if x < 0.0 { tail } else { 1.0 - tail }
}

/// Coefficients of Phi(x) = 1/2 + x P(u) with u = 2 (x/5)² - 1 for |x| <= 5, constant beyond: minimax,
/// monomials in u.
pub(crate) const CDF_SERIES: [f32; 13] = [
    0.141_363_78,
    -0.070_296_28,
    0.051_520_523,
    -0.040_442_61,
    0.031_442_173,
    -0.023_268_653,
    0.016_402_174,
    -0.011_164_339,
    0.006_410_51,
    -0.002_685_575,
    0.001_722_799_5,
    -0.001_613_265_1,
    0.000_608_727_3,
];

/// Range of the series for Phi, in standard deviations.
pub(crate) const CDF_REACH: f32 = 5.0;

/// Returns Phi(x) within 3e-7, in a third of the time of [`cdf`], for differences of Phi. Its tails are not
/// accurate.
#[inline(always)]
pub(crate) fn cdf_near<const FMA: bool>(x: f32) -> f32 {
    let x = x.clamp(-CDF_REACH, CDF_REACH);
    let u = madd::<FMA>(x * x, 2.0 / (CDF_REACH * CDF_REACH), -1.0);
    let [lower @ .., last] = CDF_SERIES;
    let series = lower
        .iter()
        .rev()
        .fold(last, |sum, c| madd::<FMA>(sum, u, *c));
    madd::<FMA>(x, series, 0.5)
}

/// Returns 1 - exp(-tau) for tau >= 0, with a small relative error at any tau. There is no cancellation,
/// because 2^n (2^f - 1) and 2^n - 1 are each exact if tau is small (n = 0).
#[inline(always)]
pub(crate) fn opacity<const FMA: bool>(tau: f32) -> f32 {
    // Beyond 64 the opacity is 1 in f32.
    let Exp2 { power, f, series } = Exp2::of::<FMA>(tau.min(64.0), -std::f32::consts::LOG2_E);
    madd::<FMA>(-power * f, series, 1.0 - power)
}

/// Returns ln x for x from the least normal number up. The error is within 1.2e-7 of the result or, near 1, of
/// the distance from 1. Infinity gives 88.7, NaN gives NaN. The method is twice the inverse hyperbolic
/// tangent's series.
#[inline(always)]
pub(crate) fn ln(x: f32) -> f32 {
    /// The bits of sqrt(1/2): the reduced x lies between it and its double.
    const ROOT: u32 = 0x3f35_04f3;
    /// ln 2 with so few digits that integer multiples of it are exact; then the remainder.
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = -2.121_944_4e-4;
    let bits = x.to_bits();
    let exponent = bits.wrapping_sub(ROOT) as i32 >> 23;
    let rest = f32::from_bits(bits.wrapping_sub((exponent as u32) << 23));
    let s = (rest - 1.0) / (rest + 1.0);
    let square = s * s;
    let series = square * (1.0 / 3.0 + square * (1.0 / 5.0 + square * (1.0 / 7.0 + square / 9.0)));
    let whole = exponent as f32;
    let ln = whole * LN_2_HIGH + (2.0 * s + (2.0 * s * series + whole * LN_2_LOW));
    if x.is_nan() { x } else { ln }
}

/// Returns sqrt(x² + y²) without squares outside the range of f32; infinity or NaN if x or y is infinite.
#[inline(always)]
pub(crate) fn hypot(x: f32, y: f32) -> f32 {
    let (x, y) = (x.abs(), y.abs());
    let longer = if x > y { x } else { y };
    let ratio = if x > y { y } else { x } / longer;
    let length = longer * (1.0 + ratio * ratio).sqrt();
    if longer == 0.0 { 0.0 } else { length }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithms_and_lengths_are_right_to_a_few_roundings() {
        for i in -379_000..380_000 {
            let x = 10_f32.powf(i as f32 * 1e-4);
            let exact = f64::from(x).ln();
            let error = (f64::from(ln(x)) - exact).abs();
            assert!(error <= 2e-7 * exact.abs(), "{x}: {error}");
            let y = x * (i % 7) as f32;
            let exact = f64::from(x).hypot(f64::from(y));
            let error = (f64::from(hypot(x, y)) - exact).abs();
            assert!(
                error <= 3e-7 * exact || exact > f64::from(f32::MAX),
                "{x}, {y}: {error}"
            );
        }
        assert_eq!(ln(1.0), 0.0);
        assert!(ln(f32::NAN).is_nan());
        assert_eq!((ln(f32::INFINITY) * 10.0).round(), 887.0);
        assert_eq!(hypot(0.0, -0.0), 0.0);
        assert_eq!(hypot(-3.0, 4.0), 5.0);
        // The squares of both would underflow to 0, or overflow.
        assert_eq!(hypot(3e-30, 4e-30), 5e-30);
        assert_eq!(hypot(3e30, 4e30), 5e30);
        assert!(hypot(f32::NAN, 1.0).is_nan() && hypot(1.0, f32::NAN).is_nan());
    }

    #[test]
    fn the_short_integral_holds_its_error() {
        for i in 0..=400_000 {
            let x = i as f32 * (16.0 / 400_000.0) - 8.0;
            let ([_], [exact]) = crate::math::normal_density_and_cdf([f64::from(x)]);
            for found in [cdf_near::<false>(x), cdf_near::<true>(x)] {
                let error = (f64::from(found) - exact).abs();
                // 1.6e-7 of the series, 2.9e-7 of the constant beyond, a rounding error or two.
                assert!(error < 4e-7 && (0.0..=1.0).contains(&found), "{x}: {error}");
            }
        }
        assert!(cdf_near::<true>(f32::NAN).is_nan());
        assert!(cdf_near::<true>(f32::NEG_INFINITY) < 3e-7);
    }

    #[test]
    fn exponentials_hold_their_relative_error() {
        for i in 0..200_000 {
            let q = i as f32 * (49.0 / 200_000.0);
            let exact = (-0.5 * f64::from(q)).exp();
            let error = (f64::from(exp_minus_half::<false>(q)) - exact).abs() / exact;
            // The series' 4.3e-7 of a part below .41, and the rounding of y up to 35: 2e-6.
            assert!(error < 3e-6, "{q}: {error}");
            let tau = 10_f32.powf(i as f32 / 20_000.0 - 9.0);
            let exact = -(-f64::from(tau)).exp_m1();
            let error = (f64::from(opacity::<false>(tau)) - exact).abs() / exact;
            assert!(error < 8e-7, "{tau}: {error}");
        }
        assert_eq!(opacity::<false>(0.0), 0.0);
        assert_eq!(opacity::<true>(1e30), 1.0);
    }
}
