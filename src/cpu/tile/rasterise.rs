//! Stage: draws lists of footprints into tiles of pixels, front to back.
//!
//! Twin: `shaders/rasterise.wgsl`.

use rayon::prelude::*;

use super::accumulate::layers::LayeredTile;
use super::accumulate::over::OverTile;
use super::accumulate::ring::Ring;
use super::classify::slab::PostClassification;
use super::interval::cut::{CutTile, Spans};
use super::pixels::{PREFETCH, Plane, Tile, TilePlace, prefetch, ray};
use super::settings::RasteriseSettings;
use crate::constants::{TERMINATION_INTERVAL, TERMINATION_SHARE, TILE_PIXELS, TILE_SIZE};
use crate::cpu::bin::Bins;
use crate::record::{ExactTerms, Footprint, NearTerms, ViewUniform};
use crate::splat::Accumulate;
use crate::task::Stage;

/// Draws all tiles that have lists. Returns the number of splat-pixels: kernels evaluated at pixel
/// centres within their cut-off.
///
/// - `columns`: tiles in a row of the picture.
/// - `surface`: opaque surfaces among the kernels, as drawn by
///   [`rasterise_surface`](super::accumulate::opaque::rasterise_surface); empty if there are none.
/// - `post`: data to classify layers, if particles carry values.
#[allow(
    clippy::too_many_arguments,
    reason = "a stage takes the slices it reads and writes"
)]
pub fn rasterise(
    view: &ViewUniform,
    settings: RasteriseSettings<'_>,
    footprints: &[Footprint],
    exact: &[ExactTerms],
    near: &[NearTerms],
    bins: &Bins,
    columns: usize,
    surface: &[Tile],
    post: Option<PostClassification<'_>>,
    tiles: &mut [Tile],
) -> u64 {
    let RasteriseSettings {
        axes,
        level,
        ends,
        task,
    } = settings;
    let listed = bins.tiles();
    let stage = Stage::new(task, "drawing", listed.len());
    tiles[listed.clone()]
        .par_iter_mut()
        .zip(listed)
        .map_init(TileMemory::default, |memory, (tile, t)| {
            if !stage.goes_on() {
                return 0;
            }
            let TileMemory {
                list,
                rays,
                behind,
                spans,
                ring,
            } = memory;
            list.clear();
            list.extend(bins.tile(t));
            let place = TilePlace::new(view, t, columns);
            tile.clear(axes.depth);
            if axes.may_be_exact {
                for (i, length) in rays.iter_mut().enumerate() {
                    *length = ray(view, place.pixel(i)).length();
                }
            }
            let rays = &*rays;
            let cut = CutTile::new(&place, axes.depth, surface.get(t), ends, behind, spans);
            let mut drawing = if axes.accumulate == Accumulate::Over {
                Drawing::Over(OverTile {
                    place,
                    axes,
                    level,
                    rays,
                    cut,
                })
            } else {
                ring.clear();
                Drawing::Layers(LayeredTile {
                    place,
                    axes,
                    level,
                    rays,
                    post,
                    ring,
                    cut,
                })
            };
            let transparent = view.tolerance * TERMINATION_SHARE;
            let mut splat_pixels = 0_u64;
            for (n, &i) in list.iter().enumerate() {
                let ahead = list.get(n + PREFETCH).map(|&i| i as usize);
                prefetch(ahead.and_then(|i| footprints.get(i)));
                prefetch(ahead.and_then(|i| exact.get(i)));
                if n > 0
                    && n % TERMINATION_INTERVAL == 0
                    && least_alpha(&place, tile) >= 1.0 - transparent
                {
                    break;
                }
                let i = i as usize;
                let (footprint, terms) = (&footprints[i], exact.get(i));
                let inside = match &mut drawing {
                    Drawing::Over(over) => over.add(tile, footprint, terms, near),
                    Drawing::Layers(layers) => layers.add(tile, footprint, terms, near),
                };
                splat_pixels += u64::from(inside);
            }
            match drawing {
                Drawing::Over(over) => over.finish(tile),
                Drawing::Layers(layers) => layers.finish(tile),
            }
            stage.advance(1);
            splat_pixels
        })
        .sum()
}

/// Memory that a thread reuses from tile to tile.
#[derive(Debug)]
struct TileMemory {
    list: Vec<u32>,
    /// |D| of each pixel's ray D = (X, Y, 1), if any footprint is on the exact path.
    rays: Plane,
    behind: Tile,
    spans: Spans,
    ring: Ring,
}

impl Default for TileMemory {
    fn default() -> Self {
        Self {
            list: Vec::new(),
            rays: [1.0; TILE_PIXELS],
            behind: Tile::default(),
            spans: Spans::default(),
            ring: Ring::default(),
        }
    }
}

/// Ways to combine a tile's footprints.
enum Drawing<'a, 'b> {
    /// One by one.
    Over(OverTile<'a, 'b>),
    /// In sheets or slabs.
    Layers(LayeredTile<'a, 'b>),
}

/// Returns the least opacity of the tile's pixels in the image.
fn least_alpha(place: &TilePlace<'_>, tile: &Tile) -> f32 {
    let mut least = [f32::INFINITY; TILE_SIZE];
    for row in tile.alpha.chunks_exact(TILE_SIZE).take(place.height()) {
        for (least, alpha) in least.iter_mut().zip(row) {
            *least = if *alpha < *least { *alpha } else { *least };
        }
    }
    let of_image = &least[..place.width()];
    of_image.iter().copied().fold(f32::INFINITY, f32::min)
}
