//! Builds the blocks of a lattice whose planes are partitioned among ranks: the same bricks and levels of detail as of
//! the whole lattice in one place.
//!
//! Each rank keeps the values of its own planes, and of the planes beside them as a halo of its bricks. Every rank
//! knows the bounds of all bricks, and has the coarser grids, whose values are a sixty-fourth of the lattice's.

use std::ops::Range;

use rayon::prelude::*;

use super::super::brick::BrickGrid;
use super::super::build::family;
use super::super::density::densities;
use super::super::merge::{
    CubeMoments, LONGEST_COPIED, LongCube, WholeCube, adopted, is_large, levels_of,
};
use super::super::room::Sparse;
use super::planes::{Held, PlaneRuns};
use super::shared_volume::SharedVolume;
use crate::blocks::block::Block;
use crate::blocks::merge::places::PlaceSums;
use crate::blocks::options::SceneOptions;
use crate::blocks::share::runs_in_turn;
use crate::blocks::volume::{BlockedParticles, BlockedVolume};
use crate::collective::Collective;
use crate::constants::BRICK;
use crate::error::Result;
use crate::message::unknown;
use crate::scene::{
    Lattice, Particles, PointVolume, Requirements, Shared, StrengthIn, ValueScale, ValuesIn,
};

/// Builds the bricks of a lattice, and its levels of detail.
///
/// - `volume`: the whole lattice, without values.
/// - `held`: the planes of [`PlaneRuns::wanted`].
/// - `first`: number of the volume in its scene.
///
/// # Errors
/// A rank that is gone.
pub(crate) fn build_lattice_together(
    volume: PointVolume,
    held: Held,
    assigned: &PlaneRuns,
    options: &SceneOptions,
    first: usize,
    ranks: &mut dyn Collective,
) -> Result<SharedVolume> {
    let requirements = Requirements {
        values: held.values.type_name(),
        ..Requirements::of(&volume)
    };
    // Blocks have single precision at most.
    let held = Held {
        values: ValueScale::Linear.positions(held.values),
        ..held
    };
    let Particles::Lattice {
        lattice,
        kernel_width,
    } = volume.particles
    else {
        return Err(unknown("others"));
    };
    let is_sharp = volume.boundary.is_some();
    let grid = match is_sharp {
        true => BrickGrid::with_faces(&lattice, kernel_width),
        false => BrickGrid::new(lattice.clone(), kernel_width),
    };
    let (rank, size) = (ranks.rank(), ranks.size());
    let planes = grid.dims()[2];
    let runs = |rank| assigned.runs(planes, rank);
    let values = ranks.agree(widened(held, &lattice, &grid, is_sharp, runs(rank)))?;
    let bricks = |run: &Range<usize>| {
        let [x, y, _] = grid.bricks();
        let layer =
            |plane: usize| u32::try_from(x * y * plane.div_ceil(BRICK[2])).unwrap_or(u32::MAX);
        layer(run.start)..layer(run.end)
    };
    let is_classified = matches!(volume.strength, StrengthIn::Classified { .. });
    let of_run = |run: Range<usize>| grid.blocks_of(bricks(&run), Some(&values), is_classified, 0);
    let own: Vec<Block> = runs(rank).flat_map(of_run).collect();
    let parts = ranks.gather_records(Ok(own))?;
    let count: usize = grid.bricks().iter().product();
    let mut blocks = vec![None; count];
    for (rank, part) in parts.into_iter().enumerate() {
        let places = runs(rank).flat_map(|run| bricks(&run));
        for (place, block) in places.zip(part) {
            blocks[place as usize] = Some(block);
        }
    }
    let blocks: Option<Vec<Block>> = blocks.into_iter().collect();
    let own_bricks: Vec<Range<u32>> = runs(rank).map(|run| bricks(&run)).collect();
    let not_finite = runs(rank).map(|run| {
        let [x, y, _] = grid.dims();
        not_finite_count(&values, run.start * x * y..run.end * x * y)
    });
    let not_finite = ranks.sum(Ok(not_finite.sum()))?;
    let is_merged = options.level_of_detail && is_large(&grid) && not_finite == 0;
    let mut base = BlockedVolume {
        blocks: blocks.ok_or_else(|| unknown("others"))?,
        particles: BlockedParticles::Lattice(Box::new(grid)),
        strength: volume.strength.shared(),
        colour: volume.colour.shared(),
        values: Some(values),
        transfer_function: volume.transfer_function,
        normals: None,
        boundary: None,
        indices: None,
        local_models: None,
        lobes: None,
        merged: None,
    };
    let levels = match &base.values {
        Some(values) if is_merged => {
            let mut extents = None;
            let levels = levels_of(&base, &mut |cells, cube| {
                let extents = extents.get_or_insert_with(|| cells.axis_extents());
                let making = Making {
                    cells,
                    values,
                    extents,
                    assigned,
                };
                match cube <= LONGEST_COPIED {
                    true => making.short(cube, options, ranks),
                    false => making.long(cube, ranks),
                }
            })?;
            adopted(&mut base, levels)
        }
        _ => Vec::new(),
    };
    let visible = base.visible_boxes();
    let family = family(base, levels);
    let mut own = vec![own_bricks];
    for (level, volume) in family.iter().enumerate().skip(1) {
        own.push(runs_in_turn(volume.blocks.len(), size, rank, first + level));
    }
    Ok(SharedVolume {
        densities: family.iter().map(densities).collect(),
        family,
        own,
        fitted: visible.clone(),
        visible,
        requirements,
    })
}

