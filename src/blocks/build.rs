//! Builds the blocks of a point set: the subtrees of a BVH with few enough particles.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::brick::outwards;
use super::extent::spread_of;
use super::merge::{merge_lattice, merge_points, widen_to_members};
use super::options::BuildOptions;
use super::overlap::OverlapCounts;
use super::points::{Picking, PointShapes, Points};
use super::room::{MEMORY, RUN, Room};
use super::tree::Tree;
use crate::blocks::block::{Block, EMPTY_RANGE, NO_PARENT, value_range};
use crate::blocks::brick::BrickGrid;
use crate::blocks::source::Source;
use crate::blocks::transfer::set_transfer_function;
use crate::blocks::volume::{BlockedParticles, BlockedVolume};
use crate::constants::BLOCK_CAPACITY;
use crate::error::{Error, Result};
use crate::math::{TOGETHER, principal_sigmas_together};
use crate::scene::columns::Columns;
use crate::scene::{
    Column, Particles, PointVolume, Shared, StrengthIn, TransferFunction, Values, ValuesIn,
};
use crate::task::{Stage, Task};

/// Refuses more particles than 32-bit indices can number.
pub(crate) fn check_count(total: usize) -> Result<()> {
    if u32::try_from(total).is_ok() {
        return Ok(());
    }
    Err(Error::invalid(
        "scene",
        "particles",
        "at most 4,294,967,295 particles",
        total.to_string(),
        "render a part of the data",
    ))
}

/// Builds the blocks of a volume and, if the options ask for them, its levels of detail, the finest first.
///
/// # Errors
/// The task is cancelled.
pub(super) fn build(
    volume: PointVolume,
    options: BuildOptions,
    task: Option<&Task>,
) -> Result<Vec<BlockedVolume>> {
    build_ordered(volume, options, None, task)
}

impl BlockedVolume {
    /// Sorts a volume's particles into blocks.
    ///
    /// # Panics
    /// Never: the first of the volumes built is the volume itself.
    pub fn new(volume: PointVolume) -> Self {
        Self::built(volume, BuildOptions::default()).swap_remove(0)
    }

    /// Sorts a volume's particles into blocks, and adds its levels of detail, the finest first. The levels of a point
    /// set are one volume.
    pub fn with_detail(volume: PointVolume) -> Vec<Self> {
        let options = BuildOptions {
            detail: true,
            ..BuildOptions::default()
        };
        Self::built(volume, options)
    }

    fn built(volume: PointVolume, options: BuildOptions) -> Vec<Self> {
        // Without a task nothing cancels it.
        build(volume, options, None).unwrap_or_default()
    }
}

/// A volume whose values can be exchanged. It stores everything but the values, and the order of its particles in a
/// tree.
#[derive(Debug, Clone)]
pub(super) struct Exchangeable {
    volume: PointVolume,
    ordered: Option<Ordered>,
    options: BuildOptions,
}

impl Exchangeable {
    pub(super) fn new(
        volume: &PointVolume,
        options: BuildOptions,
        task: Option<&Task>,
    ) -> Result<Self> {
        let ordered = match &volume.particles {
            Particles::Lattice { .. } => None,
            Particles::Isotropic { positions, .. }
            | Particles::Anisotropic { positions, .. }
            | Particles::Surfels { positions, .. } => Some(finite_block_order(positions, task)?),
        };
        Ok(Self {
            volume: PointVolume {
                values: None,
                particles: volume.particles.clone(),
                strength: volume.strength.clone(),
                colour: volume.colour.clone(),
                transfer_function: volume.transfer_function.clone(),
                boundary: volume.boundary.clone(),
                normals: volume.normals.clone(),
                local_models: None,
            },
            ordered,
            options,
        })
    }

    /// Number of particles, and so of values.
    pub(super) fn len(&self) -> usize {
        self.volume.particles.len()
    }

