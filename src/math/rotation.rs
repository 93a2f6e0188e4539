//! Makes rotations, and converts them to matrices.

use std::f64::consts::FRAC_1_SQRT_2;

use glam::{DMat3, DQuat, DVec3};

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

/// Returns the rotation that brings one direction up to another. Between axes it is exact, and the rotation back is its
/// conjugate.
///
/// Between y up and y down it is half a turn about z, as in conversions from glTF to PLY: both have z forward.
///
/// - `from`, `to`: unit vectors.
pub(crate) fn turn_between(from: DVec3, to: DVec3) -> DQuat {
    if from == to {
        return DQuat::IDENTITY;
    }
    if from == -to && (to.x == 0.0 || to.z == 0.0) {
        let axis = if to.z == 0.0 { DVec3::Z } else { DVec3::X };
        let axis = axis * to.element_sum().signum();
        return DQuat::from_vec4(axis.extend(0.0));
    }
    if from.dot(to) == 0.0 {
        let axis = from.cross(to) * FRAC_1_SQRT_2;
        return DQuat::from_vec4(axis.extend(FRAC_1_SQRT_2));
    }
    DQuat::from_rotation_arc(from, to)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_up_turn_as_conversions_do() {
        let p = DVec3::new(1.0, 2.0, 3.0);
        for (from, to, expected) in [
            (DVec3::NEG_Y, DVec3::Y, [-1.0, -2.0, 3.0]),
            (DVec3::Y, DVec3::NEG_Y, [-1.0, -2.0, 3.0]),
            (DVec3::NEG_Z, DVec3::Z, [1.0, -2.0, -3.0]),
            (DVec3::Y, DVec3::Z, [1.0, -3.0, 2.0]),
            (DVec3::X, DVec3::NEG_X, [-1.0, -2.0, 3.0]),
        ] {
            let turned = rotation_matrix(turn_between(from, to)) * p;
            assert_eq!(turned.to_array(), expected, "{from} to {to}");
            let back = turn_between(to, from);
            assert_eq!(back, turn_between(from, to).conjugate());
        }
    }
}
