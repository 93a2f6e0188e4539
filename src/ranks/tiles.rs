//! Assigns tiles to ranks: a run of tiles, row by row, of about equal work for each rank.
//!
//! The assignment does not change the image. It follows from the blocks in view, which every rank knows before any
//! particle is projected. A rank can therefore send footprints as soon as it has made them.

use std::ops::Range;

use crate::blocks::BlockedVolume;
use crate::constants::MAX_CUTOFF;
use crate::record::{BlockView, Footprint, ViewUniform};

/// Tiles of an image, or some of them, and the ranks that draw them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct TileShares {
    /// Pixels along a side of a tile.
    size: usize,
    /// Tiles in a row.
    columns: usize,
    /// Tiles of each rank.
    runs: Vec<Range<usize>>,
    /// For each tile, the end of the run of tiles with the same owner, and that owner: [`NOBODY`] if no rank draws
    /// them.
    owners: Vec<(u32, u32)>,
}

/// Stands for a rank: no rank draws the tile.
const NOBODY: u32 = u32::MAX;

/// Work of a tile without footprints (clearing, gathering, resolving), in kernel evaluations at pixels.
const EMPTY_TILE: f64 = 256.0;
/// Work of a footprint's entry in a tile's list, besides its pixels.
const ENTRY: f64 = 32.0;

/// Work of an image's tiles, estimated from the blocks in view.
#[derive(Debug)]
pub(super) struct Work {
    size: usize,
    columns: usize,
    rows: usize,
    /// Differences of the work along both axes; one column and one row more than there are tiles.
    differences: Vec<f64>,
}

impl Work {
    /// Starts with no work, for an image in tiles of `size`² pixels.
    pub(super) fn new(view: &ViewUniform, size: usize) -> Self {
        let [columns, rows] = view.size.map(|n| (n as usize).div_ceil(size));
        Self {
            size,
            columns,
            rows,
            differences: vec![0.0; (columns + 1) * (rows + 1)],
        }
    }

    /// Adds a volume's blocks in view, as if each block's particles were spread evenly over its box.
    pub(super) fn add(&mut self, volume: &BlockedVolume, views: &[BlockView], view: &ViewUniform) {
        let focal = view.focal_px.map(f64::from);
        let size = self.size as f64;
        for seen in views {
            let block = &volume.blocks[seen.block as usize];
            let [x, y, z] = seen.origin_camera.map(f64::from);
            let sigma = f64::from(block.max_sigma);
            let reach = block.half_extent.as_dvec3().length() + f64::from(MAX_CUTOFF) * sigma;
            let depth = if view.orthographic != 0 { 1.0 } else { z };
            let focal = focal.map(|f| f / depth);
            // Blocks beside the eye may reach any tile.
            let is_near = view.orthographic == 0 && z <= reach;
            let range = |axis: usize, at: f64, count: usize| {
                let centre = focal[axis] * at + f64::from(view.centre_px[axis]);
                let half = focal[axis] * reach;
                let tile = |px: f64| ((px / size).max(0.0) as usize).min(count - 1);
                if is_near || !(centre.is_finite() && half.is_finite()) {
                    return 0..count;
                }
                tile(centre - half)..tile(centre + half) + 1
            };
            let (columns, rows) = (range(0, x, self.columns), range(1, y, self.rows));
            // Work of one footprint: its pixels, and the tiles whose lists it enters.
            let radius = f64::from(MAX_CUTOFF).min(3.0)
                * (focal[0].abs() * sigma).hypot(f64::from(view.low_pass_variance_px2).sqrt());
            let most = (self.columns * self.rows) as f64;
            let listed = (2.0 * radius / size + 1.0).powi(2).min(most);
            let pixels = (std::f64::consts::PI * radius * radius).min(most * size * size);
            let work = f64::from(block.count) * (pixels + listed * ENTRY);
            if work.is_finite() {
                self.spread(work, columns, rows);
            }
        }
    }

    fn spread(&mut self, work: f64, columns: Range<usize>, rows: Range<usize>) {
        let each = work / (columns.len() * rows.len()) as f64;
        let line = self.columns + 1;
        for (row, sign) in [(rows.start, 1.0), (rows.end, -1.0)] {
            self.differences[row * line + columns.start] += sign * each;
            self.differences[row * line + columns.end] -= sign * each;
        }
    }

