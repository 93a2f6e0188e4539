//! Stage: sums lists of footprints to a column density, without opacity and without depth order.
//!
//! Twin: `shaders/tile/accumulate/column.wgsl`.
//!
//! A pixel may receive a hundred thousand contributions. In f32 alone, similar contributions would lose a
//! percent of the sum. So a tile sums [`RUN`] footprints in f32, from zero, and adds the result to sums
//! in f64. The error of each contribution is at most RUN/2 units in its last place of f32, 4e-6, and on
//! average far less. Adding a tile to the f64 sums costs 64 evaluations a footprint. f64 throughout would
//! double the memory traffic, which limits separable footprints.
//!
//! Uncut affine and exact footprints are evaluated and summed in one loop. Footprints that clip planes
//! cut, and near ones, are evaluated in rows of the pictures' tiles, of which a tile here is made.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::Vec2;
use rayon::prelude::*;

use crate::constants::{COLUMN_TILE_SIZE, TILE_SIZE};
use crate::cpu::bin::{Bins, bin_into};
use crate::cpu::tile::evaluate::affine::{RowForm, is_aligned};
use crate::cpu::tile::evaluate::exact::{ExactAt, RowOfExact};
use crate::cpu::tile::evaluate::{Evaluate, depth_reach};
use crate::cpu::tile::interval::cut::{Cut, Side, Spans};
use crate::cpu::tile::interval::domain::domain_of;
use crate::cpu::tile::interval::{between, shares_at, whole};
use crate::cpu::tile::pixels::{Patch, TilePlace, prefetch, ray};
use crate::math::lane::{exp_minus_half, madd};
use crate::record::{
    ExactTerms, Footprint, FootprintTerms, NearTerms, PATH_AFFINE, PATH_EXACT, PATH_HALF_LINE,
    PATH_NEAR, ViewUniform,
};
use crate::simd::{SimdLevel, SimdWork, run_at};
use crate::splat::{Band, PixelMean, RANK, Smoothed};
use crate::task::{Stage, Task};

const SIZE: usize = COLUMN_TILE_SIZE;
const PIXELS: usize = SIZE * SIZE;
/// Number of picture tiles along a side of a column tile.
const PARTS: usize = SIZE / TILE_SIZE;
/// Pixels of a row that are evaluated together, for every instruction set. So the set of pixels that a
/// footprint adds to does not depend on the instruction set.
const CHUNK: usize = 16;
/// Footprints summed in f32 before the sums are added to f64.
const RUN: usize = 64;
/// Least number of footprints of a tile in a task of its own.
const TASK: usize = 16_384;
/// Greatest number of tasks of a tile.
const TASKS: usize = 32;

/// The sums of one column-density image, kept from frame to frame.
#[derive(Debug, Default)]
pub struct ColumnSums {
    /// One per tile, in order.
    tiles: Vec<TileSums>,
    /// Sums of parts of long lists, while they are formed.
    others: Vec<TileSums>,
}

/// The sums of a tile's pixels, or of a part of its list.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct TileSums([f64; PIXELS]);

impl TileSums {
    const ZERO: Self = Self([0.0; PIXELS]);
}

/// Memory of a task.
#[repr(align(64))]
struct Scratch {
    /// Sums of the pixels.
    sums: [f32; PIXELS],
    /// Factors of the tile's rows and of its columns, and those of the columns in a list for each product.
    of_rows: [[f32; RANK]; SIZE],
    of_columns: [[f32; RANK]; SIZE],
    lists: [[f32; SIZE]; RANK],
}

/// Input of a frame's sums.
#[derive(Debug, Clone, Copy)]
pub struct ColumnInput<'a> {
    /// The frame's view.
    pub view: &'a ViewUniform,
    /// Footprints, which carry the amplitude's sign.
    pub footprints: &'a [Footprint],
    /// Their exact terms, or none.
    pub exact: &'a [ExactTerms],
    /// Terms of the kernels that cross the camera plane.
    pub near: &'a [NearTerms],
    /// Result of [`bin_columns`].
    pub bins: &'a Bins,
    /// The instruction set of the inner loop.
    pub level: SimdLevel,
    /// Receives the progress of the sum, and may end it early.
    pub task: Option<&'a Task>,
}

