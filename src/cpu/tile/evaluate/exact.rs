//! Evaluates exact footprints under perspective: tau = tau0 |D| / sqrt(w) exp(-Q / 2w), with w(d) a
//! quadratic of the pixel's offset ([`ExactTerms`]).
//!
//! Twin: `shaders/tile/evaluate/exact.wgsl`.

use super::affine::RowForm;
use super::{Row, RowSlope, Walk};
use crate::constants::TILE_SIZE;
use crate::cpu::tile::pixels::RowOf;
use crate::math::lane::{exp_minus_half, madd};
use crate::record::{ExactTerms, Footprint};

/// Q and w along a row.
#[derive(Debug, Clone, Copy)]
pub(in crate::cpu::tile) struct RowOfExact {
    form: RowForm,
    hxx: f32,
    // w along the row is w_row + dx (w_slope + dx hxx).
    w_row: f32,
    w_slope: f32,
}

/// Values at a pixel.
#[derive(Debug, Clone, Copy)]
pub(in crate::cpu::tile) struct ExactAt {
    /// Q / w.
    pub(in crate::cpu::tile) q: f32,
    /// 1 / w.
    pub(in crate::cpu::tile) inverse: f32,
    /// True if the ray meets the kernel in front of the eye.
    pub(in crate::cpu::tile) is_ahead: bool,
}

impl RowOfExact {
    /// Prepares the row at `dy` from the centre.
    #[inline(always)]
    pub(in crate::cpu::tile) fn new<const FMA: bool>(
        footprint: &Footprint,
        terms: &ExactTerms,
        dy: f32,
    ) -> Self {
        let ([gx, gy], [hxx, hxy, hyy]) = (terms.gradient, terms.hessian);
        Self {
            form: RowForm::new(footprint, dy),
            hxx,
            w_row: madd::<FMA>(dy, madd::<FMA>(dy, hyy, gy), 1.0),
            w_slope: madd::<FMA>(dy, hxy, gx),
        }
    }

    /// Returns the values at `dx` from the centre.
    #[inline(always)]
    pub(in crate::cpu::tile) fn at<const FMA: bool>(&self, dx: f32) -> ExactAt {
        let w = madd::<FMA>(dx, madd::<FMA>(dx, self.hxx, self.w_slope), self.w_row);
        let inverse = 1.0 / w;
        ExactAt {
            q: self.form.q::<FMA>(dx) * inverse,
            inverse,
            is_ahead: w > 0.0,
        }
    }
}

/// Evaluates row `y`. `ray_length` is |D| of its pixels; z* = z (1 + g . d / 2) / w, and sigma_z scales
/// as 1 / sqrt(w).
///
/// The difference z* - z = -z (g . d / 2 + dᵀHd) / w is computed directly, and rounded like the twin: it
/// matters to needles.
#[inline(always)]
pub(super) fn row<const FMA: bool>(
    walk: &Walk<'_>,
    terms: &ExactTerms,
    y: usize,
    ray_length: &RowOf<f32>,
) -> Row {
    // Copies: loads through references would prevent vector code.
    let (footprint, terms) = (&{ *walk.footprint }, &{ *terms });
    let ([gx, gy], [hxx, hxy, hyy]) = (terms.gradient, terms.hessian);
    let per_sigma = 1.0 / terms.depth_sigma.max(f32::MIN_POSITIVE);
    let dy = walk.dy(y);
    let of_row = RowOfExact::new::<FMA>(footprint, terms, dy);
    let mut row = Row::new(footprint, y);
    #[allow(
        clippy::needless_range_loop,
        reason = "one counter for all arrays of a row becomes vector code"
    )]
    for lane in 0..TILE_SIZE {
        let dx = walk.dx(lane);
        let ExactAt {
            q,
            inverse,
            is_ahead,
        } = of_row.at::<FMA>(dx);
        // Without a branch, which would prevent vector code; NaN compares false: outside.
        let is_inside = is_ahead & (q <= walk.limits[lane]);
        let tau = footprint.tau * (ray_length[lane] * inverse.sqrt()) * exp_minus_half::<FMA>(q);
        row.tau[lane] = if is_inside { tau } else { 0.0 };
        let slope = gx * dx + gy * dy;
        let bend = dx * (hxx * dx + hxy * dy) + hyy * dy * dy;
        row.beyond[lane] = -footprint.depth * (0.5 * slope + bend) * inverse;
        row.per_sigma[lane] = per_sigma * (1.0 / inverse).sqrt();
        row.inside[lane] = u32::from(is_inside);
    }
    row.count = row.inside.iter().sum();
    row
}

/// Returns the derivatives of the kernel along row `y`.
#[inline(always)]
pub(super) fn slope(walk: &Walk<'_>, terms: &ExactTerms, y: usize) -> RowSlope {
    let footprint = walk.footprint;
    let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
    let ([gx, gy], [hxx, hxy, hyy]) = (terms.gradient, terms.hessian);
    let dy = walk.dy(y);
    let mut out = RowSlope {
        log_tau: [[0.0; TILE_SIZE]; 2],
        mean: [[0.0; TILE_SIZE]; 2],
    };
    for lane in 0..TILE_SIZE {
        let dx = walk.dx(lane);
        let (p, r) = (px * dx + py * dy, rx * dx + ry * dy);
        let of_form = [-(p * px + r * rx), -(p * py + r * ry)];
        let slope = gx * dx + gy * dy;
        let w = 1.0 + slope + dx * (hxx * dx + hxy * dy) + hyy * dy * dy;
        let w_slope = [
            gx + 2.0 * hxx * dx + hxy * dy,
            gy + hxy * dx + 2.0 * hyy * dy,
        ];
        let q = (p * p + r * r) / w;
        for (k, g) in [gx, gy].into_iter().enumerate() {
            out.log_tau[k][lane] = (of_form[k] + (0.5 * q - 0.5) * w_slope[k]) / w;
            let mean = 0.5 * g - (1.0 + 0.5 * slope) / w * w_slope[k];
            out.mean[k][lane] = footprint.depth / w * mean;
        }
    }
    out
}
