//! Defines the filters that can draw a kernel.

/// Filters that can draw a kernel. For kernels that cross the camera plane an affine footprint is
/// meaningless: they are integrated along the half line in front of the plane, whatever the filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Filter {
    /// For each particle: the affine footprint if its error bound fits the tolerance, else the exact one.
    #[default]
    Adaptive = 0,
    /// The exact line integral of the low-passed kernel under perspective.
    Exact = 1,
    /// The resampling filter of Zwicker et al. 2001: affine projection plus low-pass filter.
    Ewa = 2,
    /// The projected reconstruction kernel alone: it aliases if it falls below a pixel.
    ///
    /// It differs from EWA by sqrt((1 + h²/l1)(1 + h²/l2)) - 1 of EWA's peak; this is exact at the
    /// centre. Here l1, l2 are the variances of the projected kernel along its axes, px², and h² is that
    /// of the low-pass filter.
    Reconstruction = 3,
    /// The low-pass filter alone: it breaks into dots if kernels exceed a pixel. It differs from EWA by
    /// sqrt((1 + l1/h²)(1 + l2/h²)) - 1 of its peak.
    LowPass = 4,
    /// A round footprint of half the trace of the projected variance.
    ///
    /// It differs from EWA by at most .368 delta + .64 delta⁴ of its peak, with delta = |l1 - l2| / 2
    /// over h² + (l1 + l2) / 2. The first term is the first order, delta r²/2 exp(-r²/2) at r² = 2. The
    /// second covers the higher orders for elongated footprints, up to the whole peak.
    Isotropic = 5,
    /// Swan's anti-aliasing, the comparison method of the 2001 paper: the kernel is enlarged as a whole
    /// until its minor radius reaches the low-pass filter's.
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

    /// Returns the name on the command line.
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
