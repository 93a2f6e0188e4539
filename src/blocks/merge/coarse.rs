//! Builds the levels of detail that are merged from clusters; of the particles they read only values.

use std::ops::Range;

use rayon::prelude::*;

use super::levels::{Head, Level, MergedCluster, heads_in, is_last};
use super::sums::{Cluster, Sums};
use super::{FINE_LEVELS, MERGE_RATIO};
use crate::blocks::merge::places::Places;
use crate::blocks::overlap::OverlapCounts;
use crate::blocks::tree::Tree;
use crate::constants::BLOCK_CAPACITY;
use crate::error::Result;
use crate::task::{Stage, Task};

/// Leaves of the coarse levels: clusters of the last fine level, which are not divided again.
#[derive(Debug)]
pub(in crate::blocks) struct Atoms {
    /// Clusters of all particles, in block order.
    pub(in crate::blocks) clusters: Vec<Cluster>,
    /// Tree over the clusters.
    pub(in crate::blocks) tree: Tree,
    /// Headers of the clusters' blocks.
    pub(in crate::blocks) heads: Vec<Head>,
}

/// Finds the distribution of the values of clusters' members.
pub(in crate::blocks) type FindPlaces<'a> = &'a mut dyn FnMut(&[Cluster]) -> Result<Vec<Places>>;

/// Builds the levels after the fine ones, up to one of a few particles.
///
/// - `places`: given if there are values.
pub(in crate::blocks) fn coarse_levels(
    atoms: &Atoms,
    overlaps: &OverlapCounts,
    mut places: Option<FindPlaces<'_>>,
    task: Option<&Task>,
) -> Result<Vec<Level>> {
    let mut levels: Vec<Level> = Vec::new();
    let mut members = MERGE_RATIO.pow(FINE_LEVELS);
    let mut clusters: Vec<Cluster> = Vec::new();
    loop {
        members *= MERGE_RATIO;
        let subtrees = atoms
            .tree
            .largest(|run| atoms.particles(&run).len() <= BLOCK_CAPACITY * members);
        let stage = Stage::new(task, "levels of detail", subtrees.len());
        let finer = Finer {
            atoms,
            heads: levels.last().map_or(&*atoms.heads, |level| &*level.heads),
            clusters: &clusters,
        };
        let made: Vec<(Head, Vec<Cluster>)> = subtrees
            .par_iter()
            .filter(|_| stage.goes_on())
            .map(|&subtree| {
                let run = atoms.particles(&subtree.run());
                let crowding = overlaps.greatest(&run, 1.0 / members as f32);
                let mut head = Head::new(run.start, crowding);
                for of_finer in heads_in(finer.heads, &run) {
                    head.extend(of_finer.lower, of_finer.upper, of_finer.narrowest());
                }
                let count = run.len().div_ceil(members);
                let subtrees = atoms.tree.clusters(subtree, count);
                let clusters = subtrees
                    .into_par_iter()
                    .map(|subtree| finer.cluster(&subtree.run()))
                    .collect();
                stage.advance(1);
                (head, clusters)
            })
            .collect();
        stage.check()?;
        let (heads, of_blocks): (Vec<Head>, Vec<Vec<Cluster>>) = made.into_iter().unzip();
        let mut merged: Vec<Vec<MergedCluster>> = heads
            .par_iter()
            .zip(&of_blocks)
            .map(|(head, clusters)| {
                let drawn = clusters.iter().filter_map(Cluster::drawn);
                let merged = drawn.map(|sums| sums.merged(head.origin(), head.narrowest()));
                merged.collect()
            })
            .collect();
        clusters = of_blocks.concat();
        if let Some(places) = &mut places {
            let drawn = clusters.iter().filter(|own| own.drawn().is_some());
            let places = places(&drawn.copied().collect::<Vec<_>>())?;
            for (merged, places) in merged.iter_mut().flatten().zip(places) {
                merged.bounds.uneven = places.unevenness() as f32;
            }
        }
        let mut level = Level::default();
        for (head, merged) in heads.into_iter().zip(&merged) {
            level.heads.push(head.with(merged.iter()));
            let particles = merged.iter().map(|merged| merged.particle);
            level.particles.push(particles.collect());
        }
        level.own.push(0..level.heads.len() as u32);
        let is_last = is_last(&level.heads);
        levels.push(level);
        if is_last {
            return Ok(levels);
        }
    }
}

impl Atoms {
    /// Returns the particles of a run of atoms.
    fn particles(&self, run: &Range<usize>) -> Range<usize> {
        match &self.clusters[run.clone()] {
            [first, .., last] => first.run().start..last.run().end,
            [one] => one.run(),
            [] => 0..0,
        }
    }
}

/// Data that a level is made of.
#[derive(Debug, Clone, Copy)]
struct Finer<'a> {
    atoms: &'a Atoms,
    /// Block headers of the level before.
    heads: &'a [Head],
    /// Clusters of the level before, in block order; empty if these are the atoms.
    clusters: &'a [Cluster],
}

