//! Builds the levels of detail of a lattice: clusters are cubes of its cells, which are the cells of coarser grids.

use std::ops::Range;

use rayon::prelude::*;

use super::LAST_LEVEL;
use crate::blocks::brick::BrickGrid;
use crate::blocks::merge::places::{Places, unevenness};
use crate::blocks::merged::{MergeBounds, Merged};
use crate::blocks::volume::{BlockedParticles, BlockedVolume};
use crate::constants::BLOCK_CAPACITY;
use crate::error::Result;
use crate::scene::{Column, Shared, ValuesIn};
use crate::task::{Stage, Task};

/// Cells along the edge of a cube of the first level: 64 cells share its storage.
const FIRST_CUBE: usize = 4;

/// Ratio of the edges of the next level's cubes.
const NEXT_CUBE: usize = 2;

/// Longest edge of cubes whose values are copied. Longer cubes are read in place, in parts on all cores: copies of
/// several would take many times the memory of the lattice.
pub(in crate::blocks) const LONGEST_COPIED: usize = 32;

/// Builds the coarser grids of a lattice, the finest first, and sets the parents of its bricks. Returns none if the
/// lattice cannot be merged (it has masses or colours of its own, or cells that are not finite) or is small.
pub(in crate::blocks) fn merge_lattice(
    base: &mut BlockedVolume,
    task: Option<&Task>,
) -> Result<Vec<BlockedVolume>> {
    let (Some(values), BlockedParticles::Lattice(cells)) = (&base.values, &base.particles) else {
        return Ok(Vec::new());
    };
    if !base.has_values_alone() || !is_large(cells) || values.non_finite_count() > 0 {
        return Ok(Vec::new());
    }
    let extents = cells.axis_extents();
    let levels = levels_of(base, &mut |cells, cube| {
        let [_, rows, slices] = cells.dims().map(|n| n.div_ceil(cube));
        CubeMoments::of_lines(cells, values, &extents, cube, 0..rows * slices, task)
    })?;
    Ok(adopted(base, levels))
}

/// Whether the lattice has enough cells to be merged.
pub(in crate::blocks) fn is_large(cells: &BrickGrid) -> bool {
    cells.len() > BLOCK_CAPACITY
}

/// Builds the coarser grids of a lattice, the finest first.
///
/// - `moments`: returns the moments of cubes of a number of cells along each edge.
pub(in crate::blocks) fn levels_of(
    base: &BlockedVolume,
    moments: &mut dyn FnMut(&BrickGrid, usize) -> Result<CubeMoments>,
) -> Result<Vec<BlockedVolume>> {
    let mut levels: Vec<BlockedVolume> = Vec::new();
    let BlockedParticles::Lattice(cells) = &base.particles else {
        return Ok(levels);
    };
    let mut cube = FIRST_CUBE;
    loop {
        let number = levels.len() as u32 + 1;
        let level = level_of(base, cells, cube, number, moments(cells, cube)?);
        let count = level.particle_count();
        levels.push(level);
        if count <= LAST_LEVEL {
            return Ok(levels);
        }
        cube *= NEXT_CUBE;
    }
}

/// Links the levels of a lattice as parents of its bricks and of one another's.
pub(in crate::blocks) fn adopted(
    base: &mut BlockedVolume,
    mut levels: Vec<BlockedVolume>,
) -> Vec<BlockedVolume> {
    // Parents are counted from the first merged block.
    let mut first = 0;
    let mut finer = base;
    let mut ratio = FIRST_CUBE;
    for coarser in &mut levels {
        adopt(finer, coarser, ratio, first);
        first += coarser.blocks.len() as u32;
        ratio = NEXT_CUBE;
        finer = coarser;
    }
    levels
}

/// Sets the parents of a grid's bricks: a brick of the coarser grid spans `ratio` of them along each axis.
fn adopt(finer: &mut BlockedVolume, coarser: &BlockedVolume, ratio: usize, first: u32) {
    let (BlockedParticles::Lattice(fine), BlockedParticles::Lattice(coarse)) =
        (&finer.particles, &coarser.particles)
    else {
        return;
    };
    let ([x, y, _], [parent_x, parent_y, _]) = (fine.bricks(), coarse.bricks());
    for block in &mut finer.blocks {
        let b = block.first as usize;
        let [i, j, k] = [b % x, b / x % y, b / (x * y)].map(|at| at / ratio);
        let parent = i + parent_x * (j + parent_y * k);
        block.parent = first + parent as u32;
    }
}

