//! Stage: from lists of surfels of opaque surfaces to tiles of pixels: colour, coverage, depth and,
//! where asked for, normals.
//!
//! Each pixel keeps a window of a few layers, front to back: the surfaces that its surfels have
//! shown so far. A surfel joins the first layer whose depth is its own within its slack, opens a
//! layer of its own elsewhere, and is nothing where nearer layers cover the pixel already. Where there
//! is no room the two farthest layers become one. A layer's
//! colour is the weighted mean of its surfels; its coverage their sum, as far as nearer layers
//! have left anything to cover. So neighbouring pieces of one surface that fall into two layers
//! still cover what they cover together.
//!
//! Where a plane clips a surface, its coverage falls from 1 to 0 across the cut as the low-pass filter
//! spreads it: Phi of the distance from the cut on the image, in standard deviations of the filter.
//!
//! Twin: `shaders/surface.wgsl`.

use glam::{Mat2, Vec2, Vec3};
use rayon::prelude::*;

use super::bin::Bins;
use super::lanes::{Kernel, Plane, SimdLevel, Tile, cdf, exp_minus_half, madd, prefetch, run_at};
use super::rasterise::{PREFETCH, ray};
use crate::constants::{
    CLIP_SOFTNESS, COVERAGE_FULL, MAX_CLIP_PLANES, SURFACE_LAYERS, TERMINATION_INTERVAL,
    TILE_PIXELS, TILE_SIZE,
};
use crate::layout::{ExactTerms, Footprint, NearTerms, PATH_NEAR_SURFEL, SurfelTerms, ViewUniform};
use crate::math::unpack_normal;

/// Sums over the surfels of one layer of each pixel.
#[derive(Debug, Clone)]
#[repr(align(64))]
struct Layer {
    /// Weights: what the surfels cover.
    weight: Plane,
    /// Weight times nearness.
    nearness: Plane,
    /// Weight times linear colour.
    colour: [Plane; 3],
    /// Weight times the unit normal, camera space; zero unless asked for.
    normal: [Plane; 3],
}

impl Layer {
    const fn new() -> Self {
        Self {
            weight: [0.0; TILE_PIXELS],
            nearness: [0.0; TILE_PIXELS],
            colour: [[0.0; TILE_PIXELS]; 3],
            normal: [[0.0; TILE_PIXELS]; 3],
        }
    }

    fn clear(&mut self, has_normals: bool) {
        self.weight.fill(0.0);
        self.nearness.fill(0.0);
        self.colour.iter_mut().for_each(|plane| plane.fill(0.0));
        if has_normals {
            self.normal.iter_mut().for_each(|plane| plane.fill(0.0));
        }
    }

    fn add(&mut self, i: usize, fragment: &Fragment) {
        let w = fragment.weight;
        self.weight[i] += w;
        self.nearness[i] += w * fragment.nearness;
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
        self.nearness[i] += other.nearness[i];
        for (to, from) in self.colour.iter_mut().zip(&other.colour) {
            to[i] += from[i];
        }
        for (to, from) in self.normal.iter_mut().zip(&other.normal) {
            to[i] += from[i];
        }
    }

    /// Takes a pixel of another layer.
    fn take(&mut self, i: usize, other: &Self) {
        self.weight[i] = other.weight[i];
        self.nearness[i] = other.nearness[i];
        for (to, from) in self.colour.iter_mut().zip(&other.colour) {
            to[i] = from[i];
        }
        for (to, from) in self.normal.iter_mut().zip(&other.normal) {
            to[i] = from[i];
        }
    }

    fn forget(&mut self, i: usize) {
        self.weight[i] = 0.0;
        self.nearness[i] = 0.0;
        for plane in self.colour.iter_mut().chain(&mut self.normal) {
            plane[i] = 0.0;
        }
    }
}

/// Where planes clip a surfel: how far inside lies what a pixel shows of it, standard deviations of the
/// low-pass filter, is linear over the image.
///
/// Of a surfel that the filter spreads, a pixel at offset d from its centre shows what lies at F d on
/// average, F = V (V + V_h)⁻¹ = 1 - V_h S⁻¹ with S the variance of its footprint. Its gradient of
/// nearness is one over the image already.
#[derive(Debug, Clone, Copy)]
struct ClipEdges {
    /// At the surfel's centre, and the change per pixel.
    edges: [[f32; 3]; MAX_CLIP_PLANES],
    count: usize,
}

