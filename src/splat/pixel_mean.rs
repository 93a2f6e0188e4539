//! Computes the means of footprints over pixels, for column sums. They are exact for kernels whose axes
//! are the image's.
//!
//! Footprints are widened by the variance of a pixel, 1/12 px². For deviations of two pixels and more,
//! the widened footprint is the mean over the pixel, within 1.3e-4 of the kernel's peak. For narrower
//! footprints this module subtracts that variance again and integrates the footprint over the pixel in
//! bands. Bands are rows or columns of pixels, whichever the longer axis crosses. A band has the kernel's
//! exact mass. Across the band, the mass is distributed as a Gaussian with the mean and the variance of
//! the kernel within the band. Sums over pixels telescope, so that mass is conserved for every size, down
//! to points.
//!
//! Twin: `shaders/shared/pixel_mean.wgsl`.

use crate::constants::FRAC_1_SQRT_2PI;
use crate::math::lane::{cdf_near, exp_minus_half, madd};
use crate::record::{Footprint, ViewUniform};

/// Variance of a pixel along either axis \[px²\]. As the low-pass variance of a column density it stands
/// for the pixel itself: values are then means over pixels.
pub const PIXEL_VARIANCE_PX2: f32 = 1.0 / 12.0;

/// Returns whether the variance of a low-pass filter stands for the pixel itself. The comparison is bit
/// for bit.
pub(crate) fn is_of_pixels(variance_px2: f32) -> bool {
    variance_px2.to_bits() == PIXEL_VARIANCE_PX2.to_bits()
}

/// Widened footprints of at least this variance are sampled at the pixels' centres \[px²\].
pub(crate) const SAMPLED_FROM_PX2: f32 = 4.0 + PIXEL_VARIANCE_PX2;

/// Least deviation \[px\]. Below it f32 cannot resolve the variance that remains without the pixel's.
pub(crate) const LEAST_MEAN_SIGMA_PX: f32 = 1.0 / 64.0;

/// 1 / (2 Phi(5) - 1): compensates for the tails that `cdf_near` omits on both sides.
pub(crate) const CDF_WHOLE: f32 = 1.000_000_6;

/// Range along a band's axis over which its mean and variance are integrated, standard deviations.
pub(crate) const BAND_REACH: f32 = 4.5;

/// Gauss-Legendre nodes on the positive half of -1 to 1, and their weights.
pub(crate) const BAND_NODES: [[f32; 2]; 4] = [
    [0.183_434_64, 0.362_683_78],
    [0.525_532_4, 0.313_706_65],
    [0.796_666_5, 0.222_381_03],
    [0.960_289_9, 0.101_228_535],
];

/// A footprint with a variance below `SAMPLED_FROM_PX2` along at least one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelMean {
    /// True if bands are rows (otherwise columns).
    pub(crate) has_rows: bool,
    /// True if the masses of bands are sampled at their middles.
    is_sampled: bool,
    /// The mass of all bands together; if their masses are sampled, the mass of the band through the centre \[px\].
    mass: f32,
    /// Deviation along the axis that crosses bands, px.
    sigma: f32,
    per_sigma: f32,
    /// Change of the mean across a band per pixel along that axis.
    slope: f32,
    /// Variance across a band at a fixed position along it, px²; one over its root.
    variance: f32,
    per_across: f32,
}

/// The part of a footprint in a row or a column of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Band {
    /// The mass in the band, px².
    pub(crate) mass: f32,
    /// The middle across the band, from the footprint's centre, px.
    pub(crate) mean: f32,
    /// One over the deviation across the band, 1/px.
    pub(crate) per_sigma: f32,
}

