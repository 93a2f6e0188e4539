//! Defines over which part of a kernel the transfer function is evaluated.

/// The part of a kernel over which the transfer function is evaluated, for particles with a value and a local
/// model of the field. Lattices have such models; see
/// [`PointVolume::local_models`](crate::scene::PointVolume::local_models) for others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Classification {
    /// Over the kernel's extent, with the field's local linear model. If the field crosses a narrow lobe of the
    /// function within a kernel, a flattened and shifted piece of the kernel is drawn: a splat of the
    /// iso-surface. If lobes are wide compared with the field's change over a kernel, the result is that of
    /// [`Self::Particle`] to within an optical depth of 1/255.
    #[default]
    Extent,
    /// At the particle's value alone: the whole kernel has the function's extinction and colour there.
    Particle,
}
