//! Stage: which footprints touch which tiles, in depth order.

use glam::Vec2;
use rayon::prelude::*;

use super::lanes::prefetch;
use super::sort::footprint_index;
use crate::constants::TILE_SIZE;
use crate::layout::{ExactTerms, Footprint, PATH_EXACT, PATH_NEAR};

/// Footprints between asking for one and reading it.
const PREFETCH: usize = 8;

/// Lists of footprints per tile. Each chunk of the sorted footprints keeps its own lists; a
/// tile's list is the chunks' lists one after the other, so that chunks need not know each other.
#[derive(Debug, Default)]
pub struct Bins {
    chunks: Vec<ChunkBins>,
}

#[derive(Debug, Default)]
struct ChunkBins {
    /// Where each tile's list begins, and one past the last.
    starts: Vec<u32>,
    /// Footprint indices, tile by tile.
    list: Vec<u32>,
    /// (tile, footprint) as found.
    found: Vec<[u32; 2]>,
}

impl Bins {
    /// The footprints of a tile, front to back.
    pub fn tile(&self, tile: usize) -> impl Iterator<Item = u32> + '_ {
        self.chunks.iter().flat_map(move |c| {
            c.list[c.starts[tile] as usize..c.starts[tile + 1] as usize]
                .iter()
                .copied()
        })
    }

    /// How many footprints a tile has.
    pub fn tile_len(&self, tile: usize) -> usize {
        let of = |c: &ChunkBins| (c.starts[tile + 1] - c.starts[tile]) as usize;
        self.chunks.iter().map(of).sum()
    }

    /// Entries of all lists.
    pub fn len(&self) -> usize {
        self.chunks.iter().map(|c| c.list.len()).sum()
    }

    /// Whether all lists are empty.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Bins sorted footprints into tiles of [`TILE_SIZE`]², `tiles` \[columns, rows\] of them.
pub fn bin(
    footprints: &[Footprint],
    exact: &[ExactTerms],
    order: &[u64],
    tiles: [usize; 2],
    bins: &mut Bins,
) {
    bin_into::<TILE_SIZE>(footprints, exact, order, tiles, bins);
}

/// [`bin`] into tiles of any size.
pub(super) fn bin_into<const SIZE: usize>(
    footprints: &[Footprint],
    exact: &[ExactTerms],
    order: &[u64],
    tiles: [usize; 2],
    bins: &mut Bins,
) {
    // Enough chunks for the threads to share evenly; each costs a word per tile.
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
            // Find, count, scan, place. Each footprint is visited once: after the sort they lie
            // scattered in memory, and reading them is the cost.
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
                    exact.get(i as usize),
                    tiles[0],
                    |t| {
                        found.push([t as u32, i]);
                    },
                );
            }
            starts.clear();
            starts.resize(tiles[0] * tiles[1] + 1, 0);
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
            // Placing moved every start to its successor's place.
            starts.rotate_right(1);
            starts[0] = 0;
        });
}

/// Calls `emit` with the index of every tile that holds a pixel centre within the footprint's
/// cut-off, by the exact test of ellipse against rectangle.
#[inline]
pub fn for_each_tile(
    footprint: &Footprint,
    exact: Option<&ExactTerms>,
    tile_columns: usize,
    emit: impl FnMut(usize),
) {
    for_each_tile_of::<TILE_SIZE>(footprint, exact, tile_columns, emit);
}

