//! Kernels that cross the camera plane: the direct line integral along the half line in front of
//! the eye. No affine footprint, no clamp of the Jacobian.
//!
//! Twin: `shaders/shared/near.wgsl`.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::footprint::Kernel;
use crate::math::normal_cdf;
use crate::record::{NearTerms, ViewUniform};

/// What [`evaluate_near`] needs, and the kernel's weight g/(2 pi) in the same units; `None` where
/// the kernel has no volume to speak of (a point or a rod without low-pass filter).
///
/// The low-pass filter of such a kernel is that of its depth u2, as on the exact path, but no
/// less than that of a standard deviation of its depth: in the plane itself it is not nothing.
pub fn near_terms(view: &ViewUniform, kernel: &Kernel) -> Option<(NearTerms, f32)> {
    // Units of the kernel's own size: squares of it would underflow or overflow at the scale of
    // some scenes.
    let [c0, c1, c2] = kernel.factor.columns();
    let unit = [c0, c1, c2, kernel.centre]
        .iter()
        .map(|v| v.abs().max_element())
        .fold(0.0, f32::max);
    if !(unit > 0.0 && unit.is_finite()) {
        return None;
    }
    let scale = 1.0 / unit;
    let u = kernel.centre * scale;
    let depth = u.z.abs().max(kernel.factor.z.length() * scale);
    let h = view.low_pass_variance_px2.sqrt() * depth;
    let columns = [
        c0 * scale,
        c1 * scale,
        c2 * scale,
        Vec3::X * (h / view.focal_px[0]),
        Vec3::Y * (h / view.focal_px[1]),
    ];

    let mut terms = NearTerms::default();
    let mut pair = 0;
    let mut determinant = 0.0;
    let mut any_minor = false;
    for (i, f) in columns.iter().enumerate() {
        terms.misses[i] = f.cross(u).into();
        for (j, g) in columns.iter().enumerate().skip(i + 1) {
            let minor = f.cross(*g);
            any_minor |= minor != Vec3::ZERO;
            terms.minors[pair] = minor.into();
            terms.minor_depths[pair] = minor.dot(u);
            pair += 1;
            for k in &columns[j + 1..] {
                determinant += minor.dot(*k).powi(2);
            }
        }
    }
    terms.sigma = determinant.sqrt();
    terms.unit = unit;
    any_minor.then_some((terms, kernel.mass * scale * scale / TAU))
}

/// Optical depth of the kernel along the half line t D, t > 0, D = (X, Y, 1), cut off at
/// Q > `cutoff_squared`.
///
/// tau = g |D| / (2 pi sqrt(DᵀKD)) exp(-Q/2) Phi(z*/sigma_z), K = adj(V). Q and DᵀKD are sums of
/// squares of one dot product per column and pair of columns of the factor: with V or K formed,
/// the error would grow with the square of the axis ratio.
#[inline]
pub fn evaluate_near(terms: &NearTerms, weight: f32, direction: Vec3, cutoff_squared: f32) -> f32 {
    let (across, along) = minors_along(terms, direction);
    let miss: f32 = terms
        .misses
        .iter()
        .map(|f| direction.dot(Vec3::from(*f)).powi(2))
        .sum();
    let q = miss / across;
    // Phrased so that NaN gives nothing.
    if !(q <= cutoff_squared) {
        return 0.0;
    }
    let root = across.sqrt();
    // z*/sigma_z = (along / across) / (sigma / root); a flat kernel lies wholly on one side.
    let behind = along / (root * terms.sigma).max(f32::MIN_POSITIVE);
    weight * direction.length() / root * (-0.5 * q).exp() * normal_cdf(behind)
}

/// DᵀKD, and its product with the mean depth z*.
#[inline]
fn minors_along(terms: &NearTerms, direction: Vec3) -> (f32, f32) {
    let mut across = 0.0;
    let mut along = 0.0;
    for (minor, depth) in terms.minors.iter().zip(terms.minor_depths) {
        let m = direction.dot(Vec3::from(*minor));
        across += m * m;
        along += m * depth;
    }
    (across, along)
}

/// Of what [`evaluate_near`] finds in front of the eye: the share up to the depth z = `at`.
pub fn near_share(terms: &NearTerms, direction: Vec3, at: f32) -> f32 {
    let (across, along) = minors_along(terms, direction);
    let per_sigma = across.sqrt() / terms.sigma.max(f32::MIN_POSITIVE);
    let mean = along / across;
    let behind_eye = normal_cdf(-mean * per_sigma);
    let up_to = normal_cdf((at / terms.unit - mean) * per_sigma);
    let share = (up_to - behind_eye) / (1.0 - behind_eye);
    if share.is_nan() {
        return 0.0;
    }
    share.clamp(0.0, 1.0)
}

/// For an orthographic camera: the kernel's depth along the ray at offset d is
/// z* = u2 + g . d with a constant standard deviation.
///
/// - `slope`, `sigma`: those of [`depth_terms`](super::depth_terms).
pub fn half_line_terms(kernel: &Kernel, slope: Vec2, sigma: f32) -> NearTerms {
    NearTerms {
        half_line: [slope.x, slope.y, kernel.centre.z],
        sigma,
        ..NearTerms::default()
    }
}
