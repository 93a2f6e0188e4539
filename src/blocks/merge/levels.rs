//! Defines levels of detail of points: merged particles in blocks.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::LAST_LEVEL;
use crate::blocks::block::{Block, EMPTY_RANGE, NO_PARENT};
use crate::blocks::merged::{MergeBounds, Merged};
use crate::blocks::volume::{BlockedParticles, BlockedVolume};
use crate::scene::{ColourIn, StrengthIn, ValuesIn};

/// A cluster as a particle.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::blocks) struct Particle {
    /// Centre relative to the block's origin.
    pub(super) centre: DVec3,
    pub(super) factor: [f32; 6],
    pub(super) strength: f32,
    pub(super) colour: [f32; 3],
    pub(super) value: f32,
    pub(super) spread: f32,
    pub(super) member_depth: f32,
}

/// A cluster as a particle, and bounds on the difference from its members.
#[derive(Debug, Clone, Copy)]
pub(super) struct MergedCluster {
    pub(super) particle: Particle,
    pub(super) bounds: MergeBounds,
    /// Greatest standard deviation of the particle.
    pub(super) widest: f32,
}

/// Header of a block of merged particles: bounds of these and of all their members.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(in crate::blocks) struct Head {
    /// Beginning of its members in block order.
    start: u64,
    /// Bounds of the members' centres.
    pub(super) lower: DVec3,
    pub(super) upper: DVec3,
    bounds: MergeBounds,
    /// Least standard deviation of the members, greatest of the merged particles.
    sigmas: [f32; 2],
    crowding: f32,
    max_strength: f32,
    /// Number of merged particles in the block.
    pub(in crate::blocks) count: u32,
}

impl Head {
    /// Makes the header of a block without particles.
    ///
    /// - `start`: beginning of its members in block order.
    /// - `crowding`: as [`Block::crowding`].
    pub(super) fn new(start: usize, crowding: f32) -> Self {
        Self {
            start: start as u64,
            lower: DVec3::INFINITY,
            upper: DVec3::NEG_INFINITY,
            bounds: MergeBounds::default(),
            sigmas: [f32::INFINITY, 0.0],
            crowding,
            max_strength: 0.0,
            count: 0,
        }
    }

    /// Adds members.
    pub(super) fn extend(&mut self, lower: DVec3, upper: DVec3, narrowest: f32) {
        self.lower = self.lower.min(lower);
        self.upper = self.upper.max(upper);
        self.sigmas[0] = self.sigmas[0].min(narrowest);
    }

    /// Adds the merged particles to a header that has none.
    pub(super) fn with<'a>(mut self, merged: impl Iterator<Item = &'a MergedCluster>) -> Self {
        let (mut third_squares, mut uneven_squares) = (0.0, 0.0);
        for MergedCluster {
            particle,
            bounds,
            widest,
        } in merged
        {
            third_squares += f64::from(bounds.third).powi(6);
            uneven_squares += f64::from(bounds.uneven).powi(2);
            self.bounds = self.bounds.max(*bounds);
            self.sigmas[1] = self.sigmas[1].max(*widest);
            self.max_strength = self.max_strength.max(particle.strength);
            self.count += 1;
        }
        let count = f64::from(self.count.max(1));
        self.bounds.third_mean = (third_squares / count).powf(1.0 / 6.0) as f32;
        self.bounds.uneven = (uneven_squares / count).sqrt() as f32;
        self
    }

    /// Beginning of its members in block order.
    pub(in crate::blocks) fn start(&self) -> usize {
        self.start as usize
    }

    pub(super) fn origin(&self) -> DVec3 {
        (self.lower + self.upper) / 2.0
    }

    /// Least standard deviation of its members.
    pub(super) fn narrowest(&self) -> f32 {
        self.sigmas[0]
    }
}

/// Returns the headers of the blocks within a run of particles.
pub(super) fn heads_in<'a>(heads: &'a [Head], run: &Range<usize>) -> &'a [Head] {
    let first = heads.partition_point(|head| head.start() < run.start);
    let count = heads[first..].partition_point(|head| head.start() < run.end);
    &heads[first..first + count]
}

/// A level of detail.
#[derive(Debug, Default)]
pub(in crate::blocks) struct Level {
    /// Headers of all blocks, in block order.
    pub(in crate::blocks) heads: Vec<Head>,
    /// Blocks whose particles are here.
    pub(in crate::blocks) own: Vec<Range<u32>>,
    /// Particles of each of these blocks.
    pub(in crate::blocks) particles: Vec<Vec<Particle>>,
}