    /// Builds the blocks of the volume with these values, and its levels of detail.
    pub(super) fn with_values(
        &self,
        values: Option<Values>,
        task: Option<&Task>,
    ) -> Result<Vec<BlockedVolume>> {
        let volume = PointVolume {
            values,
            ..self.volume.clone()
        };
        build_ordered(volume, self.options, self.ordered.clone(), task)
    }
}

fn build_ordered(
    volume: PointVolume,
    options: BuildOptions,
    ordered: Option<Ordered>,
    task: Option<&Task>,
) -> Result<Vec<BlockedVolume>> {
    if matches!(volume.particles, Particles::Lattice { .. }) {
        return build_lattice(volume, options, task);
    }
    let Some((points, transfer_function)) = Points::of(volume) else {
        return Ok(Vec::new());
    };
    let Ordered { order, runs, tree } = match ordered {
        Some(ordered) => ordered,
        None => finite_block_order(&points.positions, task)?,
    };
    // From here on in the order of the tree: stages that read runs of it repeatedly find them together in memory.
    let points = points.gather(&order, MEMORY)?;
    let sorted = Sorted {
        points,
        numbers: order.into(),
        runs,
        tree,
        transfer_function,
    };
    build_sorted(sorted, options, MEMORY, task)
}

fn build_lattice(
    volume: PointVolume,
    options: BuildOptions,
    task: Option<&Task>,
) -> Result<Vec<BlockedVolume>> {
    let own = match &volume.particles {
        Particles::Lattice { lattice, .. } if volume.boundary.is_some() => Some(lattice.clone()),
        _ => None,
    };
    let PointVolume {
        particles,
        strength,
        colour,
        values,
        transfer_function,
        normals,
        ..
    } = volume.with_ghosts();
    let Particles::Lattice {
        lattice,
        kernel_width,
    } = particles
    else {
        return Ok(Vec::new());
    };
    // Merged particles reflect unlike any of their members; see `PointVolume::normals`.
    let detail = options.detail && normals.is_none();
    let grid = match own {
        None => BrickGrid::new(lattice, kernel_width),
        Some(own) => BrickGrid::with_faces(&own, kernel_width),
    };
    let values = values.map(Values::shared);
    let blocks = if grid.is_empty() {
        Vec::new()
    } else {
        let is_classified = matches!(strength, StrengthIn::Classified { .. });
        grid.blocks(values.as_ref(), is_classified, 0)
    };
    let mut base = BlockedVolume {
        blocks,
        particles: BlockedParticles::Lattice(Box::new(grid)),
        strength: strength.shared(),
        colour: colour.shared(),
        values,
        transfer_function,
        normals: normals.map(Into::into),
        boundary: None,
        // A cell's number is its index.
        indices: None,
        local_models: None,
        lobes: None,
        merged: None,
    };
    let levels = if detail {
        merge_lattice(&mut base, task)?
    } else {
        Vec::new()
    };
    Ok(family(base, levels))
}

/// Points in the order of a tree over them.
#[derive(Debug)]
pub(super) struct Sorted {
    pub(super) points: Points,
    /// Number of each point among the caller's points.
    pub(super) numbers: Column<u32>,
    /// Blocks, as runs of that order.
    pub(super) runs: Vec<Range<usize>>,
    /// Tree over the points; empty if all are in one block.
    pub(super) tree: Tree,
    pub(super) transfer_function: Option<TransferFunction>,
}

/// Builds blocks of sorted points, and their levels of detail.
///
/// - `room`: storage for the blocks' columns.
pub(super) fn build_sorted(
    sorted: Sorted,
    options: BuildOptions,
    room: Room<'_>,
    task: Option<&Task>,
) -> Result<Vec<BlockedVolume>> {
    let Sorted {
        points,
        numbers,
        runs,
        tree,
        transfer_function,
    } = sorted;
    let principal = principal_ranges(&points.shapes);
    let source = points.source(&principal);
    let overlaps = OverlapCounts::new(&tree, &source);
    let merged = match options.detail && points.are_merged() {
        true => merge_points(&source, &tree, &overlaps, task)?,
        false => None,
    };
    drop(tree);
    let runs = runs
        .into_iter()
        .map(|run| (overlaps.greatest(&run, 1.0), run))
        .collect();
    let mut base = in_blocks(points, numbers, runs, principal, room, options)?;
    base.transfer_function = transfer_function;
    if let Some(merged) = &merged {
        for block in &mut base.blocks {
            block.parent = merged.parent_of(block.first as usize);
        }
    }
    let coarse = merged.map(|merged| merged.into_volume(&base).0);
    Ok(family(base, coarse.into_iter().collect()))
}