impl ClipEdges {
    /// Of the plane of a surfel with this nearness at a point of the image and this change of it, the
    /// planes that cut it within `reach` pixels.
    ///
    /// - `shown`: F.
    fn new(
        view: &ViewUniform,
        pixel: Vec2,
        nearness: f32,
        gradient: Vec2,
        shown: Mat2,
        reach: f32,
    ) -> Self {
        let mut edges = Self {
            edges: [[0.0; 3]; MAX_CLIP_PLANES],
            count: 0,
        };
        let direction = ray(view, pixel);
        let focal = Vec2::from(view.focal_px);
        for &[nx, ny, nz, d] in &view.clip_planes[..view.clip_count as usize] {
            // Of the point D / nearness (orthographic: X, Y, -nearness), times what is positive.
            let across = nx * direction.x + ny * direction.y;
            let (inside, rate) = if view.orthographic == 0 {
                (across + nz + d * nearness, d)
            } else {
                (across - nz * nearness + d, -nz)
            };
            let slope = shown * (Vec2::new(nx, ny) / focal) + gradient * rate;
            // The variance of what a pixel shows is h² F.
            let kept = slope.dot(shown * slope) / slope.length_squared();
            let spread = (view.low_pass_variance_px2 / kept.max(LEAST_SHOWN)).sqrt();
            let softness = slope.length() * spread;
            let scale = 1.0 / softness.max(f32::MIN_POSITIVE);
            if inside * scale - slope.length() * scale * reach < WHOLE {
                let slope = slope * scale;
                edges.edges[edges.count] = [inside * scale, slope.x, slope.y];
                edges.count += 1;
            }
        }
        edges
    }

    /// The share of a surfel that is left at an offset from its centre; 0 beyond the softness.
    #[inline(always)]
    fn share<const FMA: bool>(&self, dx: f32, dy: f32) -> f32 {
        let mut share = 1.0;
        for [inside, along_x, along_y] in &self.edges[..self.count] {
            let inside = madd::<FMA>(*along_x, dx, madd::<FMA>(*along_y, dy, *inside));
            // Phrased so that NaN is outside.
            share *= if inside > -CLIP_SOFTNESS {
                cdf::<FMA>(inside)
            } else {
                0.0
            };
        }
        share
    }
}

/// So many standard deviations inside a plane a surfel is whole: Phi is 1 to f32.
const WHOLE: f32 = 5.5;

/// What a surfel shows at a pixel.
#[derive(Debug, Clone, Copy)]
struct Fragment {
    weight: f32,
    nearness: f32,
    slack: f32,
    colour: [f32; 3],
    normal: [f32; 3],
}

/// The share of a pixel that weights of this sum cover.
///
/// Weights add up to 1 only nearly: from [`COVERAGE_FULL`] on a pixel is covered. Up to a half, as at
/// most of a silhouette's outer side, the sum is taken as it is.
#[inline]
pub(crate) fn coverage(weight: f32) -> f32 {
    if weight <= 0.5 {
        return weight;
    }
    (0.5 + (weight - 0.5) * (0.5 / (COVERAGE_FULL - 0.5))).min(1.0)
}

/// Normals of a tile's pixels: camera space, unit length, towards the eye; zero where there is no
/// surface.
pub type NormalTile = Vec<[f32; 3]>;

