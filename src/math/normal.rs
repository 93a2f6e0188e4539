//! The normal distribution: in f32 for the renderer, in f64 for the reference integrator.

/// Phi(x): the share of a unit Gaussian's integral that lies below x.
///
/// Abramowitz and Stegun 7.1.26 refined: erfc by the rational Chebyshev fit of Numerical
/// Recipes' `erfcc`, whose fractional error is below 1.2e-7 everywhere, which f32 rounds to
/// about 3e-7.
#[inline]
pub fn normal_cdf(x: f32) -> f32 {
    let z = x.abs() * std::f32::consts::FRAC_1_SQRT_2;
    let t = 1.0 / (1.0 + 0.5 * z);
    let poly = t
        * (1.000_023_7
            + t * (0.374_091_96
                + t * (0.096_784_18
                    + t * (-0.186_288_06
                        + t * (0.278_868_07
                            + t * (-1.135_204
                                + t * (1.488_515_9 + t * (-0.822_152_23 + t * 0.170_872_77))))))));
    let tail = 0.5 * t * (-z * z - 1.265_512_2 + poly).exp();
    if x < 0.0 { tail } else { 1.0 - tail }
}

/// (phi(z), Phi(z)): the unit Gaussian and its integral up to z, in f64.
///
/// The tail is phi times Mills' ratio, a polynomial of degree 14 in (|z| - 4)/(|z| + 4) fitted
/// so that Phi errs by its rounding alone; |z| is held to 8.5, where the tail is 1e-17. Straight
/// arithmetic without a branch or a call, so that a loop over kernels becomes vector code.
#[inline(always)]
pub fn normal_density_and_cdf(z: f64) -> (f64, f64) {
    /// From the highest power down.
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
    let size = z.abs().min(8.5);
    let density = FRAC_1_SQRT_TAU * small_exp(-0.5 * size * size);
    let x = (size - 4.0) / (size + 4.0);
    let mills = MILLS.iter().fold(0.0, |sum, c| sum * x + c);
    // The fit is of erfc without the density's constant.
    let tail = density * SQRT_TAU * mills;
    (density, if z < 0.0 { tail } else { 1.0 - tail })
}

const SQRT_TAU: f64 = 2.506_628_274_631_000_5;
const FRAC_1_SQRT_TAU: f64 = 1.0 / SQRT_TAU;

/// exp(x) for -700 <= x <= 0, to two units in the last place: 2^k exp(r), |r| <= ln(2)/2, by
/// Taylor's series to r^13, whose remainder is 4e-18.
#[inline(always)]
fn small_exp(x: f64) -> f64 {
    /// Adding it rounds to an integer and leaves that integer in the lowest bits.
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
    let shifted = x * std::f64::consts::LOG2_E + ROUND;
    let k = shifted - ROUND;
    let r = (x - k * LN_2_HIGH) - k * LN_2_LOW;
    let series = SERIES.iter().fold(0.0, |sum, c| sum * r + c);
    let power = f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52);
    series * power
}

#[cfg(test)]
mod tests {
    use super::{normal_cdf, normal_density_and_cdf, small_exp};

    #[test]
    fn f64_agrees_with_a_library_to_rounding() {
        for i in -2000..=2000 {
            let z = f64::from(i) * 0.005;
            let (density, cdf) = normal_density_and_cdf(z);
            let truth = 0.5 * libm::erfc(-z * std::f64::consts::FRAC_1_SQRT_2);
            assert!((cdf - truth).abs() < 5e-16, "{z}: {cdf} {truth}");
            let truth = (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
            // Below exp(-8.5^2/2) the density stays where it is.
            assert!((density - truth).abs() < 1e-15, "{z}: {density} {truth}");
        }
        for x in [0.0, -1e-300, -0.3, -0.35, -1.0, -17.3, -300.0, -700.0] {
            let error = (small_exp(x) / x.exp() - 1.0).abs();
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
