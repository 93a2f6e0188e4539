//! Kernels that cross the camera plane: the direct line integral along the half line in front of
//! the eye. No affine footprint, no clamp of the Jacobian.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::footprint::Kernel;
use crate::layout::{NearTerms, ViewUniform};
use crate::math::normal_cdf;

/// What [`evaluate_near`] needs, and the kernel's weight g/(2 pi) in the same units; `None` where
/// the kernel has no volume to speak of (a point or a rod without low-pass filter).
///
/// The low-pass filter of such a kernel is that of its root mean square depth,
/// sqrt(u2² + V_zz), which is u2 again far from the plane.
pub fn near_terms(view: &ViewUniform, kernel: &Kernel) -> Option<(NearTerms, f32)> {
    // Units of the kernel's own size: V² would underflow or overflow at the scale of some scenes.
    let [c0, c1, c2] = kernel.factor.columns();
    let unit = c0
        .abs()
        .max(c1.abs())
        .max(c2.abs())
        .max(kernel.centre.abs())
        .max_element();
    if !(unit > 0.0 && unit.is_finite()) {
        return None;
    }
    let scale = 1.0 / unit;
    let u = kernel.centre * scale;
    let (c0, c1, c2) = (c0 * scale, c1 * scale, c2 * scale);
    let mean_depth = (u.z * u.z + c0.z * c0.z + c1.z * c1.z + c2.z * c2.z).sqrt();
    let h = view.low_pass_variance_px2.sqrt() * mean_depth;
    let columns = [
        c0,
        c1,
        c2,
        Vec3::X * (h / view.focal_px[0]),
        Vec3::Y * (h / view.focal_px[1]),
    ];

    // Sums of squares only: N, K = adj(V) and det V by Cauchy-Binet.
    let mut miss = [0.0; 6];
    let mut adjugate = [0.0; 6];
    let mut determinant = 0.0;
    for (i, f) in columns.iter().enumerate() {
        add_outer(&mut miss, f.cross(u));
        for (j, g) in columns.iter().enumerate().skip(i + 1) {
            let minor = f.cross(*g);
            add_outer(&mut adjugate, minor);
            for k in &columns[j + 1..] {
                determinant += minor.dot(*k).powi(2);
            }
        }
    }
    if !(adjugate[0] + adjugate[3] + adjugate[5] > 0.0) {
        return None;
    }
    let depth = symmetric_times(&adjugate, u);
    let terms = NearTerms {
        miss,
        adjugate,
        depth: depth.into(),
        sigma: determinant.sqrt(),
    };
    Some((terms, kernel.mass * scale * scale / TAU))
}

/// Optical depth of the kernel along the half line t D, t > 0, D = (X, Y, 1), cut off at
/// Q > `cutoff_squared`.
///
/// tau = g |D| / (2 pi sqrt(DᵀKD)) exp(-Q/2) Phi(z*/sigma_z).
#[inline]
pub fn evaluate_near(terms: &NearTerms, weight: f32, direction: Vec3, cutoff_squared: f32) -> f32 {
    let across = quadratic(&terms.adjugate, direction);
    let q = quadratic(&terms.miss, direction) / across;
    // Phrased so that NaN gives nothing.
    if !(q <= cutoff_squared) {
        return 0.0;
    }
    let root = across.sqrt();
    // z*/sigma_z = (D . k / DᵀKD) / (sigma / sqrt(DᵀKD)); a flat kernel lies wholly on one side.
    let behind =
        direction.dot(Vec3::from(terms.depth)) / (root * terms.sigma.max(f32::MIN_POSITIVE));
    weight * direction.length() / root * (-0.5 * q).exp() * normal_cdf(behind)
}

/// For an orthographic camera: the kernel's depth along the ray at offset d is
/// z* = u2 + g . d with a constant standard deviation. `low-passed` (a, b, c, det) as in the
/// footprint.
pub fn half_line_terms(
    view: &ViewUniform,
    kernel: &Kernel,
    [a, b, c, determinant]: [f32; 4],
) -> NearTerms {
    let focal = Vec2::from(view.focal_px);
    let z = kernel.factor.z;
    let zx = z.dot(kernel.factor.x) * focal.x;
    let zy = z.dot(kernel.factor.y) * focal.y;
    let gx = (c * zx - b * zy) / determinant;
    let gy = (a * zy - b * zx) / determinant;
    let variance = z.length_squared() - (gx * zx + gy * zy);
    NearTerms {
        depth: [gx, gy, kernel.centre.z],
        sigma: variance.max(0.0).sqrt(),
        ..NearTerms::default()
    }
}

#[inline]
fn add_outer(m: &mut [f32; 6], v: Vec3) {
    let products = [
        v.x * v.x,
        v.x * v.y,
        v.x * v.z,
        v.y * v.y,
        v.y * v.z,
        v.z * v.z,
    ];
    for (m, p) in m.iter_mut().zip(products) {
        *m += p;
    }
}

#[inline]
fn symmetric_times(m: &[f32; 6], v: Vec3) -> Vec3 {
    let [xx, xy, xz, yy, yz, zz] = *m;
    Vec3::new(
        xx * v.x + xy * v.y + xz * v.z,
        xy * v.x + yy * v.y + yz * v.z,
        xz * v.x + yz * v.y + zz * v.z,
    )
}

#[inline]
fn quadratic(m: &[f32; 6], v: Vec3) -> f32 {
    symmetric_times(m, v).dot(v)
}