/// Bins footprints into tiles of [`COLUMN_TILE_SIZE`]².
///
/// - `columns`: tiles in a row of the picture.
/// - `tiles`: the tiles that get lists.
pub fn bin_columns(
    footprints: &[Footprint],
    terms: FootprintTerms<'_>,
    order: &[u64],
    columns: usize,
    tiles: Range<usize>,
    bins: &mut Bins,
) {
    bin_into::<SIZE>(footprints, terms, order, columns, tiles, bins);
}

/// Returns the numbers of columns and rows of tiles.
fn tiles(view: &ViewUniform) -> [usize; 2] {
    view.size.map(|n| (n as usize).div_ceil(SIZE))
}

impl ColumnSums {
    /// Clears the sums of the last frame.
    pub fn clear(&mut self) {
        self.tiles.clear();
    }

    /// Sums the footprints of the tiles that have lists; these tiles follow those of the last call.
    /// Returns the number of splat-pixels: kernels evaluated at pixel centres within their cut-off (for
    /// separable footprints: within its bounding box).
    ///
    /// The result does not depend on the number of threads, nor on where and when other tiles are summed: the
    /// tasks of a tile depend only on its list.
    pub fn add_all(&mut self, input: &ColumnInput) -> u64 {
        let [columns, _] = tiles(input.view);
        let lists = input.bins.tiles();
        let before = self.tiles.len();
        self.tiles.resize(before + lists.len(), TileSums::ZERO);
        let longest = |tile| input.bins.tile_len(tile).div_ceil(TASKS).max(TASK);
        // The first task of a tile has the tile's sums, others have their own.
        let others = |tile| {
            input
                .bins
                .tile_len(tile)
                .div_ceil(longest(tile))
                .saturating_sub(1)
        };
        self.others
            .resize(lists.clone().map(others).sum(), TileSums::ZERO);
        let mut sums_of_others = self.others.iter_mut();
        let mut tasks = Vec::new();
        for (tile, sums) in lists.clone().zip(&mut self.tiles[before..]) {
            let (len, longest) = (input.bins.tile_len(tile), longest(tile));
            let starts = (0..len).step_by(longest);
            let sums = std::iter::once(sums).chain(&mut sums_of_others);
            tasks.extend(starts.zip(sums).map(|(first, sums)| SumTask {
                input,
                tile,
                list: first..len.min(first + longest),
                place: TilePlace::new(input.view, tile, columns),
                sums,
            }));
        }
        let stage = Stage::new(input.task, "summing", tasks.len());
        let splat_pixels = tasks
            .into_par_iter()
            .with_max_len(1)
            .map(|task| {
                if !stage.goes_on() {
                    return 0;
                }
                let splat_pixels = run_at(input.level, task);
                stage.advance(1);
                splat_pixels
            })
            .sum();
        let mut sums_of_others = self.others.iter();
        for (tile, total) in lists.zip(&mut self.tiles[before..]) {
            for part in sums_of_others.by_ref().take(others(tile)) {
                for (sum, own) in total.0.iter_mut().zip(&part.0) {
                    *sum += own;
                }
            }
        }
        splat_pixels
    }

    /// Returns the sums of each tile that had lists, in order.
    pub fn totals(&self) -> &[TileSums] {
        &self.tiles
    }

    /// Wraps sums of every tile of a picture that were formed elsewhere.
    pub fn of_totals(totals: Vec<TileSums>) -> Self {
        Self {
            tiles: totals,
            ..Self::default()
        }
    }

    /// Writes the sums times `scale`, row by row from the top. Returns the largest magnitude
    /// before narrowing.
    pub fn write(&self, view: &ViewUniform, scale: f64, pixels: &mut [f32]) -> f64 {
        let [columns, _] = tiles(view);
        let width = view.size[0] as usize;
        pixels
            .par_chunks_mut(width.max(1))
            .enumerate()
            .map(|(y, row)| {
                let mut largest = 0.0_f64;
                let first = y % SIZE * SIZE;
                for (t, pixels) in row.chunks_mut(SIZE).enumerate() {
                    let tile = y / SIZE * columns + t;
                    let sums = &self.tiles[tile].0[first..];
                    for (sum, pixel) in sums.iter().zip(pixels) {
                        let value = sum * scale;
                        // Phrased so that `max` would not lose a NaN.
                        if !(value.abs() <= largest) {
                            largest = value.abs();
                        }
                        *pixel = value as f32;
                    }
                }
                largest
            })
            .reduce(|| 0.0, |a, b| if b <= a { a } else { b })
    }
}