/// Puts points into blocks, without parents.
///
/// - `runs`: runs of the points, each with its overlap count ([`Block::crowding`]). A run becomes a block, or several
///   if far particles stretch it.
/// - `principal`: the result of [`principal_ranges`].
pub(super) fn in_blocks(
    points: Points,
    numbers: Column<u32>,
    runs: Vec<(f32, Range<usize>)>,
    principal: Vec<[f32; 2]>,
    room: Room<'_>,
    options: BuildOptions,
) -> Result<BlockedVolume> {
    let source = points.source(&principal);
    // Particles are reordered within their blocks.
    let mut places: Vec<u32> = (0..numbers.len() as u32).collect();
    // Overlap counts belong to whole runs, in which the tree counted them.
    let (crowding, runs): (Vec<f32>, Vec<Range<usize>>) = runs.into_iter().unzip();
    let parts = without_outliers(&mut places, &runs, &points.positions, &|i| {
        source.sigmas(i as usize)[1]
    });
    if let Some(values) = &points.rest.values {
        sort_by_value(&mut places, &parts, values, &numbers);
    }
    let mut blocks: Vec<Block> = parts
        .par_iter()
        .map(|run| block(&places[run.clone()], run.start, &source))
        .collect();
    for (block, part) in blocks.iter_mut().zip(&parts) {
        let whole = runs.partition_point(|run| run.end <= part.start);
        block.crowding = crowding[whole];
    }
    drop(principal);
    let Points {
        positions,
        mut shapes,
        mut rest,
    } = points;
    let offsets = offsets(&positions, &places, &blocks, room)?;
    drop(positions);
    let is_moved = !places.par_windows(2).all(|w| w[0] < w[1]);
    if is_moved {
        let order = &*places;
        shapes.visit(&mut Picking { order, room })?;
        rest.visit(&mut Picking { order, room })?;
    }
    Ok(BlockedVolume {
        particles: match shapes {
            PointShapes::Spheres(sigmas) => BlockedParticles::Isotropic { offsets, sigmas },
            PointShapes::Ellipsoids(factors) => BlockedParticles::Anisotropic { offsets, factors },
            PointShapes::Surfels {
                tangents,
                is_one_sided,
            } => BlockedParticles::Surfels {
                offsets,
                tangents,
                is_one_sided,
            },
        },
        strength: rest.strength,
        colour: rest.colour,
        values: rest.values,
        transfer_function: None,
        normals: rest.normals,
        boundary: rest.boundary,
        blocks,
        local_models: rest.local_models,
        lobes: None,
        indices: match options.indices {
            true => Some(room.pick(numbers, &places)?),
            false => None,
        },
        merged: None,
    })
}

/// Returns the particles' offsets from their blocks' origins.
///
/// - `places`: index of each particle in `positions`, block by block.
fn offsets(
    positions: &[DVec3],
    places: &[u32],
    blocks: &[Block],
    room: Room<'_>,
) -> Result<Column<[f32; 3]>> {
    let mut all = room.column(places.len())?;
    let mut of_run: Vec<[f32; 3]> = Vec::new();
    let mut rest = blocks;
    while let Some(first) = rest.first() {
        // Whole blocks, of about a run's particles together.
        let end = first.first as usize + RUN;
        let count = rest.partition_point(|block| (block.first as usize) < end);
        let (own, later) = rest.split_at(count);
        rest = later;
        of_run.par_extend(own.par_iter().flat_map_iter(|block| {
            let members = block.first as usize..(block.first + block.count) as usize;
            let at = |&i: &u32| positions[i as usize] - block.origin;
            places[members]
                .iter()
                .map(move |i| at(i).as_vec3().to_array())
        }));
        all.extend(&of_run)?;
        of_run.clear();
    }
    all.finish()
}

