//! Chooses the approximation that draws a kernel.
//!
//! Twin: `shaders/shared/filter.wgsl`.

use super::bounds::{affine_error, opacity_amplification};
use super::budget::AFFINE_SHARE;
use super::exact::exact_terms;
use super::filter::Filter;
use super::footprint::{ImageKernel, ScreenFactor};
use crate::record::{ExactTerms, ViewUniform};

/// Chooses between the affine and the exact footprint. Returns the exact footprint's terms, or `None` if
/// the affine one suffices. This choice is made nowhere else.
///
/// An orthographic projection is affine, so the exact footprint gains nothing there.
///
/// - `crowding`: [`Block::crowding`](crate::blocks::Block::crowding) of the kernel's block.
#[inline]
pub fn choose_exact(
    view: &ViewUniform,
    filter: Filter,
    screen: &ScreenFactor,
    kernel: &ImageKernel,
    crowding: f32,
) -> Option<ExactTerms> {
    let is_exact = filter == Filter::Exact;
    if view.orthographic != 0 || !(is_exact || filter == Filter::Adaptive) {
        return None;
    }
    let terms = exact_terms(screen, view.low_pass_variance_px2, kernel.determinant);
    (is_exact || !suffices(view, screen, kernel, &terms, crowding)).then_some(terms)
}

/// Returns whether the affine footprint approximates the exact one within the tolerance.
#[inline(always)]
pub(crate) fn suffices(
    view: &ViewUniform,
    screen: &ScreenFactor,
    kernel: &ImageKernel,
    terms: &ExactTerms,
    crowding: f32,
) -> bool {
    // The error is relative to the kernel's own depth if that is below 1, as for the cut-off. The errors
    // of faint neighbours are alike, and many of them add up along a ray. Kernels at the same point act
    // as one of their total depth.
    let amplification = opacity_amplification(kernel.tau * crowding).max(1.0);
    let error = affine_error(view, screen, kernel, terms) * amplification;
    // NaN takes the safe side.
    error <= view.tolerance * AFFINE_SHARE
}
