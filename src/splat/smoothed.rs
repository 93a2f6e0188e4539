//! Computes the means over pixels of projected SPH kernels, for column sums.
//!
//! The line integral of a round kernel W of unit mass and support H depends on the impact parameter b alone. With
//! t = b²/H², it is F(t)/H², and F(t) = (1 - t)³ P(2t - 1) with a polynomial P of degree 14, fitted to the integral in f64:
//! within 1.4e-5 of the peak (Wendland C2: 5e-5), with a mass of 1. The mean over a pixel is the value at
//! its centre and 1/24 of the Laplacian, (1 - t) R(2t - 1)/H² with R of degree 10, H in pixels. For kernels narrower than
//! [`LEAST_REACH_PX`] a pixel has 4, 16 or 64 parts. Means are within 1e-4 of the greatest
//! (Wendland C2: 2e-4), and their sum within 1e-5 of the mass. Kernels narrower than [`LEAST_DRAWN_PX`] remain Gaussians,
//! whose means over pixels keep the mass at any size.
//!
//! Footprints have the kernel's variance, widened by that of a pixel, and its mass. So the kernel needs no other numbers.
//!
//! Twin: `shaders/shared/smoothed.wgsl`.

use std::f32::consts::TAU;

use super::pixel_mean::{PIXEL_VARIANCE_PX2, is_of_pixels};
use crate::math::lane::madd;
use crate::record::{Footprint, ViewUniform};

/// Number of kernels.
const KERNELS: usize = 6;
/// Number of coefficients of P.
const VALUES: usize = 15;
/// Number of coefficients of R.
const BENDS: usize = 11;

/// Squared support over the variance along an axis: of the cubic, quartic and quintic spline, and of Wendland C2,
/// C4 and C6, in the order of [`SphKernel`](crate::io::SphKernel).
pub(crate) const REACHES: [f32; KERNELS] =
    [40.0 / 3.0, 375.0 / 23.0, 135.0 / 7.0, 15.0, 19.5, 24.0];

/// Coefficients of P, from the constant on.
pub(crate) const PROJECTED: [[f32; VALUES]; KERNELS] = [
    [
        0.622_868_36,
        -0.637_949_05,
        0.266_428_1,
        -0.392_348_26,
        0.215_239_3,
        2.305_213_7,
        0.841_697_04,
        -12.573_317,
        -7.838_817,
        27.683_195,
        21.356_901,
        -25.064_041,
        -22.278_612,
        6.964_594_4,
        7.009_492_4,
    ],
    [
        0.307_412_2,
        -0.687_055_23,
        0.599_315_76,
        -0.302_742_24,
        0.520_311_1,
        -1.250_589_8,
        -2.096_558_6,
        3.108_437_8,
        8.422_237,
        -0.204_870_4,
        -13.689_855,
        -8.540_015,
        6.160_119_5,
        7.630_35,
        1.917_835_7,
    ],
    [
        0.146_076_5,
        -0.500_590_8,
        0.715_873_1,
        -0.659_142_3,
        0.618_034_7,
        -0.257_323_3,
        -0.575_573_3,
        -0.735_433_4,
        1.295_837_8,
        3.596_327,
        -0.195_890_05,
        -6.061_276,
        -2.442_128,
        3.393_756_4,
        2.078_873_9,
    ],
    [
        0.417_276_83,
        -0.802_530_8,
        0.372_075_92,
        0.008_975_889,
        3.001_737,
        0.670_273_3,
        -22.937_412,
        -23.044_819,
        71.047_874,
        107.131_16,
        -75.304_98,
        -183.759_78,
        -15.330_313,
        106.191_345,
        47.356_39,
    ],
    [
        0.128_668_84,
        -0.512_767_2,
        0.786_713_96,
        -0.645_359_93,
        0.853_164_73,
        0.106_576_15,
        -3.741_677,
        -4.777_814_4,
        11.500_625,
        20.068_193,
        -11.053_834,
        -33.212_92,
        -4.640_193,
        18.789_633,
        8.899_89,
    ],
    [
        0.036_895_946,
        -0.223_543_63,
        0.572_125,
        -0.843_552_8,
        0.948_850_6,
        -0.370_362_8,
        -0.954_013_5,
        -1.954_084_2,
        3.615_772_7,
        7.155_855,
        -2.970_810_7,
        -11.560_925,
        -2.266_856_7,
        6.406_079,
        3.248_270_3,
    ],
];

