//! Computes the normal distribution: in f32 for the renderer, in f64 for the reference integrator.

/// The coefficients of Numerical Recipes' `erfcc`: erfc(z) = t exp(-z² + c0 + c1 t + ...),
/// t = 1 / (1 + z/2).
pub(crate) const ERFC_SERIES: [f32; 10] = [
    -1.265_512_2,
    1.000_023_7,
    0.374_091_96,
    0.096_784_18,
    -0.186_288_06,
    0.278_868_07,
    -1.135_204,
    1.488_515_9,
    -0.822_152_23,
    0.170_872_77,
];

/// Returns Phi(x), the share of a unit Gaussian's integral below x.
///
/// The method refines Abramowitz and Stegun 7.1.26: erfc by the rational Chebyshev fit of Numerical Recipes'
/// `erfcc`, whose fractional error is below 1.2e-7 everywhere. In f32 the relative error is below 5e-7 + 1.2e-7
/// x²: below zero the exponent -x²/2 and its some four rounding errors count, 8e-6 at -8. The absolute error is
/// below 2e-7. `tests/frames/bounds.rs` measures both.
#[inline]
pub fn normal_cdf(x: f32) -> f32 {
    let z = x.abs() * std::f32::consts::FRAC_1_SQRT_2;
    let t = 1.0 / (1.0 + 0.5 * z);
    let [c0, higher @ ..] = ERFC_SERIES;
    let poly = higher.iter().rev().fold(0.0, |sum, c| t * (c + sum));
    let tail = 0.5 * t * (-z * z + c0 + poly).exp();
    if x < 0.0 { tail } else { 1.0 - tail }
}

/// Returns (phi(z), Phi(z)), the unit Gaussian and its integral up to z, in f64, for N numbers at once.
///
/// The tail is phi times Mills' ratio, a polynomial of degree 14 in (|z| - 4)/(|z| + 4) fitted so that Phi errs
/// by its rounding alone. |z| is clamped to 8.5, where the tail is 1e-17. The code has no branch or call, so
/// that a loop over kernels vectorises.
#[inline(always)]
pub fn normal_density_and_cdf<const N: usize>(z: [f64; N]) -> ([f64; N], [f64; N]) {
    /// Coefficients from the highest power down.
    const MILLS: [f64; 15] = [
        -3.226_462_543_141_543_7e-7,
        -2.398_786_170_195_417_5e-6,
        -5.351_809_477_864_973e-6,
        4.973_955_138_244_725e-6,
        2.998_608_070_220_772e-5,
        -4.428_382_524_645_996e-5,
        -0.000_186_537_686_301_135_14,
        0.000_638_978_007_600_811_8,
        0.000_507_557_048_134_519_2,
        -0.008_492_114_226_637_46,
        0.030_864_797_569_598_4,
        -0.071_707_408_479_498_84,
        0.124_379_255_234_087_56,
        -0.170_397_721_552_764_42,
        0.094_410_641_301_932_26,
    ];
    // One operation on all lanes at a time, which the compiler vectorises.
    let size = z.map(|z| z.abs().min(8.5));
    let exponential = small_exp(size.map(|z| -0.5 * z * z));
    let x = size.map(|z| (z - 4.0) / (z + 4.0));
    let mut mills = [0.0; N];
    for c in MILLS {
        for (sum, x) in mills.iter_mut().zip(x) {
            *sum = *sum * x + c;
        }
    }
    let mut cdf = [0.0; N];
    for l in 0..N {
        let tail = exponential[l] * mills[l];
        cdf[l] = if z[l] < 0.0 { tail } else { 1.0 - tail };
    }
    (exponential.map(|e| e * FRAC_1_SQRT_TAU), cdf)
}

/// 1 / sqrt(2 pi).
pub(crate) const FRAC_1_SQRT_TAU: f64 = 0.398_942_280_401_432_7;

/// Returns exp(x) for -700 <= x <= 0, to two units in the last place: 2^k exp(r) with |r| <= ln(2)/2, by
/// Taylor's series to r^13, whose remainder is 4e-18.
#[inline(always)]
pub(crate) fn small_exp<const N: usize>(x: [f64; N]) -> [f64; N] {
    /// Adding this rounds to an integer and leaves that integer in the lowest bits.
    const ROUND: f64 = 1.5 * (1_u64 << 52) as f64;
    const LN_2_HIGH: f64 = 6.931_471_803_691_238e-1;
    const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
    /// 1/n!, from n = 13 down.
    const SERIES: [f64; 14] = [
        1.0 / 6_227_020_800.0,
        1.0 / 479_001_600.0,
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5_040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        1.0 / 2.0,
        1.0,
        1.0,
    ];
    let shifted = x.map(|x| x * std::f64::consts::LOG2_E + ROUND);
    let mut r = x;
    for (r, shifted) in r.iter_mut().zip(shifted) {
        let k = shifted - ROUND;
        *r = (*r - k * LN_2_HIGH) - k * LN_2_LOW;
    }
    let mut series = [0.0; N];
    for c in SERIES {
        for (sum, r) in series.iter_mut().zip(r) {
            *sum = *sum * r + c;
        }
    }
    for (sum, shifted) in series.iter_mut().zip(shifted) {
        *sum *= f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52);
    }
    series
}

#[cfg(test)]
mod tests {
    use super::{normal_cdf, normal_density_and_cdf, small_exp};

    #[test]
    fn f64_agrees_with_a_library_to_rounding() {
        for i in -2000..=2000 {
            let z = f64::from(i) * 0.005;
            let ([density], [cdf]) = normal_density_and_cdf([z]);
            let truth = 0.5 * libm::erfc(-z * std::f64::consts::FRAC_1_SQRT_2);
            assert!((cdf - truth).abs() < 5e-16, "{z}: {cdf} {truth}");
            let truth = (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
            // Below exp(-8.5^2/2) the density is constant.
            assert!((density - truth).abs() < 1e-15, "{z}: {density} {truth}");
        }
        for x in [0.0, -1e-300, -0.3, -0.35, -1.0, -17.3, -300.0, -700.0] {
            let error = (small_exp([x])[0] / f64::exp(x) - 1.0).abs();
            assert!(error < 5e-16, "{x}: {error}");
        }
    }

    #[test]
    fn matches_published_digits() {
        // Phi at 0, 1, -1, -2, 3, -5 (standard tables, seven significant digits or more).
        for (x, phi) in [
            (0.0, 0.5),
            (1.0, 0.841_344_7),
            (-1.0, 0.158_655_25),
            (-2.0, 0.022_750_132),
            (3.0, 0.998_650_1),
            (-5.0, 2.866_515_7e-7),
        ] {
            let error = (normal_cdf(x) - phi).abs() / phi;
            assert!(error < 1e-6, "{x}: {error}");
        }
        assert_eq!(normal_cdf(40.0), 1.0);
        assert_eq!(normal_cdf(-40.0), 0.0);
    }
}
