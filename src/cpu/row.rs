//! A footprint along a row of a tile: optical depths and where along the rays they lie, what cut kernels
//! and layers need of each pixel.

use super::lanes::{Patch, cdf, exp_minus_half, madd};
use crate::constants::TILE_SIZE;
use crate::layout::{ExactTerms, Footprint, PATH_EXACT};

/// A footprint on its way through the rows of a tile.
pub(super) struct RowWalk<'a> {
    footprint: &'a Footprint,
    terms: &'a ExactTerms,
    first: [f32; 2],
    /// Of each column; negative beside the patch, where nothing is within the cut-off.
    limits: [f32; TILE_SIZE],
}

/// What its pixels have.
pub(super) struct Row {
    /// Optical depths; 0 outside.
    pub(super) tau: [f32; TILE_SIZE],
    /// Mean z of the kernel along each ray.
    pub(super) depth: [f32; TILE_SIZE],
    /// One over the standard deviation of z.
    pub(super) per_sigma: [f32; TILE_SIZE],
    /// 1 within the cut-off.
    pub(super) inside: [u32; TILE_SIZE],
    /// How many are within it.
    pub(super) count: u32,
}

/// How a footprint changes from pixel to pixel of a row: along the columns and the rows of the image.
pub(super) struct RowSlope {
    /// The logarithm of its optical depth.
    pub(super) log_tau: [[f32; TILE_SIZE]; 2],
    /// Its mean z.
    pub(super) mean: [[f32; TILE_SIZE]; 2],
}

impl<'a> RowWalk<'a> {
    #[inline(always)]
    pub(super) fn new(footprint: &'a Footprint, terms: &'a ExactTerms, patch: Patch) -> Self {
        let mut limits = [-1.0; TILE_SIZE];
        limits[patch.columns[0]..patch.columns[1]].fill(footprint.cutoff_squared);
        let first = |i: usize| patch.first_px[i] - footprint.centre_px[i];
        Self {
            footprint,
            terms,
            first: [first(0), first(1)],
            limits,
        }
    }

    /// Row `y` of the tile.
    ///
    /// - `ray_length`: of its pixels; read on the exact path alone.
    #[inline(always)]
    pub(super) fn row<const FMA: bool>(&self, y: usize, ray_length: &[f32]) -> Row {
        if self.footprint.path == PATH_EXACT {
            self.row_of::<FMA, true>(y, ray_length)
        } else {
            self.row_of::<FMA, false>(y, ray_length)
        }
    }

    #[inline(always)]
    fn row_of<const FMA: bool, const EXACT: bool>(&self, y: usize, ray_length: &[f32]) -> Row {
        let (footprint, terms) = (self.footprint, self.terms);
        let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
        let ([gx, gy], [hxx, hxy, hyy]) = (terms.gradient, terms.hessian);
        let flat_per_sigma = 1.0 / terms.depth_sigma.max(f32::MIN_POSITIVE);
        let dy = self.first[1] + y as f32;
        let mut row = Row {
            tau: [0.0; TILE_SIZE],
            depth: [0.0; TILE_SIZE],
            per_sigma: [0.0; TILE_SIZE],
            inside: [0; TILE_SIZE],
            count: 0,
        };
        let Some(ray_length) = ray_length.first_chunk::<TILE_SIZE>() else {
            return row;
        };
        for (lane, length) in ray_length.iter().enumerate() {
            let dx = self.first[0] + lane as f32;
            let p = madd::<FMA>(px, dx, py * dy);
            let r = madd::<FMA>(rx, dx, ry * dy);
            let mut q = madd::<FMA>(p, p, r * r);
            let slope = madd::<FMA>(gx, dx, gy * dy);
            let (mut tau, mut per_sigma) = (footprint.tau, flat_per_sigma);
            let mut z = footprint.depth + slope;
            let mut is_inside = true;
            if EXACT {
                let w = 1.0 + slope + dx * (hxx * dx + hxy * dy) + hyy * dy * dy;
                let root = w.sqrt();
                q /= w;
                tau *= length / root;
                per_sigma *= root;
                z = footprint.depth * (1.0 + 0.5 * slope) / w;
                is_inside = w > 0.0;
            }
            // NaN compares false: outside.
            is_inside &= q <= self.limits[lane];
            row.tau[lane] = if is_inside {
                tau * exp_minus_half::<FMA>(q)
            } else {
                0.0
            };
            row.depth[lane] = z;
            row.per_sigma[lane] = per_sigma;
            row.inside[lane] = u32::from(is_inside);
        }
        row.count = row.inside.iter().sum();
        row
    }
}

