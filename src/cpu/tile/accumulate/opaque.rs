//! Stage: draws lists of surfels of opaque surfaces into tiles of pixels: colour, coverage, depth and, on
//! request, normals.
//!
//! Each pixel keeps a few layers, front to back: the surfaces that its surfels have shown so far. A
//! surfel joins the first layer whose depth equals its own within its slack. Otherwise it opens a new
//! layer, unless nearer layers already cover the pixel: then it is dropped. If no layer is free, the two
//! farthest layers are merged.
//!
//! A layer's colour is the weighted mean of its surfels. Its coverage is the sum of their weights,
//! limited to the part that nearer layers leave uncovered. So neighbouring pieces of one surface that
//! fall into two layers still have the same coverage together.
//!
//! Twin: `shaders/tile/accumulate/opaque.wgsl`.

use glam::Vec3;
use rayon::prelude::*;

use crate::constants::{
    COVERAGE_FULL, SURFACE_LAYERS, TERMINATION_INTERVAL, TILE_PIXELS, TILE_SIZE,
};
use crate::cpu::bin::Bins;
use crate::cpu::tile::evaluate::surfel::{NearSurfel, SurfelRow, SurfelWalk};
use crate::cpu::tile::interval::edges::ClipEdges;
use crate::cpu::tile::pixels::{PREFETCH, Plane, Tile, TilePlace, prefetch};
use crate::cpu::tile::settings::RasteriseSettings;
use crate::frame::backdrop::of_surfels;
use crate::math::lane::madd;
use crate::record::{Footprint, NearTerms, PATH_NEAR_SURFEL, SurfelTerms, ViewUniform};
use crate::simd::{SimdWork, run_at};
use crate::task::Stage;

/// Sums over the surfels of one layer of each pixel.
#[derive(Debug, Clone)]
#[repr(align(64))]
struct Layer {
    /// Sum of weights: the coverage of the surfels.
    weight: Plane,
    /// Weight times inverse depth.
    inverse_depth: Plane,
    /// Weight times linear colour.
    colour: [Plane; 3],
    /// Weight times the unit normal, camera space; zero unless normals are written.
    normal: [Plane; 3],
}

impl Layer {
    const fn new() -> Self {
        Self {
            weight: [0.0; TILE_PIXELS],
            inverse_depth: [0.0; TILE_PIXELS],
            colour: [[0.0; TILE_PIXELS]; 3],
            normal: [[0.0; TILE_PIXELS]; 3],
        }
    }

    fn clear(&mut self, has_normals: bool) {
        self.weight.fill(0.0);
        self.inverse_depth.fill(0.0);
        self.colour.iter_mut().for_each(|plane| plane.fill(0.0));
        if has_normals {
            self.normal.iter_mut().for_each(|plane| plane.fill(0.0));
        }
    }

    fn add(&mut self, i: usize, fragment: &Fragment) {
        let w = fragment.weight;
        self.weight[i] += w;
        self.inverse_depth[i] += w * fragment.inverse_depth;
        for (sums, c) in self.colour.iter_mut().zip(fragment.colour) {
            sums[i] += w * c;
        }
        for (sums, n) in self.normal.iter_mut().zip(fragment.normal) {
            sums[i] += w * n;
        }
    }

    /// Adds a pixel of another layer.
    fn merge(&mut self, i: usize, other: &Self) {
        self.weight[i] += other.weight[i];
        self.inverse_depth[i] += other.inverse_depth[i];
        for (to, from) in self.colour.iter_mut().zip(&other.colour) {
            to[i] += from[i];
        }
        for (to, from) in self.normal.iter_mut().zip(&other.normal) {
            to[i] += from[i];
        }
    }

    /// Copies a pixel of another layer.
    fn take(&mut self, i: usize, other: &Self) {
        self.weight[i] = other.weight[i];
        self.inverse_depth[i] = other.inverse_depth[i];
        for (to, from) in self.colour.iter_mut().zip(&other.colour) {
            to[i] = from[i];
        }
        for (to, from) in self.normal.iter_mut().zip(&other.normal) {
            to[i] = from[i];
        }
    }

    fn forget(&mut self, i: usize) {
        self.weight[i] = 0.0;
        self.inverse_depth[i] = 0.0;
        for plane in self.colour.iter_mut().chain(&mut self.normal) {
            plane[i] = 0.0;
        }
    }
}

/// The part of a surfel at a pixel.
#[derive(Debug, Clone, Copy)]
struct Fragment {
    weight: f32,
    inverse_depth: f32,
    slack: f32,
    colour: [f32; 3],
    normal: [f32; 3],
}