fn not_finite_count(values: &ValuesIn<Shared>, run: Range<usize>) -> u64 {
    match values {
        ValuesIn::F32(v) => v[run].iter().filter(|v| !v.is_finite()).count() as u64,
        _ => 0,
    }
}

/// Bytes of planes that are freed at a time.
const GIVEN_BACK: usize = if cfg!(test) { 1 << 14 } else { 1 << 26 };

/// Puts the values of planes, with ghosts if there are any, into the order of the whole lattice. Planes that are
/// neither in a run nor beside one take no memory.
fn widened(
    mut held: Held,
    lattice: &Lattice,
    grid: &BrickGrid,
    has_ghosts: bool,
    runs: impl Iterator<Item = Range<usize>>,
) -> Result<ValuesIn<Shared>> {
    let [x, y, planes] = grid.dims();
    let mut all = Sparse::new(x * y * planes, &held.values)?;
    let beside = |run: Range<usize>| run.start.saturating_sub(2)..(run.end + 2).min(planes);
    let mut needed: Vec<usize> = runs.flat_map(beside).collect();
    needed.sort_unstable();
    needed.dedup();
    let [columns, rows, _] = lattice.dims;
    let samples = columns * rows;
    let step = (GIVEN_BACK / (samples * held.values.bytes_per_value()).max(1)).max(1);
    // The last planes first: their source is truncated from the end as they are copied.
    for some in needed.rchunks(step) {
        for &plane in some {
            let at = x * y * plane;
            if has_ghosts {
                let pairs = lattice.ghost_sources_of(plane);
                // Both sources lie in planes that are here.
                let place = |i: usize| {
                    let plane = held.place(i / samples).unwrap_or(0);
                    plane * samples + i % samples
                };
                let pairs = pairs.map(|pair| pair.map(place));
                all.put(at, &held.values.extrapolated(pairs));
            } else {
                let first = held.place(plane).unwrap_or(0) * samples;
                all.put(at, &held.values.part(first..first + samples));
            }
        }
        // Later iterations need no planes behind their own; the first ghosts need the first two planes.
        let last = some.first().map_or(0, |plane| (*plane).max(1));
        held.values.truncate(held.count_up_to(last) * samples);
    }
    all.finish()
}

/// Context for making a level of detail.
struct Making<'a> {
    cells: &'a BrickGrid,
    /// Values, including the planes beside this rank's.
    values: &'a ValuesIn<Shared>,
    /// Extents from [`BrickGrid::axis_extents`].
    extents: &'a [Vec<f64>; 3],
    assigned: &'a PlaneRuns,
}

