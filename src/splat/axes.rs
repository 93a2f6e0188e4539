//! Defines the axes along which the rasterisers vary: four questions about a kernel on a pixel, each with
//! a few answers.
//!
//! A pass of a frame has one answer to each. The rasterisers of both back ends are composed of one file
//! per answer.
//!
//! | axis | question | answers |
//! |---|---|---|
//! | *evaluate* | how are the kernel's optical depth at this pixel and its depth along the ray computed? | affine, exact, near, surfel: each footprint has its own ([`crate::record::Footprint::path`]) |
//! | [`Interval`] | which part of the ray counts? | all, between clip planes, up to a surface |
//! | [`Accumulate`] | how are the kernels of one pixel combined? | over, sheets, slabs, maximum, column, opaque |
//! | [`Classify`] | to what is the transfer function applied? | particles, slabs |

/// The part of a pixel's ray that counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Interval {
    /// The whole ray.
    #[default]
    All,
    /// The part inside the clip planes, and up to a depth of the caller's.
    Planes,
    /// The part inside the clip planes, if there are any, divided by an opaque surface. The part in front
    /// of the surface counts. If the surface covers the pixel only in part, the part behind it counts in
    /// proportion.
    Surface,
}

impl Interval {
    /// Returns whether kernels may be cut at all.
    pub fn is_cut(self) -> bool {
        self != Self::All
    }
}

/// Ways to combine the kernels of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum Accumulate {
    /// Kernels are composited one by one, front to back.
    #[default]
    Over = 0,
    /// Whole kernels are summed in the layers of their centres; the layers are composited.
    Sheets = 1,
    /// Kernels are cut into the layers that they reach; the layers are composited.
    Slabs = 2,
    /// Kernels are summed, without occlusion.
    Column = 3,
    /// Surfels are averaged in a few layers, each an opaque surface.
    Opaque = 4,
    /// Kernels are cut into the layers that they reach; the layer with the greatest mean value is shown.
    Maximum = 5,
}

impl Accumulate {
    /// Returns whether kernels are summed in layers along the ray, whose numbers are the depth keys.
    pub fn is_layered(self) -> bool {
        self == Self::Sheets || self.cuts_slabs()
    }

    /// Returns whether kernels are cut into the layers that they reach.
    pub fn cuts_slabs(self) -> bool {
        matches!(self, Self::Slabs | Self::Maximum)
    }
}

/// The quantity that the transfer function is applied to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Classify {
    /// The value of each particle, before the frame's projection.
    #[default]
    Particle,
    /// The mean value of each slab of each pixel; particles carry their values.
    Slab {
        /// True if slabs are lit.
        is_lit: bool,
    },
}

/// The variant of a pass's rasteriser: an answer on each axis, and the outputs besides a colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Axes {
    /// True if any footprint may be on the exact path.
    pub may_be_exact: bool,
    /// The part of a ray that counts.
    pub interval: Interval,
    /// True if the boundary of their domain may cut kernels, each at planes of its own.
    pub edges: bool,
    /// Way to combine the kernels of a pixel.
    pub accumulate: Accumulate,
    /// The quantity that the transfer function is applied to.
    pub classify: Classify,
    /// Opacity min(tau, 1) instead of 1 - exp(-tau), for all footprints. Splats that state their opacity
    /// always use it.
    pub linear_opacity: bool,
    /// True if depths are written.
    pub depth: bool,
    /// True if the normals of opaque surfaces are written.
    pub normals: bool,
    /// True if rays end at depths of the caller's.
    pub ends: bool,
    /// True if column sums draw SPH kernels in place of Gaussians.
    pub smooths: bool,
    /// True if pixels count the kernels that they evaluate within their cut-off, in all three colours,
    /// instead of showing them.
    pub count: bool,
}

impl Axes {
    /// Returns whether all footprints of the pass need terms that describe their depth along a ray, not
    /// only those on the exact path.
    pub fn needs_depth_terms(&self) -> bool {
        self.interval.is_cut() || self.accumulate.cuts_slabs()
    }

    /// Returns whether lighting needs the derivatives of layers.
    pub fn has_slopes(&self) -> bool {
        self.classify == Classify::Slab { is_lit: true }
    }
}
