//! Gathers bounds of the blocks of each rank on all ranks.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::super::density;
use super::super::merge::{Atoms, Cluster, Head, Level, Levels};
use super::super::tree::{Node, Tree};
use super::assign::{OwnTree, Partition};
use crate::blocks::block::Block;
use crate::blocks::volume::BlockedVolume;
use crate::collective::Collective;
use crate::error::Result;
use crate::view::Bounds;

/// Merges the gathered elements in block order, and lists those of this rank.
///
/// - `start`: beginning of an element in block order.
fn joined<T: Pod>(all: Vec<Vec<T>>, rank: usize, start: impl Fn(&T) -> usize) -> Joined<T> {
    let mut sorted: Vec<(usize, T)> = Vec::new();
    for (owner, own) in all.into_iter().enumerate() {
        sorted.extend(own.into_iter().map(|own| (owner, own)));
    }
    sorted.sort_by_key(|(_, own)| start(own));
    let mut joined = Joined {
        all: Vec::with_capacity(sorted.len()),
        own: Vec::new(),
    };
    for (i, (owner, own)) in (0..).zip(sorted) {
        joined.all.push(own);
        if owner != rank {
            continue;
        }
        match joined.own.last_mut() {
            Some(run) if run.end == i => run.end += 1,
            _ => joined.own.push(i..i + 1),
        }
    }
    joined
}

struct Joined<T> {
    all: Vec<T>,
    own: Vec<Range<u32>>,
}

/// Gathers the block headers of a level.
pub(super) fn level(own: Level, ranks: &mut dyn Collective) -> Result<Level> {
    let heads = ranks.gather_records(Ok(own.heads))?;
    let heads = joined(heads, ranks.rank(), Head::start);
    Ok(Level {
        heads: heads.all,
        own: heads.own,
        particles: own.particles,
    })
}

/// Gathers the clusters of all ranks, and builds the tree over them; the caller adds the headers.
pub(super) fn atoms(
    trees: &[OwnTree],
    partitions: &[Partition],
    clusters: Vec<Cluster>,
    top_tree: &Tree,
    ranks: &mut dyn Collective,
) -> Result<Atoms> {
    let mut next = clusters.as_slice();
    let (mut counts, mut nodes) = (Vec::new(), Vec::<Node>::new());
    for own in trees {
        let run = &partitions[own.partition].run;
        let count = next.partition_point(|cluster| cluster.run().start < run.end);
        let (of_tree, rest) = next.split_at(count);
        next = rest;
        let within = |cluster: &Cluster| {
            let of_all = cluster.run();
            of_all.start - run.start..of_all.end - run.start
        };
        let runs: Vec<Range<usize>> = of_tree.iter().map(within).collect();
        counts.push([own.partition as u64, count as u64]);
        nodes.extend(own.tree.above(&runs).nodes());
    }
    let counts = ranks.gather_records(Ok(counts))?;
    let nodes = ranks.gather_records(Ok(nodes))?;
    let mut parts = vec![Tree::default(); partitions.len()];
    for (counts, nodes) in counts.iter().zip(&nodes) {
        let mut nodes = nodes.as_slice();
        for [partition, count] in counts {
            let own = (*count as usize).saturating_sub(1).min(nodes.len());
            let (of_part, rest) = nodes.split_at(own);
            nodes = rest;
            parts[*partition as usize] = top_tree.of_nodes(of_part.to_vec());
        }
    }
    let clusters = ranks.gather_records(Ok(clusters))?;
    let start = |cluster: &Cluster| cluster.run().start;
    Ok(Atoms {
        clusters: joined(clusters, ranks.rank(), start).all,
        tree: top_tree.grafted(&parts),
        heads: Vec::new(),
    })
}

/// A block, and data that follow from its particles.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Known {
    block: Block,
    /// Beginning in block order.
    start: u64,
    density: f64,
    /// Middle and half extent of the visible part.
    visible: [DVec3; 2],
    is_visible: u64,
}

/// A volume with the blocks of all ranks.
pub(super) struct JoinedVolume {
    pub(super) volume: BlockedVolume,
    /// Blocks whose particles are here.
    pub(super) own: Vec<Range<u32>>,
    /// Densities of all blocks.
    pub(super) densities: Vec<f64>,
    /// Boxes around the visible part.
    pub(super) visible: Vec<Bounds>,
}

/// Gathers the blocks of all ranks into a volume.
///
/// - `starts`: for each tree, the beginning of its particles here and in block order.
pub(super) fn blocks(
    mut base: BlockedVolume,
    merged: Option<&Levels>,
    starts: &[(usize, usize)],
    ranks: &mut dyn Collective,
) -> Result<JoinedVolume> {
    let visible = base.visible_box_of_each(base.transfer_function.as_ref());
    let densities = density::densities(&base);
    let known = base.blocks.iter().zip(visible).zip(densities);
    let known = known.map(|((block, visible), density)| {
        let first = block.first as usize;
        let tree = starts.partition_point(|(at, _)| *at <= first);
        let (at, start) = tree.checked_sub(1).map_or((0, 0), |tree| starts[tree]);
        Known {
            block: *block,
            start: (start + first - at) as u64,
            density,
            visible: visible.map_or([DVec3::ZERO; 2], |(middle, half)| [middle, half]),
            is_visible: u64::from(visible.is_some()),
        }
    });
    let known: Vec<Known> = known.collect();
    let known = ranks.gather_records(Ok(known))?;
    let known = joined(known, ranks.rank(), |known: &Known| known.start as usize);
    let block = |known: &Known| Block {
        first: 0,
        parent: merged.map_or(known.block.parent, |levels| {
            levels.parent_of(known.start as usize)
        }),
        ..known.block
    };
    base.blocks = known.all.iter().map(block).collect();
    let mut first = 0;
    for block in known.own.iter().cloned().flatten() {
        let block = &mut base.blocks[block as usize];
        block.first = first;
        first += block.count;
    }
    let densities = known.all.iter().map(|known| known.density).collect();
    let visible = known.all.iter().filter(|known| known.is_visible > 0);
    Ok(JoinedVolume {
        volume: base,
        own: known.own,
        densities,
        visible: visible
            .map(|known| (known.visible[0], known.visible[1]))
            .collect(),
    })
}

/// Gathers the densities of all blocks.
///
/// - `own`: blocks whose particles are here.
pub(super) fn densities(
    volume: &BlockedVolume,
    own: &[Range<u32>],
    ranks: &mut dyn Collective,
) -> Result<Vec<f64>> {
    let own = own.iter().cloned().flatten();
    let own = own.map(|i| {
        let block = &volume.blocks[i as usize];
        (f64::from(i), density::density_of(volume, block))
    });
    let own: Vec<[f64; 2]> = own.map(|(i, density)| [i, density]).collect();
    let mut all = vec![0.0; volume.blocks.len()];
    for [i, density] in ranks.gather_records(Ok(own))?.concat() {
        all[i as usize] = density;
    }
    Ok(all)
}