    /// Cuts the tiles into runs of about equal work, one for each of `ranks`.
    pub(super) fn shares(mut self, ranks: usize) -> TileShares {
        let line = self.columns + 1;
        for row in 0..=self.rows {
            for column in 1..line {
                self.differences[row * line + column] += self.differences[row * line + column - 1];
            }
        }
        for i in line..self.differences.len() {
            self.differences[i] += self.differences[i - line];
        }
        let tiles = self.columns * self.rows;
        let mut before = Vec::with_capacity(tiles + 1);
        let mut sum = 0.0;
        before.push(sum);
        for tile in 0..tiles {
            let (row, column) = (tile / self.columns, tile % self.columns);
            // Rounding may leave a negative number.
            sum += self.differences[row * line + column].max(0.0) + EMPTY_TILE;
            before.push(sum);
        }
        let cut = |rank: usize| {
            let share = sum * rank as f64 / ranks as f64;
            before.partition_point(|before| *before < share).min(tiles)
        };
        let mut cuts: Vec<usize> = (0..=ranks).map(cut).collect();
        (cuts[0], cuts[ranks]) = (0, tiles);
        TileShares::new(self.size, self.columns, cuts)
    }
}

impl TileShares {
    /// Assigns each rank the tiles between two cuts.
    ///
    /// - `cuts`: ascending, from 0 to the number of tiles.
    pub(super) fn new(size: usize, columns: usize, cuts: Vec<usize>) -> Self {
        let tiles = cuts.last().copied().unwrap_or(0);
        let runs = cuts.windows(2).map(|run| run[0]..run[1]).collect();
        Self::of_runs(size, columns, tiles, runs)
    }

    /// Assigns each rank a run of tiles.
    ///
    /// - `runs`: one for each rank, ascending.
    fn of_runs(size: usize, columns: usize, tiles: usize, runs: Vec<Range<usize>>) -> Self {
        let mut owners = Vec::with_capacity(tiles);
        for (rank, run) in (0..).zip(&runs) {
            if run.is_empty() {
                continue;
            }
            let start = run.start.max(owners.len());
            owners.resize(start, (start as u32, NOBODY));
            owners.resize(run.end.max(start), (run.end as u32, rank));
        }
        owners.resize(tiles.max(owners.len()), (tiles as u32, NOBODY));
        Self {
            size,
            columns,
            runs,
            owners,
        }
    }

    /// Returns one of `parts` parts of each rank's tiles, each with about as many tiles.
    pub(super) fn part(&self, part: usize, parts: usize) -> Self {
        let of_rank = |run: &Range<usize>| {
            let cut = |n: usize| run.start + n * run.len() / parts;
            cut(part)..cut(part + 1)
        };
        let runs = self.runs.iter().map(of_rank).collect();
        Self::of_runs(self.size, self.columns, self.owners.len(), runs)
    }

    /// Returns the boxes of pixels (columns, rows) around the tiles of each rank that has any.
    pub(super) fn boxes(&self, [width, height]: [usize; 2]) -> Vec<[Range<usize>; 2]> {
        let with_tiles = self.runs.iter().filter(|run| !run.is_empty());
        let around = with_tiles.map(|run| {
            let rows = run.start / self.columns..(run.end - 1) / self.columns + 1;
            let columns = match rows.len() {
                1 => run.start % self.columns..(run.end - 1) % self.columns + 1,
                _ => 0..self.columns,
            };
            let pixels = |tiles: Range<usize>, count: usize| {
                tiles.start * self.size..(tiles.end * self.size).min(count)
            };
            [pixels(columns, width), pixels(rows, height)]
        });
        around.collect()
    }

    /// Tiles of a rank.
    pub(super) fn of(&self, rank: usize) -> Range<usize> {
        self.runs[rank].clone()
    }

    /// Number of tiles in a row.
    pub(super) fn columns(&self) -> usize {
        self.columns
    }

