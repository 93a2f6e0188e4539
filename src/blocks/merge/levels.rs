//! Levels of detail of points: merged particles in blocks.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::{LAST_LEVEL, MergeBounds, Merged};
use crate::blocks::{Block, BlockedParticles, BlockedVolume, EMPTY_RANGE, NO_PARENT};
use crate::scene::{ColourIn, StrengthIn, ValuesIn};

/// A cluster as a particle.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::blocks) struct Particle {
    /// From the block's origin.
    pub(super) centre: DVec3,
    pub(super) factor: [f32; 6],
    pub(super) strength: f32,
    pub(super) colour: [f32; 3],
    pub(super) value: f32,
    pub(super) spread: f32,
    pub(super) member_depth: f32,
}

/// A cluster as a particle, and what that leaves out.
#[derive(Debug, Clone, Copy)]
pub(super) struct MergedCluster {
    pub(super) particle: Particle,
    pub(super) bounds: MergeBounds,
    /// Its greatest standard deviation.
    pub(super) widest: f32,
}

/// What bounds a block of merged particles, and all that these stand for.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(in crate::blocks) struct Head {
    /// Where its members begin in block order.
    start: u64,
    /// Of the members' centres.
    pub(super) lower: DVec3,
    pub(super) upper: DVec3,
    bounds: MergeBounds,
    /// The least of the members, the greatest of the merged particles.
    sigmas: [f32; 2],
    crowding: f32,
    max_strength: f32,
    /// How many merged particles it has.
    pub(in crate::blocks) count: u32,
}

impl Head {
    /// Of a block that has no particles yet.
    ///
    /// - `start`: where its members begin in block order.
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

    /// With merged particles, in place of none.
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

    /// Where its members begin in block order.
    pub(in crate::blocks) fn start(&self) -> usize {
        self.start as usize
    }

    pub(super) fn origin(&self) -> DVec3 {
        (self.lower + self.upper) / 2.0
    }

    /// The least standard deviation of its members.
    pub(super) fn narrowest(&self) -> f32 {
        self.sigmas[0]
    }
}

/// The heads of those blocks that hold a run of particles.
pub(super) fn heads_in<'a>(heads: &'a [Head], run: &Range<usize>) -> &'a [Head] {
    let first = heads.partition_point(|head| head.start() < run.start);
    let count = heads[first..].partition_point(|head| head.start() < run.end);
    &heads[first..first + count]
}

/// A level of detail.
#[derive(Debug, Default)]
pub(in crate::blocks) struct Level {
    /// Of all blocks, in block order.
    pub(in crate::blocks) heads: Vec<Head>,
    /// The blocks whose particles are here.
    pub(in crate::blocks) own: Vec<Range<u32>>,
    /// The particles of each of these.
    pub(in crate::blocks) particles: Vec<Vec<Particle>>,
}

impl Level {
    /// With the particles of some blocks alone, where those of all are here.
    pub(in crate::blocks) fn keep(mut self, own: Vec<Range<u32>>) -> Self {
        let kept = own.iter().cloned().flatten();
        let kept = kept.map(|block| std::mem::take(&mut self.particles[block as usize]));
        self.particles = kept.collect();
        self.own = own;
        self
    }
}

/// The levels of a point set, the finest first.
#[derive(Debug)]
pub(in crate::blocks) struct Levels(pub(in crate::blocks) Vec<Level>);

/// Whether no level is needed after this one.
pub(super) fn is_last(heads: &[Head]) -> bool {
    matches!(heads, [head] if head.count as usize <= LAST_LEVEL)
}

impl Levels {
    /// The first-level block that stands for the particle at `place` of block order, counted as in
    /// [`Levels::into_volume`].
    pub(in crate::blocks) fn parent_of(&self, place: usize) -> u32 {
        self.number(0, place)
    }

    /// The number of the block of a level that holds the particle at `place` of block order: blocks
    /// of the coarsest level come first.
    fn number(&self, level: usize, place: usize) -> u32 {
        let coarser: usize = self.0[level + 1..].iter().map(|l| l.heads.len()).sum();
        let within = self.0[level]
            .heads
            .partition_point(|head| head.start() <= place)
            - 1;
        (coarser + within) as u32
    }

    /// All levels as one volume, the coarsest first, and those of its blocks whose particles are here.
    ///
    /// - `base`: the volume whose levels these are.
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