/// Returns the coverage of a pixel for a sum of weights.
///
/// The weights of a closed surface sum to 1 only approximately: a pixel counts as covered from
/// [`COVERAGE_FULL`] on. Up to one half, as on most of a silhouette's outer side, the coverage is the sum
/// itself.
#[inline]
pub(crate) fn coverage(weight: f32) -> f32 {
    if weight <= 0.5 {
        return weight;
    }
    (0.5 + (weight - 0.5) * (0.5 / (COVERAGE_FULL - 0.5))).min(1.0)
}

/// Normals of a tile's pixels: camera space, unit length, towards the eye; zero if there is no surface.
pub type NormalTile = Vec<[f32; 3]>;

/// Draws all tiles of opaque surfels: colour (premultiplied), coverage as alpha, and depth. The depth is
/// that of the surface at which half of the coverage is reached; infinite if there is none. Returns the
/// number of splat-pixels.
///
/// - `columns`: tiles in a row of the picture.
/// - `terms`: terms of each footprint.
/// - `normals`: one per tile if they are wanted, empty otherwise.
#[allow(
    clippy::too_many_arguments,
    reason = "a stage takes the slices it reads and writes"
)]
pub fn rasterise_surface(
    view: &ViewUniform,
    settings: RasteriseSettings<'_>,
    footprints: &[Footprint],
    terms: &[SurfelTerms],
    near: &[NearTerms],
    bins: &Bins,
    columns: usize,
    tiles: &mut [Tile],
    normals: &mut [NormalTile],
) -> u64 {
    let RasteriseSettings {
        axes,
        level,
        ends,
        task,
    } = settings;
    let listed = bins.tiles();
    let stage = Stage::new(task, "drawing surfaces", listed.len());
    let has_normals = !normals.is_empty();
    let mut none = vec![NormalTile::new(); if has_normals { 0 } else { listed.len() }];
    let normals = if has_normals {
        &mut normals[listed.clone()]
    } else {
        &mut none
    };
    let memory = || {
        let layers = Box::new([const { Layer::new() }; SURFACE_LAYERS]);
        let ends = Box::new([f32::NEG_INFINITY; TILE_PIXELS]);
        (Vec::new(), layers, Box::new([0.0; TILE_PIXELS]), ends)
    };
    tiles[listed.clone()]
        .par_iter_mut()
        .zip(normals)
        .zip(listed)
        .map_init(
            memory,
            |(list, layers, counts, planes), ((tile, normals), t)| {
                if !stage.goes_on() {
                    return 0;
                }
                list.clear();
                list.extend(bins.tile(t));
                let place = TilePlace::new(view, t, columns);
                if let Some(ends) = ends {
                    for i in place.pixels() {
                        planes[i] = of_surfels(ends.at(place.at(i)), view.orthographic != 0);
                    }
                }
                let raster = SurfaceRaster {
                    place,
                    ends: ends.map(|_| &**planes),
                    has_normals,
                    footprints,
                    terms,
                    near,
                    list,
                    layers,
                    counts,
                };
                let splat_pixels = run_at(level, raster);
                resolve_layers(view, layers, tile, has_normals.then_some(normals));
                if axes.count {
                    for plane in [&mut tile.red, &mut tile.green, &mut tile.blue] {
                        plane.copy_from_slice(&**counts);
                    }
                }
                stage.advance(1);
                splat_pixels
            },
        )
        .sum()
}

/// The work on one tile.
struct SurfaceRaster<'a> {
    place: TilePlace<'a>,
    /// Inverse depths at which rays end, as surfels state theirs.
    ends: Option<&'a Plane>,
    has_normals: bool,
    footprints: &'a [Footprint],
    terms: &'a [SurfelTerms],
    near: &'a [NearTerms],
    list: &'a [u32],
    layers: &'a mut [Layer; SURFACE_LAYERS],
    /// Number of surfels evaluated at each pixel.
    counts: &'a mut Plane,
}

