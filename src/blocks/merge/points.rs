//! Clusters of a point set: subtrees of the BVH that its blocks are subtrees of.

use std::ops::Range;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::moments::{Moments, Symmetric, Tensors};
use super::{LAST_LEVEL, MERGE_RATIO, MergeBounds, Merged, unevenness};
use crate::blocks::overlap::Crowds;
use crate::blocks::tree::{Subtree, Tree};
use crate::blocks::{Block, BlockedParticles, BlockedVolume, EMPTY_RANGE, NO_PARENT};
use crate::constants::BLOCK_CAPACITY;
use crate::error::Result;
use crate::math::{eigen, lower_factor, lower_matrix, symmetric};
use crate::scene::{
    BoundaryPlanesIn, ColourIn, LocalModelsIn, Shared, StrengthIn, ValuesIn, cut_kernel,
};
use crate::task::{Stage, Task};

/// The particles that are merged, in block order.
#[derive(Debug, Clone, Copy)]
pub(in crate::blocks) struct Source<'a> {
    pub(in crate::blocks) positions: &'a [DVec3],
    pub(in crate::blocks) shapes: Shapes<'a>,
    /// Least and greatest standard deviation of each that is no sphere.
    pub(in crate::blocks) principal: &'a [[f32; 2]],
    pub(in crate::blocks) strength: &'a StrengthIn<Shared>,
    pub(in crate::blocks) colour: &'a ColourIn<Shared>,
    pub(in crate::blocks) values: Option<&'a ValuesIn<Shared>>,
    pub(in crate::blocks) models: Option<&'a LocalModelsIn<Shared>>,
    pub(in crate::blocks) boundary: Option<&'a BoundaryPlanesIn<Shared>>,
}

/// Shapes of particles.
#[derive(Debug, Clone, Copy)]
pub(in crate::blocks) enum Shapes<'a> {
    Spheres(&'a [f32]),
    Factors(&'a [[f32; 6]]),
}

/// A particle that is merged, as far as the domain leaves it.
#[derive(Debug, Clone)]
struct Member {
    index: usize,
    strength: f64,
    /// Of its mean from the block's origin.
    offset: DVec3,
    variance: Symmetric,
    /// Its third central moments are the sum of the third powers of these vectors; empty where nothing is cut.
    skews: Vec<DVec3>,
}

impl Source<'_> {
    /// Least and greatest standard deviation of a particle.
    #[inline]
    pub(in crate::blocks) fn sigmas(&self, i: usize) -> [f32; 2] {
        match self.shapes {
            Shapes::Spheres(sigmas) => [sigmas[i]; 2],
            Shapes::Factors(_) => self.principal[i],
        }
    }

    /// The strength of a whole particle; `None` where it has none that draws anything, or no value.
    fn whole_strength(&self, i: usize) -> Option<f64> {
        let strength = self.strength.stored()[i];
        let has_value = self.values.is_none_or(|v| !v.get(i).is_nan());
        (strength > 0.0 && strength.is_finite() && has_value).then_some(f64::from(strength))
    }

    /// What the domain leaves of it.
    fn strength_left(&self, i: usize) -> Option<f64> {
        match self.boundary.and_then(|b| b.of(i)) {
            None => self.whole_strength(i),
            Some(_) => self.member(i, self.positions[i]).map(|m| m.strength),
        }
    }

    /// `None` where a particle draws nothing: it has no strength, no value, or lies outside the domain.
    fn member(&self, i: usize, origin: DVec3) -> Option<Member> {
        let strength = self.whole_strength(i)?;
        let lower @ [l00, l10, l11, l20, l21, l22] = match self.shapes {
            Shapes::Spheres(sigmas) => {
                let l = f64::from(sigmas[i]);
                [l, 0.0, l, 0.0, 0.0, l]
            }
            Shapes::Factors(factors) => factors[i].map(f64::from),
        };
        let whole = Member {
            index: i,
            strength,
            offset: self.positions[i] - origin,
            variance: [
                l00 * l00,
                l00 * l10,
                l00 * l20,
                l10 * l10 + l11 * l11,
                l10 * l20 + l11 * l21,
                l20 * l20 + l21 * l21 + l22 * l22,
            ],
            skews: Vec::new(),
        };
        let Some(planes) = self.boundary.and_then(|b| b.of(i)) else {
            return Some(whole);
        };
        let left = cut_kernel(lower_matrix(lower), planes)?;
        Some(Member {
            index: i,
            strength: whole.strength * left.share,
            offset: whole.offset + left.shift,
            variance: symmetric(left.factor * left.factor.transpose()),
            skews: left.skews,
        })
    }
}

