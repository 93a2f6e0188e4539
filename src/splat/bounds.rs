//! What an approximation costs at most. Conservative bounds: evidence of thousands of random
//! kernels, not proof; `tests/footprint_laws.rs` draws them again.

use glam::Vec2;

use super::footprint::{ImageKernel, ScreenFactor};
use crate::layout::{ExactTerms, ViewUniform};

/// Bound on max |affine - exact| / peak of one footprint.
///
/// With S the low-passed footprint variance, S = L Lᵀ, gamma = Lᵀ g and
/// a = Lᵀ (x_k/f)/(1 + |x_k|²):
/// B = min(.58 |gamma| + .607 |a - gamma/2|, .409 |gamma| + .607 |a|)
///   + 1.1 l_max(Lᵀ H L) + .4 l_max(S/f²)/(1 + |x_k|²). Median slack 1.12.
#[inline]
pub fn affine_error(
    view: &ViewUniform,
    screen: &ScreenFactor,
    kernel: &ImageKernel,
    terms: &ExactTerms,
) -> f32 {
    let ImageKernel {
        a,
        b,
        c,
        determinant,
        ..
    } = *kernel;
    // L lower triangular: (l0 0; l1 l2).
    let l0 = a.sqrt();
    let l1 = b / l0;
    let l2 = (determinant / a).sqrt();
    let transposed = |v: Vec2| Vec2::new(l0 * v.x + l1 * v.y, l2 * v.y);
    let focal = Vec2::from(view.focal_px);
    let ray_squared = screen.ray_length * screen.ray_length;
    let gamma = transposed(Vec2::from(terms.gradient));
    let growth = transposed(screen.slope / focal / ray_squared);
    let linear = (0.58 * gamma.length() + 0.607 * (growth - gamma * 0.5).length())
        .min(0.409 * gamma.length() + 0.607 * growth.length());

    let [hxx, hxy, hyy] = terms.hessian;
    let hxy = 0.5 * hxy;
    let (m0, m1) = (hxx * l0 + hxy * l1, hxy * l0 + hyy * l1);
    let curvature = largest_eigenvalue(l0 * m0 + l1 * m1, l2 * m1, hyy * l2 * l2);
    let angle = largest_eigenvalue(
        a / (focal.x * focal.x),
        b / (focal.x * focal.y),
        c / (focal.y * focal.y),
    );
    linear + 1.1 * curvature + 0.4 * angle / ray_squared
}

/// What [`affine_error`] is to be multiplied by for the error of the opacity 1 - exp(-tau), `tau`
/// being the optical depth at the centre.
///
/// tau below 1. Above, the error moves the edge of an opaque kernel, which lies near
/// r = sqrt(2 ln tau): there the terms of the affine error have grown to r³/2 (the gradient of w)
/// and r⁴/2 (its Hessian, what remains on the axis), against .58 and 1.1 where they peak. With
/// x exp(-x) <= 1/e at the edge that is .32 r³ and .17 r⁴; terms that partly cancel, and the
/// breadth of the edge, ask for .43 r³ and .18 r⁴. (1 + .33 r³ was tried: exceeded 1.25 times at
/// tau = 1,000 off the axis, 1.8 times on it.)
#[inline]
pub fn opacity_amplification(tau: f32) -> f32 {
    if tau < 1.0 {
        tau
    } else {
        let r = (2.0 * tau.ln()).sqrt();
        1.0 + 0.43 * r.powi(3) * (0.42 * r).max(1.0)
    }
}

#[inline]
fn largest_eigenvalue(a: f32, b: f32, c: f32) -> f32 {
    0.5 * (a + c) + (0.5 * (a - c)).hypot(b)
}
