//! Bounds the errors of the approximations. The bounds are conservative: they rest on the evidence of
//! thousands of random kernels, not on proof. `tests/frames/bounds.rs` repeats the experiment.
//!
//! Twin: `shaders/shared/bounds.wgsl`.

use glam::Vec2;

use super::footprint::{ImageKernel, ScreenFactor};
use crate::math::lane::{hypot, ln};
use crate::record::{ExactTerms, ViewUniform};

/// Bound on max |affine - exact| / peak of one footprint.
///
/// With S the low-passed footprint variance, S = L Lᵀ, gamma = Lᵀ g and
/// a = Lᵀ (x_k/f)/(1 + |x_k|²):
/// B = min(.58 |gamma| + .607 |a - gamma/2|, .409 |gamma| + .607 |a|)
///   + 1.1 l_max(Lᵀ H L) + .4 l_max(S/f²)/(1 + |x_k|²). Median slack 1.12.
#[inline(always)]
pub fn affine_error(
    view: &ViewUniform,
    screen: &ScreenFactor,
    kernel: &ImageKernel,
    terms: &ExactTerms,
) -> f32 {
    let Whitened {
        gamma,
        growth,
        angle,
        ..
    } = Whitened::new(view, screen, kernel, terms);
    let linear = (0.58 * gamma.length() + 0.607 * (growth - gamma * 0.5).length())
        .min(0.409 * gamma.length() + 0.607 * growth.length());
    let [l0, l1, l2] = lower_factor(kernel);
    let [hxx, hxy, hyy] = terms.hessian;
    let hxy = 0.5 * hxy;
    let (m0, m1) = (hxx * l0 + hxy * l1, hxy * l0 + hyy * l1);
    let curvature = largest_eigenvalue(l0 * m0 + l1 * m1, l2 * m1, hyy * l2 * l2);
    linear + 1.1 * curvature + 0.4 * angle
}

/// Bound on the amount by which the exact footprint exceeds exp(-r²/2) of its centre on the outline of
/// its cut-off `r`. There Q = r² w, and the factor |D|/|D0| w^(-1/2) remains.
///
/// With d = r sqrt(w) L e, |e| = 1, and u = w^(-1/2), which solves u² + r gamma.e u = 1 - r² eᵀLᵀHLe:
/// |D|²/|D0|²/w = 1 + 2 r u (a - gamma/2).e + r² (eᵀLᵀ(1/f²)Le/(1 + |x_k|²) - eᵀLᵀHLe)
///   <= 1 + 2 r |a - gamma/2| u_max + r² l_max(S/f²)/(1 + |x_k|²),
/// u_max = (r |gamma| + sqrt(r² |gamma|² + 4))/2. The letters are those of [`affine_error`].
#[inline(always)]
pub fn edge_growth(
    view: &ViewUniform,
    screen: &ScreenFactor,
    kernel: &ImageKernel,
    terms: &ExactTerms,
    r: f32,
) -> f32 {
    let Whitened {
        gamma,
        growth,
        angle,
    } = Whitened::new(view, screen, kernel, terms);
    let half = 0.5 * r * gamma.length();
    let u = half + hypot(half, 1.0);
    (1.0 + 2.0 * r * (growth - gamma * 0.5).length() * u + r * r * angle).sqrt()
}

/// The terms of perspective in units of the footprint's standard deviations.
struct Whitened {
    /// Lᵀ g.
    gamma: Vec2,
    /// a, the growth of |D|/|D0|.
    growth: Vec2,
    /// l_max(S/f²)/(1 + |x_k|²).
    angle: f32,
}

impl Whitened {
    #[inline(always)]
    fn new(
        view: &ViewUniform,
        screen: &ScreenFactor,
        kernel: &ImageKernel,
        terms: &ExactTerms,
    ) -> Self {
        let [l0, l1, l2] = lower_factor(kernel);
        let transposed = |v: Vec2| Vec2::new(l0 * v.x + l1 * v.y, l2 * v.y);
        let focal = Vec2::from(view.focal_px);
        let ray_squared = screen.ray_length * screen.ray_length;
        let angle = largest_eigenvalue(
            kernel.a / (focal.x * focal.x),
            kernel.b / (focal.x * focal.y),
            kernel.c / (focal.y * focal.y),
        );
        Self {
            gamma: transposed(Vec2::from(terms.gradient)),
            growth: transposed(screen.slope / focal / ray_squared),
            angle: angle / ray_squared,
        }
    }
}

/// L = (l0 0; l1 l2) of the footprint's variance.
#[inline(always)]
fn lower_factor(kernel: &ImageKernel) -> [f32; 3] {
    let l0 = kernel.a.sqrt();
    [l0, kernel.b / l0, (kernel.determinant / kernel.a).sqrt()]
}

/// Returns the factor that turns [`affine_error`] into the error of the opacity 1 - exp(-tau). `tau` is
/// the optical depth at the centre.
///
/// For tau below 1 the factor is tau. For larger tau the error moves the edge of an opaque kernel, which
/// lies near r = sqrt(2 ln tau). There the terms of the affine error have grown to r³/2 (the gradient of
/// w) and r⁴/2 (its Hessian, which remains on the axis), against .58 and 1.1 where they peak. With x
/// exp(-x) <= 1/e at the edge the factors are .32 r³ and .17 r⁴. Terms that partly cancel, and the
/// breadth of the edge, raise them to .43 r³ and .18 r⁴. (1 + .33 r³ was tried: exceeded 1.25 times at
/// tau = 1,000 off the axis, 1.8 times on it.)
#[inline(always)]
pub fn opacity_amplification(tau: f32) -> f32 {
    if tau < 1.0 {
        tau
    } else {
        let r = (2.0 * ln(tau)).sqrt();
        1.0 + 0.43 * (r * r * r) * (0.42 * r).max(1.0)
    }
}

#[inline(always)]
fn largest_eigenvalue(a: f32, b: f32, c: f32) -> f32 {
    0.5 * (a + c) + hypot(0.5 * (a - c), b)
}