/// A cluster as a particle.
#[derive(Debug, Clone, Copy, Default)]
struct Particle {
    centre: DVec3,
    factor: [f32; 6],
    strength: f32,
    colour: [f32; 3],
    value: f32,
    spread: f32,
    member_depth: f32,
}

/// Merges particles level by level: the blocks of all levels, the coarsest first, and for each run
/// of `runs` (the particles' own blocks, in block order) the block that stands for it first.
///
/// `None` where merging means nothing (splats, which state opacities; colours that depend on the
/// view) or does not pay (all particles are in one block).
pub(in crate::blocks) fn merge_points(
    source: &Source<'_>,
    tree: &Tree,
    crowds: &Crowds,
    task: Option<&Task>,
) -> Result<Option<MergedPoints>> {
    let is_mergeable = !matches!(source.strength, StrengthIn::PeakOpacity { .. })
        && !matches!(source.colour, ColourIn::Harmonics { .. })
        && source.values.is_none_or(|v| !v.has_infinite());
    if !is_mergeable || source.positions.len() <= BLOCK_CAPACITY {
        return Ok(None);
    }
    let mut levels: Vec<Vec<MergedBlock>> = Vec::new();
    let mut clusters: Vec<Cluster> = Vec::new();
    let mut members = 1;
    loop {
        members *= MERGE_RATIO;
        let subtrees = tree.subtrees(BLOCK_CAPACITY * members);
        let stage = Stage::new(task, "levels of detail", subtrees.len());
        let finer = Finer {
            blocks: levels.last().map_or(&[], Vec::as_slice),
            clusters: &clusters,
        };
        let level: Vec<(MergedBlock, Vec<Cluster>)> = subtrees
            .par_iter()
            .filter(|_| stage.goes_on())
            .map(|&subtree| {
                let run = subtree.run();
                let count = run.len().div_ceil(members);
                let clusters = tree.clusters(subtree, count).into_iter();
                let clusters: Vec<_> = clusters.map(Subtree::run).collect();
                // A block's clusters are as many as fit its particles, the widest cut first: in
                // one place there is no more than their share.
                let crowding = crowds.greatest(&run, 1.0 / members as f32);
                let (block, mut clusters) = MergedBlock::new(source, finer, run, clusters);
                if members < KEPT_MEMBERS {
                    clusters = Vec::new();
                }
                stage.advance(1);
                (MergedBlock { crowding, ..block }, clusters)
            })
            .collect();
        stage.check()?;
        let (level, of_level): (Vec<_>, Vec<_>) = level.into_iter().unzip();
        clusters = of_level.into_iter().flatten().collect();
        let is_last = level.len() == 1 && level[0].particles.len() <= LAST_LEVEL;
        levels.push(level);
        if is_last {
            break;
        }
    }
    Ok(Some(MergedPoints { levels }))
}

/// Clusters of so many members keep their sums for the next level: for smaller ones these would take as much
/// memory as the particles do, and reading the particles twice takes less.
const KEPT_MEMBERS: usize = MERGE_RATIO * MERGE_RATIO;

