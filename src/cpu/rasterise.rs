//! Stage: from lists of footprints to tiles of pixels, front to back.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::bin::Bins;
use super::cut::{CutTile, Spans};
use super::lanes::{Mode, Patch, SimdLevel, Tile, prefetch, splat};
use super::layers::{LayeredTile, Ring};
use super::post::PostClassification;
use crate::constants::{TERMINATION_INTERVAL, TERMINATION_SHARE, TILE_SIZE};
use crate::layout::{
    ExactTerms, Footprint, NearTerms, PATH_EXACT, PATH_HALF_LINE, PATH_NEAR, PATH_PEAK, ViewUniform,
};
use crate::math::normal_cdf;
use crate::splat::{Composite, evaluate_near};

/// What specialises the rasteriser.
#[derive(Debug, Clone, Copy)]
pub struct RasteriseSettings {
    /// Opacity min(tau, 1) instead of 1 - exp(-tau), for all footprints; splats have it anyway.
    pub linear_opacity: bool,
    /// Whether depths are wanted.
    pub depth: bool,
    /// Whether pixels count the kernels that they evaluate within their cut-off, in all three
    /// colours, instead of showing them.
    pub count: bool,
    /// Whether any footprint is on the exact path and needs the rays' lengths.
    pub exact: bool,
    /// How footprints become a picture.
    pub composite: Composite,
    /// The instruction set of the inner loop.
    pub level: SimdLevel,
}

/// Footprints between asking for one and reading it.
pub(super) const PREFETCH: usize = 4;