impl Making<'_> {
    fn runs(&self, rank: usize) -> impl Iterator<Item = Range<usize>> {
        self.assigned.runs(self.cells.dims()[2], rank)
    }

    /// Computes the moments of cubes that each lie in one run.
    fn short(
        &self,
        cube: usize,
        options: &SceneOptions,
        ranks: &mut dyn Collective,
    ) -> Result<CubeMoments> {
        let [columns, rows, slices] = self.cells.dims().map(|n| n.div_ceil(cube));
        let lines = |run: Range<usize>| {
            rows * (run.start / cube)..rows * run.end.div_ceil(cube).min(slices)
        };
        let own = self.runs(ranks.rank()).map(|run| {
            let (cells, values, extents) = (self.cells, self.values, self.extents);
            let task = options.task.as_ref();
            CubeMoments::of_lines(cells, values, extents, cube, lines(run), task)
        });
        let own = own.map(|part| Ok(part?.interleaved()));
        let own: Result<Vec<Vec<f32>>> = own.collect();
        let own = ranks.agree(own)?.concat();
        let parts = ranks.gather_records(Ok(own))?;
        let mut runs: Vec<(Range<usize>, &[f32])> = Vec::new();
        for (rank, part) in parts.iter().enumerate() {
            let mut rest = part.as_slice();
            for run in self.runs(rank).map(lines) {
                let own = rest.split_off(..3 * columns * run.len());
                runs.push((run, own.ok_or_else(|| unknown("others"))?));
            }
        }
        runs.sort_unstable_by_key(|(run, _)| run.start);
        let mut all = CubeMoments::default();
        for (_, own) in runs {
            all.extend(own);
        }
        Ok(all)
    }

    /// Computes the moments of cubes whose slices lie on several ranks.
    fn long(&self, cube: usize, ranks: &mut dyn Collective) -> Result<CubeMoments> {
        let dims = self.cells.dims();
        let [columns, rows, layers] = dims.map(|n| n.div_ceil(cube));
        let range = |at: usize, a: usize| at * cube..((at + 1) * cube).min(dims[a]);
        let mut all = CubeMoments::default();
        for layer in 0..layers {
            let slices = range(layer, 2);
            let cubes: Vec<LongCube<'_>> = (0..columns * rows)
                .map(|n| LongCube {
                    cells: self.cells,
                    values: self.values,
                    extents: self.extents,
                    columns: range(n % columns, 0),
                    rows: range(n / columns, 1),
                })
                .collect();
            let of_rank = |rank: usize| {
                let runs = self.runs(rank);
                let meet = |run: Range<usize>| run.start.max(slices.start)..run.end.min(slices.end);
                runs.flat_map(meet).collect::<Vec<usize>>()
            };
            let own = of_rank(ranks.rank());
            let first: Vec<f64> = match own.contains(&slices.start) {
                true => cubes.iter().map(|cube| cube.first(slices.start)).collect(),
                false => Vec::new(),
            };
            let firsts = ranks.gather_records(Ok(first))?.concat();
            if firsts.len() != cubes.len() {
                return Err(unknown("others"));
            }
            let sums = own.par_iter().flat_map_iter(|&k| {
                let of_cube = move |(cube, first): (&LongCube<'_>, &f64)| cube.sums(k, *first);
                cubes.iter().zip(&firsts).map(of_cube)
            });
            let sums: Vec<[f64; 3]> = sums.collect();
            let parts = ranks.gather_records(Ok(sums))?;
            let mut of_slices = vec![vec![[0.0; 3]; slices.len()]; cubes.len()];
            for (rank, part) in parts.iter().enumerate() {
                for (k, sums) in of_rank(rank).iter().zip(part.chunks_exact(cubes.len())) {
                    for (of_cube, sums) in of_slices.iter_mut().zip(sums) {
                        of_cube[k - slices.start] = *sums;
                    }
                }
            }
            let whole: Vec<WholeCube> = firsts
                .iter()
                .zip(&of_slices)
                .map(|(first, sums)| WholeCube::of(*first, sums))
                .collect();
            let places: Vec<PlaceSums> = cubes
                .par_iter()
                .zip(&whole)
                .map(|(cube, whole)| {
                    let of_slice = |&k: &usize| *cube.places(k, whole).sums();
                    let places = own.iter().map(of_slice);
                    let all = places.fold(whole.no_places(), |all, own| all.with(&own));
                    *all.sums()
                })
                .collect();
            // Sums of integers do not depend on the order.
            let places = ranks.reduce(Ok(places), |sum, own| {
                sum.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
            })?;
            for (whole, places) in whole.iter().zip(&places) {
                all.extend(&whole.moments(&whole.no_places().with(places)));
            }
        }
        Ok(all)
    }
}
