//! Defines a block: a run of particles and their bounds.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

/// A run of particles and their bounds.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Block {
    /// World position that the particles' offsets are relative to: the middle of their bounds.
    pub origin: DVec3,
    /// Half the extent of the particles' centres.
    pub half_extent: Vec3,
    /// Greatest standard deviation of a kernel in any direction.
    pub max_sigma: f32,
    /// Least standard deviation of a kernel. For merged particles, also that of their members.
    pub min_sigma: f32,
    /// The greatest mass, cell volume or opacity of a particle.
    pub max_strength: f32,
    /// The first particle (points) or the brick's index (lattice).
    pub first: u32,
    /// Number of particles.
    pub count: u32,
    /// Least and greatest finite value; reversed if there is none.
    pub value_range: [f32; 2],
    /// Range of all values that classification over the kernels' extents may need: those of the samples around.
    pub values_around: [f32; 2],
    /// Greatest standard deviation w of the field's values over a kernel; 0 if it is not known.
    pub greatest_spread: f32,
    /// Parent: the block of merged particles that represents this one and others. It is counted over the merged blocks
    /// of its volume or, in a renderer, of all volumes; [`NO_PARENT`] for none.
    pub parent: u32,
    /// 0 for the data's own particles, above for merged ones.
    pub level: u32,
    /// Overlap count: the most kernels in one place, as a multiple of [`OVERLAP`](crate::splat::budget::OVERLAP); at
    /// least 1.
    pub crowding: f32,
}

/// Stands for a block's parent: there is none.
pub const NO_PARENT: u32 = u32::MAX;

/// Range that contains no value.
pub(crate) const EMPTY_RANGE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

/// Least and greatest finite value among `values`.
pub(crate) fn value_range(values: impl Iterator<Item = f32>) -> [f32; 2] {
    values
        .filter(|v| v.is_finite())
        .fold(EMPTY_RANGE, |[lo, hi], v| [lo.min(v), hi.max(v)])
}
