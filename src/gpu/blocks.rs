//! Blocks and the shapes of points as the device keeps them.

use std::ops::Range;

use super::shaders::words;
use crate::blocks::{BlockedParticles, BlockedVolume};
use crate::constants::BLOCK_CAPACITY;
use crate::layout::DeviceBlock;

/// Blocks of a volume as those of a part: `first` counts within the part.
pub(super) fn pack_blocks(volume: &BlockedVolume, run: &Range<usize>) -> Vec<DeviceBlock> {
    let blocks = &volume.blocks[run.clone()];
    let is_lattice = matches!(volume.particles, BlockedParticles::Lattice(_));
    (0..)
        .zip(blocks)
        .map(|(n, block)| DeviceBlock {
            origin: block.origin.to_array().map(words),
            half_extent: block.half_extent.into(),
            max_sigma: block.max_sigma,
            value_range: block.value_range,
            first: if is_lattice {
                n * BLOCK_CAPACITY as u32
            } else {
                block.first - blocks[0].first
            },
            count: block.count,
        })
        .collect()
}

/// Offset and shape of each particle: 4 or 9 words; nothing of a lattice.
pub(super) fn pack_points(volume: &BlockedVolume, particles: Range<usize>) -> Vec<f32> {
    match &volume.particles {
        BlockedParticles::Lattice(_) => Vec::new(),
        BlockedParticles::Isotropic { offsets, sigmas } => particles
            .flat_map(|i| offsets[i].into_iter().chain([sigmas[i]]))
            .collect(),
        BlockedParticles::Anisotropic { offsets, factors } => particles
            .flat_map(|i| offsets[i].into_iter().chain(factors[i]))
            .collect(),
    }
}