    /// Calls `each` once with every rank that draws a tile of a visible footprint's box, ascending.
    pub(super) fn for_each_rank(&self, footprint: &Footprint, mut each: impl FnMut(usize)) {
        let tiles = |(first, end): (u32, u32)| {
            let (first, end) = (
                first as usize / self.size,
                (end as usize).div_ceil(self.size),
            );
            first..end
        };
        let columns = tiles(footprint.column_range());
        if columns.is_empty() {
            return;
        }
        let mut next = 0;
        for row in tiles(footprint.row_range()) {
            let end = row * self.columns + columns.end;
            let mut tile = row * self.columns + columns.start;
            while tile < end {
                let (end_of_run, owner) = self.owners[tile];
                if owner != NOBODY && owner as usize >= next {
                    each(owner as usize);
                    next = owner as usize + 1;
                }
                tile = end_of_run as usize;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;
    use crate::record::pack_range;

    #[test]
    fn footprints_go_to_whoever_draws_a_tile_of_theirs_once() {
        // Rows of five tiles; one rank without any, and one with a part of a row.
        let shares = TileShares::new(16, 5, vec![0, 7, 7, 9, 20]);
        let ranks = |columns: [u32; 2], rows: [u32; 2]| {
            let footprint = Footprint {
                columns: pack_range(columns[0], columns[1]),
                rows: pack_range(rows[0], rows[1]),
                ..Footprint::zeroed()
            };
            let mut ranks = Vec::new();
            shares.for_each_rank(&footprint, |rank| ranks.push(rank));
            ranks
        };
        assert_eq!(ranks([0, 80], [0, 64]), [0, 2, 3]);
        assert_eq!(ranks([0, 16], [0, 16]), [0]);
        assert_eq!(ranks([15, 33], [31, 32]), [0, 2]);
        assert_eq!(ranks([64, 80], [10, 20]), [0, 3]);
        assert!(ranks([0, 0], [0, 0]).is_empty());
    }

    #[test]
    fn parts_are_all_tiles_and_what_touches_none_of_one_goes_nowhere() {
        let shares = TileShares::new(16, 5, vec![0, 7, 7, 9, 20]);
        let mut drawn = [0; 20];
        for part in 0..3 {
            let some = shares.part(part, 3);
            for rank in 0..4 {
                let own = some.of(rank);
                assert!(own.is_empty() || shares.of(rank).start <= own.start);
                assert!(own.end <= shares.of(rank).end);
                own.for_each(|tile| drawn[tile] += 1);
            }
            for tile in 0..20_usize {
                let [x, y] = [tile % 5 * 16, tile / 5 * 16].map(|at| at as u32);
                let footprint = Footprint {
                    columns: pack_range(x + 1, x + 15),
                    rows: pack_range(y + 1, y + 15),
                    ..Footprint::zeroed()
                };
                let mut ranks = Vec::new();
                some.for_each_rank(&footprint, |rank| ranks.push(rank));
                let owner = (0..4).find(|&rank| some.of(rank).contains(&tile));
                assert_eq!(ranks, owner.into_iter().collect::<Vec<_>>());
            }
            // Every tile lies in the box of a rank.
            let boxes = some.boxes([78, 60]);
            for tile in (0..4).flat_map(|rank| some.of(rank)) {
                let [x, y] = [tile % 5 * 16, tile / 5 * 16];
                assert!(
                    boxes
                        .iter()
                        .any(|[columns, rows]| columns.contains(&x) && rows.contains(&y))
                );
            }
            assert!(
                boxes
                    .iter()
                    .all(|[columns, rows]| columns.end <= 78 && rows.end <= 60)
            );
        }
        assert_eq!(drawn, [1; 20]);
    }

    #[test]
    fn runs_are_all_tiles_whatever_is_in_view() {
        let view = ViewUniform {
            size: [100, 70],
            ..ViewUniform::zeroed()
        };
        for ranks in [1, 2, 3, 7, 100] {
            let mut work = Work::new(&view, 16);
            work.spread(1e9, 2..3, 1..2);
            let shares = work.shares(ranks);
            let mut next = 0;
            for rank in 0..ranks {
                let own = shares.of(rank);
                assert_eq!(own.start, next);
                next = own.end;
            }
            assert_eq!(next, 7 * 5);
        }
        // Nearly all work is in one tile: no other rank has much of it.
        let mut work = Work::new(&view, 16);
        work.spread(1e9, 2..3, 1..2);
        let shares = work.shares(2);
        assert!(shares.of(0).end.abs_diff(9) <= 1, "{shares:?}");
    }
}
