//! Converts rotations to matrices.

use glam::{DMat3, DQuat};

/// Greatest distance of a matrix element from 0 or 1 that counts as rounding: quarter turns by quaternions of
/// f64 are off by some 4e-16.
const SNAP: f64 = 1e-14;

/// Returns the matrix of a rotation, given as a quaternion of any length but zero. It is exact for rotations
/// that map axes to axes.
pub(crate) fn rotation_matrix(rotation: DQuat) -> DMat3 {
    let matrix = DMat3::from_quat(rotation.normalize());
    let near = |x: f64| (x - x.round()).abs() <= SNAP;
    if matrix.to_cols_array().into_iter().all(near) {
        // Adding 0.0 turns -0 into 0.
        DMat3::from_cols_array(&matrix.to_cols_array().map(|x| x.round() + 0.0))
    } else {
        matrix
    }
}
