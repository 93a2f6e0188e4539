//! Particles as the device keeps them: blocks, positions and shapes of a part, a run of whole
//! blocks of a volume.

use std::ops::Range;

use glam::Mat3;

use super::kinds::ParticleKind;
use super::packed::words;
use crate::blocks::{BlockedParticles, BlockedVolume, BrickGrid, NO_PARENT};
use crate::constants::BLOCK_CAPACITY;
use crate::record::{DeviceBlock, LatticeUniform};

/// The blocks of a part. The part's arrays of one entry per particle hold the blocks' particles one
/// after the other; those of a lattice, [`BLOCK_CAPACITY`] cells per brick, whatever lies beyond
/// its edge.
///
/// - `parents`: the number of the first merged block of the volume's family among those of the
///   scene; `None` where it has none.
pub(super) fn pack_blocks(
    volume: &BlockedVolume,
    blocks: Range<usize>,
    parents: Option<u32>,
) -> Vec<DeviceBlock> {
    let is_lattice = matches!(volume.particles, BlockedParticles::Lattice(_));
    let mut first = 0;
    volume.blocks[blocks]
        .iter()
        .map(|block| {
            let packed = DeviceBlock {
                origin: block.origin.to_array().map(words),
                half_extent: block.half_extent.into(),
                max_sigma: block.max_sigma,
                min_sigma: block.min_sigma,
                max_strength: block.max_strength,
                value_range: block.value_range,
                first,
                count: block.count,
                parent: match parents {
                    Some(first) if block.parent != NO_PARENT => first + block.parent,
                    _ => NO_PARENT,
                },
                level: block.level,
                crowding: block.crowding,
                unused: 0,
            };
            first += if is_lattice {
                BLOCK_CAPACITY as u32
            } else {
                block.count
            };
            packed
        })
        .collect()
}

/// Positions and shapes of a part as floats: per particle for points, the samples of all axes (the
/// lattice's, whatever the part) for a rectilinear lattice, nothing for a uniform one.
pub(super) fn pack_shapes(volume: &BlockedVolume, blocks: Range<usize>) -> Vec<f32> {
    let kind = ParticleKind::of(&volume.particles);
    let blocks = &volume.blocks[blocks];
    let count: usize = blocks.iter().map(|b| b.count as usize).sum();
    let mut words = Vec::with_capacity(count * kind.words_per_particle());
    let particles = blocks
        .iter()
        .flat_map(|b| b.first as usize..(b.first + b.count) as usize);
    match &volume.particles {
        BlockedParticles::Lattice(grid) => {
            for axis in grid.axes().into_iter().flatten() {
                words.extend_from_slice(bytemuck::cast_slice(axis));
            }
        }
        BlockedParticles::Isotropic { offsets, sigmas } => {
            for i in particles {
                words.extend_from_slice(&offsets[i]);
                words.push(sigmas[i]);
            }
        }
        BlockedParticles::Anisotropic { offsets, factors }
        | BlockedParticles::Surfels {
            offsets,
            tangents: factors,
            ..
        } => {
            for i in particles {
                words.extend_from_slice(&offsets[i]);
                words.extend_from_slice(&factors[i]);
            }
        }
    }
    words
}

/// A lattice whose part begins at brick `first_brick`.
pub(super) fn lattice_uniform(grid: &BrickGrid, first_brick: usize) -> LatticeUniform {
    LatticeUniform {
        dims: grid.dims().map(|n| n as u32),
        bricks: grid.bricks().map(|n| n as u32),
        first_brick: first_brick as u32,
        has_axes: u32::from(grid.axes().is_some()),
        basis: grid.basis().to_cols_array_2d(),
        factor: grid
            .shared_factor()
            .unwrap_or(Mat3::ZERO)
            .to_cols_array_2d(),
    }
}