impl Level {
    /// Keeps the particles of some blocks only; the particles of all blocks must be here.
    pub(in crate::blocks) fn keep(mut self, own: Vec<Range<u32>>) -> Self {
        let kept = own.iter().cloned().flatten();
        let kept = kept.map(|block| std::mem::take(&mut self.particles[block as usize]));
        self.particles = kept.collect();
        self.own = own;
        self
    }
}

/// Levels of a point set, the finest first.
#[derive(Debug)]
pub(in crate::blocks) struct Levels(pub(in crate::blocks) Vec<Level>);

/// Whether no level is needed after this one.
pub(super) fn is_last(heads: &[Head]) -> bool {
    matches!(heads, [head] if head.count as usize <= LAST_LEVEL)
}

impl Levels {
    /// Returns the first-level block that contains the particle at `place` in block order, counted as in
    /// [`Levels::into_volume`].
    pub(in crate::blocks) fn parent_of(&self, place: usize) -> u32 {
        self.number(0, place)
    }

    /// Returns the number of the block of a level that contains the particle at `place` in block order. Blocks of the
    /// coarsest level come first.
    fn number(&self, level: usize, place: usize) -> u32 {
        let coarser: usize = self.0[level + 1..].iter().map(|l| l.heads.len()).sum();
        let within = self.0[level]
            .heads
            .partition_point(|head| head.start() <= place)
            - 1;
        (coarser + within) as u32
    }

    /// Converts all levels to one volume, the coarsest first; also returns the blocks whose particles are here.
    ///
    /// - `base`: the volume of which these are the levels.
    pub(in crate::blocks) fn into_volume(
        self,
        base: &BlockedVolume,
    ) -> (BlockedVolume, Vec<Range<u32>>) {
        let of_blocks = self.0.iter().flat_map(|level| &level.particles);
        let count = of_blocks.map(Vec::len).sum();
        let has_colours = matches!(base.colour, ColourIn::PerParticle(_));
        let has_values = base.values.is_some();
        let mut blocks: Vec<Block> = Vec::new();
        let mut own: Vec<Range<u32>> = Vec::new();
        let mut merged = Merged::default();
        let mut offsets = Vec::with_capacity(count);
        let mut factors = Vec::with_capacity(count);
        let mut strengths = Vec::with_capacity(count);
        let mut colours = Vec::new();
        let mut values = Vec::new();
        let (mut member_depths, mut spreads) = (Vec::new(), Vec::new());
        for (level, of_level) in self.0.iter().enumerate().rev() {
            let first = blocks.len();
            for head in &of_level.heads {
                blocks.push(Block {
                    origin: head.origin(),
                    half_extent: ((head.upper - head.lower) / 2.0).as_vec3() * (1.0 + f32::EPSILON),
                    max_sigma: head.sigmas[1],
                    min_sigma: head.sigmas[0],
                    max_strength: head.max_strength,
                    first: 0,
                    count: head.count,
                    value_range: EMPTY_RANGE,
                    values_around: EMPTY_RANGE,
                    greatest_spread: 0.0,
                    parent: if level + 1 < self.0.len() {
                        self.number(level + 1, head.start())
                    } else {
                        NO_PARENT
                    },
                    level: level as u32 + 1,
                    crowding: head.crowding,
                });
                merged.bounds.push(head.bounds);
            }
            let mut place = offsets.len() as u32;
            for run in &of_level.own {
                own.push(run.start + first as u32..run.end + first as u32);
                for block in &mut blocks[first..][run.start as usize..run.end as usize] {
                    block.first = place;
                    place += block.count;
                }
            }
            for particle in of_level.particles.iter().flatten() {
                offsets.push(particle.centre.as_vec3().to_array());
                factors.push(particle.factor);
                strengths.push(particle.strength);
                member_depths.push(particle.member_depth);
                if has_colours {
                    colours.push(particle.colour);
                }
                if has_values {
                    values.push(particle.value);
                    spreads.push(particle.spread);
                }
            }
        }
        merged.member_depths = member_depths.into();
        merged.spreads = spreads.into();
        let volume = BlockedVolume {
            blocks,
            particles: BlockedParticles::Anisotropic {
                offsets: offsets.into(),
                factors: factors.into(),
            },
            strength: match base.strength {
                StrengthIn::Classified { .. } => StrengthIn::Classified {
                    volumes: strengths.into(),
                },
                _ => StrengthIn::Mass(strengths.into()),
            },
            colour: match &base.colour {
                ColourIn::PerParticle(_) => ColourIn::PerParticle(colours.into()),
                other => other.clone(),
            },
            values: has_values.then(|| ValuesIn::F32(values.into())),
            transfer_function: None,
            normals: None,
            local_models: None,
            lobes: None,
            indices: None,
            boundary: None,
            merged: Some(merged),
        };
        (volume, own)
    }
}
