//! Computes the variance that the opening of a lens adds to a footprint.
//!
//! Twin: `shaders/shared/defocus.wgsl`.

use super::footprint::Kernel;
use crate::record::ViewUniform;

/// Returns the variance that the opening of the lens adds to a kernel's footprint along each axis, px²; 0 for a point.
///
/// A point at depth z, seen from a place l on the opening, moves by f l (1/focus - 1/z) pixels. The mean square over a kernel has
/// the square at its centre, and, to first order, the variance s² = |z row|²/z² of its relative depth: (f sigma/z)² ((z/focus - 1)² + s²), with
/// sigma the opening's standard deviation. A kernel at the eye is as far away as it is deep, as in
/// [`near_terms`](super::near_terms).
#[inline(always)]
pub fn defocus(view: &ViewUniform, kernel: &Kernel) -> f32 {
    if view.aperture > 0.0 {
        let reach = kernel.factor.z.length();
        let depth = kernel.centre.z.abs().max(reach);
        let unit = view.aperture / depth;
        let beside = kernel.centre.z * view.per_focus - 1.0;
        let spread = reach / depth;
        let [fx, fy] = view.focal_px;
        (fx * unit) * (fy * unit) * (beside * beside + spread * spread)
    } else {
        0.0
    }
}