impl RowWalk<'_> {
    /// How the footprint changes along row `y` of the tile. Of the exact path without what all kernels
    /// have in common, the length of the ray, and without the change of `per_sigma`.
    #[inline(always)]
    pub(super) fn slope(&self, y: usize) -> RowSlope {
        let (footprint, terms) = (self.footprint, self.terms);
        let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
        let ([gx, gy], [hxx, hxy, hyy]) = (terms.gradient, terms.hessian);
        let dy = self.first[1] + y as f32;
        let mut out = RowSlope {
            log_tau: [[0.0; TILE_SIZE]; 2],
            mean: [[gx; TILE_SIZE], [gy; TILE_SIZE]],
        };
        let is_exact = footprint.path == PATH_EXACT;
        for lane in 0..TILE_SIZE {
            let dx = self.first[0] + lane as f32;
            let (p, r) = (px * dx + py * dy, rx * dx + ry * dy);
            let mut log_tau = [-(p * px + r * rx), -(p * py + r * ry)];
            if is_exact {
                let slope = gx * dx + gy * dy;
                let w = 1.0 + slope + dx * (hxx * dx + hxy * dy) + hyy * dy * dy;
                let w_slope = [
                    gx + 2.0 * hxx * dx + hxy * dy,
                    gy + hxy * dx + 2.0 * hyy * dy,
                ];
                let q = (p * p + r * r) / w;
                for (k, g) in [gx, gy].into_iter().enumerate() {
                    log_tau[k] = (log_tau[k] + (0.5 * q - 0.5) * w_slope[k]) / w;
                    let mean = 0.5 * g - (1.0 + 0.5 * slope) / w * w_slope[k];
                    out.mean[k][lane] = footprint.depth / w * mean;
                }
            }
            for (plane, d) in out.log_tau.iter_mut().zip(log_tau) {
                plane[lane] = d;
            }
        }
        out
    }
}

impl Row {
    /// The optical depths between two shares of each.
    #[inline(always)]
    pub(super) fn between(
        &self,
        from: &[f32; TILE_SIZE],
        to: &[f32; TILE_SIZE],
    ) -> [f32; TILE_SIZE] {
        let mut taus = [0.0; TILE_SIZE];
        for lane in 0..TILE_SIZE {
            // `max` takes the other argument where one is NaN.
            taus[lane] = self.tau[lane] * (to[lane] - from[lane]).max(0.0);
        }
        taus
    }

    /// The share of each pixel's optical depth that lies in front of a depth of its own.
    ///
    /// - `is_peak`: of a splat that states its opacity: all or nothing.
    #[inline(always)]
    pub(super) fn shares_up_to<const FMA: bool>(
        &self,
        depths: &[f32],
        is_peak: bool,
    ) -> [f32; TILE_SIZE] {
        let mut shares = [0.0; TILE_SIZE];
        let Some(depths) = depths.first_chunk::<TILE_SIZE>() else {
            return shares;
        };
        for lane in 0..TILE_SIZE {
            let ahead = (depths[lane] - self.depth[lane]) * self.per_sigma[lane];
            let share = if is_peak {
                f32::from(u8::from(ahead > 0.0))
            } else {
                cdf::<FMA>(ahead)
            };
            // NaN lies behind.
            shares[lane] = if share > 0.0 { share } else { 0.0 };
        }
        shares
    }
}