/// Coefficients of R, from the constant on.
pub(crate) const BENT: [[f32; BENDS]; KERNELS] = [
    [
        0.467_105_84,
        0.088_974_24,
        -0.386_520_9,
        -0.619_661_4,
        1.128_425_4,
        3.634_124_5,
        -10.070_254,
        -2.702_485_3,
        15.688_415,
        0.405_936_2,
        -7.776_851_7,
    ],
    [
        0.451_653_72,
        -0.592_665_9,
        0.631_531_95,
        -0.660_283_4,
        -6.949_13,
        8.007_613,
        16.405_828,
        -10.997_807,
        -21.310_062,
        5.765_627,
        9.550_845,
    ],
    [
        0.362_638_35,
        -1.044_925_6,
        0.958_275_3,
        1.237_067_1,
        -2.259_986_4,
        -2.244_837_5,
        -1.761_467_8,
        7.885_848_5,
        3.237_631,
        -3.982_579_5,
        -2.701_58,
    ],
    [
        0.536_167_2,
        0.614_399_43,
        -0.100_168_43,
        -13.079_632,
        -10.751_713,
        56.831_112,
        41.454_086,
        -85.766_624,
        -62.155_754,
        43.550_11,
        30.457_102,
    ],
    [
        0.394_171_68,
        -1.120_027_9,
        -0.272_641_63,
        0.950_778_07,
        6.160_565,
        2.492_208,
        -23.329_548,
        -3.223_649_3,
        26.772_581,
        3.064_534,
        -11.924_984,
    ],
    [
        0.205_167_62,
        -1.068_072_4,
        1.334_658_7,
        0.233_902_95,
        4.569_002,
        -3.299_507_1,
        -23.192_274,
        9.935_232,
        29.456_3,
        -2.712_991_5,
        -15.916_088,
    ],
];

/// Least support that is sampled once in a pixel \[px\].
pub(crate) const LEAST_REACH_PX: f32 = 14.0;
/// Least support that is drawn as it is \[px\]: an eighth of [`LEAST_REACH_PX`].
pub(crate) const LEAST_DRAWN_PX: f32 = 1.75;
/// Greatest number of parts of a pixel along an axis.
pub(crate) const MOST_PARTS: usize = 8;
/// Half of a pixel's diagonal, rounded up \[px\].
pub(crate) const HALF_DIAGONAL_PX: f32 = 0.71;

/// A footprint that is drawn by its SPH kernel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Smoothed {
    /// Copies: an index into the tables would prevent vector code.
    values: [f32; VALUES],
    bends: [f32; BENDS],
    /// t of the footprint's quadratic form at 1.
    per_form: f32,
    /// Factor of F for each part of a pixel, as column.
    amplitude: f32,
    /// Factor of the Laplacian's term.
    bend: f32,
    /// Parts of a pixel along an axis: at most [`MOST_PARTS`].
    parts: usize,
    /// Quadratic form at the farthest centre of a pixel that the kernel reaches.
    pub(crate) farthest: f32,
}

impl Smoothed {
    /// Returns the kernel of an affine footprint; `None` if it is drawn as a Gaussian.
    #[inline(always)]
    pub(crate) fn of(view: &ViewUniform, footprint: &Footprint) -> Option<Self> {
        if view.smoothing == 0 || !is_of_pixels(view.low_pass_variance_px2) {
            return None;
        }
        let kernel = (view.smoothing as usize - 1).min(KERNELS - 1);
        let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
        let wide = 1.0 / (px * ry - py * rx).abs();
        let reach_squared = (wide - PIXEL_VARIANCE_PX2) * REACHES[kernel];
        // Phrased so that NaN is drawn as a Gaussian.
        if !(reach_squared >= LEAST_DRAWN_PX * LEAST_DRAWN_PX && reach_squared.is_finite()) {
            return None;
        }
        let mut parts = 1;
        let mut fine = reach_squared;
        while fine < LEAST_REACH_PX * LEAST_REACH_PX && parts < MOST_PARTS {
            fine *= 4.0;
            parts *= 2;
        }
        let edge = reach_squared.sqrt() + HALF_DIAGONAL_PX;
        let per_form = wide / reach_squared;
        Some(Self {
            values: PROJECTED[kernel],
            bends: BENT[kernel],
            per_form,
            amplitude: footprint.tau * TAU * per_form / (parts * parts) as f32,
            bend: 1.0 / fine,
            parts,
            farthest: edge * edge / wide,
        })
    }

    /// Returns the number of parts of a pixel along an axis: at most [`MOST_PARTS`].
    #[inline(always)]
    pub(crate) fn parts(&self) -> usize {
        self.parts
    }

    /// Returns the footprint's quadratic form where the kernel ends.
    #[inline(always)]
    pub(crate) fn rim(&self) -> f32 {
        1.0 / self.per_form
    }

    /// Returns the offsets of the middles of a pixel's parts from its centre along an axis, px.
    #[inline(always)]
    pub(crate) fn offsets(&self) -> impl Iterator<Item = f32> + use<> {
        let parts = self.parts as f32;
        (0..self.parts).map(move |part| (part as f32 + 0.5) / parts - 0.5)
    }

    /// Returns the share of a part of a pixel, by the footprint's quadratic form at its middle.
    ///
    /// Even and odd terms are added apart, so that fewer operations wait for one another.
    #[inline(always)]
    pub(crate) fn at<const FMA: bool>(&self, q: f32) -> f32 {
        let t = (q * self.per_form).min(1.0);
        let (s, rest) = (madd::<FMA>(t, 2.0, -1.0), 1.0 - t);
        let value = series::<FMA, VALUES>(&self.values, s) * (rest * rest);
        let bent = series::<FMA, BENDS>(&self.bends, s);
        let value = madd::<FMA>(bent, self.bend, value);
        // The fit falls below 0 near the rim, by less than its error.
        self.amplitude * (value * rest).max(0.0)
    }

