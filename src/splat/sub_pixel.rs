//! Computes the opacity of a lone kernel smaller than a pixel.
//!
//! The resampling filter averages optical depths over a pixel, and transmittance is their exponential. If
//! an opaque kernel fills only part of a pixel, the filtered depth makes the whole pixel opaque. The
//! filtered opacity gives the true result.
//!
//! Twin: `shaders/shared/sub_pixel.wgsl`.

use super::filter::Filter;
use super::footprint::{ImageKernel, ScreenFactor};
use crate::math::EULER;

/// Cubes of the nodes of the eight-point Gauss rule on 0 to 1. Integrals over u are taken over t³,
/// because 1 - u^a is steep at 0 for small a.
pub(crate) const SUB_PIXEL_NODES: [f32; 8] = [
    0.941_609_6,
    0.724_957_3,
    0.443_786_74,
    0.207_177_62,
    0.068_058_58,
    0.013_351_488,
    1.050_841e-3,
    7.827_343e-6,
];
/// Logarithms of [`SUB_PIXEL_NODES`].
pub(crate) const SUB_PIXEL_LOGS: [f32; 8] = [
    -0.060_164_497,
    -0.321_642_57,
    -0.812_411_1,
    -1.574_178_8,
    -2.687_386_5,
    -4.316_127_3,
    -6.858_164_3,
    -11.757_887,
];
/// The rule's weights times 3 t², the derivative of t³.
pub(crate) const SUB_PIXEL_WEIGHTS: [f32; 8] = [
    0.145_872_97,
    0.269_193_1,
    0.273_777_57,
    0.190_479_38,
    0.090_686_22,
    0.026_483_055,
    3.447_839e-3,
    5.986_006e-5,
];

/// From this fraction of a pixel on, areas are integrated over the other variable.
pub(crate) const SUB_PIXEL_SPLIT: f32 = 4.0;
/// Beyond this many mean free paths almost no light is transmitted: exp(-12) = 6e-6.
pub(crate) const SUB_PIXEL_REACH: f32 = 12.0;

/// Below this depth opacity equals depth, so averaging makes no difference: the correction is less than a
/// quarter of its square.
pub(crate) const SUB_PIXEL_FAINT: f32 = 1e-3;
/// From this fraction of a pixel on the kernel is used without correction. At a depth of 1e4 the filtered
/// one is off by tau0^(1/a), a hundredth, which moves its edge by a thousandth of its width.
pub(crate) const SUB_PIXEL_LARGE: f32 = 1e3;
/// Depths between which the depth of a footprint changes over from following the peak to following the
/// extent; see [`sub_pixel_depth`].
pub(crate) const SUB_PIXEL_OPAQUE: [f32; 2] = [3.0, 7.0];

/// Returns the opacity at its centre of a lone round kernel under a Gaussian low-pass filter, 0 to 1: 1 -
/// a tau0^-a gamma(a, tau0), gamma the lower incomplete gamma function.
///
/// - `area`: a, the kernel's variance over the filter's, above 0.
/// - `tau0`: its optical depth at the centre before the filter, from 0 up.
///
/// Evaluated as the integral of tau0 exp(-tau0 u) (1 - u^a) over u from 0 to 1, or of 1 - exp(-tau0
/// v^(1/a)) over v, each with eight points. Neither subtracts numbers that are alike. The relative error
/// is below 6e-5 for a from 1e-6 to 100 and tau0 from 1e-4 to 1e4.
pub fn filtered_opacity(area: f32, tau0: f32) -> f32 {
    let mut sum = 0.0;
    if area < SUB_PIXEL_SPLIT {
        let end = (SUB_PIXEL_REACH / tau0).min(1.0);
        let depth = tau0 * end;
        let log_end = end.ln();
        for i in 0..8 {
            let missed = -(area * (log_end + SUB_PIXEL_LOGS[i])).exp_m1();
            sum += SUB_PIXEL_WEIGHTS[i] * (-depth * SUB_PIXEL_NODES[i]).exp() * missed;
        }
        return depth * sum;
    }
    for i in 0..8 {
        let depth = tau0 * (SUB_PIXEL_LOGS[i] / area).exp();
        sum += SUB_PIXEL_WEIGHTS[i] * -(-depth).exp_m1();
    }
    sum
}

/// Returns the optical depth at the centre whose opacity is the filtered one: -ln(1 - alpha) with alpha
/// of [`filtered_opacity`]. It replaces tau0 a / (1 + a), and is never more.
///
/// If the footprint is opaque, the peak no longer tells how far the kernel reaches. From a depth of 3 on,
/// and alone from 7 on, another depth is used: the one that keeps the sum of opacity over the image,
/// Ein(tau) = a / (1 + a) Ein(tau0). For large depths that is tau = (tau0^a exp(-gamma))^(1 / (1 + a))
/// with Euler's gamma.
pub fn sub_pixel_depth(area: f32, tau0: f32) -> f32 {
    let [opaque, saturated] = SUB_PIXEL_OPAQUE;
    // Rounding may give an opacity above 1.
    let peak = -(-filtered_opacity(area, tau0).min(0.999_99)).ln_1p();
    let share = ((peak - opaque) / (saturated - opaque)).clamp(0.0, 1.0);
    let extent = ((area * tau0.ln() - EULER) / (1.0 + area)).exp();
    let depth = peak + (extent - peak).max(0.0) * share;
    depth.min(tau0 * area / (1.0 + area))
}

