//! Builds blocks of points that are partitioned among ranks in any way. The blocks and levels of detail are those of
//! all points in one place, to the last bit. No rank holds more than a share of the particles; every rank knows the
//! bounds of all blocks.
//!
//! 1. All ranks find the chunks of all points ([`chunks`]) by counting, and the tree over the chunks' boxes (top tree).
//! 2. The subtrees of a chunk's size are assigned to ranks, and the particles are sent to the rank that builds with
//!    them ([`assign`]).
//! 3. Each rank builds the trees over its particles, their blocks, and the levels of detail that are merged from
//!    particles.
//! 4. All ranks gather the bounds of these blocks, and the clusters of the last of these levels ([`join`]). From these
//!    clusters each rank makes the coarser levels by itself.
//!
//! A lattice needs none of these steps. Its planes are assigned to ranks ([`planes`]), which make bricks and coarser
//! grids of them ([`lattice`]).

mod assign;
mod chunks;
mod corners;
mod join;
mod lattice;
mod numbers;
mod planes;
mod shared_volume;

use std::ops::Range;

use glam::DVec3;

use super::build::{family, in_blocks, principal_ranges};
use super::merge::{Atoms, Cluster, Levels, coarse_levels, fine_levels, is_mergeable};
use super::options::{BuildOptions, SceneOptions};
use super::overlap::OverlapCounts;
use super::points::Points;
use super::room::MEMORY;
use super::tree::{CHUNK, PartialTree};
use crate::blocks::share::runs_in_turn;
use crate::collective::Collective;
use crate::constants::BLOCK_CAPACITY;
use crate::error::Result;
use crate::scene::{PointVolume, Requirements};
use assign::Assigned;
pub(crate) use lattice::build_lattice_together;
pub(crate) use planes::{Held, PlaneRuns};
pub(crate) use shared_volume::SharedVolume;

/// Number of points up to which each rank may build the blocks of all.
pub(crate) const LEAST: u64 = CHUNK as u64;

/// Builds the blocks of points, and their levels of detail.
///
/// - `volume`: this rank's points; the volumes of other ranks differ in their particles only.
/// - `numbers`: a number for each point, unique over all ranks; `None` numbers them by rank.
///
/// # Errors
/// No more than [`LEAST`] points with finite positions, or more than can be counted; a number that occurs twice; a rank
/// that is gone.
pub(crate) fn build_together(
    volume: PointVolume,
    numbers: Option<Vec<u64>>,
    options: &SceneOptions,
    ranks: &mut dyn Collective,
) -> Result<SharedVolume> {
    let requirements = Requirements::of(&volume);
    let transfer_function = volume.transfer_function.clone();
    let Assigned {
        volume,
        numbers,
        trees,
        partitions,
        top_tree,
    } = assign::assign(volume, numbers, options.task.as_ref(), ranks)?;
    let mut shared = SharedVolume {
        family: Vec::new(),
        own: Vec::new(),
        densities: Vec::new(),
        visible: Vec::new(),
        fitted: Vec::new(),
        requirements,
    };
    let Some((points, _)) = Points::of(volume) else {
        return Ok(shared);
    };
    let principal = principal_ranges(&points.shapes);
    let source = points.source(&principal);
    let partial: Vec<PartialTree<'_>> = trees.iter().map(|own| own.partial()).collect();
    let overlaps = {
        let leaves = trees.iter().map(|own| (own.partition, own.partial()));
        let runs: Vec<Range<usize>> = partitions.iter().map(|own| own.run.clone()).collect();
        OverlapCounts::of_all_ranks(
            &leaves.collect::<Vec<_>>(),
            &top_tree,
            &runs,
            &source,
            ranks,
        )?
    };
    let is_merged =
        options.level_of_detail && points.are_merged() && { !ranks.any(!is_mergeable(&source))? };
    let mut levels = Vec::new();
    if is_merged {
        let task = options.task.as_ref();
        let made = fine_levels(&source, &partial, &overlaps, false, task);
        let (fine, clusters) = ranks.agree(made)?;
        let atoms = join::atoms(&trees, &partitions, clusters, &top_tree, ranks)?;
        for level in fine {
            levels.push(join::level(level, ranks)?);
        }
        let atoms = Atoms {
            heads: levels.last().map_or(Vec::new(), |last| last.heads.clone()),
            ..atoms
        };
        let (rank, size) = (ranks.rank(), ranks.size());
        let places = &mut |asked: &[Cluster]| {
            let own = source.places_of_parts(asked, &partial);
            let sums = own.iter().map(|places| *places.sums()).collect();
            let all = ranks.reduce(Ok(sums), |sum, own| {
                sum.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
            })?;
            let none = asked.iter().map(Cluster::no_places);
            Ok(none.zip(&all).map(|(none, sums)| none.with(sums)).collect())
        };
        let places = source.values.is_some().then_some(places as _);
        for level in coarse_levels(&atoms, &overlaps, places, None)? {
            let own = runs_in_turn(level.heads.len(), size, rank, levels.len());
            levels.push(level.keep(own));
        }
    }
    let merged = is_merged.then_some(Levels(levels));
    let mut runs = Vec::new();
    for own in &partial {
        for subtree in own.tree.subtrees(BLOCK_CAPACITY) {
            let run = subtree.run();
            let in_order = run.start + own.start..run.end + own.start;
            let crowding = overlaps.greatest(&in_order, 1.0);
            runs.push((crowding, run.start + own.at..run.end + own.at));
        }
    }
    let starts: Vec<(usize, usize)> = partial.iter().map(|own| (own.at, own.start)).collect();
    drop(trees);
    let mut base = in_blocks(
        points,
        numbers.into(),
        runs,
        principal,
        MEMORY,
        BuildOptions::default(),
    )?;
    base.transfer_function = transfer_function;
    let joined = join::blocks(base, merged.as_ref(), &starts, ranks)?;
    shared.own.push(joined.own);
    shared.densities.push(joined.densities);
    shared.fitted.clone_from(&joined.visible);
    shared.visible = joined.visible;
    let base = joined.volume;
    let coarse = match merged {
        None => None,
        Some(merged) => {
            let (volume, own) = merged.into_volume(&base);
            let densities = join::densities(&volume, &own, ranks)?;
            shared.own.push(own);
            shared.densities.push(densities);
            Some(volume)
        }
    };
    shared.family = family(base, coarse.into_iter().collect());
    Ok(shared)
}

/// Assigns points to ranks by position, so that each rank gets a part of space with about as many points: chunks of the
/// tree, one after another. All positions must be finite. Returns the rank of each of this rank's points.
pub(crate) fn assign_by_position(
    positions: &[DVec3],
    ranks: &mut dyn Collective,
) -> Result<Vec<u32>> {
    let count = ranks.sum(Ok(positions.len() as u64))?.max(1);
    let (members, chunks) = chunks::chunks(positions, count, ranks)?;
    let mut owners = vec![0; positions.len()];
    let mut before = 0;
    for chunk in &chunks {
        // The middle of the chunk decides.
        let middle = u128::from(2 * before + chunk.count) * ranks.size() as u128;
        let owner = (middle / (2 * u128::from(count))) as u32;
        let owner = owner.min(ranks.size() as u32 - 1);
        members[chunk.here.clone()]
            .iter()
            .for_each(|&i| owners[i as usize] = owner);
        before += chunk.count;
    }
    Ok(owners)
}
