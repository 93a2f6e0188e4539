//! What the lengths of smoothed particles mean.

/// Which fields of a data set describe smoothed particles, and what their lengths mean.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Smoothing {
    /// The field with one length per particle; `None` where the neighbours tell.
    pub length: Option<String>,
    /// What that length is.
    pub meaning: LengthMeaning,
    /// The kernel it belongs to.
    pub kernel: SphKernel,
    /// The field with the particles' masses.
    pub mass: Option<String>,
    /// The field with their densities.
    pub density: Option<String>,
}

/// What a particle's length is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthMeaning {
    /// The smoothing length h of the kernel's usual definition; see [`SphKernel`].
    SmoothingLength,
    /// The radius H at which the kernel ends.
    Support,
    /// One standard deviation.
    Sigma,
    /// Full width at half maximum of the Gaussian that stands for the kernel.
    Fwhm,
}

/// The smoothing kernels of SPH. W(r) is zero from the support radius on, which is so many
/// smoothing lengths h:
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