/// Moments of the values in a level's cubes, in the order of the level's grid.
#[derive(Debug, Default)]
pub(in crate::blocks) struct CubeMoments {
    pub(in crate::blocks) means: Vec<f32>,
    pub(in crate::blocks) spreads: Vec<f32>,
    pub(in crate::blocks) uneven: Vec<f32>,
}

impl CubeMoments {
    fn of(count: usize) -> Self {
        Self {
            means: vec![0.0; count],
            spreads: vec![0.0; count],
            uneven: vec![0.0; count],
        }
    }

    /// Computes the moments of some lines of cubes along x.
    ///
    /// - `extents`: of the cells along each axis, from [`BrickGrid::axis_extents`].
    /// - `lines`: counted along y, then along z.
    pub(in crate::blocks) fn of_lines(
        cells: &BrickGrid,
        values: &ValuesIn<Shared>,
        extents: &[Vec<f64>; 3],
        cube: usize,
        lines: Range<usize>,
        task: Option<&Task>,
    ) -> Result<Self> {
        let [columns, rows, _] = cells.dims().map(|n| n.div_ceil(cube));
        let mut all = Self::of(lines.len() * columns);
        let stage = Stage::new(task, "levels of detail", lines.len());
        let each = columns.max(1);
        all.means
            .par_chunks_mut(each)
            .zip(all.spreads.par_chunks_mut(each))
            .zip(all.uneven.par_chunks_mut(each))
            .enumerate()
            .filter(|(line, _)| stage.counts(*line))
            .for_each_init(
                Cubes::default,
                |cubes, (line, ((means, spreads), uneven))| {
                    let line = lines.start + line;
                    cubes.move_to(cells, [line % rows, line / rows], cube);
                    let is_copied = cube <= LONGEST_COPIED;
                    if is_copied {
                        cubes.copy(cells, values);
                    }
                    let out = means.iter_mut().zip(spreads).zip(uneven);
                    for (i, ((mean, spread), uneven)) in out.enumerate() {
                        [*mean, *spread, *uneven] = if is_copied {
                            cubes.moments(extents, i)
                        } else {
                            cubes.moments_in_place(cells, values, extents, i)
                        };
                    }
                },
            );
        stage.check()?;
        Ok(all)
    }

    pub(in crate::blocks) fn extend(&mut self, others: &[f32]) {
        for [mean, spread, uneven] in others.as_chunks().0 {
            self.means.push(*mean);
            self.spreads.push(*spread);
            self.uneven.push(*uneven);
        }
    }

    /// Returns the three moments of each cube, one cube after another.
    pub(in crate::blocks) fn interleaved(&self) -> Vec<f32> {
        let others = self.spreads.iter().zip(&self.uneven);
        let each = self.means.iter().zip(others);
        each.flat_map(|(mean, (spread, uneven))| [*mean, *spread, *uneven])
            .collect()
    }
}

/// Builds one level: cubes of `cube` cells along each edge, with means and spreads of their values.
pub(in crate::blocks) fn level_of(
    base: &BlockedVolume,
    cells: &BrickGrid,
    cube: usize,
    level: u32,
    moments: CubeMoments,
) -> BlockedVolume {
    let grid = cells.merged(cube);
    let CubeMoments {
        means,
        spreads,
        uneven,
    } = moments;
    let blocks = grid.blocks(None, false, level);
    let moments = cells.axis_moments(cube);
    let bounds: Vec<MergeBounds> = blocks
        .par_iter()
        .map(|block| {
            let cells = grid.cells(block.first);
            let mut bounds = grid.merge_bounds(&moments, cells);
            let [x, y, z] = cells;
            let mut squares = 0.0;
            for k in z[0]..z[1] {
                for j in y[0]..y[1] {
                    let row = grid.index([x[0], j, k])..grid.index([x[1] - 1, j, k]) + 1;
                    let widest = spreads[row.clone()].iter().copied().fold(0.0, f32::max);
                    bounds.spread = bounds.spread.max(widest);
                    squares += uneven[row]
                        .iter()
                        .map(|&u| f64::from(u).powi(2))
                        .sum::<f64>();
                }
            }
            bounds.uneven = (squares / f64::from(block.count)).sqrt() as f32;
            bounds
        })
        .collect();
    BlockedVolume {
        blocks,
        particles: BlockedParticles::Lattice(Box::new(grid)),
        strength: base.strength.clone(),
        colour: base.colour.clone(),
        values: Some(ValuesIn::F32(means.into())),
        transfer_function: None,
        normals: None,
        local_models: None,
        lobes: None,
        indices: None,
        boundary: None,
        merged: Some(Merged {
            bounds,
            spreads: spreads.into(),
            transfer: None,
            member_depths: Column::default(),
        }),
    }
}

