//! Finds the planes of a boundary that cut kernels.

use glam::{DMat3, DVec3};

use crate::constants::{EDGE_REACH, MOST_EDGES};
use crate::math::narrowed;
use crate::scene::NO_EDGE;

/// Least sine of the angle between two tangents that span a face.
const LEAST_SINE: f64 = 1e-6;

/// Returns the plane through a point of a face: its normal into the grid, and the point. Returns `None` if the
/// face has collapsed.
///
/// - `inward`: direction to the next node inside; `u`, `v`: tangents.
pub(in crate::sample) fn plane_of(
    origin: DVec3,
    inward: DVec3,
    u: DVec3,
    v: DVec3,
) -> Option<[DVec3; 2]> {
    let across = u.cross(v);
    // Phrased so that NaN gives no plane.
    if !(across.length() > LEAST_SINE * u.length() * v.length()) {
        return None;
    }
    let normal = across.normalize();
    let height = normal.dot(inward);
    (height.abs() > LEAST_SINE * inward.length()).then(|| [normal * height.signum(), origin])
}

/// Returns those of some planes (each a normal into the domain and a point) that reach a kernel.
pub(in crate::sample) fn edges(
    planes: &[[DVec3; 2]],
    centre: DVec3,
    factor: &DMat3,
) -> Option<[[f32; 4]; MOST_EDGES]> {
    let mut out = [NO_EDGE; MOST_EDGES];
    let mut count = 0;
    for &[normal, point] in planes {
        let inside = normal.dot(centre - point);
        let reach = f64::from(EDGE_REACH) * (factor.transpose() * normal).length();
        if inside < reach && count < MOST_EDGES {
            out[count] = normal.extend(inside).to_array().map(narrowed);
            count += 1;
        }
    }
    (count > 0).then_some(out)
}