/// The level before, from which a level is made.
#[derive(Debug, Clone, Copy)]
struct Finer<'a> {
    /// Empty for the first level.
    blocks: &'a [MergedBlock],
    /// In block order; empty where they were not kept.
    clusters: &'a [Cluster],
}

impl<'a> Finer<'a> {
    /// The clusters that a run of particles consists of; `None` where it is a part of one, or none are kept.
    fn clusters(&self, run: &Range<usize>) -> Option<&'a [Cluster]> {
        // Both are subtrees of one tree: one holds the other, or they have nothing in common.
        let first = self.clusters.partition_point(|c| c.run.end <= run.start);
        let count = self.clusters[first..].partition_point(|c| c.run.end <= run.end);
        let own = &self.clusters[first..first + count];
        own.first().filter(|c| c.run.start == run.start)?;
        Some(own)
    }
}

/// The levels of a point set, the finest first.
#[derive(Debug)]
pub(in crate::blocks) struct MergedPoints {
    levels: Vec<Vec<MergedBlock>>,
}

/// Particles that a task merges at least.
const TASK: usize = 8192;

/// A block of merged particles.
#[derive(Debug)]
struct MergedBlock {
    /// Where its members begin in block order.
    start: usize,
    lower: DVec3,
    upper: DVec3,
    bounds: MergeBounds,
    sigmas: [f32; 2],
    crowding: f32,
    particles: Vec<Particle>,
}

impl MergedBlock {
    /// A block, and its clusters as the next level takes them.
    fn new(
        source: &Source<'_>,
        finer: Finer<'_>,
        run: Range<usize>,
        clusters: Vec<Range<usize>>,
    ) -> (Self, Vec<Cluster>) {
        let mut block = Self {
            start: run.start,
            lower: DVec3::INFINITY,
            upper: DVec3::NEG_INFINITY,
            bounds: MergeBounds::default(),
            sigmas: [f32::INFINITY, 0.0],
            crowding: 1.0,
            particles: Vec::new(),
        };
        let mut extend = |lower, upper, sigma| {
            block.lower = block.lower.min(lower);
            block.upper = block.upper.max(upper);
            block.sigmas[0] = block.sigmas[0].min(sigma);
        };
        if finer.blocks.is_empty() {
            for i in run.clone() {
                let at = source.positions[i];
                extend(at, at, source.sigmas(i)[0]);
            }
        } else {
            let first = finer.blocks.partition_point(|b| b.start < run.start);
            let own = finer.blocks[first..].iter();
            for b in own.take_while(|b| b.start < run.end) {
                extend(b.lower, b.upper, b.sigmas[0]);
            }
        }
        let origin = block.origin();
        let mut third_squares = 0.0;
        let mut uneven_squares = 0.0;
        let each = run.len() / clusters.len().max(1);
        let clusters: Vec<(Cluster, Option<_>)> = clusters
            .into_par_iter()
            .with_min_len((TASK / each.max(1)).max(1))
            .map(|run| {
                let sums = match finer.clusters(&run) {
                    Some(parts) => Sums::of_parts(parts),
                    None => Sums::of_members(source, origin, run.clone()),
                };
                let sums = sums.map(Box::new);
                let merged = sums
                    .as_ref()
                    .map(|sums| sums.merged(source, &run, origin, block.sigmas[0]));
                (Cluster { run, sums }, merged)
            })
            .collect();
        for (particle, bounds, sigma) in clusters.iter().filter_map(|(_, merged)| *merged) {
            third_squares += f64::from(bounds.third).powi(6);
            uneven_squares += f64::from(bounds.uneven).powi(2);
            block.bounds = block.bounds.max(bounds);
            block.sigmas[1] = block.sigmas[1].max(sigma);
            block.particles.push(particle);
        }
        let count = block.particles.len().max(1) as f64;
        block.bounds.third_mean = (third_squares / count).powf(1.0 / 6.0) as f32;
        block.bounds.uneven = (uneven_squares / count).sqrt() as f32;
        let clusters = clusters.into_iter().map(|(cluster, _)| cluster).collect();
        (block, clusters)
    }