/// Cells of a line of cubes.
#[derive(Debug, Default)]
struct Cubes {
    cube: usize,
    /// Number of cells of the lattice along x.
    columns: usize,
    /// Rows of cells in the cubes: the rows at `rows` along y and at `slices` along z.
    rows: Range<usize>,
    slices: Range<usize>,
    /// Values of these cells, row after row.
    values: Vec<f32>,
    /// Members of one cube: share of its volume, and value relative to the first.
    members: Vec<(f64, f64)>,
}

impl Cubes {
    /// Moves to the line of cubes at `[j, k]` along y and z.
    fn move_to(&mut self, cells: &BrickGrid, at: [usize; 2], cube: usize) {
        let [columns, rows, slices] = cells.dims();
        let range = |at: usize, count: usize| at * cube..((at + 1) * cube).min(count);
        (self.cube, self.columns) = (cube, columns);
        (self.rows, self.slices) = (range(at[0], rows), range(at[1], slices));
    }

    /// Copies the values of the cells.
    fn copy(&mut self, cells: &BrickGrid, values: &ValuesIn<Shared>) {
        self.values.clear();
        for k in self.slices.clone() {
            for j in self.rows.clone() {
                let first = cells.index([0, j, k]);
                values.append_to(first..first + self.columns, &mut self.values);
            }
        }
    }

    /// Cells of cube `i` along x.
    fn of_cube(&self, i: usize) -> Range<usize> {
        i * self.cube..((i + 1) * self.cube).min(self.columns)
    }

    /// Returns the mean of the values in cube `i`, weighted by volume; the half width of the interval over which evenly
    /// spread values would have their variance; and their unevenness.
    fn moments(&mut self, extents: &[Vec<f64>; 3], i: usize) -> [f32; 3] {
        let range = self.of_cube(i);
        let [along_x, along_y, along_z] = extents;
        let widths = &along_x[range.clone()];
        // Relative to the first value, so that nothing cancels.
        let first = f64::from(self.values[range.start]);
        let mut lines = self.values.chunks_exact(self.columns);
        self.members.clear();
        for z in &along_z[self.slices.clone()] {
            for (y, line) in along_y[self.rows.clone()].iter().zip(&mut lines) {
                let members = widths.iter().zip(&line[range.clone()]);
                let own = members.map(|(x, value)| (x * y * z, f64::from(*value) - first));
                self.members.extend(own);
            }
        }
        let (mut volume, mut sum, mut square) = (0.0, 0.0, 0.0);
        for (own, value) in &self.members {
            volume += own;
            sum += own * value;
            square += own * value * value;
        }
        let (mean, spread) = mean_and_spread(volume, sum, square);
        let shares = self
            .members
            .iter()
            .map(|&(own, value)| (own / volume, value));
        let uneven = unevenness(shares, mean, spread);
        [(first + mean) as f32, spread as f32, uneven as f32]
    }

    /// Computes the same from values in place, in sums over slices, so that the result does not depend on threads.
    fn moments_in_place(
        &self,
        cells: &BrickGrid,
        values: &ValuesIn<Shared>,
        extents: &[Vec<f64>; 3],
        i: usize,
    ) -> [f32; 3] {
        let cube = LongCube {
            cells,
            values,
            extents,
            columns: self.of_cube(i),
            rows: self.rows.clone(),
        };
        let slices = || self.slices.clone().into_par_iter();
        let first = cube.first(self.slices.start);
        let sums: Vec<[f64; 3]> = slices().map(|k| cube.sums(k, first)).collect();
        let whole = WholeCube::of(first, &sums);
        let places: Vec<Places> = slices().map(|k| cube.places(k, &whole)).collect();
        let places = places
            .iter()
            .fold(whole.no_places(), |all, own| all.and(own));
        whole.moments(&places)
    }
}

/// A cube that is read in place, slice by slice along z.
#[derive(Debug, Clone)]
pub(in crate::blocks) struct LongCube<'a> {
    pub(in crate::blocks) cells: &'a BrickGrid,
    pub(in crate::blocks) values: &'a ValuesIn<Shared>,
    /// Extents from [`BrickGrid::axis_extents`].
    pub(in crate::blocks) extents: &'a [Vec<f64>; 3],
    pub(in crate::blocks) columns: Range<usize>,
    pub(in crate::blocks) rows: Range<usize>,
}