/// Draws all tiles of opaque surfels, `columns` of them in a row: colour (premultiplied), coverage as
/// alpha, and the depth of the surface at which half of what is covered is, infinite where there is
/// none. Returns the number of splat-pixels.
///
/// - `terms`: [`SurfelTerms`] of each footprint, in the place of its exact terms.
/// - `is_count`: whether colours count the surfels that a pixel evaluated within their cut-off.
/// - `normals`: one per tile where they are wanted, empty otherwise.
#[allow(
    clippy::too_many_arguments,
    reason = "a stage takes the slices it reads and writes"
)]
pub fn rasterise_surface(
    view: &ViewUniform,
    level: SimdLevel,
    is_count: bool,
    footprints: &[Footprint],
    terms: &[ExactTerms],
    near: &[NearTerms],
    bins: &Bins,
    columns: usize,
    tiles: &mut [Tile],
    normals: &mut [NormalTile],
) -> u64 {
    let has_normals = !normals.is_empty();
    let mut none = vec![NormalTile::new(); if has_normals { 0 } else { tiles.len() }];
    let normals = if has_normals { normals } else { &mut none };
    let memory = || {
        let layers = Box::new([const { Layer::new() }; SURFACE_LAYERS]);
        (Vec::new(), layers, Box::new([0.0; TILE_PIXELS]))
    };
    tiles
        .par_iter_mut()
        .zip(normals)
        .enumerate()
        .map_init(memory, |(list, layers, counts), (t, (tile, normals))| {
            list.clear();
            list.extend(bins.tile(t));
            let origin = [t % columns * TILE_SIZE, t / columns * TILE_SIZE];
            let raster = SurfaceRaster {
                view,
                origin,
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
            if is_count {
                for plane in [&mut tile.red, &mut tile.green, &mut tile.blue] {
                    plane.copy_from_slice(&**counts);
                }
            }
            splat_pixels
        })
        .sum()
}

/// A tile's work.
struct SurfaceRaster<'a> {
    view: &'a ViewUniform,
    /// The tile's first pixel.
    origin: [usize; 2],
    has_normals: bool,
    footprints: &'a [Footprint],
    terms: &'a [ExactTerms],
    near: &'a [NearTerms],
    list: &'a [u32],
    layers: &'a mut [Layer; SURFACE_LAYERS],
    /// Surfels evaluated at each pixel.
    counts: &'a mut Plane,
}

impl Kernel for SurfaceRaster<'_> {
    type Output = u64;

    #[inline(always)]
    fn run<const FMA: bool>(self) -> u64 {
        let mut raster = self;
        for layer in raster.layers.iter_mut() {
            layer.clear(raster.has_normals);
        }
        raster.counts.fill(0.0);
        // The least nearness of the tile's front layers, once all of it is covered.
        let mut behind = f32::NEG_INFINITY;
        for (n, &i) in raster.list.iter().enumerate() {
            let ahead = raster.list.get(n + PREFETCH).map(|&i| i as usize);
            prefetch(ahead.and_then(|i| raster.footprints.get(i)));
            if n > 0 && n % TERMINATION_INTERVAL == 0 {
                behind = raster.farthest_front();
            }
            let footprint = &raster.footprints[i as usize];
            if footprint.depth < behind {
                continue;
            }
            if footprint.path & 15 == PATH_NEAR_SURFEL {
                raster.add_near(footprint);
            } else {
                let terms = SurfelTerms::from(raster.terms[i as usize]);
                if terms.homography > 0.0 {
                    raster.add::<FMA, true>(footprint, &terms);
                } else {
                    raster.add::<FMA, false>(footprint, &terms);
                }
            }
        }
        // Each is a whole number far below 2²⁴.
        raster.counts.iter().map(|&count| count as u64).sum()
    }
}