    fn origin(&self) -> DVec3 {
        (self.lower + self.upper) / 2.0
    }
}

/// A run of particles that became one.
#[derive(Debug)]
struct Cluster {
    run: Range<usize>,
    /// `None` where no member has any strength.
    sums: Option<Box<Sums>>,
}

/// What a cluster knows of its members, enough to be one of a larger cluster's parts. Means are weighted by
/// strength.
#[derive(Debug, Clone, Default)]
struct Sums {
    /// Of all members together.
    strength: f64,
    /// World units.
    centre: DVec3,
    moments: Tensors,
    /// Means of values, of their squares, of colours and of their squared lengths.
    value: f64,
    square: f64,
    colour: DVec3,
    colour_square: f64,
    /// Sum of strength² over the least area of the kernel.
    depth: f64,
    /// Sum of the kernels' own volumes.
    overlap: f64,
}

impl Sums {
    /// Over particles. `None` where none has any strength.
    ///
    /// - `origin`: near them, so that their places keep their digits.
    fn of_members(source: &Source<'_>, origin: DVec3, members: Range<usize>) -> Option<Self> {
        let visible: Vec<Member> = members.filter_map(|i| source.member(i, origin)).collect();
        let strength: f64 = visible.iter().map(|m| m.strength).sum();
        if !(strength > 0.0 && strength.is_finite()) {
            return None;
        }
        let share = |m: &Member| m.strength / strength;
        let centre: DVec3 = visible.iter().map(|m| m.offset * share(m)).sum();
        let mut sums = Self {
            strength,
            centre: origin + centre,
            ..Self::default()
        };
        let mut moments = Moments::default();
        for m in &visible {
            let (i, w) = (m.index, share(m));
            moments.add(w, m.offset - centre, &m.variance);
            for skew in &m.skews {
                moments.add_skew(w, *skew);
            }
            if let Some(values) = source.values {
                let v = f64::from(values.get(i));
                sums.value += w * v;
                sums.square += w * v * v;
            }
            if let ColourIn::PerParticle(colours) = source.colour {
                let c = DVec3::from(colours[i].map(f64::from));
                sums.colour += c * w;
                sums.colour_square += w * c.length_squared();
            }
            let [least, greatest] = source.sigmas(i).map(f64::from);
            sums.depth += m.strength.powi(2) / (std::f64::consts::TAU * least * greatest);
            sums.overlap += (4.0 * std::f64::consts::PI).powf(1.5) * least * greatest * greatest;
        }
        sums.moments = moments.tensors();
        Some(sums)
    }

    /// Over clusters. `None` where none has any strength.
    fn of_parts(parts: &[Cluster]) -> Option<Self> {
        let parts = || parts.iter().filter_map(|part| part.sums.as_deref());
        let strength: f64 = parts().map(|part| part.strength).sum();
        let near = parts().next()?.centre;
        let shares = || parts().map(|part| (part.strength / strength, part));
        let centre: DVec3 = shares().map(|(w, part)| (part.centre - near) * w).sum();
        let mut sums = Self {
            strength,
            centre: near + centre,
            ..Self::default()
        };
        for (w, part) in shares() {
            sums.moments
                .add(w, part.centre - near - centre, &part.moments);
            sums.value += w * part.value;
            sums.square += w * part.square;
            sums.colour += part.colour * w;
            sums.colour_square += w * part.colour_square;
            sums.depth += part.depth;
            sums.overlap += part.overlap;
        }
        Some(sums)
    }

