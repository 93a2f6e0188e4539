//! Rotations as matrices.

use glam::{DMat3, DQuat};

/// How far an element of a rotation matrix may be from 0 or 1 to be that: quarter turns by quaternions of f64 are off
/// by some 4e-16.
const SNAP: f64 = 1e-14;

/// The matrix of a rotation, a quaternion of any length but zero; exact where it takes axes to axes.
pub(crate) fn rotation_matrix(rotation: DQuat) -> DMat3 {
    let matrix = DMat3::from_quat(rotation.normalize());
    let near = |x: f64| (x - x.round()).abs() <= SNAP;
    if matrix.to_cols_array().into_iter().all(near) {
        // Zeros without a sign.
        DMat3::from_cols_array(&matrix.to_cols_array().map(|x| x.round() + 0.0))
    } else {
        matrix
    }
}