impl SurfaceRaster<'_> {
    /// Rows and columns of the tile, half-open, that the footprint's box meets.
    fn patch(&self, footprint: &Footprint) -> [[usize; 2]; 2] {
        let clip = |(first, end): (u32, u32), i: usize| {
            let first = (first as usize).max(self.origin[i]) - self.origin[i];
            let end = (end as usize).min(self.origin[i] + TILE_SIZE);
            [first, end.saturating_sub(self.origin[i])]
        };
        [
            clip(footprint.column_range(), 0),
            clip(footprint.row_range(), 1),
        ]
    }

    /// The least nearness of the front layers where all pixels of the image are covered by them.
    fn farthest_front(&self) -> f32 {
        let front = &self.layers[0];
        let width = (self.view.size[0] as usize - self.origin[0]).min(TILE_SIZE);
        let height = (self.view.size[1] as usize - self.origin[1]).min(TILE_SIZE);
        let mut least = f32::INFINITY;
        for y in 0..height {
            for i in y * TILE_SIZE..y * TILE_SIZE + width {
                if front.weight[i] < COVERAGE_FULL {
                    return f32::NEG_INFINITY;
                }
                least = least.min(front.nearness[i] / front.weight[i]);
            }
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
        let [columns, rows] = self.patch(footprint);
        let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
        let [gx, gy] = terms.gradient;
        let (peak, slack) = (footprint.tau, terms.slack);
        let [red, green, blue] = footprint.colour;
        let first = |i: usize| self.origin[i] as f32 + 0.5 - footprint.centre_px[i];
        let (dx_first, dy_first) = (first(0), first(1));
        let per_centre = 1.0 / terms.nearness;
        let edges = (self.view.clip_count > 0).then(|| {
            let reach = farthest(columns, dx_first).hypot(farthest(rows, dy_first));
            let centre = Vec2::from(footprint.centre_px);
            ClipEdges::new(
                self.view,
                centre,
                terms.nearness,
                terms.gradient.into(),
                shown(self.view, footprint, terms),
                reach,
            )
        });
        let edges = edges.filter(|edges| edges.count > 0);
        // Vectors reach beyond the box; there nothing is within the cut-off.
        let mut limits = [-1.0; TILE_SIZE];
        limits[columns[0]..columns[1]].fill(footprint.cutoff_squared);
        let normal = if self.has_normals {
            unpack_normal(terms.normal).into()
        } else {
            [0.0; 3]
        };
        for y in rows[0]..rows[1] {
            let row = y * TILE_SIZE..(y + 1) * TILE_SIZE;
            let dy = dy_first + y as f32;
            let (p_row, r_row) = (py * dy, ry * dy);
            let nearness_row = madd::<FMA>(gy, dy, terms.nearness);
            let mut shares = [1.0_f32; TILE_SIZE];
            if let Some(edges) = &edges {
                for (lane, share) in shares.iter_mut().enumerate() {
                    *share = edges.share::<FMA>(dx_first + lane as f32, dy);
                }
            }
            let mut weights = [0.0_f32; TILE_SIZE];
            let mut nearnesses = [0.0_f32; TILE_SIZE];
            let mut others = [0_u32; TILE_SIZE];
            let mut inside = [0.0_f32; TILE_SIZE];
            {
                let Layer {
                    weight,
                    nearness,
                    colour: [r_sum, g_sum, b_sum],
                    normal: normal_sums,
                } = &mut self.layers[0];
                let (Some(w_sum), Some(z_sum), Some(r_sum), Some(g_sum), Some(b_sum)) = (
                    weight[row.clone()].first_chunk_mut::<TILE_SIZE>(),
                    nearness[row.clone()].first_chunk_mut::<TILE_SIZE>(),
                    r_sum[row.clone()].first_chunk_mut::<TILE_SIZE>(),
                    g_sum[row.clone()].first_chunk_mut::<TILE_SIZE>(),
                    b_sum[row.clone()].first_chunk_mut::<TILE_SIZE>(),
                ) else {
                    continue;
                };
                for lane in 0..TILE_SIZE {
                    let dx = dx_first + lane as f32;
                    let p = madd::<FMA>(px, dx, p_row);
                    let r = madd::<FMA>(rx, dx, r_row);
                    let mut q = madd::<FMA>(p, p, r * r);
                    let z = madd::<FMA>(gx, dx, nearness_row);
                    let mut is_inside = true;
                    if HOMOGRAPHY {
                        let root = z * per_centre;
                        q /= root * root;
                        is_inside = root > 0.0;
                    }
                    // NaN compares false: outside.
                    is_inside &= q <= limits[lane] && shares[lane] > 0.0;
                    let w = if is_inside {
                        peak * exp_minus_half::<FMA>(q) * shares[lane]
                    } else {
                        0.0
                    };
                    let sum = w_sum[lane];
                    let ahead = madd::<FMA>(z, sum, -z_sum[lane]);
                    let joins = ahead.abs() <= slack * sum;
                    let is_hidden = sum >= COVERAGE_FULL && ahead < 0.0;
                    let share = if joins { w } else { 0.0 };
                    w_sum[lane] = sum + share;
                    z_sum[lane] = madd::<FMA>(share, z, z_sum[lane]);
                    r_sum[lane] = madd::<FMA>(share, red, r_sum[lane]);
                    g_sum[lane] = madd::<FMA>(share, green, g_sum[lane]);
                    b_sum[lane] = madd::<FMA>(share, blue, b_sum[lane]);
                    weights[lane] = w;
                    nearnesses[lane] = z;
                    others[lane] = u32::from(is_inside && !joins && !is_hidden);
                    inside[lane] = f32::from(u8::from(is_inside));
                    if self.has_normals {
                        for (sums, n) in normal_sums.iter_mut().zip(normal) {
                            sums[row.start + lane] += share * n;
                        }
                    }
                }
            }
            for (count, is) in self.counts[row.clone()].iter_mut().zip(inside) {
                *count += is;
            }
            if others.iter().any(|&is| is != 0) {
                for lane in 0..TILE_SIZE {
                    if others[lane] != 0 {
                        let fragment = Fragment {
                            weight: weights[lane],
                            nearness: nearnesses[lane],
                            slack,
                            colour: footprint.colour,
                            normal,
                        };
                        insert(self.layers, row.start + lane, &fragment);
                    }
                }
            }
        }
    }

    /// Adds a surfel that reaches the camera plane, pixel by pixel.
    fn add_near(&mut self, footprint: &Footprint) {
        let Some(terms) = self.near.get((footprint.path >> 4) as usize) else {
            return;
        };
        let [a, b, n] = [0, 1, 2].map(|i| Vec3::from(terms.misses[i]));
        let [columns, rows] = self.patch(footprint);
        let mut normal = n.normalize_or_zero();
        for y in rows[0]..rows[1] {
            for x in columns[0]..columns[1] {
                let pixel = [x + self.origin[0], y + self.origin[1]].map(|px| px as f32 + 0.5);
                let d = ray(self.view, Vec2::from(pixel));
                let nearness = d.dot(n);
                let (along_a, along_b) = (d.dot(a) / nearness, d.dot(b) / nearness);
                let q = along_a * along_a + along_b * along_b;
                // Phrased so that NaN is outside.
                if !(nearness > 0.0 && q <= footprint.cutoff_squared) {
                    continue;
                }
                let gradient = n.truncate() / Vec2::from(self.view.focal_px);
                let (view, pixel) = (self.view, pixel.into());
                let edges = ClipEdges::new(view, pixel, nearness, gradient, Mat2::IDENTITY, 0.0);
                let share = edges.share::<false>(0.0, 0.0);
                if share == 0.0 {
                    continue;
                }
                self.counts[y * TILE_SIZE + x] += 1.0;
                if normal.dot(d) > 0.0 {
                    normal = -normal;
                }
                let fragment = Fragment {
                    weight: footprint.tau * (-0.5 * q).exp() * share,
                    nearness,
                    slack: terms.sigma * nearness * nearness,
                    colour: footprint.colour,
                    normal: normal.into(),
                };
                insert(self.layers, y * TILE_SIZE + x, &fragment);
            }
        }
    }
}

