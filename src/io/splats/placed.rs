//! Transforms splats from the space of their node or prim to world space.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::data::splats::SplatCloud;
use crate::math::{HarmonicsTransform, narrowed, scales_and_rotation};

/// Transforms splats to world space.
///
/// Rotations and uniform scales are exact, and rotate the harmonics. For other linear transforms, shapes stay exact,
/// and harmonics of degree 1 and higher become the nearest ones.
pub(super) fn transform(cloud: &mut SplatCloud, world_from_local: DAffine3) {
    if world_from_local == DAffine3::IDENTITY {
        return;
    }
    for p in &mut cloud.positions {
        *p = world_from_local.transform_point3(*p);
    }
    let linear = world_from_local.matrix3;
    if linear == DMat3::IDENTITY {
        return;
    }
    let similarity = as_similarity(linear);
    for (scales, rotation) in cloud.scales.iter_mut().zip(&mut cloud.rotations) {
        let [w, x, y, z] = rotation.map(f64::from);
        let local = DQuat::from_xyzw(x, y, z, w);
        let length = local.length();
        if !(length > 0.0 && length.is_finite()) {
            // Such splats are left out and counted later.
            continue;
        }
        let local = local * (1.0 / length);
        let (sigmas, turned) = match similarity {
            Some((scale, turn)) => (scales.map(|s| f64::from(s) * scale), turn * local),
            None => {
                let sigmas = DVec3::from(scales.map(f64::from));
                let factor = DMat3::from_quat(local) * DMat3::from_diagonal(sigmas);
                scales_and_rotation(linear * factor)
            }
        };
        *scales = sigmas.map(narrowed);
        *rotation = [turned.w, turned.x, turned.y, turned.z].map(narrowed);
    }
    if cloud.harmonics_degree > 0 {
        let moved = HarmonicsTransform::new(linear.inverse());
        let stride = cloud.harmonics_stride();
        for set in cloud.harmonics.chunks_exact_mut(stride) {
            moved.apply(set);
        }
    }
}

/// Returns the scale and the rotation of a similarity; `None` for other matrices. A reflection is ignored, because
/// Gaussians are symmetric.
fn as_similarity(m: DMat3) -> Option<(f64, DQuat)> {
    // Tolerance for the rounding of four f32 products in a file's matrices.
    const ROUNDING: f64 = 1e-6;
    let gram = m.transpose() * m;
    let mean = (gram.x_axis.x + gram.y_axis.y + gram.z_axis.z) / 3.0;
    let apart = gram - DMat3::from_diagonal(DVec3::splat(mean));
    let apart = apart
        .to_cols_array()
        .into_iter()
        .fold(0.0_f64, |a, b| a.max(b.abs()));
    // The condition is negated so that NaN returns `None`.
    if !(apart <= ROUNDING * mean && mean > 0.0) {
        return None;
    }
    let scale = mean.sqrt();
    let sign = m.determinant().signum();
    Some((scale, DQuat::from_mat3(&(m * (sign / scale))).normalize()))
}
