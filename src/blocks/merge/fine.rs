//! Builds the levels of detail that are merged from particles: clusters of 16 and of 256.

use std::ops::Range;

use rayon::prelude::*;

use super::levels::{Head, Level, MergedCluster, Particle, heads_in, is_last};
use super::sums::{Cluster, Sums};
use super::{FINE_LEVELS, MERGE_RATIO};
use crate::blocks::overlap::OverlapCounts;
use crate::blocks::source::Source;
use crate::blocks::tree::{PartialTree, Subtree};
use crate::constants::BLOCK_CAPACITY;
use crate::error::Result;
use crate::task::{Stage, Task};

/// Builds the levels of the particles that are here; also returns the clusters of the last level.
///
/// - `are_all`: whether these are all particles. If so, levels end once few merged particles are left.
/// - `trees`: over all of these particles, in block order.
/// - `overlaps`: overlap counts in block order.
pub(in crate::blocks) fn fine_levels(
    source: &Source<'_>,
    trees: &[PartialTree<'_>],
    overlaps: &OverlapCounts,
    are_all: bool,
    task: Option<&Task>,
) -> Result<(Vec<Level>, Vec<Cluster>)> {
    let mut levels: Vec<Level> = Vec::new();
    let mut clusters: Vec<Cluster> = Vec::new();
    let mut members = 1;
    for number in 1..=FINE_LEVELS {
        members *= MERGE_RATIO;
        let subtrees = trees.iter().flat_map(|own| {
            let subtrees = own.tree.subtrees(BLOCK_CAPACITY * members);
            subtrees.into_iter().map(move |subtree| (own, subtree))
        });
        let subtrees: Vec<(&PartialTree<'_>, Subtree)> = subtrees.collect();
        let stage = Stage::new(task, "levels of detail", subtrees.len());
        let of_level = Making {
            source,
            finer: levels.last().map(|finer| &*finer.heads),
            overlaps,
            members,
        };
        let made: Vec<(Head, Vec<Particle>, Vec<Cluster>)> = subtrees
            .par_iter()
            .filter(|_| stage.goes_on())
            .map(|&(own, subtree)| {
                let (head, particles, mut clusters) = of_level.block(own, subtree);
                // Clusters of finer levels would take as much memory as the particles.
                if number < FINE_LEVELS {
                    clusters = Vec::new();
                }
                stage.advance(1);
                (head, particles, clusters)
            })
            .collect();
        stage.check()?;
        let mut level = Level::default();
        for (head, particles, of_block) in made {
            level.heads.push(head);
            level.particles.push(particles);
            clusters.extend(of_block);
        }
        level.own.push(0..level.heads.len() as u32);
        levels.push(level);
        if are_all && levels.last().is_some_and(|level| is_last(&level.heads)) {
            break;
        }
    }
    Ok((levels, clusters))
}

/// Context for making a level.
#[derive(Debug, Clone, Copy)]
struct Making<'a> {
    source: &'a Source<'a>,
    /// Block headers of the level before.
    finer: Option<&'a [Head]>,
    overlaps: &'a OverlapCounts,
    /// Number of members of a cluster.
    members: usize,
}

/// Least number of particles that a task merges.
const TASK: usize = 8192;

impl Making<'_> {
    /// Makes a block: its header, its particles, and their clusters.
    fn block(
        &self,
        own: &PartialTree<'_>,
        subtree: Subtree,
    ) -> (Head, Vec<Particle>, Vec<Cluster>) {
        let source = self.source;
        let run = subtree.run();
        let in_order = moved(&run, own.start);
        // A block gets one cluster for each `members` particles, and the widest subtree is cut first. The overlap count
        // in one place is therefore at most that share.
        let crowding = self.overlaps.greatest(&in_order, 1.0 / self.members as f32);
        let mut head = Head::new(in_order.start, crowding);
        match self.finer {
            None => {
                for i in moved(&run, own.at) {
                    let at = source.positions[i];
                    head.extend(at, at, source.sigmas(i)[0]);
                }
            }
            Some(finer) => {
                for of_finer in heads_in(finer, &in_order) {
                    head.extend(of_finer.lower, of_finer.upper, of_finer.narrowest());
                }
            }
        }
        let origin = head.origin();
        let count = run.len().div_ceil(self.members);
        let subtrees = own.tree.clusters(subtree, count);
        let each = run.len() / subtrees.len().max(1);
        let clusters: Vec<(Cluster, Option<MergedCluster>)> = subtrees
            .into_par_iter()
            .with_min_len((TASK / each.max(1)).max(1))
            .map(|subtree| {
                let run = subtree.run();
                let members = moved(&run, own.at);
                let sums = Sums::of_members(source, origin, members.clone());
                let cluster = Cluster::new(moved(&run, own.start), sums);
                let merged = cluster.drawn().map(|sums| {
                    let mut merged = sums.merged(origin, head.narrowest());
                    let places = source.places(members, &cluster);
                    merged.bounds.uneven = places.unevenness() as f32;
                    merged
                });
                (cluster, merged)
            })
            .collect();
        let merged = || clusters.iter().filter_map(|(_, merged)| merged.as_ref());
        let particles = merged().map(|merged| merged.particle).collect();
        let head = head.with(merged());
        (
            head,
            particles,
            clusters.into_iter().map(|(own, _)| own).collect(),
        )
    }
}

fn moved(run: &Range<usize>, by: usize) -> Range<usize> {
    run.start + by..run.end + by
}