    /// Returns the mean over the pixel whose centre lies `d` from the footprint's, px.
    #[inline(always)]
    pub(crate) fn mean<const FMA: bool>(&self, footprint: &Footprint, d: [f32; 2]) -> f32 {
        let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
        let mut sum = 0.0;
        for dy in self.offsets() {
            for dx in self.offsets() {
                let (x, y) = (d[0] + dx, d[1] + dy);
                let p = madd::<FMA>(px, x, py * y);
                let r = madd::<FMA>(rx, x, ry * y);
                sum += self.at::<FMA>(madd::<FMA>(p, p, r * r));
            }
        }
        sum
    }
}

/// Returns a polynomial with an even degree.
#[inline(always)]
fn series<const FMA: bool, const COUNT: usize>(coefficients: &[f32; COUNT], s: f32) -> f32 {
    let u = s * s;
    let (mut even, mut odd) = (coefficients[COUNT - 1], 0.0);
    let mut i = COUNT - 1;
    while i > 0 {
        odd = madd::<FMA>(odd, u, coefficients[i - 1]);
        even = madd::<FMA>(even, u, coefficients[i - 2]);
        i -= 2;
    }
    madd::<FMA>(odd, s, even)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A kernel over the distance, of any mass: support 1.
    fn kernel(which: usize, u: f64) -> f64 {
        let spline = |support: f64, power: i32, weights: &[f64]| -> f64 {
            let knot = |(k, weight): (usize, &f64)| {
                let rest = support - k as f64 - support * u;
                weight * rest.max(0.0).powi(power)
            };
            weights.iter().enumerate().map(knot).sum()
        };
        let rest = (1.0 - u).max(0.0);
        match which {
            0 => spline(2.0, 3, &[1.0, -4.0]),
            1 => spline(2.5, 4, &[1.0, -5.0, 10.0]),
            2 => spline(3.0, 5, &[1.0, -6.0, 15.0]),
            3 => rest.powi(4) * (1.0 + 4.0 * u),
            4 => rest.powi(6) * (1.0 + 6.0 * u + 35.0 / 3.0 * u * u),
            _ => rest.powi(8) * (1.0 + 8.0 * u + 25.0 * u * u + 32.0 * u.powi(3)),
        }
    }

    /// Returns the line integral at an impact parameter, by the midpoint rule.
    fn projected(which: usize, b: f64) -> f64 {
        let half = (1.0 - b * b).max(0.0).sqrt();
        let steps = 1000;
        let at = |i: i32| {
            let z = half * (f64::from(i) + 0.5) / f64::from(steps);
            kernel(which, (b * b + z * z).sqrt())
        };
        2.0 * half / f64::from(steps) * (0..steps).map(at).sum::<f64>()
    }

    fn fitted(which: usize, t: f64) -> f64 {
        let s = 2.0 * t - 1.0;
        let series = PROJECTED[which].iter().rev();
        (1.0 - t).powi(3) * series.fold(0.0, |sum, &c| sum * s + f64::from(c))
    }

    #[test]
    fn polynomials_are_the_projections_of_the_kernels() {
        for which in 0..KERNELS {
            let steps = 1000;
            let places = || (0..steps).map(|i| (f64::from(i) + 0.5) / f64::from(steps));
            // Over t = b²: the area is pi dt.
            let sum = |of: &dyn Fn(f64) -> f64| places().map(of).sum::<f64>() / f64::from(steps);
            let mass = std::f64::consts::PI * sum(&|t| projected(which, t.sqrt()));
            let variance = sum(&|t| t * projected(which, t.sqrt())) / 2.0;
            let variance = std::f64::consts::PI * variance / mass;
            let reach = f64::from(REACHES[which]);
            assert!((reach * variance - 1.0).abs() < 1e-4, "{which}: {variance}");
            let own = std::f64::consts::PI * sum(&|t| fitted(which, t));
            assert!((own - 1.0).abs() < 3e-5, "{which}: mass {own}");
            let peak = projected(which, 0.0) / mass;
            let most = if which == 3 { 7e-5 } else { 2.5e-5 };
            for t in places() {
                let error = (fitted(which, t) - projected(which, t.sqrt()) / mass) / peak;
                assert!(error.abs() < most, "{which} at {t}: {error:e}");
            }
            // The Laplacian has no mass.
            let bent = sum(&|t| {
                let series = BENT[which].iter().rev();
                (1.0 - t) * series.fold(0.0, |sum, &c| sum * (2.0 * t - 1.0) + f64::from(c))
            });
            assert!(bent.abs() < 1e-5, "{which}: {bent:e}");
        }
    }
}
