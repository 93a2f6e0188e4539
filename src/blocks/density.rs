//! Bounds the density of blocks' kernels, from which the thickness of slabs follows.

use rayon::prelude::*;

use crate::blocks::block::Block;
use crate::blocks::volume::{BlockedParticles, BlockedVolume};

/// Returns, for each block of a volume, the greatest ratio of strength to the volume that a kernel represents.
///
/// It is the kernel's extinction at its densest for a unit of strength; \[1/length\] if strengths are masses. Flat
/// kernels have density 0: a slab holds all of such a kernel.
pub(crate) fn densities(volume: &BlockedVolume) -> Vec<f64> {
    let blocks = volume.blocks.par_iter();
    blocks.map(|block| density_of(volume, block)).collect()
}

/// Returns the density of a block. A kernel of the default width represents the volume (sigma / .6)³.
pub(super) fn density_of(volume: &BlockedVolume, block: &Block) -> f64 {
    let members = block.first as usize..(block.first + block.count) as usize;
    let strengths = volume.strength.stored();
    let density = |i: usize, volume: f64| {
        let density = 0.6_f64.powi(3) * f64::from(strengths[i]) / volume;
        if density.is_finite() { density } else { 0.0 }
    };
    match &volume.particles {
        BlockedParticles::Lattice(grid) => (0.6 / grid.kernel_width()).powi(3),
        BlockedParticles::Isotropic { sigmas, .. } => members
            .map(|i| density(i, f64::from(sigmas[i]).powi(3)))
            .fold(0.0, f64::max),
        BlockedParticles::Anisotropic { factors, .. } => members
            .map(|i| {
                let [a, _, b, _, _, c] = factors[i].map(f64::from);
                density(i, (a * b * c).abs())
            })
            .fold(0.0, f64::max),
        BlockedParticles::Surfels { .. } => 0.0,
    }
}
