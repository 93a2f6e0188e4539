//! The ways to draw a kernel.

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
