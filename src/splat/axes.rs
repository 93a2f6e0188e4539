//! The axes of what happens to a kernel on a pixel: four questions, each with a few answers. A pass of
//! a frame has one answer to each; the rasterisers of both back ends are put together of them, one file
//! an answer.
//!
//! | axis | question | answers |
//! |---|---|---|
//! | *evaluate* | what is the kernel's optical depth at this pixel, and where along the ray does it lie? | affine, exact, near, surfel: each footprint says which ([`crate::record::Footprint::path`]) |
//! | [`Interval`] | which part of the ray counts? | all, between clip planes, up to a surface |
//! | [`Accumulate`] | what do kernels of one pixel become together? | over, sheets, slabs, maximum, column, opaque |
//! | [`Classify`] | where is the transfer function asked? | per particle, per slab |

/// Which part of a pixel's ray counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Interval {
    /// All of it.
    #[default]
    All,
    /// What clip planes leave.
    Planes,
    /// What clip planes, if there are any, leave, divided by an opaque surface: in front of it, and as
    /// far as that covers a pixel in part, behind it.
    Surface,
}

impl Interval {
    /// Whether kernels may be cut at all.
    pub fn is_cut(self) -> bool {
        self != Self::All
    }
}

/// What the kernels of a pixel become together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum Accumulate {
    /// Composited one by one, front to back.
    #[default]
    Over = 0,
    /// Summed whole in the layers of their centres, which are composited.
    Sheets = 1,
    /// Cut into the layers that they reach, which are composited.
    Slabs = 2,
    /// Summed; nothing hides anything.
    Column = 3,
    /// Averaged in a few layers, each an opaque surface.
    Opaque = 4,
    /// Cut into the layers that they reach, of which the one with the greatest mean value counts.
    Maximum = 5,
}

impl Accumulate {
    /// Whether kernels are summed in layers along the ray, which their depth keys number.
    pub fn is_layered(self) -> bool {
        self == Self::Sheets || self.cuts_slabs()
    }

    /// Whether kernels are cut into the layers that they reach.
    pub fn cuts_slabs(self) -> bool {
        matches!(self, Self::Slabs | Self::Maximum)
    }
}

/// Where the transfer function is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Classify {
    /// For the value of each particle, before the frame's projection.
    #[default]
    Particle,
    /// For the mean value of each slab of each pixel; particles carry their values.
    Slab {
        /// Whether light falls on slabs.
        is_lit: bool,
    },
}

/// What the rasteriser of a pass is specialised for: an answer on each axis, and what is asked for
/// besides a colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Axes {
    /// Whether any footprint may be on the exact path.
    pub may_be_exact: bool,
    /// Which part of a ray counts.
    pub interval: Interval,
    /// Whether the domain of their data may cut kernels, each at planes of its own.
    pub edges: bool,
    /// Returns the way kernels are accumulated.
    pub accumulate: Accumulate,
    /// Where the transfer function is asked.
    pub classify: Classify,
    /// Opacity min(tau, 1) instead of 1 - exp(-tau), for all footprints; splats that state their opacity
    /// have it anyway.
    pub linear_opacity: bool,
    /// Whether depths are wanted.
    pub depth: bool,
    /// Whether the normals of opaque surfaces are wanted.
    pub normals: bool,
    /// Whether pixels count the kernels that they evaluate within their cut-off, in all three colours,
    /// instead of showing them.
    pub count: bool,
}

impl Axes {
    /// Whether all footprints of the pass have terms that say where along a ray they lie, and not only
    /// those on the exact path.
    pub fn needs_depth_terms(&self) -> bool {
        self.interval.is_cut() || self.accumulate.cuts_slabs()
    }
}
