//! Blocks of particles, and particles that are visible, on their way to footprints.

use bytemuck::{Pod, Zeroable};

use super::Carried;

/// A block of particles as the device keeps it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct DeviceBlock {
    /// World position that the particles' offsets are relative to, f64 as its bits.
    pub origin: [[u32; 2]; 3],
    /// Half the extent of the particles' centres.
    pub half_extent: [f32; 3],
    /// No kernel's standard deviation exceeds this in any direction.
    pub max_sigma: f32,
    /// None falls below this.
    pub min_sigma: f32,
    /// The greatest mass, cell volume or opacity of a particle.
    pub max_strength: f32,
    /// Least and greatest finite value; reversed where there is none.
    pub value_range: [f32; 2],
    /// Index of its first particle in the arrays of its part.
    pub first: u32,
    /// Number of particles; for a brick of a lattice, of its cells within the lattice.
    pub count: u32,
    /// The block of merged particles that stands for this one among others, counted over the merged
    /// blocks of the scene; [`NO_PARENT`](crate::blocks::NO_PARENT) for none.
    pub parent: u32,
    /// 0 for the data's own particles, above for merged ones.
    pub level: u32,
    /// The most kernels that lie in one place, as [`Block::crowding`](crate::blocks::Block::crowding).
    pub crowding: f32,
    /// The greatest standard deviation of values over a kernel, as [`Block::greatest_spread`](crate::blocks::Block::greatest_spread).
    pub greatest_spread: f32,
    /// What classification over extents may ask for, as [`Block::values_around`](crate::blocks::Block::values_around).
    pub values_around: [f32; 2],
    /// Of points that the boundary of their domain cuts: where the planes begin among the words of the
    /// part's shapes, one more than that; 0 where there are none.
    pub edges: u32,
    /// Pads the struct to a multiple of its alignment.
    pub unused: u32,
}

/// A block of merged particles in a frame on the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct MergedBlock {
    /// The merged block that stands for this one among others, as [`DeviceBlock::parent`].
    pub parent: u32,
    /// Whether it decides about its members by itself: one of the `MERGED_` constants.
    pub state: u32,
}

/// Its members are asked.
pub const MERGED_OPEN: u32 = 0;
/// Nothing is seen of it or of its members.
pub const MERGED_UNSEEN: u32 = 1;
/// Its particles may be drawn instead of their members.
pub const MERGED_FITS: u32 = 2;

/// A lattice as the device keeps it: particles are cells, in bricks of
/// [`BRICK`](crate::constants::BRICK).
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LatticeUniform {
    /// Cells along each axis.
    pub dims: [u32; 3],
    /// Bricks along each axis.
    pub bricks: [u32; 3],
    /// Which of the lattice's bricks is the first of its part.
    pub first_brick: u32,
    /// 1 where cells follow from the samples of the axes, 0 where all are alike.
    pub has_axes: u32,
    /// Columns: the units of the axes in the world; of a uniform lattice the step from one cell to
    /// the next along each index.
    pub basis: [[f32; 3]; 3],
    /// Columns of the factor that all kernels share, world units.
    pub factor: [[f32; 3]; 3],
    /// Unit normals of the lower faces of the box of the samples, into it, world.
    pub face_normals: [[f32; 3]; 3],
    /// Where the distances from these faces begin among the axes' samples, one more than that; 0 where
    /// the box cuts nothing.
    pub first_face: u32,
}

/// Which bricks of a lattice a part holds, and where it keeps how its field runs over kernels.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct BrickUniform {
    /// Samples of the lattice along x, y and z; zeros where the part's volume is none.
    pub dims: [u32; 3],
    /// The brick that is the part's first block.
    pub first: u32,
    /// The brick whose values come first: those around the part's own are kept, too, where kernels are
    /// classified over their extents.
    pub values_first: u32,
    /// Standard deviation of a lattice's kernels, in spacings.
    pub kernel_width: f32,
    /// Where local models begin among the strengths of points.
    pub models_first: u32,
    /// Padding to four words.
    pub unused: u32,
    /// What lengths in the codes of local models count from: slopes, departures.
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
    /// Which block of its volume.
    pub block: u32,
    /// Where its classified particles begin.
    pub first: u32,
    /// How many there are.
    pub count: u32,
    /// Depth key of the block's origin.
    pub key: u32,
    /// What draws its particles, as [`crate::splat::Filter`] numbers them: `Adaptive` where each
    /// is asked for itself.
    pub filter_kind: u32,
    /// Its level of detail: 0 for the data's own particles.
    pub level: u32,
    /// What decides about its kernels, as [`ClassifiedBy`] numbers it.
    pub classified_by: u32,
}

/// What decides what a transfer function leaves of a kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum ClassifiedBy {
    /// Its value.
    Value = 0,
    /// The values over its own extent: it may become several pieces, or none.
    Extent = 1,
    /// Slabs are classified, not kernels: one is whole where any of the values around is shown, and is left out
    /// where none is.
    Neighbours = 2,
}

impl ClassifiedBy {
    /// That of a number.
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
    /// Whether its kernels are classified over their extents.
    #[inline]
    pub fn is_spread(&self) -> bool {
        self.classified_by == ClassifiedBy::Extent as u32
    }
}

/// A particle that the transfer function leaves visible.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ClassifiedParticle {
    /// Which [`BlockView`] of its volume.
    pub view: u32,
    /// Which particle of the block.
    pub local: u32,
    /// g = extinction x volume \[length²\]; for splats: the peak opacity.
    pub mass: f32,
    /// A colour, a value or a sign.
    pub carried: Carried,
}
