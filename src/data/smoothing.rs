//! Defines the meaning of smoothed particles' lengths.

use serde::{Deserialize, Serialize};

/// The fields of a data set that describe smoothed particles, and the meaning of their lengths.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Smoothing {
    /// The field with one length per particle; `None` to estimate it from the neighbours.
    pub length: Option<String>,
    /// Meaning of that length.
    pub meaning: LengthMeaning,
    /// The kernel to which the length belongs.
    pub kernel: SphKernel,
    /// The field with the particles' masses.
    pub mass: Option<String>,
    /// The field with the particles' densities.
    pub density: Option<String>,
}

/// Meaning of a particle's length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthMeaning {
    /// The smoothing length h of the kernel's usual definition; see [`SphKernel`].
    SmoothingLength,
    /// The radius H at which the kernel ends.
    Support,
    /// One standard deviation.
    Sigma,
    /// Full width at half maximum of the Gaussian that replaces the kernel.
    Fwhm,
}

/// The smoothing kernels of SPH. W(r) is zero from the support radius on, which is a multiple of the smoothing
/// length h:
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum SphKernel {
    /// M4, the cubic B-spline: support 2 h.
    CubicSpline,
    /// M5, the quartic B-spline: support 2.5 h.
    QuarticSpline,
    /// M6, the quintic B-spline: support 3 h.
    QuinticSpline,
    /// Wendland C2: support 2 h.
    WendlandC2,
    /// Wendland C4: support 2 h.
    WendlandC4,
    /// Wendland C6: support 2 h.
    WendlandC6,
}