/// Joins a volume and its levels of detail, which share a transfer function.
pub(super) fn family(base: BlockedVolume, levels: Vec<BlockedVolume>) -> Vec<BlockedVolume> {
    let transfer = base.transfer_function.clone();
    let mut volumes = vec![base];
    volumes.extend(levels);
    widen_to_members(&mut volumes);
    if let Some(transfer) = transfer {
        set_transfer_function(&mut volumes, &transfer, None);
    }
    volumes
}

/// Returns the least and the greatest standard deviation of each kernel that is not a sphere, rounded outwards.
pub(super) fn principal_ranges(shapes: &PointShapes) -> Vec<[f32; 2]> {
    match shapes {
        PointShapes::Spheres(_) => Vec::new(),
        PointShapes::Surfels { tangents, .. } => tangents
            .par_iter()
            .map(|tangents| outwards(0.0, widest_tangent(tangents.map(f64::from))))
            .collect(),
        PointShapes::Ellipsoids(factors) => {
            let mut ranges = vec![[0.0; 2]; factors.len()];
            let runs = ranges
                .par_chunks_mut(TOGETHER)
                .zip(factors.par_chunks(TOGETHER));
            runs.for_each(|(ranges, factors)| {
                let mut run = [[0.0; 6]; TOGETHER];
                run[..factors.len()].copy_from_slice(factors);
                let sigmas = principal_sigmas_together(&run);
                for (range, [greatest, _, least]) in ranges.iter_mut().zip(sigmas) {
                    *range = outwards(least, greatest);
                }
            });
            ranges
        }
    }
}

/// Returns the greatest standard deviation of a surfel: the square root of the greater eigenvalue of the tangents' Gram
/// matrix.
fn widest_tangent([ax, ay, az, bx, by, bz]: [f64; 6]) -> f64 {
    let (a, b) = (DVec3::new(ax, ay, az), DVec3::new(bx, by, bz));
    let (aa, bb) = (a.length_squared(), b.length_squared());
    (0.5 * (aa + bb) + (0.5 * (aa - bb)).hypot(a.dot(b))).sqrt()
}

/// Greatest extent of a block, as a multiple of its kernels' width: 2^14 leaves f32 offsets a thousandth of a standard
/// deviation.
const WIDEST_BLOCK: f64 = 16_384.0;

/// Splits blocks that a few far particles stretch, if one gap is most of the width. Otherwise the far particles would
/// cost the others bits of their offsets.
fn without_outliers(
    order: &mut [u32],
    runs: &[Range<usize>],
    positions: &[DVec3],
    sigma: &(impl Fn(u32) -> f32 + Sync),
) -> Vec<Range<usize>> {
    let blocks = members_of(order, runs).into_par_iter().zip(runs);
    let kept = blocks.flat_map_iter(|(members, run)| {
        let parts = dense_parts(members, positions, sigma).into_iter();
        parts.map(|part| run.start + part.start..run.start + part.end)
    });
    kept.collect()
}

