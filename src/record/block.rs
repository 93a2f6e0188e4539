//! Defines the records of blocks, and of visible particles on their way to footprints.

use bytemuck::{Pod, Zeroable};

use crate::record::footprint::Carried;

/// A block of particles as the device keeps it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct DeviceBlock {
    /// World position that the particles' offsets are relative to, f64 as its bits.
    pub origin: [[u32; 2]; 3],
    /// Half the extent of the box of the particles' centres.
    pub half_extent: [f32; 3],
    /// Upper bound of the kernels' standard deviations in any direction.
    pub max_sigma: f32,
    /// Lower bound of the kernels' standard deviations.
    pub min_sigma: f32,
    /// The greatest mass, cell volume or opacity of a particle.
    pub max_strength: f32,
    /// Least and greatest finite value; reversed if there is none.
    pub value_range: [f32; 2],
    /// Index of its first particle in the arrays of its part.
    pub first: u32,
    /// Number of particles. For a brick of a lattice: number of its cells within the lattice.
    pub count: u32,
    /// Index of the block of merged particles that contains this block's cluster, counted over the merged
    /// blocks of the scene; [`NO_PARENT`](crate::blocks::NO_PARENT) if there is none.
    pub parent: u32,
    /// 0 for the data's own particles, above for merged ones.
    pub level: u32,
    /// Greatest number of kernels that overlap at a point, as
    /// [`Block::crowding`](crate::blocks::Block::crowding).
    pub crowding: f32,
    /// Greatest standard deviation of values over a kernel, as
    /// [`Block::greatest_spread`](crate::blocks::Block::greatest_spread).
    pub greatest_spread: f32,
    /// Range of values that classification over extents may look up, as
    /// [`Block::values_around`](crate::blocks::Block::values_around).
    pub values_around: [f32; 2],
    /// For points that the boundary of their domain cuts: one more than the index at which the planes
    /// begin among the words of the part's shapes; 0 if there are no planes.
    pub edges: u32,
    /// Pads the struct to a multiple of its alignment.
    pub unused: u32,
}

/// A block of merged particles as one frame on the device stores it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct MergedBlock {
    /// Index of the merged block that contains this block's cluster, as [`DeviceBlock::parent`].
    pub parent: u32,
    /// One of the `MERGED_` constants: it says whether this block's members need a test of their own.
    pub state: u32,
}

/// The block's members are tested one by one.
pub const MERGED_OPEN: u32 = 0;
/// Neither the block nor any of its members is visible.
pub const MERGED_UNSEEN: u32 = 1;
/// The block's particles may be drawn instead of their members.
pub const MERGED_FITS: u32 = 2;

/// A lattice as the device keeps it. Particles are cells, stored in bricks of
/// [`BRICK`](crate::constants::BRICK).
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LatticeUniform {
    /// Cells along each axis.
    pub dims: [u32; 3],
    /// Bricks along each axis.
    pub bricks: [u32; 3],
    /// Index, within the lattice, of the first brick of this part.
    pub first_brick: u32,
    /// 1 if cells follow from the samples of the axes, 0 if all cells are alike.
    pub has_axes: u32,
    /// Columns: the world directions of the axes. For a uniform lattice: the step from one cell to the
    /// next along each index.
    pub basis: [[f32; 3]; 3],
    /// Columns of the factor that all kernels share, world units.
    pub factor: [[f32; 3]; 3],
    /// Inward unit normals, in the world, of the lower faces of the samples' box.
    pub face_normals: [[f32; 3]; 3],
    /// One more than the index at which the distances from these faces begin among the axes' samples; 0
    /// if the box cuts nothing.
    pub first_face: u32,
}

/// The bricks of a lattice that a part holds, and where the part stores the local models of its field.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct BrickUniform {
    /// Samples of the lattice along x, y and z; zeros if the part's volume is not a lattice.
    pub dims: [u32; 3],
    /// Index of the brick that is the part's first block.
    pub first: u32,
    /// Index of the brick whose values come first. If kernels are classified over their extents, the part
    /// also stores the values of the bricks around its own.
    pub values_first: u32,
    /// Standard deviation of a lattice's kernels, in spacings.
    pub kernel_width: f32,
    /// Index at which local models begin among the strengths of points.
    pub models_first: u32,
    /// Padding to four words.
    pub unused: u32,
    /// Units of the lengths in the codes of local models: slopes, departures.
    pub model_scales: [f32; 2],
    /// Padding to four words.
    pub unused_end: [u32; 2],
}

/// A visible block of particles as one frame sees it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct BlockView {
    /// The block's origin in camera space, subtracted in f64.
    pub origin_camera: [f32; 3],
    /// Index of the block in its volume.
    pub block: u32,
    /// Index of its first classified particle.
    pub first: u32,
    /// Number of its classified particles.
    pub count: u32,
    /// Depth key of the block's origin.
    pub key: u32,
    /// The filter of its particles, as [`crate::splat::Filter`] numbers them; `Adaptive` if each particle
    /// chooses its own.
    pub filter_kind: u32,
    /// Its level of detail: 0 for the data's own particles.
    pub level: u32,
    /// Rule that classifies its kernels, as [`ClassifiedBy`] numbers it.
    pub classified_by: u32,
}

/// Rules by which a transfer function classifies a kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum ClassifiedBy {
    /// By the particle's value.
    Value = 0,
    /// By the values over the kernel's own extent: it may become several pieces, or none.
    Extent = 1,
    /// By the values around. Slabs are classified, not kernels. A kernel is kept whole if the transfer
    /// function shows any of the values around, and left out otherwise.
    Neighbours = 2,
}

impl ClassifiedBy {
    /// Returns the rule with this number; [`Self::Value`] for any other number.
    #[inline]
    pub(crate) fn of(number: u32) -> Self {
        const EXTENT: u32 = ClassifiedBy::Extent as u32;
        const NEIGHBOURS: u32 = ClassifiedBy::Neighbours as u32;
        match number {
            EXTENT => Self::Extent,
            NEIGHBOURS => Self::Neighbours,
            _ => Self::Value,
        }
    }
}

impl BlockView {
    /// Returns whether its kernels are classified over their extents.
    #[inline]
    pub fn is_spread(&self) -> bool {
        self.classified_by == ClassifiedBy::Extent as u32
    }
}

/// A particle that the transfer function leaves visible.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ClassifiedParticle {
    /// Index of the particle's [`BlockView`] in its volume.
    pub view: u32,
    /// Index of the particle in its block.
    pub local: u32,
    /// g = extinction x volume \[length²\]; for splats: the peak opacity.
    pub mass: f32,
    /// A colour, a value or a sign.
    pub carried: Carried,
}
