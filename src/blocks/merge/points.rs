//! Clusters of a point set: subtrees of the BVH that its blocks are subtrees of.

use std::ops::Range;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::{LAST_LEVEL, MERGE_RATIO, MergeBounds, Merged, unevenness};
use crate::blocks::overlap::Crowds;
use crate::blocks::tree::Tree;
use crate::blocks::{Block, BlockedParticles, BlockedVolume, EMPTY_RANGE, NO_PARENT};
use crate::constants::BLOCK_CAPACITY;
use crate::error::Result;
use crate::math::{eigen, lower_factor, lower_matrix, symmetric};
use crate::scene::{BoundaryPlanes, Colour, LocalModels, Strength, Values, cut_kernel};
use crate::task::{Stage, Task};

/// The particles that are merged, in block order.
#[derive(Debug, Clone, Copy)]
pub(in crate::blocks) struct Source<'a> {
    pub(in crate::blocks) positions: &'a [DVec3],
    pub(in crate::blocks) shapes: Shapes<'a>,
    /// Least and greatest standard deviation of each.
    pub(in crate::blocks) sigmas: &'a [[f32; 2]],
    pub(in crate::blocks) strength: &'a Strength,
    pub(in crate::blocks) colour: &'a Colour,
    pub(in crate::blocks) values: Option<&'a Values>,
    pub(in crate::blocks) models: Option<&'a LocalModels>,
    pub(in crate::blocks) boundary: Option<&'a BoundaryPlanes>,
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
    /// `None` where a particle draws nothing: it has no strength, no value, or lies outside the domain.
    fn member(&self, i: usize, origin: DVec3) -> Option<Member> {
        let strength = self.strength.stored()[i];
        let has_value = self.values.is_none_or(|v| !v.get(i).is_nan());
        if !(strength > 0.0 && strength.is_finite() && has_value) {
            return None;
        }
        let lower @ [l00, l10, l11, l20, l21, l22] = match self.shapes {
            Shapes::Spheres(sigmas) => {
                let l = f64::from(sigmas[i]);
                [l, 0.0, l, 0.0, 0.0, l]
            }
            Shapes::Factors(factors) => factors[i].map(f64::from),
        };
        let whole = Member {
            index: i,
            strength: f64::from(strength),
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
    let is_mergeable = !matches!(source.strength, Strength::PeakOpacity { .. })
        && !matches!(source.colour, Colour::Harmonics { .. })
        && source.values.is_none_or(|v| !v.has_infinite());
    if !is_mergeable || source.positions.len() <= BLOCK_CAPACITY {
        return Ok(None);
    }
    let mut levels: Vec<Vec<MergedBlock>> = Vec::new();
    let mut members = 1;
    loop {
        members *= MERGE_RATIO;
        let subtrees = tree.subtrees(BLOCK_CAPACITY * members);
        let stage = Stage::new(task, "levels of detail", subtrees.len());
        let level: Vec<MergedBlock> = subtrees
            .par_iter()
            .filter(|_| stage.goes_on())
            .map(|&subtree| {
                let run = tree.run(subtree);
                let count = run.len().div_ceil(members);
                let clusters = tree.clusters(subtree, count).into_iter();
                let clusters: Vec<_> = clusters.map(|node| tree.run(node)).collect();
                // A block's clusters are as many as fit its particles, the widest cut first: in
                // one place there is no more than their share.
                let crowding = crowds.greatest(&run, 1.0 / members as f32);
                let block = MergedBlock::new(source, run, &clusters);
                stage.advance(1);
                MergedBlock { crowding, ..block }
            })
            .collect();
        stage.check()?;
        let is_last = level.len() == 1 && level[0].particles.len() <= LAST_LEVEL;
        levels.push(level);
        if is_last {
            break;
        }
    }
    Ok(Some(MergedPoints { levels }))
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
    origin: DVec3,
    half_extent: DVec3,
    bounds: MergeBounds,
    sigmas: [f32; 2],
    crowding: f32,
    particles: Vec<Particle>,
}

impl MergedBlock {
    fn new(source: &Source<'_>, run: Range<usize>, clusters: &[Range<usize>]) -> Self {
        // The coarsest blocks are few and have millions: they are shared among all processors, too.
        let positions = source.positions[run.clone()].par_chunks(TASK);
        let sigmas = source.sigmas[run.clone()].par_chunks(TASK);
        let (lower, upper, narrowest) = positions
            .zip(sigmas)
            .map(|(positions, sigmas)| {
                let mut lower = DVec3::INFINITY;
                let mut upper = DVec3::NEG_INFINITY;
                let mut narrowest = f32::INFINITY;
                for (&p, &[sigma, _]) in positions.iter().zip(sigmas) {
                    lower = lower.min(p);
                    upper = upper.max(p);
                    narrowest = narrowest.min(sigma);
                }
                (lower, upper, narrowest)
            })
            .reduce(
                || (DVec3::INFINITY, DVec3::NEG_INFINITY, f32::INFINITY),
                |a, b| (a.0.min(b.0), a.1.max(b.1), a.2.min(b.2)),
            );
        let origin = (lower + upper) / 2.0;
        let mut block = Self {
            start: run.start,
            origin,
            half_extent: (upper - lower) / 2.0,
            bounds: MergeBounds::default(),
            sigmas: [narrowest, 0.0],
            crowding: 1.0,
            particles: Vec::new(),
        };
        let mut third_squares = 0.0;
        let mut uneven_squares = 0.0;
        let each = run.len() / clusters.len().max(1);
        let merged: Vec<_> = clusters
            .par_iter()
            .with_min_len((TASK / each.max(1)).max(1))
            .map(|cluster| merge(source, origin, narrowest, cluster.clone()))
            .collect();
        for (particle, bounds, sigma) in merged.into_iter().flatten() {
            third_squares += f64::from(bounds.third).powi(6);
            uneven_squares += f64::from(bounds.uneven).powi(2);
            block.bounds = block.bounds.max(bounds);
            block.sigmas[1] = block.sigmas[1].max(sigma);
            block.particles.push(particle);
        }
        let count = block.particles.len().max(1) as f64;
        block.bounds.third_mean = (third_squares / count).powf(1.0 / 6.0) as f32;
        block.bounds.uneven = (uneven_squares / count).sqrt() as f32;
        block
    }
}

/// One cluster as a particle, what that leaves out, and its greatest standard deviation; `None`
/// where no member has any strength.
fn merge(
    source: &Source<'_>,
    origin: DVec3,
    narrowest: f32,
    members: Range<usize>,
) -> Option<(Particle, MergeBounds, f32)> {
    let visible: Vec<Member> = members.filter_map(|i| source.member(i, origin)).collect();
    let total: f64 = visible.iter().map(|m| m.strength).sum();
    if !(total > 0.0 && total.is_finite()) {
        return None;
    }
    let share = |m: &Member| m.strength / total;
    let centre: DVec3 = visible.iter().map(|m| m.offset * share(m)).sum();
    let common = f64::from(narrowest).powi(2);
    let mut moments = Moments::default();
    let (mut value, mut square, mut colour, mut colour_square) = (0.0, 0.0, DVec3::ZERO, 0.0);
    let mut member_depth = 0.0;
    let mut overlap = 0.0;
    for m in &visible {
        let (i, w) = (m.index, share(m));
        moments.add(w, m.offset - centre, &m.variance);
        for skew in &m.skews {
            moments.add_skew(w, *skew);
        }
        if let Some(values) = source.values {
            let v = f64::from(values.get(i));
            value += w * v;
            square += w * v * v;
        }
        if let Colour::PerParticle(colours) = source.colour {
            let c = DVec3::from(colours[i].map(f64::from));
            colour += c * w;
            colour_square += w * c.length_squared();
        }
        let [least, greatest] = source.sigmas[i].map(f64::from);
        member_depth += w * w / (std::f64::consts::TAU * least * greatest);
        overlap += (4.0 * std::f64::consts::PI).powf(1.5) * least * greatest * greatest;
    }
    let variance = moments.second();
    let (eigenvalues, axes) = eigen(variance);
    let sigmas = eigenvalues.max(DVec3::ZERO).map(f64::sqrt);
    let factor = lower_factor(axes * DMat3::from_diagonal(sigmas));
    let trace = variance[0] + variance[3] + variance[5];
    let particle = Particle {
        centre,
        factor: factor.map(|l| l as f32),
        strength: total as f32,
        colour: colour.as_vec3().into(),
        value: value as f32,
        // Even over an interval of this half width, the values have this variance.
        spread: (3.0 * (square - value * value).max(0.0)).sqrt() as f32,
        member_depth: (member_depth * lone_share(overlap, sigmas)) as f32,
    };
    let spread = (3.0 * (square - value * value).max(0.0)).sqrt();
    let uneven = source.values.map_or(0.0, |values| {
        let of = |m: &Member| (share(m), f64::from(values.get(m.index)));
        unevenness(visible.iter().map(of), value, spread)
    });
    let colour_variance = colour_square - colour.length_squared();
    let mut bounds = MergeBounds {
        third_mean: 0.0,
        third: moments.third_norm().cbrt() as f32,
        fourth: moments.fourth_cumulant_norm().sqrt().sqrt() as f32,
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
    Some((particle, bounds, greatest))
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

/// A symmetric matrix: xx, xy, xz, yy, yz, zz.
type Symmetric = [f64; 6];

/// Where a [`Symmetric`] has the element of two axes.
const PAIR: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];

/// Central moments of a mixture of Gaussians, as sums of products of places and variances: the
/// tensors are put together at the end.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    /// d dᵀ and V.
    places: Symmetric,
    variances: Symmetric,
    /// d to the powers of [`THIRD`], and d V.
    third: [f64; 10],
    third_mixed: [Symmetric; 3],
    /// d to the powers of [`FOURTH`], d dᵀ V and V V.
    fourth: [f64; 15],
    fourth_mixed: [Symmetric; 6],
    fourth_own: [Symmetric; 6],
}

/// Which axes the distinct elements of a symmetric tensor of third order belong to, and how many
/// elements are equal to each.
const THIRD: [([usize; 3], f64); 10] = [
    ([0, 0, 0], 1.0),
    ([1, 1, 1], 1.0),
    ([2, 2, 2], 1.0),
    ([0, 0, 1], 3.0),
    ([0, 0, 2], 3.0),
    ([1, 1, 0], 3.0),
    ([1, 1, 2], 3.0),
    ([2, 2, 0], 3.0),
    ([2, 2, 1], 3.0),
    ([0, 1, 2], 6.0),
];

/// The same of fourth order.
const FOURTH: [([usize; 4], f64); 15] = [
    ([0, 0, 0, 0], 1.0),
    ([1, 1, 1, 1], 1.0),
    ([2, 2, 2, 2], 1.0),
    ([0, 0, 0, 1], 4.0),
    ([0, 0, 0, 2], 4.0),
    ([1, 1, 1, 0], 4.0),
    ([1, 1, 1, 2], 4.0),
    ([2, 2, 2, 0], 4.0),
    ([2, 2, 2, 1], 4.0),
    ([0, 0, 1, 1], 6.0),
    ([0, 0, 2, 2], 6.0),
    ([1, 1, 2, 2], 6.0),
    ([0, 0, 1, 2], 12.0),
    ([1, 1, 0, 2], 12.0),
    ([2, 2, 0, 1], 12.0),
];

impl Moments {
    /// Adds a kernel of variance `own` at `d` from the centre, with weight `w`.
    fn add(&mut self, w: f64, d: DVec3, own: &Symmetric) {
        let d = d.to_array();
        let outer = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|(a, b)| d[a] * d[b]);
        let add = |sums: &mut Symmetric, factor: f64, of: &Symmetric| {
            for (sum, x) in sums.iter_mut().zip(of) {
                *sum += factor * x;
            }
        };
        add(&mut self.places, w, &outer);
        add(&mut self.variances, w, own);
        for (sum, ([a, b, c], _)) in self.third.iter_mut().zip(THIRD) {
            *sum += w * d[a] * outer[PAIR[b][c]];
        }
        for (sums, d) in self.third_mixed.iter_mut().zip(d) {
            add(sums, w * d, own);
        }
        for (sum, ([a, b, c, e], _)) in self.fourth.iter_mut().zip(FOURTH) {
            *sum += w * outer[PAIR[a][b]] * outer[PAIR[c][e]];
        }
        for (i, (mixed, both)) in self
            .fourth_mixed
            .iter_mut()
            .zip(&mut self.fourth_own)
            .enumerate()
        {
            add(mixed, w * outer[i], own);
            add(both, w * own[i], own);
        }
    }

    /// Adds third central moments of a kernel's own: the third power of a vector.
    fn add_skew(&mut self, w: f64, skew: DVec3) {
        for (sum, ([a, b, c], _)) in self.third.iter_mut().zip(THIRD) {
            *sum += w * skew[a] * skew[b] * skew[c];
        }
    }

    /// The variance.
    fn second(&self) -> Symmetric {
        let mut second = self.places;
        for (sum, v) in second.iter_mut().zip(self.variances) {
            *sum += v;
        }
        second
    }

    /// Frobenius norm of the third moments.
    fn third_norm(&self) -> f64 {
        let squares = self
            .third
            .iter()
            .zip(THIRD)
            .map(|(places, ([a, b, c], n))| {
                let mixed = |a: usize, b: usize, c: usize| self.third_mixed[a][PAIR[b][c]];
                let moment = places + mixed(a, b, c) + mixed(b, a, c) + mixed(c, a, b);
                n * moment * moment
            });
        squares.sum::<f64>().sqrt()
    }

    /// Frobenius norm of the fourth cumulants: of what the fourth moments differ from a Gaussian's.
    fn fourth_cumulant_norm(&self) -> f64 {
        let second = self.second();
        let squares = self.fourth.iter().zip(FOURTH).map(|(places, (axes, n))| {
            let mixed = pairs(axes, |i, j| self.fourth_mixed[i][j])
                + pairs(axes, |i, j| self.fourth_mixed[j][i]);
            let own = pairs(axes, |i, j| self.fourth_own[i][j]);
            let gaussian = pairs(axes, |i, j| second[i] * second[j]);
            let cumulant = places + mixed + own - gaussian;
            n * cumulant * cumulant
        });
        squares.sum::<f64>().sqrt()
    }
}

