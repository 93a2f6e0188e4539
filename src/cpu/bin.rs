//! Stage: lists the footprints that touch each tile, in depth order.

use std::ops::Range;

use glam::Vec2;
use rayon::prelude::*;

use super::sort::footprint_index;
use super::tile::prefetch;
use crate::constants::TILE_SIZE;
use crate::record::{Footprint, FootprintTerms, PATH_EXACT, PATH_NEAR, PATH_SURFEL};
use crate::splat::{KernelOutline, Outline, PlaneOutline};

/// Footprints between the prefetch of one and its use.
const PREFETCH: usize = 8;

/// Lists of footprints per tile. Each chunk of the sorted footprints has its own lists. A tile's list is
/// the concatenation of the chunks' lists, so chunks are independent.
#[derive(Debug, Default)]
pub struct Bins {
    chunks: Vec<ChunkBins>,
    /// The tiles that have lists.
    tiles: Range<usize>,
    /// Whether footprints are listed, for each tile of the picture; `None` lists all.
    drawn: Option<Vec<bool>>,
}

#[derive(Debug, Default)]
struct ChunkBins {
    /// Start of each tile's list, and one past the last.
    starts: Vec<u32>,
    /// Footprint indices, tile by tile.
    list: Vec<u32>,
    /// Pairs (tile, footprint) in the order in which they were found.
    found: Vec<[u32; 2]>,
}

impl Bins {
    /// Restricts the lists that are made from now on to some tiles of the picture; those of others are empty.
    ///
    /// - `drawn`: whether footprints are listed, for each tile; `None` for all.
    pub(crate) fn restrict(&mut self, drawn: Option<&[bool]>) {
        self.drawn = drawn.map(<[bool]>::to_vec);
    }

    /// Returns the tiles that have lists: a range of the picture's tiles.
    pub fn tiles(&self) -> Range<usize> {
        self.tiles.clone()
    }

    /// Returns the footprints of one of these tiles, front to back.
    pub fn tile(&self, tile: usize) -> impl Iterator<Item = u32> + '_ {
        let tile = tile - self.tiles.start;
        self.chunks.iter().flat_map(move |c| {
            c.list[c.starts[tile] as usize..c.starts[tile + 1] as usize]
                .iter()
                .copied()
        })
    }

    /// Returns the number of footprints of a tile.
    pub fn tile_len(&self, tile: usize) -> usize {
        let tile = tile - self.tiles.start;
        let of = |c: &ChunkBins| (c.starts[tile + 1] - c.starts[tile]) as usize;
        self.chunks.iter().map(of).sum()
    }

    /// Returns the number of entries of all lists.
    pub fn len(&self) -> usize {
        self.chunks.iter().map(|c| c.list.len()).sum()
    }

    /// Returns whether all lists are empty.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Bins sorted footprints into tiles of [`TILE_SIZE`]².
///
/// - `columns`: tiles in a row of the picture.
/// - `tiles`: the tiles that get lists.
pub fn bin(
    footprints: &[Footprint],
    terms: FootprintTerms<'_>,
    order: &[u64],
    columns: usize,
    tiles: Range<usize>,
    bins: &mut Bins,
) {
    bin_into::<TILE_SIZE>(footprints, terms, order, columns, tiles, bins);
}

/// As [`bin`], into tiles of any size.
pub(super) fn bin_into<const SIZE: usize>(
    footprints: &[Footprint],
    terms: FootprintTerms<'_>,
    order: &[u64],
    columns: usize,
    tiles: Range<usize>,
    bins: &mut Bins,
) {
    bins.tiles = tiles.clone();
    let drawn = bins.drawn.as_deref();
    let rows = tiles.start / columns..tiles.end.div_ceil(columns);
    // Enough chunks to balance the load of the threads; each costs a word per tile.
    let chunk_count = (4 * rayon::current_num_threads())
        .min(order.len().div_ceil(1024))
        .max(1);
    let chunk_len = order.len().div_ceil(chunk_count).max(1);
    bins.chunks.resize_with(chunk_count, ChunkBins::default);
    bins.chunks
        .par_iter_mut()
        .enumerate()
        .for_each(|(c, bins)| {
            let first = (c * chunk_len).min(order.len());
            let chunk = &order[first..(first + chunk_len).min(order.len())];
            // Find, count, scan, place. Each footprint is visited once: after the sort they are scattered
            // in memory, and reading them dominates the cost.
            let ChunkBins {
                starts,
                list,
                found,
            } = bins;
            found.clear();
            for (n, &word) in chunk.iter().enumerate() {
                let ahead = chunk.get(n + PREFETCH).map(|&word| footprint_index(word));
                prefetch(ahead.and_then(|i| footprints.get(i)));
                let i = word as u32;
                for_each_tile_of::<SIZE>(
                    &footprints[i as usize],
                    terms,
                    i as usize,
                    columns,
                    &rows,
                    |t| {
                        // The range may contain only a part of the first and the last row.
                        if tiles.contains(&t) && drawn.is_none_or(|drawn| drawn[t]) {
                            found.push([(t - tiles.start) as u32, i]);
                        }
                    },
                );
            }
            starts.clear();
            starts.resize(tiles.len() + 1, 0);
            for &[t, _] in found.iter() {
                starts[t as usize + 1] += 1;
            }
            for t in 1..starts.len() {
                starts[t] += starts[t - 1];
            }
            list.clear();
            list.resize(found.len(), 0);
            for &[t, i] in found.iter() {
                let place = &mut starts[t as usize];
                list[*place as usize] = i;
                *place += 1;
            }
            // Placing advanced every start to its successor's position.
            starts.rotate_right(1);
            starts[0] = 0;
        });
}