impl SimdWork for SurfaceRaster<'_> {
    type Output = u64;

    #[inline(always)]
    fn run<const FMA: bool, const LANES: usize>(self) -> u64 {
        let mut raster = self;
        for layer in raster.layers.iter_mut() {
            layer.clear(raster.has_normals);
        }
        raster.counts.fill(0.0);
        // Least inverse depth of the tile's front layers, once they cover the whole tile.
        let mut behind = f32::NEG_INFINITY;
        for (n, &i) in raster.list.iter().enumerate() {
            let ahead = raster.list.get(n + PREFETCH).map(|&i| i as usize);
            prefetch(ahead.and_then(|i| raster.footprints.get(i)));
            if n > 0 && n % TERMINATION_INTERVAL == 0 {
                behind = raster.farthest_front();
            }
            let footprint = &raster.footprints[i as usize];
            if footprint.greatest_inverse_depth() < behind {
                continue;
            }
            if footprint.path & 15 == PATH_NEAR_SURFEL {
                raster.add_near(footprint);
            } else {
                let terms = &raster.terms[i as usize];
                if terms.homography > 0.0 {
                    raster.add::<FMA, true>(footprint, terms);
                } else {
                    raster.add::<FMA, false>(footprint, terms);
                }
            }
        }
        // Each count is a whole number far below 2²⁴.
        raster.counts.iter().map(|&count| count as u64).sum()
    }
}

impl SurfaceRaster<'_> {
    /// Returns the least inverse depth of the front layers if they cover all pixels of the image.
    fn farthest_front(&self) -> f32 {
        let front = &self.layers[0];
        let mut least = f32::INFINITY;
        for i in self.place.pixels() {
            if front.weight[i] < COVERAGE_FULL {
                return f32::NEG_INFINITY;
            }
            least = least.min(front.inverse_depth[i] / front.weight[i]);
        }
        least
    }

    /// Adds a surfel.
    #[inline(always)]
    fn add<const FMA: bool, const HOMOGRAPHY: bool>(
        &mut self,
        footprint: &Footprint,
        terms: &SurfelTerms,
    ) {
        let walk = SurfelWalk::new(&self.place, footprint, terms);
        let fragment = Fragment {
            weight: 0.0,
            inverse_depth: 0.0,
            slack: terms.slack,
            colour: footprint.carried.colour(),
            normal: if self.has_normals {
                walk.normal()
            } else {
                [0.0; 3]
            },
        };
        let edges = ClipEdges::of(&self.place, footprint, terms);
        for y in walk.rows() {
            let mut row = walk.row::<FMA, HOMOGRAPHY>(y);
            if let Some(edges) = &edges {
                edges.cut::<FMA>(&mut row, walk.offset(y));
            }
            if let Some(ends) = self.ends {
                row.end(&ends[y * TILE_SIZE..]);
            }
            self.take::<FMA>(y, &row, &fragment);
        }
    }

    /// Adds a row of a surfel: to the front layers where it joins them, to other layers elsewhere.
    ///
    /// - `surfel`: values that its pixels share.
    #[inline(always)]
    fn take<const FMA: bool>(&mut self, y: usize, row: &SurfelRow, surfel: &Fragment) {
        let pixels = y * TILE_SIZE..(y + 1) * TILE_SIZE;
        let [red, green, blue] = surfel.colour;
        let mut others = [0_u32; TILE_SIZE];
        {
            let Layer {
                weight,
                inverse_depth,
                colour: [r_sum, g_sum, b_sum],
                normal: normal_sums,
            } = &mut self.layers[0];
            let (Some(w_sum), Some(z_sum), Some(r_sum), Some(g_sum), Some(b_sum)) = (
                weight[pixels.clone()].first_chunk_mut::<TILE_SIZE>(),
                inverse_depth[pixels.clone()].first_chunk_mut::<TILE_SIZE>(),
                r_sum[pixels.clone()].first_chunk_mut::<TILE_SIZE>(),
                g_sum[pixels.clone()].first_chunk_mut::<TILE_SIZE>(),
                b_sum[pixels.clone()].first_chunk_mut::<TILE_SIZE>(),
            ) else {
                return;
            };
            for lane in 0..TILE_SIZE {
                let (w, z) = (row.weight[lane], row.inverse_depth[lane]);
                let sum = w_sum[lane];
                let ahead = madd::<FMA>(z, sum, -z_sum[lane]);
                let joins = ahead.abs() <= surfel.slack * sum;
                let is_hidden = sum >= COVERAGE_FULL && ahead < 0.0;
                let share = if joins { w } else { 0.0 };
                w_sum[lane] = sum + share;
                z_sum[lane] = madd::<FMA>(share, z, z_sum[lane]);
                r_sum[lane] = madd::<FMA>(share, red, r_sum[lane]);
                g_sum[lane] = madd::<FMA>(share, green, g_sum[lane]);
                b_sum[lane] = madd::<FMA>(share, blue, b_sum[lane]);
                others[lane] = u32::from(row.inside[lane] > 0.0 && !joins && !is_hidden);
                if self.has_normals {
                    for (sums, n) in normal_sums.iter_mut().zip(surfel.normal) {
                        sums[pixels.start + lane] += share * n;
                    }
                }
            }
        }
        for (count, is) in self.counts[pixels.clone()].iter_mut().zip(row.inside) {
            *count += is;
        }
        if others.iter().any(|&is| is != 0) {
            for (lane, &is_other) in others.iter().enumerate() {
                if is_other != 0 {
                    let fragment = Fragment {
                        weight: row.weight[lane],
                        inverse_depth: row.inverse_depth[lane],
                        ..*surfel
                    };
                    insert(self.layers, pixels.start + lane, &fragment);
                }
            }
        }
    }

    /// Adds a surfel that reaches the camera plane, pixel by pixel.
    fn add_near(&mut self, footprint: &Footprint) {
        let Some(terms) = self.near.get((footprint.path >> 4) as usize) else {
            return;
        };
        let surfel = NearSurfel::new(&self.place, footprint, terms);
        let patch = self.place.patch(footprint);
        for y in patch.rows[0]..patch.rows[1] {
            for x in patch.columns[0]..patch.columns[1] {
                let Some(at) = surfel.at(x, y) else {
                    continue;
                };
                if self
                    .ends
                    .is_some_and(|ends| at.inverse_depth <= ends[y * TILE_SIZE + x])
                {
                    continue;
                }
                let pixel = self.place.centre(x, y);
                let share = ClipEdges::share_of_near(self.place.view, pixel, &at);
                if share == 0.0 {
                    continue;
                }
                self.counts[y * TILE_SIZE + x] += 1.0;
                let fragment = Fragment {
                    weight: at.weight * share,
                    inverse_depth: at.inverse_depth,
                    slack: at.slack,
                    colour: footprint.carried.colour(),
                    normal: at.normal,
                };
                insert(self.layers, y * TILE_SIZE + x, &fragment);
            }
        }
    }
}