    /// The cluster as a particle, what that leaves out, and its greatest standard deviation.
    ///
    /// - `members`: whose sums these are.
    /// - `origin`: of their block.
    /// - `narrowest`: the least standard deviation in the block.
    fn merged(
        &self,
        source: &Source<'_>,
        members: &Range<usize>,
        origin: DVec3,
        narrowest: f32,
    ) -> (Particle, MergeBounds, f32) {
        let common = f64::from(narrowest).powi(2);
        let variance = self.moments.second;
        let (eigenvalues, axes) = eigen(variance);
        let sigmas = eigenvalues.max(DVec3::ZERO).map(f64::sqrt);
        let factor = lower_factor(axes * DMat3::from_diagonal(sigmas));
        let trace = variance[0] + variance[3] + variance[5];
        // Even over an interval of this half width, the values have this variance.
        let spread = (3.0 * (self.square - self.value * self.value).max(0.0)).sqrt();
        let member_depth = self.depth / self.strength.powi(2);
        let particle = Particle {
            centre: self.centre - origin,
            factor: factor.map(|l| l as f32),
            strength: self.strength as f32,
            colour: self.colour.as_vec3().into(),
            value: self.value as f32,
            spread: spread as f32,
            member_depth: (member_depth * lone_share(self.overlap, sigmas)) as f32,
        };
        let uneven = source.values.map_or(0.0, |values| {
            let of = |i| {
                let strength = source.strength_left(i)?;
                Some((strength / self.strength, f64::from(values.get(i))))
            };
            unevenness(members.clone().filter_map(of), self.value, spread)
        });
        let colour_variance = self.colour_square - self.colour.length_squared();
        let mut bounds = MergeBounds {
            third_mean: 0.0,
            third: self.moments.third_norm().cbrt() as f32,
            fourth: self.moments.fourth_cumulant_norm().sqrt().sqrt() as f32,
            second: (trace - 3.0 * common).max(0.0).sqrt() as f32,
            spread: particle.spread,
            colour: colour_variance.max(0.0).sqrt() as f32,
            uneven: uneven as f32,
        };
        if !(trace + colour_variance + f64::from(bounds.third + bounds.fourth)).is_finite() {
            // Members without a finite shape or colour are never merged: `max` would forget a NaN.
            bounds.third = f32::INFINITY;
        }
        let greatest = sigmas.max_element() as f32 * (1.0 + 2.0 * f32::EPSILON);
        (particle, bounds, greatest)
    }
}

/// How much of their opacity the kernels of a cluster have each by itself: 1 where they lie far
/// apart, 0 where they overlap as those of a lattice do.
///
/// - `overlap`: the sum of the kernels' own volumes (4 pi)^(3/2) sigma³, the inverse of the integral
///   of the kernel's square.
/// - `sigmas`: of the cluster, whose volume is measured alike.
fn lone_share(overlap: f64, sigmas: DVec3) -> f64 {
    let room = (4.0 * std::f64::consts::PI).powf(1.5) * sigmas.element_product();
    if room > 0.0 {
        (-overlap / room).exp()
    } else {
        0.0
    }
}

impl MergedPoints {
    /// The first-level block that stands for the particle at `place` of block order, counted as in
    /// [`MergedPoints::into_volume`].
    pub(in crate::blocks) fn parent_of(&self, place: usize) -> u32 {
        self.number(0, place)
    }

    /// The number of the block of a level that holds the particle at `place` of block order: blocks
    /// of the coarsest level come first.
    fn number(&self, level: usize, place: usize) -> u32 {
        let coarser: usize = self.levels[level + 1..].iter().map(Vec::len).sum();
        let within = self.levels[level].partition_point(|block| block.start <= place) - 1;
        (coarser + within) as u32
    }