/// Returns the parts of a block that no far particle stretches.
fn dense_parts(
    order: &mut [u32],
    positions: &[DVec3],
    sigma: &impl Fn(u32) -> f32,
) -> Vec<Range<usize>> {
    let mut kept = Vec::new();
    let mut rest: Vec<Range<usize>> = std::iter::once(0..order.len()).collect();
    while let Some(run) = rest.pop() {
        let members = &mut order[run.clone()];
        let (lower, upper) = members.iter().fold(
            (DVec3::INFINITY, DVec3::NEG_INFINITY),
            |(lower, upper), &i| {
                (
                    lower.min(positions[i as usize]),
                    upper.max(positions[i as usize]),
                )
            },
        );
        // Halved first, because the extent itself may overflow.
        let half = upper / 2.0 - lower / 2.0;
        let axis = half.max_position();
        let widest_kernel = members.iter().map(|&i| sigma(i)).fold(0.0, f32::max);
        if half[axis] <= WIDEST_BLOCK * f64::from(widest_kernel) {
            kept.push(run);
            continue;
        }
        let at = |i: u32| positions[i as usize][axis];
        members.sort_unstable_by(|&a, &b| at(a).total_cmp(&at(b)).then(a.cmp(&b)));
        let gap = |n: usize| at(members[n]) / 2.0 - at(members[n - 1]) / 2.0;
        let widest = (1..members.len()).max_by(|&a, &b| gap(a).total_cmp(&gap(b)));
        match widest {
            Some(n) if gap(n) > half[axis] / 2.0 => {
                rest.push(run.start + n..run.end);
                rest.push(run.start..run.start + n);
            }
            _ => kept.push(run),
        }
    }
    kept
}

/// Splits the order into the blocks' parts.
fn members_of<'a>(mut order: &'a mut [u32], runs: &[Range<usize>]) -> Vec<&'a mut [u32]> {
    let mut blocks = Vec::with_capacity(runs.len());
    for run in runs {
        let (members, others) = order.split_at_mut(run.len());
        blocks.push(members);
        order = others;
    }
    blocks
}

/// Sorts the particles of each run by their values, NaN last. The particles in an interval of values are then a run of
/// their own.
///
/// - `numbers`: the caller's numbers of the particles: equal values keep that order.
fn sort_by_value(
    places: &mut [u32],
    runs: &[Range<usize>],
    values: &ValuesIn<Shared>,
    numbers: &[u32],
) {
    members_of(places, runs)
        .into_par_iter()
        .for_each(|members| {
            members.sort_unstable_by(|&a, &b| {
                let (v, w) = (values.get(a as usize), values.get(b as usize));
                // Zeros of either sign are equal.
                let by_value = v.partial_cmp(&w).unwrap_or(v.is_nan().cmp(&w.is_nan()));
                by_value.then_with(|| numbers[a as usize].cmp(&numbers[b as usize]))
            });
        });
}

fn block(members: &[u32], first: usize, source: &Source<'_>) -> Block {
    let start = source.positions[members[0] as usize];
    let (lower, upper) = members.iter().fold((start, start), |(lower, upper), &i| {
        let p = source.positions[i as usize];
        (lower.min(p), upper.max(p))
    });
    let sigmas = members.iter().map(|&i| source.sigmas(i as usize));
    let [min_sigma, max_sigma] = sigmas.fold([f32::INFINITY, 0.0], |[least, greatest], [a, b]| {
        [least.min(a), greatest.max(b)]
    });
    let strengths = source.strength.stored();
    let (values_around, greatest_spread) = spread_of(members, source.values, source.models);
    Block {
        origin: (lower + upper) / 2.0,
        half_extent: ((upper - lower) / 2.0).as_vec3() * (1.0 + f32::EPSILON),
        max_sigma,
        min_sigma,
        max_strength: members
            .iter()
            .map(|&i| strengths[i as usize])
            .fold(0.0, f32::max),
        first: u32::try_from(first).unwrap_or(u32::MAX),
        count: u32::try_from(members.len()).unwrap_or(u32::MAX),
        value_range: source.values.map_or(EMPTY_RANGE, |v| {
            value_range(members.iter().map(|&i| v.get(i as usize)))
        }),
        values_around,
        greatest_spread,
        parent: NO_PARENT,
        level: 0,
        crowding: 1.0,
    }
}

/// Particles in the order of a tree.
#[derive(Debug, Clone, Default)]
pub(super) struct Ordered {
    pub(super) order: Vec<u32>,
    /// Blocks, as runs of the order.
    pub(super) runs: Vec<Range<usize>>,
    /// Tree over the particles; empty if all are in one block.
    pub(super) tree: Tree,
}