/// Adds a fragment to the layers of a pixel. If it lies in front of a layer, that layer and those behind
/// move back, and the last two are merged. A fragment behind all others joins the last layer, so that no
/// coverage is lost.
fn insert(layers: &mut [Layer; SURFACE_LAYERS], i: usize, fragment: &Fragment) {
    const LAST: usize = SURFACE_LAYERS - 1;
    if fragment.inverse_depth.is_nan() {
        return;
    }
    let mut covered = 0.0;
    for k in 0..LAST {
        let sum = layers[k].weight[i];
        let ahead = fragment.inverse_depth * sum - layers[k].inverse_depth[i];
        if ahead.abs() <= fragment.slack * sum {
            layers[k].add(i, fragment);
            return;
        }
        if ahead > 0.0 {
            let (nearer, last) = layers.split_at_mut(LAST);
            last[0].merge(i, &nearer[LAST - 1]);
            for deeper in (k + 1..LAST).rev() {
                let (nearer, farther) = nearer.split_at_mut(deeper);
                farther[0].take(i, &nearer[deeper - 1]);
            }
            nearer[k].forget(i);
            nearer[k].add(i, fragment);
            return;
        }
        covered += sum;
        if covered >= COVERAGE_FULL {
            return;
        }
    }
    layers[LAST].add(i, fragment);
}

/// Computes pixels from their layers.
fn resolve_layers(
    view: &ViewUniform,
    layers: &[Layer; SURFACE_LAYERS],
    tile: &mut Tile,
    mut normals: Option<&mut NormalTile>,
) {
    if let Some(normals) = &mut normals {
        normals.clear();
        normals.resize(TILE_PIXELS, [0.0; 3]);
    }
    for i in 0..TILE_PIXELS {
        let total: f32 = layers.iter().map(|layer| coverage(layer.weight[i])).sum();
        let half = 0.5 * total.min(1.0);
        let (mut covered, mut colour) = (0.0_f32, Vec3::ZERO);
        let mut depth = f32::INFINITY;
        for layer in layers {
            let weight = layer.weight[i];
            if weight == 0.0 {
                break;
            }
            let before = covered;
            covered = (before + coverage(weight)).min(1.0);
            let [r, g, b] = &layer.colour;
            colour += Vec3::new(r[i], g[i], b[i]) * ((covered - before) / weight);
            if before < half && covered >= half {
                let inverse_depth = layer.inverse_depth[i] / weight;
                depth = if view.orthographic != 0 {
                    -inverse_depth
                } else {
                    1.0 / inverse_depth
                };
                if let Some(normals) = &mut normals {
                    let [x, y, z] = &layer.normal;
                    normals[i] = Vec3::new(x[i], y[i], z[i]).normalize_or_zero().into();
                }
            }
        }
        tile.alpha[i] = covered;
        [tile.red[i], tile.green[i], tile.blue[i]] = colour.into();
        tile.depth[i] = depth;
    }
}