impl LongCube<'_> {
    /// Returns the value that the cube's values are relative to.
    ///
    /// - `k`: the first slice.
    pub(in crate::blocks) fn first(&self, k: usize) -> f64 {
        let at = self.cells.index([self.columns.start, self.rows.start, k]);
        f64::from(self.values.get(at))
    }

    /// Sums over a slice: the volume, the values relative to the first, and their squares.
    pub(in crate::blocks) fn sums(&self, k: usize, first: f64) -> [f64; 3] {
        let mut sums = [0.0; 3];
        self.for_each(k, |own, value| {
            let value = value - first;
            sums[0] += own;
            sums[1] += own * value;
            sums[2] += own * value * value;
        });
        sums
    }

    /// Returns the distribution of a slice's values, relative to the whole cube's.
    pub(in crate::blocks) fn places(&self, k: usize, whole: &WholeCube) -> Places {
        let mut places = whole.no_places();
        self.for_each(k, |own, value| {
            places.add(own / whole.volume, value - whole.first);
        });
        places
    }

    /// Calls `each` with the volume and the value of every cell of a slice.
    fn for_each(&self, k: usize, mut each: impl FnMut(f64, f64)) {
        let [along_x, along_y, along_z] = self.extents;
        let mut line = Vec::with_capacity(self.columns.len());
        for j in self.rows.clone() {
            let start = self.cells.index([self.columns.start, j, k]);
            line.clear();
            self.values
                .append_to(start..start + self.columns.len(), &mut line);
            let yz = along_y[j] * along_z[k];
            for (x, value) in along_x[self.columns.clone()].iter().zip(&line) {
                each(x * yz, f64::from(*value));
            }
        }
    }
}

/// Moments of a long cube, from the sums of all its slices.
#[derive(Debug, Clone, Copy)]
pub(in crate::blocks) struct WholeCube {
    volume: f64,
    first: f64,
    mean: f64,
    spread: f64,
}

impl WholeCube {
    /// Combines sums.
    ///
    /// - `sums`: sums of the slices, in their order.
    pub(in crate::blocks) fn of(first: f64, sums: &[[f64; 3]]) -> Self {
        let of_all = |n: usize| sums.iter().map(|sums| sums[n]).sum::<f64>();
        let volume = of_all(0);
        let (mean, spread) = mean_and_spread(volume, of_all(1), of_all(2));
        Self {
            volume,
            first,
            mean,
            spread,
        }
    }

    pub(in crate::blocks) fn no_places(&self) -> Places {
        Places::new(self.mean, self.spread)
    }

    /// Returns mean, spread and unevenness.
    pub(in crate::blocks) fn moments(&self, places: &Places) -> [f32; 3] {
        [
            (self.first + self.mean) as f32,
            self.spread as f32,
            places.unevenness() as f32,
        ]
    }
}

/// Returns the mean of values, and the half width of the interval over which evenly spread values would have their
/// variance. The arguments are the total weight, and weighted sums of values and of their squares.
fn mean_and_spread(volume: f64, sum: f64, square: f64) -> (f64, f64) {
    let mean = sum / volume;
    let variance = (square / volume - mean * mean).max(0.0);
    (mean, (3.0 * variance).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Lattice, LatticeSpacing};

    #[test]
    fn cubes_that_are_read_where_they_lie_have_the_moments_of_copies() {
        let dims = [45, 38, 41];
        let line = |n: usize| (0..n).map(|i| (i as f64).powf(1.2)).collect::<Vec<f64>>();
        let lattice = Lattice {
            dims,
            spacing: LatticeSpacing::Rectilinear {
                coordinates: dims.map(line),
            },
        };
        let at = |n: usize| ((n * n) as f64 * 0.37).sin() as f32 + (n % dims[0]) as f32 * 0.1;
        let values: Vec<f32> = (0..lattice.len()).map(at).collect();
        let values = ValuesIn::F32(values.into());
        let cells = BrickGrid::new(lattice, 0.6);
        let extents = cells.axis_extents();
        let mut cubes = Cubes::default();
        for (cube, lines) in [(4, [3, 5]), (16, [2, 2]), (32, [1, 0]), (64, [0, 0])] {
            cubes.move_to(&cells, lines, cube);
            cubes.copy(&cells, &values);
            for i in 0..dims[0].div_ceil(cube) {
                let copied = cubes.moments(&extents, i);
                let in_place = cubes.moments_in_place(&cells, &values, &extents, i);
                // The sums have another order, and are narrowed to f32.
                for (a, b) in copied.iter().zip(in_place) {
                    assert!(
                        (a - b).abs() <= 2e-6 * a.abs().max(1e-3),
                        "{copied:?} {in_place:?}"
                    );
                }
                assert!(copied[1] > 0.0 && copied[2] > 0.0);
            }
        }
    }
}
