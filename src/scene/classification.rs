//! Defines where the transfer function is evaluated.

/// Places at which the transfer function is evaluated, for particles with a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Classification {
    /// Over the kernel's extent, with the field's local linear model. Lattices have such models; see
    /// [`PointVolume::local_models`](crate::scene::PointVolume::local_models) for others. If the field crosses a
    /// narrow lobe of the function within a kernel, a flattened and shifted piece of the kernel is drawn: a splat
    /// of the iso-surface. If lobes are wide compared with the field's change over a kernel, the result is that of
    /// [`Self::Particle`] to within an optical depth of 1/255.
    #[default]
    Extent,
    /// At the particle's value alone: the whole kernel has the function's extinction and colour there.
    Particle,
    /// At the mean value of each slab of each pixel, where lighting is evaluated, too. This is sharper if the
    /// function is steep and samples are few. For scenes of one volume with a field (and surfaces), with
    /// [`Composite::Slabs`](crate::Composite::Slabs). Reference images, which have no slabs, take
    /// [`Self::Extent`].
    Slab,
}