impl PixelMean {
    /// Returns the bands of a footprint; `None` if it is sampled at the pixels' centres.
    #[inline(always)]
    pub fn of(view: &ViewUniform, footprint: &Footprint) -> Option<Self> {
        if !is_of_pixels(view.low_pass_variance_px2) {
            return None;
        }
        // The inverse of the widened variance.
        let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
        let (xx, xy, yy) = (px * px + rx * rx, px * py + rx * ry, py * py + ry * ry);
        let (half, turn) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let sharpest = half + (turn * turn + xy * xy).sqrt();
        if !(sharpest * SAMPLED_FROM_PX2 > 1.0) {
            return None;
        }
        let per_determinant = px * ry - py * rx;
        let determinant = 1.0 / (per_determinant * per_determinant);
        let mass = footprint.tau * std::f32::consts::TAU / per_determinant.abs();
        // The longer axis of the image has the sharper entry. One over that entry is the variance across,
        // at a fixed position along.
        let has_rows = xx >= yy;
        let sharp = if has_rows { xx } else { yy };
        let wide = sharp * determinant;
        let covariance = -xy * determinant;
        if !(wide.is_finite() && mass.is_finite()) {
            return None;
        }
        let least = LEAST_MEAN_SIGMA_PX * LEAST_MEAN_SIGMA_PX;
        let is_sampled = wide >= SAMPLED_FROM_PX2;
        let own = (wide - PIXEL_VARIANCE_PX2).max(least);
        let widened_slope = covariance / wide;
        let (slope, spread) = if is_sampled {
            (widened_slope, wide)
        } else {
            (covariance / own, own)
        };
        let taken = if is_sampled {
            PIXEL_VARIANCE_PX2
        } else {
            PIXEL_VARIANCE_PX2 * (1.0 + slope * widened_slope)
        };
        let variance = (1.0 / sharp - taken).max(least);
        let per_sigma = 1.0 / spread.sqrt();
        let whole = if is_sampled {
            CDF_WHOLE * FRAC_1_SQRT_2PI * per_sigma
        } else {
            CDF_WHOLE * CDF_WHOLE
        };
        Some(Self {
            has_rows,
            is_sampled,
            mass: mass * whole,
            sigma: spread.sqrt(),
            per_sigma,
            slope,
            variance,
            per_across: 1.0 / variance.sqrt(),
        })
    }

    /// Returns the band whose middle lies `d` px from the centre.
    #[inline(always)]
    pub(crate) fn band<const FMA: bool>(&self, d: f32) -> Band {
        if self.is_sampled {
            let t = d * self.per_sigma;
            return Band {
                mass: self.mass * exp_minus_half::<FMA>((t * t).min(49.0)),
                mean: self.slope * d,
                per_sigma: self.per_across,
            };
        }
        let (begin, end) = ((d - 0.5) * self.per_sigma, (d + 0.5) * self.per_sigma);
        let mass = self.mass * (cdf_near::<FMA>(end) - cdf_near::<FMA>(begin));
        let (begin, end) = (begin.max(-BAND_REACH), end.min(BAND_REACH));
        if self.slope == 0.0 || !(begin < end) {
            return Band {
                mass,
                mean: 0.0,
                per_sigma: self.per_across,
            };
        }
        let (middle, half) = (0.5 * (begin + end), 0.5 * (end - begin));
        // Position in the band at which the density is greatest.
        let top = begin.max(end.min(0.0));
        let (mut sum, mut first, mut second) = (0.0, 0.0, 0.0);
        for [node, weight] in BAND_NODES {
            let u = node * half;
            let (before, behind) = (middle - u, middle + u);
            let least = top * top;
            let low = weight * exp_minus_half::<FMA>((before * before - least).max(0.0));
            let high = weight * exp_minus_half::<FMA>((behind * behind - least).max(0.0));
            sum += low + high;
            first = madd::<FMA>(u, high - low, first);
            second = madd::<FMA>(u * u, high + low, second);
        }
        let mean = first / sum;
        let spread = (second / sum - mean * mean).max(0.0);
        let scale = self.slope * self.sigma;
        let variance = madd::<FMA>(scale * scale, spread, self.variance);
        Band {
            mass,
            mean: scale * (middle + mean),
            per_sigma: 1.0 / variance.sqrt(),
        }
    }

    /// Returns the mean over the pixel whose centre lies `d` from the footprint's, px.
    #[inline(always)]
    pub(crate) fn at<const FMA: bool>(&self, d: [f32; 2]) -> f32 {
        let (along, across) = match self.has_rows {
            true => (d[1], d[0]),
            false => (d[0], d[1]),
        };
        self.band::<FMA>(along).at::<FMA>(across)
    }
}

impl Band {
    /// Returns the mean over the pixel whose centre lies `d` px across from the footprint's.
    #[inline(always)]
    pub(crate) fn at<const FMA: bool>(&self, d: f32) -> f32 {
        let begin = ((d - 0.5) - self.mean) * self.per_sigma;
        let end = ((d + 0.5) - self.mean) * self.per_sigma;
        self.mass * (cdf_near::<FMA>(end) - cdf_near::<FMA>(begin))
    }
}