/// The sum over the three ways to pair four axes of what two pairs have; of a variance's products it
/// is a Gaussian's fourth moment.
fn pairs([a, b, c, e]: [usize; 4], of: impl Fn(usize, usize) -> f64) -> f64 {
    of(PAIR[a][b], PAIR[c][e]) + of(PAIR[a][c], PAIR[b][e]) + of(PAIR[a][e], PAIR[b][c])
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
        for (level, of_level) in self.levels.iter().enumerate().rev() {
            for block in of_level {
                let strongest = block.particles.iter().map(|p| p.strength);
                blocks.push(Block {
                    origin: block.origin,
                    half_extent: block.half_extent.as_vec3() * (1.0 + f32::EPSILON),
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
                    merged.member_depths.push(particle.member_depth);
                    if matches!(source.colour, Colour::PerParticle(_)) {
                        colours.push(particle.colour);
                    }
                    if source.values.is_some() {
                        values.push(particle.value);
                        merged.spreads.push(particle.spread);
                    }
                }
            }
        }
        BlockedVolume {
            blocks,
            particles: BlockedParticles::Anisotropic { offsets, factors },
            strength: match source.strength {
                Strength::Classified { .. } => Strength::Classified { volumes: strengths },
                _ => Strength::Mass(strengths),
            },
            colour: match source.colour {
                Colour::PerParticle(_) => Colour::PerParticle(colours),
                other => other.clone(),
            },
            values: source.values.map(|_| Values::F32(values)),
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

    /// Numbers without a pattern, -1 to 1.
    fn number(n: usize) -> f64 {
        ((n as f64 * 12.9898).sin() * 43_758.547).fract()
    }

    #[test]
    fn moments_are_those_of_a_mixture() {
        let mut moments = Moments::default();
        let members: Vec<(f64, DVec3, DVec3)> = (0..9)
            .map(|n| {
                let at = |k: usize| number(7 * n + k);
                let d = DVec3::new(at(0), at(1), at(2));
                let v = DVec3::new(at(3).abs(), at(4).abs(), at(5).abs());
                (1.0 / 9.0, d, v)
            })
            .collect();
        let mean: DVec3 = members.iter().map(|(w, d, _)| *d * *w).sum();
        for (w, d, v) in &members {
            moments.add(*w, *d - mean, &[v.x, 0.0, 0.0, v.y, 0.0, v.z]);
        }
        // By Gauss and Hermite's rule of three points per axis: exact to the fifth power.
        let root = 3.0_f64.sqrt();
        let rule = [(-root, 1.0 / 6.0), (0.0, 2.0 / 3.0), (root, 1.0 / 6.0)];
        let expect = |of: &dyn Fn(DVec3) -> f64| {
            let mut sum = 0.0;
            for (w, d, v) in &members {
                for (x, wx) in rule {
                    for (y, wy) in rule {
                        for (z, wz) in rule {
                            let spread = DVec3::new(v.x.sqrt() * x, v.y.sqrt() * y, v.z.sqrt() * z);
                            sum += w * wx * wy * wz * of(*d - mean + spread);
                        }
                    }
                }
            }
            sum
        };
        let second = moments.second();
        for a in 0..3 {
            for b in a..3 {
                let expected = expect(&|p| p[a] * p[b]);
                assert!((second[PAIR[a][b]] - expected).abs() < 1e-14);
            }
        }
        let third: f64 = THIRD
            .iter()
            .map(|([a, b, c], n)| n * expect(&|p| p[*a] * p[*b] * p[*c]).powi(2))
            .sum();
        // Some hundred roundings of f64.
        assert!((moments.third_norm() - third.sqrt()).abs() < 1e-13);
        let fourth: f64 = FOURTH
            .iter()
            .map(|(axes, n)| {
                let [a, b, c, e] = *axes;
                let moment = expect(&|p| p[a] * p[b] * p[c] * p[e]);
                n * (moment - pairs(*axes, |i, j| second[i] * second[j])).powi(2)
            })
            .sum();
        assert!((moments.fourth_cumulant_norm() - fourth.sqrt()).abs() < 1e-13);
        assert!(third.sqrt() > 0.01 && fourth.sqrt() > 0.01);
    }
}
