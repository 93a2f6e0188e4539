//! Computes exact perspective footprints: five floats in addition to the affine footprint.
//!
//! Let D = D0 + (dx/fx, dy/fy, 0) be the ray through the pixel at offset d from the centre. Then w(d) =
//! DᵀKD / D0ᵀKD0 for K = adj(V + low-pass), and the line integral of the kernel is q = q0 |D|/|D0|
//! w^(-1/2) exp(-Q/(2w)), with Q the affine form. This is verified to 2e-12 in f64. The error in f32 is
//! at most 6e-6 of the peak plus four epsilon times the footprint's axis ratio: 1.8e-5 for needles of
//! 1:10,000 (`tests/frames/footprint_laws.rs`).
//!
//! Twin: `shaders/shared/exact.wgsl`.

use glam::Vec2;

use super::footprint::ScreenFactor;
use crate::record::{ExactTerms, ViewUniform};

/// Returns the coefficients of w(d).
///
/// For each pair of factor columns, D . (f_i x f_j) is m + dx a + dy b with m, a, b minors of the 3-row
/// matrix (T; s), s the relative depth. Hence w is a sum of squares of these over the determinant. The
/// low-pass filter adds the columns (h, 0, 0) and (0, h, 0).
///
/// - `h2`: low-pass variance, px².
/// - `determinant`: determinant of the low-passed footprint.
#[inline(always)]
pub fn exact_terms(screen: &ScreenFactor, h2: f32, determinant: f32) -> ExactTerms {
    let (x, y, s) = (screen.row_x, screen.row_y, screen.relative_depth);
    let (m, a, b) = (x.cross(y), y.cross(s), s.cross(x));
    let inv = 1.0 / determinant;
    let low_pass = h2 * s.length_squared();
    ExactTerms {
        gradient: [
            2.0 * inv * (m.dot(a) - h2 * x.dot(s)),
            2.0 * inv * (m.dot(b) - h2 * y.dot(s)),
        ],
        hessian: [
            inv * (a.length_squared() + low_pass),
            inv * 2.0 * a.dot(b),
            inv * (b.length_squared() + low_pass),
        ],
        depth_sigma: 0.0,
        edges: 0,
    }
}

/// Returns the change of a kernel's depth across its footprint, and its spread along a ray. The first is
/// the change per pixel of the mean z* of z along the ray, to first order. The second is the standard
/// deviation of z. World units.
///
/// With c the covariance of pixel and depth and S the variance of the low-passed footprint, they are S⁻¹
/// c and sqrt(V_zz - cᵀ S⁻¹ c), the latter as a sum of squares over the determinant. On the exact path
/// both follow w: z* = z (1 + g . d / 2) / w, sigma / sqrt(w).
///
/// - `h2`: low-pass variance, px².
/// - `determinant`: determinant of the low-passed footprint.
#[inline(always)]
pub fn depth_terms(
    view: &ViewUniform,
    screen: &ScreenFactor,
    h2: f32,
    determinant: f32,
    depth: f32,
) -> (Vec2, f32) {
    let (x, y, s) = (screen.row_x, screen.row_y, screen.relative_depth);
    let (m, xs, ys) = (x.cross(y), x.cross(s), y.cross(s));
    let inv = 1.0 / determinant;
    // Minors, not products of squares, which would cancel for long kernels.
    let slope = Vec2::new(h2 * x.dot(s) - m.dot(ys), h2 * y.dot(s) + m.dot(xs)) * inv;
    let triple = m.dot(s);
    let squares = triple * triple
        + h2 * (xs.length_squared() + ys.length_squared())
        + h2 * h2 * s.length_squared();
    // `relative_depth` is relative under perspective only.
    let scale = if view.orthographic != 0 { 1.0 } else { depth };
    (slope * scale, (squares * inv).sqrt() * scale)
}

/// Returns the bounding box of the cut-off ellipsoid's outline on the image: its middle relative to the
/// kernel's centre, and its half extents, pixels.
///
/// C = r² V - u uᵀ, x-range (C02 ± sqrt(C02² - C00 C22))/C22, rewritten relative to the centre so that
/// nothing cancels. `None` if the ellipsoid reaches the camera plane (r |s| >= 1): its outline is
/// unbounded.
#[inline(always)]
pub fn exact_extent(screen: &ScreenFactor, h2: f32, r: f32) -> Option<(Vec2, Vec2)> {
    let s = screen.relative_depth;
    let ss = s.length_squared();
    let in_front = 1.0 - r * r * ss;
    // Phrased so that NaN gives none.
    if !(in_front > 1e-6) {
        return None;
    }
    let axis = |row: glam::Vec3| {
        let spread = row.length_squared() + h2;
        let miss = row.cross(s).length_squared() + h2 * ss;
        let half = r * (spread - r * r * miss).max(0.0).sqrt() / in_front;
        (-r * r * s.dot(row) / in_front, half)
    };
    let (x, half_x) = axis(screen.row_x);
    let (y, half_y) = axis(screen.row_y);
    Some((Vec2::new(x, y), Vec2::new(half_x, half_y)))
}