/// Draws all tiles, `columns` of them in a row. Returns the number of splat-pixels: kernels
/// evaluated at pixel centres within their cut-off.
///
/// - `surface`: opaque surfaces among the kernels, as
///   [`rasterise_surface`](super::rasterise_surface) leaves them; empty where there are none.
/// - `post`: what classifies layers, where particles carry values.
#[allow(
    clippy::too_many_arguments,
    reason = "a stage takes the slices it reads and writes"
)]
pub fn rasterise(
    view: &ViewUniform,
    settings: RasteriseSettings,
    footprints: &[Footprint],
    exact: &[ExactTerms],
    near: &[NearTerms],
    bins: &Bins,
    columns: usize,
    surface: &[Tile],
    post: Option<PostClassification<'_>>,
    tiles: &mut [Tile],
) -> u64 {
    // The inner loop trusts its level: no caller may ask for more than the processor has.
    let settings = RasteriseSettings {
        level: settings.level.min(SimdLevel::best()),
        ..settings
    };
    tiles
        .par_iter_mut()
        .enumerate()
        .map_init(TileMemory::default, |memory, (t, tile)| {
            let TileMemory {
                list,
                behind,
                spans,
                ring,
            } = memory;
            list.clear();
            list.extend(bins.tile(t));
            let origin = [t % columns * TILE_SIZE, t / columns * TILE_SIZE];
            let raster = TileRaster {
                view,
                settings,
                origin,
            };
            raster.clear(tile);
            let cut = CutTile::new(&raster, surface.get(t), behind, spans);
            let mut drawing = if settings.composite == Composite::Over {
                Drawing::Over(cut)
            } else {
                ring.clear();
                Drawing::Layers(LayeredTile {
                    raster: &raster,
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
                if n > 0
                    && n % TERMINATION_INTERVAL == 0
                    && raster.least_alpha(tile) >= 1.0 - transparent
                {
                    break;
                }
                let i = i as usize;
                let (footprint, terms) = (&footprints[i], exact.get(i));
                let inside = match &mut drawing {
                    Drawing::Over(None) => raster.add(tile, footprint, terms, near),
                    Drawing::Over(Some(cut)) => cut.add(&raster, tile, footprint, terms, near),
                    Drawing::Layers(layers) => layers.add(tile, footprint, terms, near),
                };
                splat_pixels += u64::from(inside);
            }
            match drawing {
                Drawing::Over(None) => {}
                Drawing::Over(Some(cut)) => cut.compose(&raster, tile),
                Drawing::Layers(layers) => layers.finish(tile),
            }
            splat_pixels
        })
        .sum()
}

/// What a thread keeps from tile to tile.
#[derive(Debug, Default)]
struct TileMemory {
    list: Vec<u32>,
    behind: Tile,
    spans: Spans,
    ring: Ring,
}

/// How a tile's footprints come together.
enum Drawing<'a, 'b> {
    /// One by one, maybe cut.
    Over(Option<CutTile<'b>>),
    /// In sheets or slabs.
    Layers(LayeredTile<'a, 'b>),
}

/// The ray D = (X, Y, 1) through a point of the image.
pub(super) fn ray(view: &ViewUniform, pixel: Vec2) -> Vec3 {
    ((pixel - Vec2::from(view.centre_px)) / Vec2::from(view.focal_px)).extend(1.0)
}

/// Optical depth of a footprint on the near or the half-line path at a point of the image.
pub(super) fn near_depth(
    view: &ViewUniform,
    footprint: &Footprint,
    terms: &NearTerms,
    pixel: Vec2,
) -> f32 {
    if footprint.path & 3 == PATH_NEAR {
        let direction = ray(view, pixel);
        return evaluate_near(terms, footprint.tau, direction, footprint.cutoff_squared);
    }
    let d = pixel - Vec2::from(footprint.centre_px);
    let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
    let q = (px * d.x + py * d.y).powi(2) + (rx * d.x + ry * d.y).powi(2);
    if !(q <= footprint.cutoff_squared) {
        return 0.0;
    }
    let [gx, gy, z] = terms.half_line;
    let z = z + gx * d.x + gy * d.y;
    let in_front = normal_cdf(z / terms.sigma.max(f32::MIN_POSITIVE));
    footprint.tau * (-0.5 * q).exp() * in_front
}

/// Where a tile lies, and how it is drawn.
pub(super) struct TileRaster<'a> {
    pub(super) view: &'a ViewUniform,
    pub(super) settings: RasteriseSettings,
    /// The tile's first pixel.
    origin: [usize; 2],
}

impl TileRaster<'_> {
    pub(super) fn clear(&self, tile: &mut Tile) {
        tile.alpha.fill(0.0);
        tile.red.fill(0.0);
        tile.green.fill(0.0);
        tile.blue.fill(0.0);
        if self.settings.depth {
            tile.depth.fill(f32::INFINITY);
        }
        if self.settings.exact {
            for (i, length) in tile.ray_length.iter_mut().enumerate() {
                *length = ray(self.view, self.pixel(i)).length();
            }
        }
    }

    /// The centre of a pixel of the tile.
    pub(super) fn pixel(&self, i: usize) -> Vec2 {
        let [x, y] = [i % TILE_SIZE, i / TILE_SIZE];
        [x + self.origin[0], y + self.origin[1]]
            .map(|px| px as f32 + 0.5)
            .into()
    }

    /// Columns of the tile that lie in the image.
    fn width(&self) -> usize {
        (self.view.size[0] as usize - self.origin[0]).min(TILE_SIZE)
    }

    /// The tile's pixels that lie in the image.
    pub(super) fn pixels(&self) -> impl Iterator<Item = usize> + use<> {
        let width = self.width();
        let height = (self.view.size[1] as usize - self.origin[1]).min(TILE_SIZE);
        (0..height).flat_map(move |y| y * TILE_SIZE..y * TILE_SIZE + width)
    }

    fn least_alpha(&self, tile: &Tile) -> f32 {
        // Only pixels of the image count.
        let width = self.width();
        let height = (self.view.size[1] as usize - self.origin[1]).min(TILE_SIZE);
        let mut least = [f32::INFINITY; TILE_SIZE];
        for row in tile.alpha.chunks_exact(TILE_SIZE).take(height) {
            for (least, alpha) in least.iter_mut().zip(row) {
                *least = if *alpha < *least { *alpha } else { *least };
            }
        }
        least[..width].iter().copied().fold(f32::INFINITY, f32::min)
    }

    /// Where a footprint meets the tile.
    pub(super) fn patch(&self, footprint: &Footprint) -> Patch {
        let clip = |(first, end): (u32, u32), i: usize| {
            let first = (first as usize).max(self.origin[i]) - self.origin[i];
            let end = (end as usize).min(self.origin[i] + TILE_SIZE);
            [first, end.saturating_sub(self.origin[i])]
        };
        Patch {
            first_px: [self.origin[0] as f32 + 0.5, self.origin[1] as f32 + 0.5],
            columns: clip(footprint.column_range(), 0),
            rows: clip(footprint.row_range(), 1),
            width: self.width(),
        }
    }

    /// What a footprint is drawn by.
    pub(super) fn mode(&self, footprint: &Footprint) -> Mode {
        Mode {
            linear: self.settings.linear_opacity || footprint.path == PATH_PEAK,
            depth: self.settings.depth,
            count: self.settings.count,
        }
    }

    fn add(
        &self,
        tile: &mut Tile,
        footprint: &Footprint,
        exact: Option<&ExactTerms>,
        near: &[NearTerms],
    ) -> u32 {
        let patch = self.patch(footprint);
        let mode = self.mode(footprint);
        let terms = near.get((footprint.path >> 2) as usize);
        match (footprint.path & 3, terms) {
            (PATH_NEAR | PATH_HALF_LINE, Some(terms)) => {
                self.add_per_pixel(tile, footprint, patch, |x, y| {
                    let pixel = Vec2::from(patch.first_px) + Vec2::new(x as f32, y as f32);
                    near_depth(self.view, footprint, terms, pixel)
                })
            }
            (path, _) => {
                let exact = if path == PATH_EXACT { exact } else { None };
                splat(self.settings.level, mode, tile, footprint, exact, patch)
            }
        }
    }

    /// The rare paths: one pixel at a time.
    fn add_per_pixel(
        &self,
        tile: &mut Tile,
        footprint: &Footprint,
        patch: Patch,
        optical_depth: impl Fn(usize, usize) -> f32,
    ) -> u32 {
        let mut inside = 0;
        for y in patch.rows[0]..patch.rows[1] {
            for x in patch.columns[0]..patch.columns[1] {
                let tau = optical_depth(x, y);
                if !(tau > 0.0) {
                    continue;
                }
                inside += 1;
                let opacity = if self.settings.linear_opacity {
                    tau.min(1.0)
                } else {
                    -(-tau).exp_m1()
                };
                let i = y * TILE_SIZE + x;
                let before = tile.alpha[i];
                let weight = opacity * (1.0 - before);
                tile.alpha[i] = before + weight;
                let (share, [red, green, blue]) = if self.settings.count {
                    (1.0, [1.0; 3])
                } else {
                    (weight, footprint.colour)
                };
                tile.red[i] += share * red;
                tile.green[i] += share * green;
                tile.blue[i] += share * blue;
                if self.settings.depth && before < 0.5 && tile.alpha[i] >= 0.5 {
                    // Within a kernel that holds the eye, the centre may lie behind.
                    tile.depth[i] = footprint.depth.max(0.0);
                }
            }
        }
        inside
    }
}