impl ScreenFactor {
    /// Returns `image` with the opacity of a lone kernel: its depth times [`sub_pixel_depth`] over tau0 a
    /// / (1 + a).
    ///
    /// Exact for round kernels; for others a is the root of the ratio of the areas' squares, sqrt(l1 l2)
    /// / h². Kernels beside or behind one another are treated as if each was alone. If they fill pixels
    /// together the result is too faint ([`crate::render::Advanced::sub_pixel_opacity`]).
    #[inline]
    pub fn as_lone(&self, filter: Filter, h2: f32, image: ImageKernel) -> ImageKernel {
        if matches!(filter, Filter::Reconstruction | Filter::UniformScaling) {
            return image;
        }
        let width = self.row_x.cross(self.row_y).length();
        let area = width / h2;
        let tau0 = self.weight / (std::f32::consts::TAU * width);
        // Phrased so that NaN changes nothing.
        if !(area < SUB_PIXEL_LARGE && tau0 >= SUB_PIXEL_FAINT) {
            return image;
        }
        // A kernel without area hides nothing, however deep.
        let factor = if area > 0.0 && tau0.is_finite() {
            sub_pixel_depth(area, tau0) / (tau0 * area / (1.0 + area))
        } else {
            0.0
        };
        ImageKernel {
            tau: image.tau * factor.min(1.0),
            ..image
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns nodes and weights of the Gauss rule of `n` points on 0 to 1, by Newton's method.
    fn gauss(n: usize) -> Vec<(f64, f64)> {
        let legendre = |x: f64| {
            let (mut before, mut p) = (1.0, x);
            for k in 2..=n {
                let k = k as f64;
                (before, p) = (p, ((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k);
            }
            (p, n as f64 * (x * p - before) / (x * x - 1.0))
        };
        (0..n)
            .map(|i| {
                let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
                for _ in 0..50 {
                    let (p, slope) = legendre(x);
                    x -= p / slope;
                }
                let slope = legendre(x).1;
                (0.5 * (x + 1.0), 1.0 / ((1.0 - x * x) * slope * slope))
            })
            .collect()
    }

    /// Returns the filtered opacity in f64: the integral over ln u, in sixty parts of twenty points.
    fn quadrature(area: f64, tau0: f64) -> f64 {
        let low = -45.0 - tau0.max(1.0).ln();
        let step = -low / 60.0;
        let rule = gauss(20);
        let parts = (0..60).flat_map(|i| {
            let first = low + step * f64::from(i);
            rule.iter().map(move |(x, w)| (first + step * x, w * step))
        });
        parts
            .map(|(log, weight)| {
                let depth = tau0 * log.exp();
                weight * depth * (-depth).exp() * -(area * log).exp_m1()
            })
            .sum()
    }

    #[test]
    fn the_rule_is_gausss() {
        for (i, (x, w)) in gauss(8).into_iter().enumerate() {
            let of = |x: f64| x * x * x;
            // To the last digit of f32.
            for (found, expected) in [
                (SUB_PIXEL_NODES[i], of(x)),
                (SUB_PIXEL_LOGS[i], of(x).ln()),
                (SUB_PIXEL_WEIGHTS[i], 3.0 * x * x * w),
            ] {
                assert!(
                    (f64::from(found) / expected - 1.0).abs() < 1e-7,
                    "{found} {expected}"
                );
            }
        }
    }

    #[test]
    fn opacities_agree_with_quadrature() {
        // a = 1: 1 - gamma(1, t) / t = 1 - (1 - e^-t) / t, which the quadrature must reproduce.
        for t in [1e-3_f64, 0.7, 30.0, 1e4] {
            let exact = 1.0 + (-t).exp_m1() / t;
            assert!((quadrature(1.0, t) / exact - 1.0).abs() < 1e-12, "{t}");
        }
        let mut worst = 0.0_f64;
        for i in 0..=64 {
            for k in 0..=64 {
                let area = 10_f32.powf(-6.0 + i as f32 / 8.0);
                let tau0 = 10_f32.powf(-4.0 + k as f32 / 8.0);
                let truth = quadrature(area.into(), tau0.into());
                let found = f64::from(filtered_opacity(area, tau0));
                worst = worst.max((found / truth - 1.0).abs());
            }
        }
        println!("worst relative error {worst:.1e}");
        // Eight points: 4.4e-5 in exact arithmetic, and some ten roundings.
        assert!(worst < 6e-5, "{worst:e}");
    }

    #[test]
    fn depths_lie_between_the_limits() {
        for i in 0..=72 {
            let area = 10_f32.powf(-6.0 + i as f32 / 8.0);
            let mut before = 0.0;
            for k in 0..=64 {
                let tau0 = 10_f32.powf(-4.0 + k as f32 / 8.0);
                let depth = sub_pixel_depth(area, tau0);
                let filtered = tau0 * area / (1.0 + area);
                // One rounding of either value.
                assert!(depth > 0.0 && depth <= filtered, "{area} {tau0}");
                assert!(depth >= before, "{area} {tau0}: {depth} after {before}");
                before = depth;
                if tau0 < 1e-3 {
                    assert!(depth > 0.9997 * filtered);
                }
                // Far below a pixel: a Ein(tau0), to the order of a.
                if area < 1e-4 {
                    let limit = area * crate::math::ein(tau0);
                    assert!(
                        (depth / limit - 1.0).abs() < 10.0 * area + 6e-5,
                        "{area} {tau0}"
                    );
                }
            }
        }
    }
}
