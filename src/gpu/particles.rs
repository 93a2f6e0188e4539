//! Packs particles for the device: blocks, positions and shapes of a part. A part is a run of whole
//! blocks of a volume.

use std::ops::Range;

use glam::Mat3;

use super::kinds::ParticleKind;
use super::packed::words;
use crate::blocks::{Block, BlockedParticles, BlockedVolume, BrickGrid, NO_PARENT};
use crate::constants::{BLOCK_CAPACITY, MOST_EDGES};
use crate::record::{DeviceBlock, LatticeUniform};
use crate::scene::{BoundaryPlanesIn, Shared};

/// Packs the blocks of a part. The part's arrays with one entry per particle contain the blocks'
/// particles one after the other. Those of a lattice contain [`BLOCK_CAPACITY`] cells per brick,
/// including cells beyond its edge.
///
/// - `parents`: index of the first merged block of the volume's family among those of the scene; `None`
///   if it has none.
pub(super) fn pack_blocks(
    volume: &BlockedVolume,
    blocks: Range<usize>,
    parents: Option<u32>,
) -> Vec<DeviceBlock> {
    let mut edges = edge_places(volume, blocks.clone()).into_iter();
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
                greatest_spread: block.greatest_spread,
                values_around: block.values_around,
                edges: edges.next().unwrap_or(0),
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

/// Packs positions and shapes of a part as floats. Points have an entry per particle. A rectilinear
/// lattice has the samples of all its axes, for any part. A uniform lattice has none.
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
            let faces = grid.faces().into_iter();
            for [lower, upper] in faces.flat_map(|f| f.distances.iter().flatten()) {
                // In the layout of the axes' samples.
                words.extend_from_slice(&[*lower, *upper, 0.0, 0.0]);
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
    if let Some(boundary) = &volume.boundary {
        for block in blocks.iter().filter(|b| has_edges(boundary, b)) {
            let members = || block.first as usize..(block.first + block.count) as usize;
            let mut place = 0.0;
            words.extend(members().map(|i| {
                let is_cut = boundary.of(i).is_some();
                place += f32::from(u8::from(is_cut));
                if is_cut { place } else { 0.0 }
            }));
            for edges in members().filter_map(|i| boundary.of(i)) {
                words.extend(edges.as_flattened());
            }
        }
        // Whole rows.
        let row = kind.words_per_particle().max(1);
        words.resize(words.len().next_multiple_of(row), 0.0);
    }
    words
}

/// Returns whether planes cut any of a block's particles.
fn has_edges(boundary: &BoundaryPlanesIn<Shared>, block: &Block) -> bool {
    (block.first..block.first + block.count).any(|i| boundary.of(i as usize).is_some())
}

/// Returns one more than the index at which [`pack_shapes`] writes the planes of each block; 0 for a
/// block without planes.
fn edge_places(volume: &BlockedVolume, blocks: Range<usize>) -> Vec<u32> {
    let Some(boundary) = &volume.boundary else {
        return Vec::new();
    };
    let kind = ParticleKind::of(&volume.particles);
    let blocks = &volume.blocks[blocks];
    let count: usize = blocks.iter().map(|b| b.count as usize).sum();
    let mut next = count * kind.words_per_particle();
    let place = |block: &Block| {
        if !has_edges(boundary, block) {
            return 0;
        }
        let place = next as u32 + 1;
        let cut = (block.first..block.first + block.count)
            .filter(|&i| boundary.of(i as usize).is_some())
            .count();
        next += block.count as usize + 4 * MOST_EDGES * cut;
        place
    };
    blocks.iter().map(place).collect()
}

/// Packs a lattice whose part begins at brick `first_brick`.
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
        face_normals: grid
            .faces()
            .map_or([[0.0; 3]; 3], |faces| faces.normals.map(Into::into)),
        first_face: match (grid.has_faces(), grid.axes()) {
            (false, _) => 0,
            (true, None) => 1,
            (true, Some(_)) => grid.dims().iter().sum::<usize>() as u32 + 1,
        },
    }
}