/// [`for_each_tile`] of any size.
#[inline]
fn for_each_tile_of<const SIZE: usize>(
    footprint: &Footprint,
    exact: Option<&ExactTerms>,
    tile_columns: usize,
    mut emit: impl FnMut(usize),
) {
    let (x0, x1) = footprint.column_range();
    let (y0, y1) = footprint.row_range();
    let size = SIZE as u32;
    let (tx0, tx1) = (x0 / size, (x1 - 1) / size);
    let (ty0, ty1) = (y0 / size, (y1 - 1) / size);
    // A box of one row or column of tiles is (nearly) all touched.
    let test = (tx1 > tx0 && ty1 > ty0) && footprint.path & 3 != PATH_NEAR;
    let conic = test.then(|| Conic::new(footprint, exact));
    for ty in ty0..=ty1 {
        for tx in tx0..=tx1 {
            let touched = conic.as_ref().is_none_or(|conic| {
                // The pixel centres of the tile that lie in the box.
                let lower = Vec2::new((tx * size).max(x0) as f32, (ty * size).max(y0) as f32);
                let upper = Vec2::new(
                    ((tx + 1) * size).min(x1) as f32,
                    ((ty + 1) * size).min(y1) as f32,
                );
                conic.touches(lower + 0.5, upper - 0.5)
            });
            if touched {
                emit(ty as usize * tile_columns + tx as usize);
            }
        }
    }
}

/// The cut-off's outline: Q(d) - r² w(d) = 0, a convex quadratic of the pixel offset.
struct Conic {
    centre_px: Vec2,
    p: Vec2,
    r: Vec2,
    /// r² times the gradient and Hessian of w; zero on affine paths.
    gradient: Vec2,
    hessian: [f32; 3],
    cutoff_squared: f32,
    /// Where the quadratic is least, relative to the centre.
    middle: Vec2,
}

impl Conic {
    fn new(footprint: &Footprint, exact: Option<&ExactTerms>) -> Self {
        let r2 = footprint.cutoff_squared;
        let mut conic = Self {
            centre_px: footprint.centre_px.into(),
            p: footprint.form_p.into(),
            r: footprint.form_r.into(),
            gradient: Vec2::ZERO,
            hessian: [0.0; 3],
            cutoff_squared: r2,
            middle: Vec2::ZERO,
        };
        if let (PATH_EXACT, Some(terms)) = (footprint.path & 3, exact) {
            conic.gradient = Vec2::from(terms.gradient) * r2;
            conic.hessian = terms.hessian.map(|h| h * r2);
            let (a, b, c) = conic.second();
            let determinant = a * c - b * b;
            if determinant > 0.0 {
                let g = conic.gradient * 0.5;
                conic.middle = Vec2::new(c * g.x - b * g.y, a * g.y - b * g.x) / determinant;
            }
        }
        conic
    }

    /// Coefficients of dx², 2 dx dy and dy².
    fn second(&self) -> (f32, f32, f32) {
        let [hxx, hxy, hyy] = self.hessian;
        (
            self.p.x * self.p.x + self.r.x * self.r.x - hxx,
            self.p.x * self.p.y + self.r.x * self.r.y - 0.5 * hxy,
            self.p.y * self.p.y + self.r.y * self.r.y - hyy,
        )
    }

    fn value(&self, d: Vec2) -> f32 {
        let [hxx, hxy, hyy] = self.hessian;
        let q = self.p.dot(d).powi(2) + self.r.dot(d).powi(2);
        let w = self.gradient.dot(d) + hxx * d.x * d.x + hxy * d.x * d.y + hyy * d.y * d.y;
        q - w - self.cutoff_squared
    }

    /// Whether the rectangle between two points (pixels) meets the inside. The least value in a
    /// rectangle that does not hold the middle lies on an edge that faces it.
    fn touches(&self, lower: Vec2, upper: Vec2) -> bool {
        let (lower, upper) = (lower - self.centre_px, upper - self.centre_px);
        let nearest = self.middle.clamp(lower, upper);
        if nearest == self.middle {
            return true;
        }
        let (a, b, c) = self.second();
        // A hair of slack: the value of a needle's edge is a difference of large numbers.
        let inside = |d: Vec2| !(self.value(d) > self.cutoff_squared * 1e-4);
        let on_column = |x: f32| {
            let y = (0.5 * self.gradient.y - b * x) / c;
            inside(Vec2::new(x, y.max(lower.y).min(upper.y)))
        };
        let on_row = |y: f32| {
            let x = (0.5 * self.gradient.x - b * y) / a;
            inside(Vec2::new(x.max(lower.x).min(upper.x), y))
        };
        (nearest.x != self.middle.x && on_column(nearest.x))
            || (nearest.y != self.middle.y && on_row(nearest.y))
    }
}
