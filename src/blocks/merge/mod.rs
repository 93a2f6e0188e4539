//! Builds levels of detail: clusters of particles that are drawn as one particle each where they lie far below a pixel.
//!
//! A cluster's particle has the mass (or volume) of its members, their centre and their mean colour. Its variance is
//! the mean of their variances plus the variance of their positions (the law of total variance). All means are weighted
//! by strength. The error begins with the third moments, on which each block keeps bounds ([`MergeBounds`](super::merged::MergeBounds)).
//!
//! Values are kept as mean and spread, and a transfer function is averaged over the interval that they fill
//! ([`TransferFunction::classify_spread`]). An edit of the transfer function changes no particle, merged or not.
//!
//! [`TransferFunction::classify_spread`]: crate::scene::TransferFunction::classify_spread

mod coarse;
mod distribution;
mod fine;
mod lattice;
mod levels;
mod moments;
pub(super) mod places;
mod sums;

use super::overlap::OverlapCounts;
use super::tree::{PartialTree, Tree};
use crate::blocks::block::Block;
use crate::blocks::volume::BlockedVolume;
use crate::constants::BLOCK_CAPACITY;
use crate::error::Result;
use crate::scene::{ColourIn, StrengthIn};
use crate::task::Task;

use super::source::Source;
pub(super) use coarse::{Atoms, coarse_levels};
pub(super) use fine::fine_levels;
pub(super) use lattice::{
    CubeMoments, LONGEST_COPIED, LongCube, WholeCube, adopted, is_large, levels_of, merge_lattice,
};
pub(super) use levels::{Head, Level, Levels};
pub(super) use sums::Cluster;

/// Number of particles in a cluster of the first level, and of clusters in one of the next.
pub(super) const MERGE_RATIO: usize = 16;

/// Number of levels whose clusters are merged from particles; later levels are merged from clusters. A cluster of the
/// last fine level takes more memory than a particle, and represents 256.
const FINE_LEVELS: u32 = 2;

/// Most particles of the block at which levels end.
const LAST_LEVEL: usize = 16;

/// Merges particles level by level. Returns `None` if they cannot be merged ([`is_mergeable`]), or if all are in one
/// block.
pub(super) fn merge_points(
    source: &Source<'_>,
    tree: &Tree,
    overlaps: &OverlapCounts,
    task: Option<&Task>,
) -> Result<Option<Levels>> {
    if !is_mergeable(source) || source.positions.len() <= BLOCK_CAPACITY {
        return Ok(None);
    }
    let all = PartialTree {
        tree,
        at: 0,
        start: 0,
    };
    let (mut levels, clusters) = fine_levels(source, &[all], overlaps, true, task)?;
    if let Some(last) = levels.last().filter(|last| !levels::is_last(&last.heads)) {
        let runs: Vec<_> = clusters.iter().map(Cluster::run).collect();
        let atoms = Atoms {
            tree: tree.above(&runs),
            clusters,
            heads: last.heads.clone(),
        };
        let places = &mut |asked: &[Cluster]| Ok(source.places_of(asked));
        let places = source.values.is_some().then_some(places as _);
        levels.extend(coarse_levels(&atoms, overlaps, places, task)?);
    }
    Ok(Some(Levels(levels)))
}

/// Whether particles can be merged. Splats that state opacities cannot, nor can particles with infinite values or with
/// colours that depend on the view.
pub(super) fn is_mergeable(source: &Source<'_>) -> bool {
    !matches!(source.strength, StrengthIn::PeakOpacity { .. })
        && !matches!(source.colour, ColourIn::Harmonics { .. })
        && source.values.is_none_or(|v| !v.has_infinite())
}

/// Gives the blocks of a volume and its levels the ranges and bounds of all their members. `volumes` are listed from
/// the finest to the coarsest, and parents are counted from the first merged block.
pub(super) fn widen_to_members(volumes: &mut [BlockedVolume]) {
    let Some((base, merged)) = volumes.split_first_mut() else {
        return;
    };
    let mut first = 0;
    let firsts: Vec<usize> = merged
        .iter()
        .map(|volume| {
            let own = first;
            first += volume.blocks.len();
            own
        })
        .collect();
    let mut bounds = vec![None; first];
    for block in &base.blocks {
        widen(&mut bounds, block);
    }
    for (volume, &first) in merged.iter_mut().zip(&firsts) {
        // Children come before their parents: the finer volumes first, and within one volume the last blocks first.
        for (i, block) in volume.blocks.iter_mut().enumerate().rev() {
            if let Some(Members {
                values,
                around,
                spread,
                sigmas,
            }) = bounds[first + i]
            {
                block.value_range = values;
                block.values_around = around;
                block.greatest_spread = spread;
                block.min_sigma = block.min_sigma.min(sigmas[0]);
                block.max_sigma = block.max_sigma.max(sigmas[1]);
            }
            widen(&mut bounds, block);
        }
    }
}

/// Bounds on all members of a merged block.
#[derive(Debug, Clone, Copy)]
struct Members {
    values: [f32; 2],
    around: [f32; 2],
    spread: f32,
    sigmas: [f32; 2],
}

/// Adds a block to the bounds of its parent.
fn widen(bounds: &mut [Option<Members>], block: &Block) {
    let union = |a: [f32; 2], b: [f32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
    let own = Members {
        values: block.value_range,
        around: block.values_around,
        spread: block.greatest_spread,
        sigmas: [block.min_sigma, block.max_sigma],
    };
    if let Some(of_parent) = bounds.get_mut(block.parent as usize) {
        *of_parent = Some(of_parent.map_or(own, |b| Members {
            values: union(b.values, own.values),
            around: union(b.around, own.around),
            spread: b.spread.max(own.spread),
            sigmas: union(b.sigmas, own.sigmas),
        }));
    }
}