/// Returns [`block_order`] of the particles with finite positions. The others are in no block, because they would make
/// the bounds of their block infinite.
fn finite_block_order(positions: &[DVec3], task: Option<&Task>) -> Result<Ordered> {
    let stage = Stage::new(task, "sorting into blocks", 1);
    let ordered = if positions.par_iter().all(|p| p.is_finite()) {
        block_order(positions, &[])
    } else {
        let (kept, finite): (Vec<u32>, Vec<DVec3>) =
            (0..).zip(positions).filter(|(_, p)| p.is_finite()).unzip();
        let mut ordered = block_order(&finite, &[]);
        for i in &mut ordered.order {
            *i = kept[*i as usize];
        }
        ordered
    };
    stage.advance(1);
    stage.check()?;
    Ok(ordered)
}

/// Returns the order of the particles in which every block is a run, and these runs: the largest subtrees of a PLOC BVH
/// with at most [`BLOCK_CAPACITY`] particles.
///
/// - `positions`, `numbers`: as in [`Tree::over`].
pub(super) fn block_order(positions: &[DVec3], numbers: &[u32]) -> Ordered {
    let count = u32::try_from(positions.len()).unwrap_or(u32::MAX);
    if positions.is_empty() {
        return Ordered::default();
    }
    if positions.len() <= BLOCK_CAPACITY {
        let all = 0..positions.len();
        return Ordered {
            order: (0..count).collect(),
            runs: std::iter::once(all).collect(),
            tree: Tree::default(),
        };
    }
    let (tree, order) = Tree::over(positions, numbers);
    let subtrees = tree.subtrees(BLOCK_CAPACITY);
    Ordered {
        order,
        runs: subtrees.into_iter().map(|subtree| subtree.run()).collect(),
        tree,
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::scene::ColourIn;

    fn points(n: usize, f: impl Fn(f64) -> DVec3) -> Vec<DVec3> {
        (0..n).map(|i| f(i as f64)).collect()
    }

    #[test]
    fn every_particle_lies_in_one_block_of_bounded_size() {
        let spiral = |t: f64| DVec3::new((t * 0.7).sin() * t, (t * 1.3).cos() * t, t * 0.01);
        for positions in [
            points(0, spiral),
            points(1, spiral),
            points(257, spiral),
            points(20_000, spiral),
            points(5_000, |_| DVec3::splat(3.0)),
            points(3_000, |t| DVec3::new(1e7 + t, 0.0, 0.0)),
            points(2_000, |t| DVec3::splat(t * 1e-14)),
        ] {
            let Ordered { order, runs, .. } = block_order(&positions, &[]);
            let mut seen = vec![0; positions.len()];
            order.iter().for_each(|&i| seen[i as usize] += 1);
            assert!(seen.iter().all(|&n| n == 1));
            assert!(
                runs.iter()
                    .all(|r| !r.is_empty() && r.len() <= BLOCK_CAPACITY)
            );
            assert_eq!(
                runs.iter().map(ExactSizeIterator::len).sum::<usize>(),
                order.len()
            );
            assert!(runs.windows(2).all(|w| w[0].end == w[1].start));
        }
    }

    #[test]
    fn blocks_bound_their_particles() {
        let positions = points(3_000, |t| {
            DVec3::new(t.sin(), (t * 0.3).cos(), t * 1e-3) * 50.0
        });
        let sigmas = vec![0.1; positions.len()];
        let volume = BlockedVolume::new(PointVolume {
            colour: ColourIn::Uniform([1.0; 3]),
            ..PointVolume::new(
                Particles::Isotropic { positions, sigmas },
                StrengthIn::Mass(vec![1.0; 3_000]),
            )
        });
        let BlockedParticles::Isotropic { offsets, .. } = &volume.particles else {
            panic!("isotropic particles stay isotropic");
        };
        for b in &volume.blocks {
            let run = b.first as usize..(b.first + b.count) as usize;
            for o in &offsets[run] {
                assert!(Vec3::from(*o).abs().cmple(b.half_extent).all());
            }
        }
    }
}
