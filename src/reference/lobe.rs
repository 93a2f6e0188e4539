//! Computes moments of kernels classified over their own extent in closed form. They come from a transfer
//! function's table itself, without the renderer's derived tables.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "whole numbers of steps"
)]

use crate::math::{FRAC_1_SQRT_TAU, normal_density_and_cdf};
use crate::scene::{LEAST_WINDOW_SHARE, Lobe, Lobes};

/// Distance from a knot, in standard deviations, beyond which a Gaussian is negligible.
const FAR: f64 = 8.0;

/// Returns moments of a piecewise linear function kappa under a Gaussian: the integral, and mean and variance
/// of the product, in standard deviations from the Gaussian's mean. They are M_0, M_1/M_0 and M_2/M_0 -
/// (M_1/M_0)² with M_j = ∫ N(t; 0, 1) kappa(value + spread t) tʲ dt.
///
/// - `knots`: value and kappa. Values do not decrease; two knots at one value are a step. kappa is 0 before the
///   first and after the last.
///
/// Returns `None` if nothing is left.
pub fn moments(knots: &[[f64; 2]], value: f64, spread: f64) -> Option<[f64; 3]> {
    let near = |x: f64| ((x - value) / spread).clamp(-FAR, FAR);
    let mut sums = [0.0; 3];
    for pair in knots.windows(2) {
        let [[a, from], [b, to]] = [pair[0], pair[1]];
        let (l, h) = (near(a), near(b));
        if !(h > l) || (from == 0.0 && to == 0.0) {
            continue;
        }
        // kappa = c0 + c1 t.
        let c1 = (to - from) / (b - a) * spread;
        let c0 = from - c1 * (a - value) / spread;
        // In the upper tail both integrals are near 1: use the mirrored, lower tail.
        let sign = if l > 0.0 { -1.0 } else { 1.0 };
        let ([at_l, at_h], [below_l, below_h]) = normal_density_and_cdf([sign * l, sign * h]);
        let i0 = sign * (below_h - below_l);
        let i1 = at_l - at_h;
        let i2 = i0 + l * at_l - h * at_h;
        let i3 = 2.0 * i1 + l * l * at_l - h * h * at_h;
        sums[0] += c0 * i0 + c1 * i1;
        sums[1] += c0 * i1 + c1 * i2;
        sums[2] += c0 * i2 + c1 * i3;
    }
    let [mass, first, second] = sums;
    let mean = first / mass;
    (mass > 0.0).then(|| [mass, mean, (second / mass - mean * mean).max(0.0)])
}

/// Returns [`moments`] of the parts that a lobe's windows leave; by quadrature if there is more than one
/// window. Windows below the share that is drawn give `None`, and the others take over their mass.
///
/// The definition of windows comes from the renderer, but none of its tables.
pub fn window_moments(
    lobes: &Lobes,
    lobe: &Lobe,
    knots: &[[f64; 2]],
    value: f64,
    spread: f64,
) -> Vec<Option<[f64; 3]>> {
    let count = lobes.windows(lobe).len();
    if count == 1 {
        return vec![moments(knots, value, spread)];
    }
    let mut sums = vec![[0.0; 3]; count];
    let near = |x: f64| ((x - value) / spread).clamp(-FAR, FAR);
    for pair in knots.windows(2) {
        let [[a, from], [b, to]] = [pair[0], pair[1]];
        let (l, h) = (near(a), near(b));
        if !(h > l) || (from == 0.0 && to == 0.0) {
            continue;
        }
        // Gauss's rule of two points over a twentieth of a deviation: its error is 1e-8 of a window's integral.
        let steps = ((h - l) / 0.05).ceil();
        let step = (h - l) / steps;
        for n in 0..steps as usize {
            for side in [-1.0, 1.0] {
                let t = l + (n as f64 + 0.5 + side * 0.5 / 3.0_f64.sqrt()) * step;
                let at = value + spread * t;
                let kappa = from + (to - from) * (at - a) / (b - a);
                let density = (-0.5 * t * t).exp() * FRAC_1_SQRT_TAU;
                let part = 0.5 * step * density * kappa;
                let weights = lobes.weights(lobe, at, spread);
                for (sums, weight) in sums.iter_mut().zip(weights) {
                    sums[0] += part * weight;
                    sums[1] += part * weight * t;
                    sums[2] += part * weight * t * t;
                }
            }
        }
    }
    let all: f64 = sums.iter().map(|s| s[0]).sum();
    let least = LEAST_WINDOW_SHARE * all;
    let drawn: f64 = sums.iter().map(|s| s[0]).filter(|&m| m > least).sum();
    let moments = |[mass, first, second]: [f64; 3]| {
        let mean = first / mass;
        (mass > least).then(|| {
            let variance = (second / mass - mean * mean).max(0.0);
            [mass * all / drawn, mean, variance]
        })
    };
    sums.into_iter().map(moments).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    /// Compares with the 16 published cases.
    #[test]
    fn published_cases_hold() {
        let text = include_str!("../../fixtures/classified_kernel_cases.json");
        let cases: Value = serde_json::from_str(text).unwrap();
        let cases = cases["cases"].as_array().unwrap();
        let number = |v: &Value| v.as_f64().unwrap();
        let mut lobes = 0;
        for case in cases {
            let knots: Vec<[f64; 2]> = case["kappa"]
                .as_array()
                .unwrap()
                .iter()
                .map(|k| [number(&k[0]), number(&k[1])])
                .collect();
            let (value, spread) = (number(&case["f"]), number(&case["w"]));
            for lobe in case["lobes"].as_array().unwrap() {
                let [lo, hi] = [0, 1].map(|i| number(&lobe["interval"][i]));
                let own: Vec<_> = knots
                    .iter()
                    .copied()
                    .filter(|k| (lo..=hi).contains(&k[0]))
                    .collect();
                if !(spread > 0.0) {
                    continue;
                }
                let found = moments(&own, value, spread);
                if lobe["drawn"] != Value::Bool(true) {
                    assert!(found.is_none_or(|m| m[0] < 1e-12), "{case}");
                    continue;
                }
                lobes += 1;
                let [mass, mean, variance] = found.unwrap();
                let name = &case["name"];
                let published = ["mass_factor", "shift", "variance"].map(|k| number(&lobe[k]));
                // Tails of 1e-5 keep eleven of sixteen digits; so do variances of a hundredth.
                assert!(
                    (mass / published[0] - 1.0).abs() < 1e-8,
                    "{name} {mass} {published:?}"
                );
                assert!(
                    (mean - published[1]).abs() < 1e-7,
                    "{name} {mean} {published:?}"
                );
                assert!(
                    (variance - published[2]).abs() < 1e-7,
                    "{name} {variance} {published:?}"
                );
            }
        }
        assert!(cases.len() >= 16 && lobes >= 16, "{lobes}");
    }
}
