//! Evaluates affine footprints: EWA and all simpler filters. tau = tau0 exp(-Q/2), Q = (p . d)² + (r .
//! d)².
//!
//! Twin: `shaders/tile/evaluate/affine.wgsl`.

use super::{Row, RowSlope, Walk};
use crate::constants::TILE_SIZE;
use crate::math::lane::{exp_minus_half, madd};
use crate::record::{ExactTerms, Footprint};

/// The quadratic form along a row.
#[derive(Debug, Clone, Copy)]
pub(in crate::cpu::tile) struct RowForm {
    px: f32,
    rx: f32,
    p_row: f32,
    r_row: f32,
}

impl RowForm {
    /// Prepares the row at `dy` from the centre.
    #[inline(always)]
    pub(in crate::cpu::tile) fn new(footprint: &Footprint, dy: f32) -> Self {
        let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
        Self {
            px,
            rx,
            p_row: py * dy,
            r_row: ry * dy,
        }
    }

    /// Returns Q at `dx` from the centre.
    #[inline(always)]
    pub(in crate::cpu::tile) fn q<const FMA: bool>(&self, dx: f32) -> f32 {
        let p = madd::<FMA>(self.px, dx, self.p_row);
        let r = madd::<FMA>(self.rx, dx, self.r_row);
        madd::<FMA>(p, p, r * r)
    }
}

/// Evaluates row `y`. The depth is linear over the image, its standard deviation constant.
#[inline(always)]
pub(super) fn row<const FMA: bool>(walk: &Walk<'_>, terms: &ExactTerms, y: usize) -> Row {
    // A copy: a load through a reference would prevent vector code.
    let footprint = &{ *walk.footprint };
    let [gx, gy] = terms.gradient;
    let per_sigma = 1.0 / terms.depth_sigma.max(f32::MIN_POSITIVE);
    let dy = walk.dy(y);
    let form = RowForm::new(footprint, dy);
    let mut row = Row::new(footprint, y);
    for lane in 0..TILE_SIZE {
        let dx = walk.dx(lane);
        let q = form.q::<FMA>(dx);
        // NaN compares false: outside.
        let is_inside = q <= walk.limits[lane];
        let tau = footprint.tau * exp_minus_half::<FMA>(q);
        row.tau[lane] = if is_inside { tau } else { 0.0 };
        // Rounded like the twin: it matters to needles.
        row.beyond[lane] = gx * dx + gy * dy;
        row.per_sigma[lane] = per_sigma;
        row.inside[lane] = u32::from(is_inside);
    }
    row.count = row.inside.iter().sum();
    row
}

/// Returns the derivatives of the kernel along row `y`.
#[inline(always)]
pub(super) fn slope(walk: &Walk<'_>, terms: &ExactTerms, y: usize) -> RowSlope {
    let ([px, py], [rx, ry]) = (walk.footprint.form_p, walk.footprint.form_r);
    let [gx, gy] = terms.gradient;
    let dy = walk.dy(y);
    let mut out = RowSlope {
        log_tau: [[0.0; TILE_SIZE]; 2],
        mean: [[gx; TILE_SIZE], [gy; TILE_SIZE]],
    };
    for lane in 0..TILE_SIZE {
        let dx = walk.dx(lane);
        let (p, r) = (px * dx + py * dy, rx * dx + ry * dy);
        out.log_tau[0][lane] = -(p * px + r * rx);
        out.log_tau[1][lane] = -(p * py + r * ry);
    }
    out
}

/// Returns whether the axes of a footprint are the image's: each row of its form has one nonzero number.
#[inline(always)]
pub(in crate::cpu::tile) fn is_aligned(footprint: &Footprint) -> bool {
    let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
    (py == 0.0 && rx == 0.0) || (px == 0.0 && ry == 0.0)
}