/// A part of a tile's list.
struct SumTask<'a> {
    input: &'a ColumnInput<'a>,
    tile: usize,
    list: Range<usize>,
    place: TilePlace<'a, SIZE>,
    sums: &'a mut TileSums,
}

impl SimdWork for SumTask<'_> {
    type Output = u64;

    #[inline(always)]
    fn run<const FMA: bool, const LANES: usize>(self) -> u64 {
        let Self {
            input,
            tile,
            list,
            place,
            sums,
        } = self;
        let mut list = input.bins.tile(tile).skip(list.start).take(list.len());
        let tile = ColumnTile::new(input, place);
        let mut scratch = Scratch {
            sums: [0.0; PIXELS],
            of_rows: [[0.0; RANK]; SIZE],
            of_columns: [[0.0; RANK]; SIZE],
            lists: [[0.0; SIZE]; RANK],
        };
        sums.0.fill(0.0);
        let mut splat_pixels = 0;
        let mut run = [0_u32; RUN];
        loop {
            let mut len = 0;
            for (place, i) in run.iter_mut().zip(&mut list) {
                prefetch(input.footprints.get(i as usize));
                *place = i;
                len += 1;
            }
            for &i in &run[..len] {
                let footprint = &input.footprints[i as usize];
                let exact = input.exact.get(i as usize);
                splat_pixels += u64::from(tile.add::<FMA>(&mut scratch, footprint, exact));
            }
            for (sum, fine) in sums.0.iter_mut().zip(&mut scratch.sums) {
                *sum += f64::from(*fine);
                *fine = 0.0;
            }
            if len < RUN {
                return splat_pixels;
            }
        }
    }
}

/// A tile in the image.
struct ColumnTile<'a> {
    input: &'a ColumnInput<'a>,
    place: TilePlace<'a, SIZE>,
    /// Number of columns in the image.
    width: usize,
    /// The parts of the rays inside the clip planes, for each part of the tile; empty without clip
    /// planes.
    spans: Vec<Spans>,
    /// Depths between which the clip planes cut nothing.
    whole: [f32; 2],
}

/// Chords of the ellipses Q = A dx² + 2 B dx dy + C dy² on rows: Q is least at dx = -B/A dy, where it is det/A dy².
struct Chords {
    a: f32,
    tilt: f32,
    least: f32,
    /// Column of the centre, px.
    centre: f32,
    /// Column of the middle of the tile's first pixel, px.
    origin: f32,
}

impl Chords {
    /// Returns the middle of the chords at `dy` from the centre, from the middle of the tile's first pixel, px.
    #[inline(always)]
    fn middle(&self, dy: f32) -> f32 {
        self.centre + self.tilt * dy - self.origin
    }

    /// Returns half of a chord, by Q at its ends, px.
    #[inline(always)]
    fn half(&self, ends: f32, dy: f32) -> f32 {
        ((ends - self.least * dy * dy).max(0.0) / self.a).sqrt()
    }

    /// Returns the first pixel of a chord and the one behind it. There is one more on either side: a test of each pixel decides
    /// despite rounding.
    #[inline(always)]
    fn columns(&self, ends: f32, dy: f32, patch: &Patch) -> [usize; 2] {
        let (middle, half) = (self.middle(dy), self.half(ends, dy) + 1.0);
        [
            patch.columns[0].max((middle - half).max(0.0) as usize),
            patch.columns[1].min((middle + half + 1.0).max(0.0) as usize),
        ]
    }
}

impl<'a> ColumnTile<'a> {
    fn new(input: &'a ColumnInput<'a>, place: TilePlace<'a, SIZE>) -> Self {
        let mut tile = Self {
            input,
            place,
            width: place.width(),
            spans: Vec::new(),
            whole: [f32::NEG_INFINITY, f32::INFINITY],
        };
        if input.view.clip_count > 0 {
            tile.spans.resize_with(PARTS * PARTS, Spans::default);
            for part in 0..PARTS * PARTS {
                let place = tile.part(part);
                tile.spans[part].fill(&place, None, None);
                let [near, far] = tile.spans[part].whole();
                tile.whole = [tile.whole[0].max(near), tile.whole[1].min(far)];
            }
        }
        tile
    }

