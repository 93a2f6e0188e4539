//! Computes the entire exponential integral Ein. It gives the opacity of a kernel far below a pixel, which is
//! less than the depth of its peak suggests.

/// Coefficients (-1)^n / ((n + 1) (n + 1)!), from n = 0 up, of the series for Ein(x) / x. The first term left
/// out is 7e-9 at [`EIN_SPLIT`].
pub(crate) const EIN_SERIES: [f32; 13] = [
    1.0,
    -0.25,
    1.0 / 18.0,
    -1.0 / 96.0,
    1.0 / 600.0,
    -1.0 / 4_320.0,
    1.0 / 35_280.0,
    -1.0 / 322_560.0,
    1.0 / 3_265_920.0,
    -1.0 / 36_288_000.0,
    1.0 / 439_084_800.0,
    -1.0 / 5_748_019_200.0,
    1.0 / 80_951_270_400.0,
];

/// Argument up to which the series is used; the logarithm beyond.
pub(crate) const EIN_SPLIT: f32 = 2.0;

/// Numerator N of x e^x E1(x) = N(1/x) / D(1/x) for x >= 1, within 2e-8: Abramowitz and Stegun 5.1.56. Both
/// from the power 0 up.
pub(crate) const E1_NUMERATOR: [f32; 5] = [1.0, 8.573_329, 18.059_017, 8.634_761, 0.267_773_74];
/// Denominator D; see [`E1_NUMERATOR`].
pub(crate) const E1_DENOMINATOR: [f32; 5] = [1.0, 9.573_322, 25.632_956, 21.099_653, 3.958_496_9];

/// Euler's constant.
pub(crate) const EULER: f32 = 0.577_215_7;

/// Returns Ein(x) / x, 1 at 0, for x >= 0. A lone kernel far smaller than a pixel whose peak has the optical
/// depth x has this share of the opacity that its mean depth would give.
///
/// Ein(x) = ∫ (1 - e^-t) / t dt from 0 to x: by its series up to 2, beyond as ln x + γ + E1(x). The relative
/// error is below 5e-7. Infinity counts as the greatest f32. Twin: `shaders/shared/ein.wgsl`.
pub fn ein_share(x: f32) -> f32 {
    if x < EIN_SPLIT {
        return polynomial(&EIN_SERIES, x);
    }
    ein(x) / x.min(f32::MAX)
}

/// Returns Ein(x), x >= 0: see [`ein_share`].
pub fn ein(x: f32) -> f32 {
    if x < EIN_SPLIT {
        return x * polynomial(&EIN_SERIES, x);
    }
    let x = x.min(f32::MAX);
    let inverse = 1.0 / x;
    let ratio = polynomial(&E1_NUMERATOR, inverse) / polynomial(&E1_DENOMINATOR, inverse);
    x.ln() + (EULER + (-x).exp() * inverse * ratio)
}

fn polynomial(coefficients: &[f32], x: f32) -> f32 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

#[cfg(test)]
mod tests {
    use super::{ein, ein_share};

    /// Returns Ein(x) by Gauss's rule of five points over 4,000 equal parts of ln(1 + t): accurate to 1e-13.
    fn quadrature(x: f64) -> f64 {
        const NODES: [(f64, f64); 5] = [
            (0.0, 0.568_888_888_888_888_9),
            (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
            (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
            (0.906_179_845_938_664, 0.236_926_885_056_189_08),
            (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
        ];
        let (parts, end) = (4_000, x.ln_1p());
        let step = end / f64::from(parts);
        let mut sum = 0.0;
        for i in 0..parts {
            for (node, weight) in NODES {
                let u = step * (f64::from(i) + 0.5 + 0.5 * node);
                let t = u.exp_m1();
                sum += 0.5 * step * weight * -(-t).exp_m1() / t * u.exp();
            }
        }
        sum
    }

    #[test]
    fn agrees_with_quadrature_and_published_digits() {
        // Ein(1), Ein(10): A&S table 5.1, ln x + γ + E1(x); the quadrature itself.
        for (x, published) in [(1.0, 0.796_599_599_297_053), (10.0, 2.879_804_914_864_508)] {
            let error = (quadrature(x) / published - 1.0).abs();
            assert!(error < 1e-12, "{x}: {error:e}");
        }
        let mut worst = 0.0_f64;
        for i in 0..4_000 {
            // From 1e-6 to 1e7, and on both sides of the split.
            let x = match i {
                0..100 => 2.0 + 1e-6 * (i - 50) as f32,
                _ => 10_f32.powf(-6.0 + 13.0 * (i - 100) as f32 / 3_900.0),
            };
            let truth = quadrature(f64::from(x));
            let error = (f64::from(ein(x)) / truth - 1.0).abs();
            let share = (f64::from(ein_share(x)) * f64::from(x) / truth - 1.0).abs();
            worst = worst.max(error).max(share);
        }
        println!("worst relative error {worst:.1e}");
        // Fits of 2e-8 and 7e-9, and some six rounding errors, doubled because the series alternates.
        assert!(worst < 5e-7, "{worst:e}");
    }

    #[test]
    fn ends_are_finite() {
        assert_eq!((ein(0.0), ein_share(0.0)), (0.0, 1.0));
        assert_eq!(ein_share(1e-40), 1.0);
        // ln(f32::MAX) + γ.
        assert!((ein(f32::INFINITY) - 89.300_05).abs() < 1e-4);
        assert!(ein_share(f32::INFINITY) < 1e-36);
    }
}