/// A surfel of a thousandth of a pixel shows so much of itself: below, roundings of F rule.
const LEAST_SHOWN: f32 = 1e-6;

/// F of [`ClipEdges`]: of surfels that follow their plane's homography 1, as their nearness does.
fn shown(view: &ViewUniform, footprint: &Footprint, terms: &SurfelTerms) -> Mat2 {
    if terms.homography > 0.0 {
        return Mat2::IDENTITY;
    }
    let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
    let across = px * py + rx * ry;
    let inverse = Mat2::from_cols_array(&[px * px + rx * rx, across, across, py * py + ry * ry]);
    Mat2::IDENTITY - inverse * view.low_pass_variance_px2
}

/// The farthest of a row or column of pixels from a centre, `first` the offset of the tile's first one.
fn farthest([start, end]: [usize; 2], first: f32) -> f32 {
    (first + start as f32).abs().max((first + end as f32).abs())
}

/// Adds a fragment to the layers of a pixel. In front of a layer: those behind move on, the last two
/// become one. Whatever is behind the others joins the last: what covers is never lost.
fn insert(layers: &mut [Layer; SURFACE_LAYERS], i: usize, fragment: &Fragment) {
    const LAST: usize = SURFACE_LAYERS - 1;
    if fragment.nearness.is_nan() {
        return;
    }
    let mut covered = 0.0;
    for k in 0..LAST {
        let sum = layers[k].weight[i];
        let ahead = fragment.nearness * sum - layers[k].nearness[i];
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

/// Pixels from their layers.
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
                let nearness = layer.nearness[i] / weight;
                depth = if view.orthographic != 0 {
                    -nearness
                } else {
                    1.0 / nearness
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