    /// Returns a part of the tile, of the size of a picture's tile.
    fn part(&self, part: usize) -> TilePlace<'a> {
        let [x, y] = self.place.origin;
        TilePlace {
            view: self.place.view,
            origin: [x + part % PARTS * TILE_SIZE, y + part / PARTS * TILE_SIZE],
        }
    }

    /// Returns whether clip planes may cut a footprint that is not near.
    fn may_be_cut(&self, footprint: &Footprint, exact: Option<&ExactTerms>) -> bool {
        let Some(terms) = exact else {
            return true;
        };
        let (depth, reach) = (footprint.depth, depth_reach(footprint, terms));
        // Phrased so that NaN counts as cut.
        !(depth - reach >= self.whole[0] && depth + reach <= self.whole[1])
    }

    #[inline(always)]
    fn add<const FMA: bool>(
        &self,
        scratch: &mut Scratch,
        footprint: &Footprint,
        exact: Option<&ExactTerms>,
    ) -> u32 {
        let patch = self.place.patch(footprint);
        if patch.is_empty() {
            return 0;
        }
        if !self.spans.is_empty() && self.may_be_cut(footprint, exact) {
            return self.add_parts::<FMA>(scratch, footprint, exact, &patch);
        }
        if exact.is_some_and(|terms| terms.edges != 0) {
            return self.add_parts::<FMA>(scratch, footprint, exact, &patch);
        }
        match (footprint.path & 3, exact) {
            (PATH_NEAR | PATH_HALF_LINE, _) => {
                self.add_parts::<FMA>(scratch, footprint, None, &patch)
            }
            (PATH_EXACT, Some(terms)) => {
                self.add_form::<FMA, true>(scratch, footprint, terms, &patch)
            }
            _ => {
                if let Some(kernel) = Smoothed::of(self.input.view, footprint) {
                    return self.add_smoothed::<FMA>(scratch, footprint, &kernel, &patch);
                }
                let mean = PixelMean::of(self.input.view, footprint);
                if is_aligned(footprint) {
                    self.add_separable::<FMA>(scratch, footprint, mean, &patch)
                } else if let Some(mean) = mean {
                    self.add_mean::<FMA>(scratch, footprint, &mean, &patch)
                } else {
                    let none = ExactTerms::default();
                    self.add_form::<FMA, false>(scratch, footprint, &none, &patch)
                }
            }
        }
    }

    /// Adds a footprint whose axes are those of the image: exp(-(dx² + dy²)/2) is the product of a row
    /// and a column, and a pixel costs one fused multiply-add.
    #[inline(always)]
    fn add_separable<const FMA: bool>(
        &self,
        scratch: &mut Scratch,
        footprint: &Footprint,
        mean: Option<PixelMean>,
        patch: &Patch,
    ) -> u32 {
        let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
        // One of each pair is zero.
        let inverse_sigma = [px + rx, py + ry];
        let sign = footprint.carried.sign();
        let profile = |axis: usize, [first, end]: [usize; 2], peak: f32, out: &mut [f32; SIZE]| {
            let (centre, scale) = (footprint.centre_px[axis], inverse_sigma[axis]);
            for chunk in first / CHUNK..end.div_ceil(CHUNK) {
                let start = chunk * CHUNK;
                let Some(out) = out[start..].first_chunk_mut::<CHUNK>() else {
                    continue;
                };
                let base = self.place.px(axis, start);
                for (lane, out) in out.iter_mut().enumerate() {
                    let d = (base + lane as f32 - centre) * scale;
                    let q = d * d;
                    // Clamped as well: the approximation of the exponential is valid only within.
                    let value = exp_minus_half::<FMA>(q.min(footprint.cutoff_squared));
                    *out = if q <= footprint.cutoff_squared {
                        peak * value
                    } else {
                        0.0
                    };
                }
            }
        };
        let (mut row, mut column) = ([0.0; SIZE], [0.0; SIZE]);
        if let Some(mean) = mean {
            let centre = footprint.centre_px;
            let offset = |axis: usize, i: usize| self.place.px(axis, i) - centre[axis];
            let (along, bands, across, others, axis) = match mean.has_rows {
                true => (patch.rows, &mut column, patch.columns, &mut row, 1),
                false => (patch.columns, &mut row, patch.rows, &mut column, 0),
            };
            let mut last = Band::default();
            for (i, band) in (along[0]..).zip(&mut bands[along[0]..along[1]]) {
                last = mean.band::<FMA>(offset(axis, i));
                *band = sign * last.mass;
            }
            // The same in all bands, because the axes of the kernel are the image's.
            let one = Band { mass: 1.0, ..last };
            for (i, other) in (across[0]..).zip(&mut others[across[0]..across[1]]) {
                *other = one.at::<FMA>(offset(1 - axis, i));
            }
        } else {
            profile(0, patch.columns, 1.0, &mut row);
            profile(1, patch.rows, footprint.tau * sign, &mut column);
        }
        let column = &column[patch.rows[0]..patch.rows[1]];
        // A single chunk takes a second one, of zeros, along. Alone it would be compiled to gathers and
        // scatters over sixteen rows, which take three times as long.
        let end = patch.columns[1].div_ceil(CHUNK);
        let first = (patch.columns[0] / CHUNK).min(SIZE / CHUNK - 2);
        let start = patch.rows[0] * SIZE + first * CHUNK;
        let (row, fine) = (&row[first * CHUNK..], &mut scratch.sums[start..]);
        match end - first {
            1 | 2 => add_outer::<FMA, { 2 * CHUNK }>(fine, row, column),
            3 => add_outer::<FMA, { 3 * CHUNK }>(fine, row, column),
            _ => add_outer::<FMA, { 4 * CHUNK }>(fine, row, column),
        }
        let [width, height] = [patch.columns, patch.rows].map(|[first, end]| (end - first) as u32);
        width * height
    }

    /// Returns the chords of a footprint on the tile's rows.
    #[inline(always)]
    fn chords(&self, footprint: &Footprint) -> Chords {
        let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
        let a = px * px + rx * rx;
        Chords {
            a,
            tilt: -(px * py + rx * ry) / a,
            least: (px * ry - py * rx).powi(2) / a,
            centre: footprint.centre_px[0],
            origin: self.place.px(0, 0),
        }
    }

    /// Adds an affine footprint that is averaged over pixels: first its bands, then the pixels of each
    /// band within the ellipse.
    #[inline(always)]
    fn add_mean<const FMA: bool>(
        &self,
        scratch: &mut Scratch,
        footprint: &Footprint,
        mean: &PixelMean,
        patch: &Patch,
    ) -> u32 {
        // Copies, which stores to the sums cannot alias.
        let (footprint, mean) = (&{ *footprint }, &{ *mean });
        let cutoff = footprint.cutoff_squared;
        let sign = footprint.carried.sign();
        let [cx, cy] = footprint.centre_px;
        let chords = self.chords(footprint);
        // Three columns rather than a column of three, so that the loops below read them as vectors.
        let mut columns = ([0.0; SIZE], [0.0; SIZE], [0.0; SIZE]);
        if !mean.has_rows {
            for i in patch.columns[0]..patch.columns[1] {
                let band = mean.band::<FMA>(self.place.px(0, i) - cx);
                (columns.0[i], columns.1[i], columns.2[i]) = (band.mass, band.mean, band.per_sigma);
            }
        }
        let mut count = 0;
        for y in patch.rows[0]..patch.rows[1] {
            let dy = self.place.px(1, y) - cy;
            let [first, end] = chords.columns(cutoff, dy, patch);
            let form = RowForm::new(footprint, dy);
            let row = &mut scratch.sums[y * SIZE..(y + 1) * SIZE];
            let band = match mean.has_rows {
                true => mean.band::<FMA>(dy),
                false => Band::default(),
            };
            for (x, pixel) in row.iter_mut().enumerate().take(end).skip(first) {
                let dx = self.place.px(0, x) - cx;
                let value = match mean.has_rows {
                    true => band.at::<FMA>(dx),
                    false => {
                        let band = Band {
                            mass: columns.0[x],
                            mean: columns.1[x],
                            per_sigma: columns.2[x],
                        };
                        band.at::<FMA>(dy)
                    }
                };
                // NaN compares false: outside.
                let is_inside = form.q::<FMA>(dx) <= cutoff;
                *pixel += if is_inside { sign * value } else { 0.0 };
                count += u32::from(is_inside);
            }
        }
        count
    }

    /// Adds the projection of an SPH kernel, averaged over pixels.
    #[inline(always)]
    fn add_smoothed<const FMA: bool>(
        &self,
        scratch: &mut Scratch,
        footprint: &Footprint,
        kernel: &Smoothed,
        patch: &Patch,
    ) -> u32 {
        // Copies, which stores to the sums cannot alias.
        let (footprint, kernel) = (&{ *footprint }, &{ *kernel });
        let sign = footprint.carried.sign();
        let [cx, cy] = footprint.centre_px;
        if kernel.is_separable() {
            let sides = |axis: usize, pixels: [usize; 2]| {
                let middle = footprint.centre_px[axis] - self.place.px(axis, 0);
                within(pixels, middle, kernel.half_extent(axis))
            };
            let [first_x, end_x] = sides(0, patch.columns);
            let [first_y, end_y] = sides(1, patch.rows);
            if first_x >= end_x || first_y >= end_y {
                return 0;
            }
            let (dx, dy) = (
                self.place.px(0, first_x) - cx,
                self.place.px(1, first_y) - cy,
            );
            let of_columns = &mut scratch.of_columns[first_x..end_x];
            kernel.factors::<FMA>(0, dx, of_columns);
            let of_rows = &mut scratch.of_rows[first_y..end_y];
            kernel.factors::<FMA>(1, dy, of_rows);
            // As in `add_separable`.
            let end = end_x.div_ceil(CHUNK);
            let first = (first_x / CHUNK).min(SIZE / CHUNK - 2);
            let start = first * CHUNK;
            for (k, list) in scratch.lists.iter_mut().enumerate() {
                list[start..end.max(first + 2) * CHUNK].fill(0.0);
                for (place, factors) in list[first_x..end_x].iter_mut().zip(&*of_columns) {
                    *place = factors[k];
                }
            }
            let (lists, sums) = (&scratch.lists, &mut scratch.sums[first_y * SIZE + start..]);
            let product = Product {
                lists,
                of_rows,
                kernel,
                first: start,
                from: [self.place.px(0, start) - cx, dy],
                factor: sign * kernel.amplitude,
            };
            match end - first {
                1 | 2 => product.add::<FMA, { 2 * CHUNK }>(sums),
                3 => product.add::<FMA, { 3 * CHUNK }>(sums),
                _ => product.add::<FMA, { 4 * CHUNK }>(sums),
            }
            return ((end_x - first_x) * (end_y - first_y)) as u32;
        }
        let chords = self.chords(footprint);
        let mut count = 0;
        for y in patch.rows[0]..patch.rows[1] {
            let dy = self.place.px(1, y) - cy;
            let half = kernel.half_chord(dy);
            let [first, end] = within(patch.columns, chords.middle(dy), half);
            if first >= end {
                continue;
            }
            let rows = kernel.rows::<FMA>(dy);
            let row = &mut scratch.sums[y * SIZE..(y + 1) * SIZE];
            for (x, pixel) in row.iter_mut().enumerate().take(end).skip(first) {
                *pixel += sign * kernel.mean::<FMA>(self.place.px(0, x) - cx, &rows);
                count += 1;
            }
        }
        count
    }

    /// Adds any footprint: a quadratic form and an exponential per pixel, row by row between the ends of
    /// the ellipse.
    #[inline(always)]
    fn add_form<const FMA: bool, const EXACT: bool>(
        &self,
        scratch: &mut Scratch,
        footprint: &Footprint,
        terms: &ExactTerms,
        patch: &Patch,
    ) -> u32 {
        // Copies, which stores to the sums cannot alias.
        let (footprint, terms) = (&{ *footprint }, &{ *terms });
        let cutoff = footprint.cutoff_squared;
        let amplitude = footprint.tau * footprint.carried.sign();
        let [cx, cy] = footprint.centre_px;
        let chords = self.chords(footprint);
        let focal = Vec2::from(self.input.view.focal_px);
        let mut limits = [cutoff; SIZE];
        for limit in limits.iter_mut().skip(self.width) {
            *limit = -1.0;
        }
        let mut inside = [0_u32; CHUNK];
        for y in patch.rows[0]..patch.rows[1] {
            let dy = self.place.px(1, y) - cy;
            let [mut first, mut end] = patch.columns;
            if !EXACT {
                [first, end] = chords.columns(cutoff, dy, patch);
                if first >= end {
                    continue;
                }
            }
            let form = RowForm::new(footprint, dy);
            let of_exact = RowOfExact::new::<FMA>(footprint, terms, dy);
            let slope_y = ray(self.input.view, Vec2::new(0.0, self.place.px(1, y))).y;
            for chunk in first / CHUNK..end.div_ceil(CHUNK) {
                let start = chunk * CHUNK;
                let Some(out) = scratch.sums[y * SIZE + start..].first_chunk_mut::<CHUNK>() else {
                    continue;
                };
                let Some(limit) = limits[start..].first_chunk::<CHUNK>() else {
                    continue;
                };
                let base = self.place.px(0, start);
                for lane in 0..CHUNK {
                    let x = base + lane as f32;
                    let dx = x - cx;
                    let (q, mut value, mut is_inside);
                    if EXACT {
                        let ExactAt {
                            q: of_ray,
                            inverse,
                            is_ahead,
                        } = of_exact.at::<FMA>(dx);
                        q = of_ray;
                        let slope_x = (x - self.input.view.centre_px[0]) / focal.x;
                        let ray = madd::<FMA>(slope_x, slope_x, madd::<FMA>(slope_y, slope_y, 1.0));
                        value = amplitude * (ray * inverse).sqrt();
                        is_inside = is_ahead;
                    } else {
                        q = form.q::<FMA>(dx);
                        value = amplitude;
                        is_inside = true;
                    }
                    // NaN compares false, here and above: outside.
                    is_inside &= q <= limit[lane];
                    value *= exp_minus_half::<FMA>(q.min(cutoff));
                    out[lane] += if is_inside { value } else { 0.0 };
                    inside[lane] += u32::from(is_inside);
                }
            }
        }
        inside.iter().sum()
    }

    /// Adds any footprint by the rows of the tile's parts: those that clip planes may cut, and near
    /// kernels.
    #[inline(always)]
    fn add_parts<const FMA: bool>(
        &self,
        scratch: &mut Scratch,
        footprint: &Footprint,
        exact: Option<&ExactTerms>,
        patch: &Patch,
    ) -> u32 {
        let parts = |[first, end]: [usize; 2]| first / TILE_SIZE..end.div_ceil(TILE_SIZE);
        let is_exact = footprint.path == PATH_EXACT;
        let sign = footprint.carried.sign();
        let (kernel, mean) = match footprint.path {
            PATH_AFFINE => (
                Smoothed::of(self.input.view, footprint),
                PixelMean::of(self.input.view, footprint),
            ),
            _ => (None, None),
        };
        let mut count = 0;
        for part_y in parts(patch.rows) {
            for part_x in parts(patch.columns) {
                let part = part_y * PARTS + part_x;
                let place = self.part(part);
                let evaluate = Evaluate::new(&place, footprint, exact, self.input.near);
                let spans = self.spans.get(part);
                let side = spans.map_or(Side::Front, |spans| spans.side(&evaluate, false));
                let cut = match side {
                    Side::Front => None,
                    Side::Cut(meets) => spans.map(|spans| Cut { spans, meets }),
                    Side::Hidden | Side::Behind => continue,
                };
                for y in evaluate.rows() {
                    let mut ray_length = [1.0; TILE_SIZE];
                    if is_exact {
                        for (x, length) in ray_length.iter_mut().enumerate() {
                            *length = ray(place.view, place.centre(x, y)).length();
                        }
                    }
                    let mut row = evaluate.row::<FMA>(y, &ray_length);
                    count += row.count;
                    if row.count == 0 {
                        continue;
                    }
                    let from =
                        |axis: usize, i: usize| place.px(axis, i) - footprint.centre_px[axis];
                    let rows = kernel.map(|kernel| kernel.rows::<FMA>(from(1, y)));
                    for (x, tau) in row.tau.iter_mut().enumerate() {
                        let d = [from(0, x), from(1, y)];
                        if row.inside[x] == 0 {
                            continue;
                        }
                        if let (Some(kernel), Some(rows)) = (&kernel, &rows) {
                            *tau = kernel.mean::<FMA>(d[0], rows);
                        } else if let Some(mean) = &mean {
                            *tau = mean.at::<FMA>(d);
                        }
                    }
                    row.domain = domain_of::<FMA>(&evaluate, &row);
                    let mut taus = whole(&row);
                    if let Some(Cut { spans, meets }) = cut {
                        let near = shares_at::<FMA>(&evaluate, &row, &spans.near, meets.near, 0.0);
                        let far = shares_at::<FMA>(&evaluate, &row, &spans.far, meets.far, 1.0);
                        taus = between(&row, &near, &far);
                    }
                    let first = (part_y * TILE_SIZE + y) * SIZE + part_x * TILE_SIZE;
                    for (sum, tau) in scratch.sums[first..].iter_mut().zip(taus) {
                        *sum += tau * sign;
                    }
                }
            }
        }
        count
    }
}

