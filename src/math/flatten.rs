//! Flattens volume kernels to surfels.

use glam::{DMat3, DVec3};

/// Flattens a kernel by 1/s along a direction. This is the continuum of section 5 of Zwicker et al. 2001 from
/// the volume kernel (s = 1) to the surfel (s infinite): V' = A V Aᵀ with A = I - (1 - 1/s) d dᵀ.
///
/// - `factor`: any F of the variance F Fᵀ, columns; the result is the factor A F.
/// - `direction`: d, unit length.
/// - `s`: 1 or more, infinity included.
///
/// The kernel keeps its mass and, seen along d, its footprint.
pub fn flatten(factor: DMat3, direction: DVec3, s: f64) -> DMat3 {
    let along = direction * (1.0 - s.recip());
    DMat3::from_cols(
        factor.x_axis - along * direction.dot(factor.x_axis),
        factor.y_axis - along * direction.dot(factor.y_axis),
        factor.z_axis - along * direction.dot(factor.z_axis),
    )
}

/// Returns the two tangents t1 and t2 of the surfel that is the limit of a kernel flattened along `direction`
/// (unit length): t1 t1ᵀ + t2 t2ᵀ = A V Aᵀ. The front faces `direction`.
///
/// The tangents lie along the flattened kernel's principal axes only by chance. The computation is in f64 up to
/// the last step, so that a short tangent keeps its digits.
pub fn tangents_of(factor: DMat3, direction: DVec3) -> [DVec3; 2] {
    let u = direction.any_orthonormal_vector();
    let v = direction.cross(u);
    // Two rows of three columns, made lower triangular by one reflection from the right.
    let row = |axis: DVec3| {
        DVec3::new(
            axis.dot(factor.x_axis),
            axis.dot(factor.y_axis),
            axis.dot(factor.z_axis),
        )
    };
    let (a, b) = (row(u), row(v));
    let length = a.length();
    if length == 0.0 {
        return [DVec3::ZERO, v * b.length()];
    }
    let along = a.dot(b) / length;
    let across = a.cross(b).length() / length;
    [u * length + v * along, v * across]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Needles, discs and spheres.
    fn factors() -> [DMat3; 4] {
        let turn = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-1.1);
        [
            DMat3::IDENTITY,
            turn * DMat3::from_diagonal(DVec3::new(1.0, 2.0, 1e-6)),
            turn * DMat3::from_diagonal(DVec3::new(3.0, 0.0, 0.0)),
            turn.transpose() * DMat3::from_diagonal(DVec3::new(1e-9, 2e-9, 5e-9)),
        ]
    }

    #[test]
    fn flattening_scales_the_direction_alone() {
        let d = DVec3::new(2.0, -1.0, 0.5).normalize();
        for f in factors() {
            let scale = f.determinant().abs().max(1e-30);
            for s in [1.0, 2.0, 1e3, f64::INFINITY] {
                let flat = flatten(f, d, s);
                for column in [0, 1, 2] {
                    let (before, after) = (f.col(column), flat.col(column));
                    // Rounding of a handful of products of the column's own size.
                    let error = 1e-15 * before.length();
                    assert!((after.dot(d) - before.dot(d) / s).abs() <= error);
                    let across = |v: DVec3| v - d * v.dot(d);
                    assert!((across(after) - across(before)).length() <= error);
                }
                assert!(
                    (flat.determinant() * s - f.determinant()).abs() < 1e-12 * scale || s > 1e9
                );
            }
        }
    }

    #[test]
    fn tangents_have_the_flattened_variance_and_face_its_direction() {
        let d = DVec3::new(-0.3, 0.4, 0.9).normalize();
        for f in factors() {
            let flat = flatten(f, d, f64::INFINITY);
            let expected = flat * flat.transpose();
            let [a, b] = tangents_of(f, d);
            let outer = |v: DVec3| DMat3::from_cols(v * v.x, v * v.y, v * v.z);
            let found = outer(a) + outer(b);
            let size =
                expected.x_axis.length() + expected.y_axis.length() + expected.z_axis.length();
            for column in [0, 1, 2] {
                let error = (found.col(column) - expected.col(column)).length();
                assert!(error <= 1e-14 * size, "{error}");
            }
            assert!(a.cross(b).dot(d) >= 0.0);
        }
    }
}
