//! Arithmetic of the tile loops: one lane of it, written so that a loop over lanes becomes vectors.

use crate::constants::EXP2_SERIES;
use crate::math::ERFC_SERIES;

/// a b + c, fused where the level has it.
#[inline(always)]
pub(in crate::cpu) fn madd<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// Adding this to y leaves round(y) + 127 in the low bits: the exponent field of 2^round(y).
const ROUND_TO_EXPONENT: f32 = 12_582_912.0 + 127.0;

/// Splits 2^y into (2^n, 2^f - 1) with n the nearest integer, for y in \[-126, 0\]; the second by
/// [`EXP2_SERIES`].
#[inline(always)]
fn exp2_parts<const FMA: bool>(y: f32) -> (f32, f32) {
    let shifted = y + ROUND_TO_EXPONENT;
    let f = y - (shifted - ROUND_TO_EXPONENT);
    let power = f32::from_bits(shifted.to_bits() << 23);
    let [c0, c1, c2, c3] = EXP2_SERIES;
    let mut series = c3;
    series = madd::<FMA>(series, f, c2);
    series = madd::<FMA>(series, f, c1);
    series = madd::<FMA>(series, f, c0);
    series = madd::<FMA>(series, f, std::f32::consts::LN_2);
    (power, series * f)
}

/// exp(-q/2) for q in \[0, 49\].
#[inline(always)]
pub(in crate::cpu) fn exp_minus_half<const FMA: bool>(q: f32) -> f32 {
    const SCALE: f32 = -0.5 * std::f32::consts::LOG2_E;
    let (power, rest) = exp2_parts::<FMA>(q * SCALE);
    madd::<FMA>(power, rest, power)
}

/// Phi(x), the integral of the unit Gaussian up to x, as [`normal_cdf`](crate::math::normal_cdf) has
/// it, by vector code: beyond 6.8 the tail stays at 1e-12.
#[inline(always)]
pub(in crate::cpu) fn cdf<const FMA: bool>(x: f32) -> f32 {
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

/// 1 - exp(-tau) for tau >= 0, with a small relative error at any tau: no cancellation, because
/// 2^n (2^f - 1) and 2^n - 1 are each exact where tau is small (n = 0).
#[inline(always)]
pub(in crate::cpu) fn opacity<const FMA: bool>(tau: f32) -> f32 {
    // Beyond 64 the opacity is 1 in f32.
    let (power, rest) = exp2_parts::<FMA>(tau.min(64.0) * -std::f32::consts::LOG2_E);
    madd::<FMA>(-power, rest, 1.0 - power)
}

#[cfg(test)]
mod tests {
    use super::*;

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