/// Returns the first of some pixels whose centre lies within `half` of `middle`, and the one behind the last \[px\].
#[inline(always)]
fn within([first, end]: [usize; 2], middle: f32, half: f32) -> [usize; 2] {
    [
        first.max((middle - half + 1.0).max(0.0) as usize),
        end.min((middle + half).ceil().max(0.0) as usize),
    ]
}

/// Adds column x row to consecutive rows of `WIDTH` pixels.
///
/// A row that is too short ends the loop; none is. Without this exit the compiler takes eight rows at
/// once even for two chunks, by gathers and scatters.
#[inline(always)]
fn add_outer<const FMA: bool, const WIDTH: usize>(fine: &mut [f32], row: &[f32], column: &[f32]) {
    let Some(&row) = row.first_chunk::<WIDTH>() else {
        return;
    };
    for (fine, &weight) in fine.chunks_mut(SIZE).zip(column) {
        let Some(fine) = fine.first_chunk_mut::<WIDTH>() else {
            return;
        };
        for (sum, &value) in fine.iter_mut().zip(&row) {
            *sum = madd::<FMA>(weight, value, *sum);
        }
    }
}

/// A kernel as a sum of products of columns and rows.
struct Product<'a> {
    /// Factors of columns, one list for each product.
    lists: &'a [[f32; SIZE]; RANK],
    of_rows: &'a [[f32; RANK]],
    kernel: &'a Smoothed,
    /// First column.
    first: usize,
    /// From the kernel's centre to that of the first pixel, px.
    from: [f32; 2],
    /// Factor of the sums of products.
    factor: f32,
}