    /// All levels as one volume, the coarsest first.
    pub(in crate::blocks) fn into_volume(self, source: &Source<'_>) -> BlockedVolume {
        let count: usize = self
            .levels
            .iter()
            .flatten()
            .map(|b| b.particles.len())
            .sum();
        let mut blocks = Vec::new();
        let mut merged = Merged::default();
        let mut offsets = Vec::with_capacity(count);
        let mut factors = Vec::with_capacity(count);
        let mut strengths = Vec::with_capacity(count);
        let mut colours = Vec::new();
        let mut values = Vec::new();
        let (mut member_depths, mut spreads) = (Vec::new(), Vec::new());
        for (level, of_level) in self.levels.iter().enumerate().rev() {
            for block in of_level {
                let strongest = block.particles.iter().map(|p| p.strength);
                blocks.push(Block {
                    origin: block.origin(),
                    half_extent: ((block.upper - block.lower) / 2.0).as_vec3()
                        * (1.0 + f32::EPSILON),
                    max_sigma: block.sigmas[1],
                    min_sigma: block.sigmas[0],
                    max_strength: strongest.fold(0.0, f32::max),
                    first: offsets.len() as u32,
                    count: block.particles.len() as u32,
                    value_range: EMPTY_RANGE,
                    values_around: EMPTY_RANGE,
                    greatest_spread: 0.0,
                    parent: if level + 1 < self.levels.len() {
                        self.number(level + 1, block.start)
                    } else {
                        NO_PARENT
                    },
                    level: level as u32 + 1,
                    crowding: block.crowding,
                });
                merged.bounds.push(block.bounds);
                for particle in &block.particles {
                    offsets.push(particle.centre.as_vec3().to_array());
                    factors.push(particle.factor);
                    strengths.push(particle.strength);
                    member_depths.push(particle.member_depth);
                    if matches!(source.colour, ColourIn::PerParticle(_)) {
                        colours.push(particle.colour);
                    }
                    if source.values.is_some() {
                        values.push(particle.value);
                        spreads.push(particle.spread);
                    }
                }
            }
        }
        merged.member_depths = member_depths.into();
        merged.spreads = spreads.into();
        BlockedVolume {
            blocks,
            particles: BlockedParticles::Anisotropic {
                offsets: offsets.into(),
                factors: factors.into(),
            },
            strength: match source.strength {
                StrengthIn::Classified { .. } => StrengthIn::Classified {
                    volumes: strengths.into(),
                },
                _ => StrengthIn::Mass(strengths.into()),
            },
            colour: match source.colour {
                ColourIn::PerParticle(_) => ColourIn::PerParticle(colours.into()),
                other => other.clone(),
            },
            values: source.values.map(|_| ValuesIn::F32(values.into())),
            transfer_function: None,
            normals: None,
            local_models: None,
            lobes: None,
            indices: None,
            boundary: None,
            merged: Some(merged),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers without a pattern, 0 to 1.
    fn number(n: usize) -> f64 {
        ((n as f64 * 12.9898).sin() * 43_758.547).fract().abs()
    }

    /// Crowded towards a corner, and some far away: clusters of a level then lie within one of the level before, or
    /// hold several.
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
            // Every seventh draws nothing.
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
        let clusters: Vec<Cluster> = clusters_of(16)
            .map(|run| Cluster {
                sums: Sums::of_members(&source, DVec3::ZERO, run.clone()).map(Box::new),
                run,
            })
            .collect();
        let finer = Finer {
            blocks: &[],
            clusters: &clusters,
        };
        let (mut of_several, mut within) = (0, 0);
        for run in clusters_of(256) {
            let Some(parts) = finer.clusters(&run) else {
                within += 1;
                assert!(
                    clusters
                        .iter()
                        .any(|c| c.run.start <= run.start && run.end <= c.run.end)
                );
                continue;
            };
            of_several += usize::from(parts.len() > 1);
            let direct = Sums::of_members(&source, positions[run.start], run.clone());
            let (Some(sums), Some(direct)) = (Sums::of_parts(parts), direct) else {
                assert!(parts.iter().all(|part| part.sums.is_none()));
                continue;
            };
            // Some hundred roundings of f64, of places up to 40 among clusters far narrower.
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
        assert!(of_several > 50 && within > 0, "{of_several} {within}");
    }
}