/// Calls `emit` with the index of every tile that contains a pixel centre within the footprint's cut-off.
/// The test of its outline against rectangles is exact.
///
/// - `terms`, `index`: terms of a frame's footprints, and the footprint's index among them.
#[inline]
pub fn for_each_tile(
    footprint: &Footprint,
    terms: FootprintTerms<'_>,
    index: usize,
    tile_columns: usize,
    emit: impl FnMut(usize),
) {
    let all = 0..usize::MAX;
    for_each_tile_of::<TILE_SIZE>(footprint, terms, index, tile_columns, &all, emit);
}

/// As [`for_each_tile`], for tiles of any size in `rows`.
#[inline]
fn for_each_tile_of<const SIZE: usize>(
    footprint: &Footprint,
    terms: FootprintTerms<'_>,
    index: usize,
    tile_columns: usize,
    rows: &Range<usize>,
    emit: impl FnMut(usize),
) {
    let (x0, x1) = footprint.column_range();
    let (y0, y1) = footprint.row_range();
    // An invisible footprint has no pixels.
    if x1 <= x0 || y1 <= y0 {
        return;
    }
    let size = SIZE as u32;
    let (tx0, tx1) = (x0 / size, (x1 - 1) / size);
    let (ty0, ty1) = (y0 / size, (y1 - 1) / size);
    // All tiles of a box of one row or column are touched, almost without exception.
    let test = (tx1 > tx0 && ty1 > ty0) && footprint.path & 3 != PATH_NEAR;
    let (first, last) = (ty0.max(rows.start as u32), ty1.min((rows.end - 1) as u32));
    let walk = TileWalk {
        footprint,
        columns: [tx0, tx1],
        rows: [first, last],
        tile_columns,
    };
    if !test {
        return walk.each::<SIZE>(|_, _| true, emit);
    }
    // One loop for each kind of outline, so that the kind is not tested at every tile.
    match bent_outline(footprint, terms, index) {
        None => {
            let (p, r) = (footprint.form_p.into(), footprint.form_r.into());
            let ellipse = KernelOutline::affine(p, r, footprint.cutoff_squared);
            walk.each::<SIZE>(|a, b| ellipse.touches(a, b), emit);
        }
        Some(Outline::Kernel(outline)) => walk.each::<SIZE>(|a, b| outline.touches(a, b), emit),
        Some(Outline::Plane(outline)) => walk.each::<SIZE>(|a, b| outline.touches(a, b), emit),
    }
}

/// The tiles of a footprint's box: first and last columns and rows of tiles.
struct TileWalk<'a> {
    footprint: &'a Footprint,
    columns: [u32; 2],
    rows: [u32; 2],
    tile_columns: usize,
}

impl TileWalk<'_> {
    /// Calls `emit` for each tile whose rectangle of pixel centres touches the footprint's outline. The
    /// rectangle is relative to the footprint's centre.
    #[inline(always)]
    fn each<const SIZE: usize>(
        self,
        touches: impl Fn(Vec2, Vec2) -> bool,
        mut emit: impl FnMut(usize),
    ) {
        let size = SIZE as u32;
        let centre = Vec2::from(self.footprint.centre_px);
        let (x0, x1) = self.footprint.column_range();
        let (y0, y1) = self.footprint.row_range();
        for ty in self.rows[0]..=self.rows[1] {
            for tx in self.columns[0]..=self.columns[1] {
                // The pixel centres of the tile within the box.
                let lower = Vec2::new((tx * size).max(x0) as f32, (ty * size).max(y0) as f32);
                let upper = Vec2::new(
                    ((tx + 1) * size).min(x1) as f32,
                    ((ty + 1) * size).min(y1) as f32,
                );
                if touches(lower + 0.5 - centre, upper - 0.5 - centre) {
                    emit(ty as usize * self.tile_columns + tx as usize);
                }
            }
        }
    }
}

/// Returns the outline of a footprint's cut-off, if it is not an ellipse.
fn bent_outline(footprint: &Footprint, terms: FootprintTerms<'_>, index: usize) -> Option<Outline> {
    let (p, r) = (footprint.form_p.into(), footprint.form_r.into());
    let cutoff_squared = footprint.cutoff_squared;
    match (footprint.path, terms) {
        (PATH_SURFEL, FootprintTerms::Surfel(terms)) => {
            let terms = terms.get(index).filter(|terms| terms.homography > 0.0)?;
            let gradient = Vec2::from(terms.gradient) / terms.inverse_depth;
            let outline = PlaneOutline::new(p, r, cutoff_squared, gradient);
            Some(Outline::Plane(outline))
        }
        (path, FootprintTerms::Exact(terms)) if path & 3 == PATH_EXACT => {
            let terms = terms.get(index)?;
            let gradient = terms.gradient.into();
            let outline = KernelOutline::exact(p, r, cutoff_squared, gradient, terms.hessian);
            Some(Outline::Kernel(outline))
        }
        _ => None,
    }
}