impl Product<'_> {
    /// Adds it to consecutive rows of `WIDTH` pixels.
    #[inline(always)]
    fn add<const FMA: bool, const WIDTH: usize>(&self, sums: &mut [f32]) {
        let mut columns = [[0.0; WIDTH]; RANK];
        for (own, list) in columns.iter_mut().zip(self.lists) {
            let Some(list) = list[self.first..].first_chunk::<WIDTH>() else {
                return;
            };
            *own = *list;
        }
        let mut away = [0.0; WIDTH];
        for (lane, away) in away.iter_mut().enumerate() {
            *away = (self.from[0] + lane as f32).abs();
        }
        let (kernel, factor) = (&{ *self.kernel }, self.factor);
        let mut dy = self.from[1];
        for (sums, of_y) in sums.chunks_mut(SIZE).zip(self.of_rows) {
            let Some(sums) = sums.first_chunk_mut::<WIDTH>() else {
                return;
            };
            let half_chord = kernel.half_chord(dy);
            dy += 1.0;
            let weights = kernel.weights(of_y);
            let mut means = [0.0; WIDTH];
            for k in 0..RANK {
                for lane in 0..WIDTH {
                    means[lane] = madd::<FMA>(weights[k], columns[k][lane], means[lane]);
                }
            }
            for lane in 0..WIDTH {
                // Sums of products fall below 0 near the rim, by less than their error.
                let mean = factor * means[lane].max(0.0);
                sums[lane] += if away[lane] < half_chord { mean } else { 0.0 };
            }
        }
    }
}
