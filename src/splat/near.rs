//! Evaluates kernels that cross the camera plane, by the direct line integral along the half line in
//! front of the eye. It uses no affine footprint and no clamp of the Jacobian.
//!
//! Twin: `shaders/shared/near.wgsl`.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::footprint::Kernel;
use crate::constants::MAX_CUTOFF;
use crate::math::normal_cdf;
use crate::record::{NearTerms, ViewUniform};

/// Returns the terms that [`evaluate_near`] needs, and the kernel's weight g/(2 pi) in the same units.
/// `None` if the kernel has almost no volume (a point or a rod without low-pass filter).
///
/// The low-pass filter of such a kernel is taken at its depth u2, as on the exact path, but at no less
/// than a standard deviation of its depth. So it does not vanish in the camera plane.
pub fn near_terms(view: &ViewUniform, kernel: &Kernel) -> Option<(NearTerms, f32)> {
    // Units of the kernel's own size: its squares would underflow or overflow at the scale of some
    // scenes.
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

/// Returns the optical depth of the kernel along the half line t D, t > 0, D = (X, Y, 1), cut off at Q >
/// `cutoff_squared`.
///
/// tau = g |D| / (2 pi sqrt(DᵀKD)) exp(-Q/2) Phi(z*/sigma_z), K = adj(V). Q and DᵀKD are sums of squares
/// of one dot product per column and pair of columns of the factor. If V or K were formed, the error
/// would grow with the square of the axis ratio. The result is 0 if the line's mean depth lies
/// [`MAX_CUTOFF`] standard deviations behind the eye: the part in front is 1e-12 of the line's.
///
/// This is the formula for one ray. The rasterisers take rows of rays or the pixels of a tile. Tests
/// compare them with this function, and this function with quadrature.
#[inline]
pub fn evaluate_near(terms: &NearTerms, weight: f32, direction: Vec3, cutoff_squared: f32) -> f32 {
    let (across, along) = minors_along(terms, direction);
    let miss: f32 = terms
        .misses
        .iter()
        .map(|f| direction.dot(Vec3::from(*f)).powi(2))
        .sum();
    let q = miss / across;
    // Phrased so that NaN gives 0.
    if !(q <= cutoff_squared) {
        return 0.0;
    }
    let root = across.sqrt();
    // z*/sigma_z = (along / across) / (sigma / root); a flat kernel lies wholly on one side.
    let behind = along / (root * terms.sigma).max(f32::MIN_POSITIVE);
    if behind < -MAX_CUTOFF {
        return 0.0;
    }
    weight * direction.length() / root * (-0.5 * q).exp() * normal_cdf(behind)
}

/// Returns DᵀKD, and its product with the mean depth z*.
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

/// Returns whether the kernel is invisible in a rectangle of directions: no ray meets it within its
/// cut-off and in front of the eye, so [`evaluate_near`] is 0. The directions are D = `middle` + (x, y,
/// 0), |x| <= `half.x`, |y| <= `half.y`.
///
/// The test is conservative. Q = |F D|² / |M D|², with F the misses and M the minors. Over the rectangle
/// |F D| is at least, and |M D| at most, the value at the middle, corrected by the change that `half` can
/// cause.
pub fn misses_near(terms: &NearTerms, middle: Vec3, half: Vec2, cutoff_squared: f32) -> bool {
    // |A D| for A with rows `rows`: its value at the middle, and its greatest change from there.
    let length = |rows: &[[f32; 3]]| {
        let (mut at, mut x, mut y) = (0.0, 0.0, 0.0);
        for row in rows {
            let along = middle.dot(Vec3::from(*row));
            at += along * along;
            x += row[0] * row[0];
            y += row[1] * row[1];
        }
        (at.sqrt(), half.x * x.sqrt() + half.y * y.sqrt())
    };
    let (miss, miss_slack) = length(&terms.misses);
    let (root, root_slack) = length(&terms.minors);
    let greatest = root + root_slack;
    // A small slack for roundings; NaN never counts as a miss.
    if (miss - miss_slack) * (1.0 - 1e-4) > cutoff_squared.sqrt() * greatest {
        return true;
    }
    let axis: Vec3 = terms
        .minors
        .iter()
        .zip(terms.minor_depths)
        .map(|(minor, depth)| Vec3::from(*minor) * depth)
        .sum();
    let along = axis.dot(middle) + half.dot(axis.truncate().abs());
    along < -(1.0 + 1e-4) * MAX_CUTOFF * greatest * terms.sigma
}

/// Returns the terms for an orthographic camera. The kernel's depth along the ray at offset d is
/// z* = u2 + g . d with a constant standard deviation.
///
/// - `slope`, `sigma`: results of [`depth_terms`](super::depth_terms).
pub fn half_line_terms(kernel: &Kernel, slope: Vec2, sigma: f32) -> NearTerms {
    NearTerms {
        half_line: [slope.x, slope.y, kernel.centre.z],
        sigma,
        ..NearTerms::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Factor;
    use bytemuck::Zeroable;

    #[test]
    fn no_rectangle_of_rays_that_meets_a_kernel_is_left_out() {
        let view = ViewUniform {
            focal_px: [100.0; 2],
            low_pass_variance_px2: 0.3,
            ..ViewUniform::zeroed()
        };
        let mut state = 11_u64;
        let mut within = |least: f32, greatest: f32| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            least + (greatest - least) * (state >> 40) as f32 / 16_777_216.0
        };
        const CUTOFF_SQUARED: f32 = 11.0;
        let (mut met, mut left_out, mut kept) = (0, 0, 0);
        for _ in 0..400 {
            // Centres near the plane of the eye, before and behind it; shapes from balls to needles.
            let centre = Vec3::new(within(-1.0, 1.0), within(-1.0, 1.0), within(-0.2, 0.2));
            let size = 10_f32.powf(within(-3.0, -0.5));
            let mut row = || Vec3::new(within(-1.0, 1.0), within(-1.0, 1.0), within(-1.0, 1.0));
            let kernel = Kernel {
                centre,
                factor: Factor {
                    x: row() * size,
                    y: row() * size,
                    z: row() * size,
                },
                mass: 1.0,
            };
            let Some((terms, weight)) = near_terms(&view, &kernel) else {
                continue;
            };
            for _ in 0..40 {
                // Tiles of a wide view.
                let half = Vec2::splat(within(0.01, 0.2));
                let middle = Vec3::new(within(-10.0, 10.0), within(-10.0, 10.0), 1.0);
                let steps = (-16..=16_i8).map(|i| f32::from(i) / 16.0);
                let meets = steps.clone().any(|x| {
                    steps.clone().any(|y| {
                        let ray = middle + (half * Vec2::new(x, y)).extend(0.0);
                        evaluate_near(&terms, weight, ray, CUTOFF_SQUARED) > 0.0
                    })
                });
                let misses = misses_near(&terms, middle, half, CUTOFF_SQUARED);
                assert!(!(meets && misses), "{kernel:?}, {middle} by {half}");
                met += usize::from(meets);
                left_out += usize::from(misses);
                kept += usize::from(!meets && !misses);
            }
        }
        println!("{met} met, {left_out} left out, {kept} kept for nothing");
        assert!(met > 500 && left_out > 5000);
        // A bound that keeps everything would otherwise pass.
        assert!(kept * 4 < left_out);
    }

    #[test]
    fn what_is_not_a_number_is_not_left_out() {
        let terms = NearTerms {
            sigma: f32::NAN,
            misses: [[f32::NAN; 3]; 5],
            minors: [[f32::NAN; 3]; 10],
            minor_depths: [f32::NAN; 10],
            ..NearTerms::default()
        };
        assert!(!misses_near(&terms, Vec3::Z, Vec2::splat(0.1), 9.0));
    }
}
