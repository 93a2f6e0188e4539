//! Computes factors of kernels that a file states by scales and rotation.

use glam::{DMat3, DQuat, DVec3};

use crate::math::lower_factor;
use crate::sample::left_out::LeftOut;

/// Returns the factor of a sphere.
pub(in crate::sample) fn sphere(sigma: f64) -> [f64; 6] {
    [sigma, 0.0, sigma, 0.0, 0.0, sigma]
}

/// Returns the lower-triangular factor of a kernel with standard deviations along its own axes. The axes are
/// rotated by a quaternion w, x, y, z of any length but zero.
pub(in crate::sample) fn factor_of_scales(
    scales: [f32; 3],
    rotation: [f32; 4],
) -> Result<[f64; 6], LeftOut> {
    let scales = DVec3::from(scales.map(f64::from));
    if !(scales.is_finite() && scales.min_element() >= 0.0 && scales.max_element() > 0.0) {
        return Err(LeftOut::Size);
    }
    let [w, x, y, z] = rotation.map(f64::from);
    let rotation = DQuat::from_xyzw(x, y, z, w);
    let length = rotation.length();
    if !(length > 0.0 && length.is_finite()) {
        return Err(LeftOut::Rotation);
    }
    let rotation = DMat3::from_quat(rotation * (1.0 / length));
    Ok(lower_factor(rotation * DMat3::from_diagonal(scales)))
}