impl Finer<'_> {
    /// Merges a run of atoms into a cluster.
    fn cluster(&self, atoms: &Range<usize>) -> Cluster {
        let run = self.atoms.particles(atoms);
        // Both are subtrees of one tree: one contains the other, or they are disjoint.
        let first = self.clusters.partition_point(|c| c.run().end <= run.start);
        let count = self.clusters[first..].partition_point(|c| c.run().end <= run.end);
        let parts = match &self.clusters[first..first + count] {
            parts @ [first, ..] if first.run().start == run.start => parts,
            // The run is a part of one cluster.
            _ => &self.atoms.clusters[atoms.clone()],
        };
        Cluster::new(run, Sums::of_parts(parts))
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::blocks::source::{Shapes, Source};
    use crate::blocks::tree::Subtree;
    use crate::scene::{ColourIn, StrengthIn, ValuesIn};

    /// Returns a pseudo-random number from 0 to 1.
    fn number(n: usize) -> f64 {
        ((n as f64 * 12.9898).sin() * 43_758.547).fract().abs()
    }

    /// Points crowded towards a corner, and some far away. Clusters of a level then lie within one of the level before,
    /// or contain several.
    #[test]
    fn sums_of_clusters_are_those_of_their_members() {
        const COUNT: usize = 40_000;
        let at = |n: usize| {
            let p = [3 * n, 3 * n + 1, 3 * n + 2].map(|n| number(n).powi(3));
            DVec3::from(p) * if n.is_multiple_of(500) { 40.0 } else { 1.0 }
        };
        let scattered: Vec<DVec3> = (0..COUNT).map(at).collect();
        let (tree, order) = Tree::over(&scattered, &[]);
        let positions: Vec<DVec3> = order.iter().map(|&i| scattered[i as usize]).collect();
        let of = |k: usize| (0..COUNT).map(move |n| number(5 * n + k) as f32);
        let factors: Vec<[f32; 6]> = of(0)
            .zip(of(1))
            .map(|(a, b)| [a, b, b, 0.1, a - b, 0.2].map(|l| 0.01 * l))
            .collect();
        let strength = StrengthIn::Classified {
            // Every seventh particle has no strength.
            volumes: of(2)
                .enumerate()
                .map(|(n, v)| if n % 7 == 0 { 0.0 } else { v })
                .collect(),
        };
        let colour = ColourIn::PerParticle(of(3).map(|c| [c, 1.0 - c, 0.5]).collect());
        let values = ValuesIn::F32(of(4).collect());
        let source = Source {
            positions: &positions,
            shapes: Shapes::Factors(&factors),
            principal: &vec![[0.001, 0.02]; COUNT],
            strength: &strength,
            colour: &colour,
            values: Some(&values),
            models: None,
            boundary: None,
        };
        let tree = &tree;
        let clusters_of = |members: usize| {
            let subtrees = tree.subtrees(BLOCK_CAPACITY * members);
            let clusters = subtrees.into_iter().flat_map(move |subtree| {
                let count = subtree.run().len().div_ceil(members);
                tree.clusters(subtree, count)
            });
            clusters.map(Subtree::run)
        };
        let of = |run: Range<usize>| {
            let sums = Sums::of_members(&source, positions[run.start], run.clone());
            Cluster::new(run, sums)
        };
        let clusters: Vec<Cluster> = clusters_of(4).map(of).collect();
        let runs: Vec<Range<usize>> = clusters.iter().map(Cluster::run).collect();
        let atoms = Atoms {
            tree: tree.above(&runs),
            clusters,
            heads: Vec::new(),
        };
        let of_atoms = |members: usize| {
            let subtrees = atoms.tree.largest(|run| run.len() <= members);
            subtrees.into_iter().map(Subtree::run)
        };
        let finer = |clusters| Finer {
            atoms: &atoms,
            heads: &[],
            clusters,
        };
        // Clusters of atoms, of several clusters, and of parts of clusters.
        let of_eight: Vec<Cluster> = of_atoms(8).map(|run| finer(&[]).cluster(&run)).collect();
        let of_many = of_atoms(64).map(|run| (finer(&of_eight), run));
        let of_few = of_atoms(3).map(|run| (finer(&of_eight), run));
        let (mut of_several, mut within) = (0, 0);
        for (finer, atoms) in of_atoms(8)
            .map(|run| (finer(&[]), run))
            .chain(of_many)
            .chain(of_few)
        {
            let cluster = finer.cluster(&atoms);
            let run = cluster.run();
            let is_within = |c: &Cluster| {
                let own = c.run();
                own.start <= run.start && run.end <= own.end && own != run
            };
            within += usize::from(finer.clusters.iter().any(is_within));
            of_several += usize::from(atoms.len() > 1);
            let direct = Sums::of_members(&source, positions[run.start], run.clone());
            let (Some(sums), Some(direct)) = (cluster.drawn(), direct) else {
                assert!(direct.is_none() && cluster.drawn().is_none());
                continue;
            };
            // Some hundred roundings of f64, at positions up to 40 among far narrower clusters.
            let width =
                direct.moments.second[0] + direct.moments.second[3] + direct.moments.second[5];
            let near = |a: f64, b: f64, unit: f64| (a - b).abs() <= 1e-9 * unit;
            assert!(near(sums.strength, direct.strength, direct.strength));
            assert!((sums.centre - direct.centre).length() <= 1e-9 * width.sqrt());
            for (a, b) in sums.moments.second.iter().zip(&direct.moments.second) {
                assert!(near(*a, *b, width));
            }
            let (a, b) = (&sums.moments, &direct.moments);
            assert!(near(a.third_norm(), b.third_norm(), width.powf(1.5)));
            assert!(near(
                a.fourth_cumulant_norm(),
                b.fourth_cumulant_norm(),
                10.0 * width.powi(2)
            ));
            assert!(near(sums.value, direct.value, 1.0));
            assert!(near(sums.square, direct.square, 1.0));
            assert!((sums.colour - direct.colour).length() <= 1e-9);
            assert!(near(sums.colour_square, direct.colour_square, 1.0));
            assert!(near(sums.depth, direct.depth, direct.depth));
            assert!(near(sums.overlap, direct.overlap, direct.overlap));
        }
        assert!(of_several > 50 && within > 50, "{of_several} {within}");
    }
}
