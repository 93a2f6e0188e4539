//! Over what part of a kernel the transfer function is asked.

/// Over what part of a kernel the transfer function is asked, for particles that have a value and a
/// model of the field around (lattices have; see
/// [`PointVolume::local_models`](crate::scene::PointVolume::local_models)).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Classification {
    /// Over its extent, with the field's local linear model: of a kernel over which the field crosses
    /// a narrow lobe of the function a flattened and shifted piece is drawn, a splat of the iso-surface.
    /// Where lobes are wide against what the field changes over a kernel, as [`Self::Particle`]
    /// ([`ALONE_DEPTH`](crate::scene::ALONE_DEPTH)).
    #[default]
    Extent,
    /// At its value alone: the whole kernel has the function's extinction and colour there.
    Particle,
}
