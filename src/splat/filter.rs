//! Which approximation draws a kernel.
//!
//! Twin: `shaders/shared/filter.wgsl`.

use super::bounds::{affine_error, opacity_amplification};
use super::budget::AFFINE_SHARE;
use super::exact::exact_terms;
use super::footprint::{ImageKernel, ScreenFactor};
use crate::record::{ExactTerms, ViewUniform};

/// The ways to draw a kernel. Kernels that cross the camera plane are integrated along the half
/// line in front of it whatever the filter: an affine footprint means nothing there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Filter {
    /// Per particle the affine footprint where its error bound fits the tolerance, the exact one
    /// elsewhere.
    #[default]
    Adaptive = 0,
    /// The exact line integral of the low-passed kernel under perspective.
    Exact = 1,
    /// The resampling filter of Zwicker et al. 2001: affine projection, low-pass filter added.
    Ewa = 2,
    /// The projected reconstruction kernel alone: aliases where it falls below a pixel.
    ///
    /// Off from EWA by sqrt((1 + h²/l1)(1 + h²/l2)) - 1 of EWA's peak, at the centre and there
    /// exactly; l1, l2 the variances of the projected kernel along its axes, px², h² the
    /// low-pass filter's.
    Reconstruction = 3,
    /// The low-pass filter alone: breaks into dots where kernels exceed a pixel. Off from EWA by
    /// sqrt((1 + l1/h²)(1 + l2/h²)) - 1 of its peak.
    LowPass = 4,
    /// A round footprint of half the trace of the projected variance.
    ///
    /// Off from EWA by .368 delta + .64 delta⁴ of its peak at most, delta = |l1 - l2| / 2 over
    /// h² + (l1 + l2) / 2. The first term is the first order, delta r²/2 exp(-r²/2) at r² = 2; the
    /// second covers what that leaves out of elongated footprints, up to the whole peak.
    Isotropic = 5,
    /// Swan's anti-aliasing, the comparison method of the 2001 paper: the kernel enlarged as a
    /// whole until its minor radius reaches the low-pass filter's.
    UniformScaling = 6,
}

impl Filter {
    /// All filters, in the order of their numbers.
    pub const ALL: [Self; 7] = [
        Self::Adaptive,
        Self::Exact,
        Self::Ewa,
        Self::Reconstruction,
        Self::LowPass,
        Self::Isotropic,
        Self::UniformScaling,
    ];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Adaptive => "adaptive",
            Self::Exact => "exact",
            Self::Ewa => "ewa",
            Self::Reconstruction => "reconstruction",
            Self::LowPass => "low-pass",
            Self::Isotropic => "isotropic",
            Self::UniformScaling => "uniform-scaling",
        }
    }
}

/// The one place that chooses between affine and exact: the exact footprint's terms, or `None`
/// where the affine one will do.
///
/// An orthographic projection is affine, so nothing is ever gained there.
///
/// - `crowding`: of the kernel's block, [`Block::crowding`](crate::blocks::Block::crowding).
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
    if is_exact {
        return Some(terms);
    }
    // Relative to the kernel's own depth where that is below 1, as for the cut-off: the errors of
    // faint neighbours are alike, and many of them add up along a ray. Kernels in the same place act
    // as one of their total depth.
    let amplification = opacity_amplification(kernel.tau * crowding).max(1.0);
    let error = affine_error(view, screen, kernel, &terms) * amplification;
    // Phrased so that NaN takes the safe side.
    (!(error <= view.tolerance * AFFINE_SHARE)).then_some(terms)
}
