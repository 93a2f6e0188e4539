//! Tiles in which what is drawn of a ray ends: at planes that clip, and at opaque surfaces among what
//! light passes through.
//!
//! Of each pixel's ray the part between two depths is drawn; a surface divides it in two. Kernels are
//! integrated up to the surface and composited in front of it; where it covers a pixel in part, as along
//! silhouettes, what is left of them behind it is composited on its own and shows through the rest. Of
//! a kernel that is cut, the share Phi((b - z*) / sigma_z) - Phi((a - z*) / sigma_z) of its optical depth
//! lies between the depths a and b, the mass of a Gaussian on an interval.
//!
//! Twin: `shaders/rasterise.wgsl` with `IS_CUT`.

use glam::Vec2;

use super::lanes::{Kernel, Mode, Patch, Plane, Tile, opacity, run_at, splat};
use super::rasterise::{TileRaster, near_depth, ray};
use super::row::RowWalk;
use crate::constants::{TILE_PIXELS, TILE_SIZE};
use crate::layout::{
    ExactTerms, Footprint, NearTerms, PATH_EXACT, PATH_HALF_LINE, PATH_NEAR, PATH_PEAK, ViewUniform,
};
use crate::math::normal_cdf;
use crate::splat::near_share;

/// What is drawn of the rays of a tile's pixels: depths z.
#[derive(Debug, Clone)]
pub(super) struct Spans {
    /// Where it begins.
    pub(super) near: Plane,
    /// Where a surface divides it; its end where there is none.
    pub(super) middle: Plane,
    /// Where it ends.
    pub(super) far: Plane,
    /// What the tile's pixels have in common: least and greatest of each.
    nears: [f32; 2],
    middles: [f32; 2],
    fars: [f32; 2],
}

impl Default for Spans {
    fn default() -> Self {
        Self {
            near: [f32::NEG_INFINITY; TILE_PIXELS],
            middle: [f32::INFINITY; TILE_PIXELS],
            far: [f32::INFINITY; TILE_PIXELS],
            nears: [f32::NEG_INFINITY; 2],
            middles: [f32::INFINITY; 2],
            fars: [f32::INFINITY; 2],
        }
    }
}

impl Spans {
    fn fill(&mut self, raster: &TileRaster<'_>, surface: Option<&Tile>) {
        const NONE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];
        (self.nears, self.middles, self.fars) = (NONE, NONE, NONE);
        for i in raster.pixels() {
            let [near, far] = clip_span(raster.view, raster.pixel(i));
            let middle = surface.map_or(far, |s| s.depth[i].max(near).min(far));
            (self.near[i], self.middle[i], self.far[i]) = (near, middle, far);
            let bounds = [&mut self.nears, &mut self.middles, &mut self.fars];
            for (bounds, depth) in bounds.into_iter().zip([near, middle, far]) {
                bounds[0] = bounds[0].min(depth);
                bounds[1] = bounds[1].max(depth);
            }
        }
    }
}

/// Between which depths planes leave something of the ray through a point of the image; from infinity to
/// infinity where they leave nothing.
pub(super) fn clip_span(view: &ViewUniform, pixel: Vec2) -> [f32; 2] {
    let (mut near, mut far) = (f32::NEG_INFINITY, f32::INFINITY);
    let direction = ray(view, pixel);
    for &[nx, ny, nz, d] in &view.clip_planes[..view.clip_count as usize] {
        // The ray is at z D, or (orthographic) at (X, Y, z): inside where rate z + start >= 0.
        let across = nx * direction.x + ny * direction.y;
        let (rate, start) = if view.orthographic == 0 {
            (across + nz, d)
        } else {
            (nz, across + d)
        };
        let at = -start / rate;
        if rate > 0.0 {
            near = near.max(at);
        } else if rate < 0.0 {
            far = far.min(at);
        } else if start < 0.0 {
            far = f32::NEG_INFINITY;
        }
    }
    if near < far {
        [near, far]
    } else {
        [f32::INFINITY; 2]
    }
}

/// What is cut of a tile, and what lies behind its surface.
pub(super) struct CutTile<'a> {
    surface: Option<&'a Tile>,
    /// What is seen behind it, where it covers a pixel in part.
    pub(super) behind: &'a mut Tile,
    pub(super) spans: &'a Spans,
    /// Whether it covers any pixel in part.
    pub(super) is_partial: bool,
}

/// Where a footprint lies in a cut tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    /// In front of the surface, cut by nothing.
    Front,
    /// Behind it, and cut by nothing else.
    Behind,
    /// Where nothing is seen.
    Hidden,
    /// Maybe cut.
    Cut,
}

impl<'a> CutTile<'a> {
    /// `None` where nothing is cut. `behind` is cleared.
    pub(super) fn new(
        raster: &TileRaster<'_>,
        surface: Option<&'a Tile>,
        behind: &'a mut Tile,
        spans: &'a mut Spans,
    ) -> Option<Self> {
        // Uncovered pixels have an infinite depth.
        let covers = |s: &&Tile| raster.pixels().any(|i| s.depth[i] < f32::INFINITY);
        let surface = surface.filter(covers);
        if surface.is_none() && raster.view.clip_count == 0 {
            return None;
        }
        spans.fill(raster, surface);
        if surface.is_some() {
            raster.clear(behind);
        }
        let is_part = |s: &Tile| {
            raster
                .pixels()
                .any(|i| s.alpha[i] > 0.0 && s.alpha[i] < 1.0)
        };
        Some(Self {
            is_partial: surface.is_some_and(is_part),
            surface,
            behind,
            spans,
        })
    }

    /// Whether a surface lies in the tile.
    pub(super) fn has_surface(&self) -> bool {
        self.surface.is_some()
    }

    /// Where a footprint lies that does not cross the plane of the eye.
    pub(super) fn side(&self, footprint: &Footprint, terms: &ExactTerms) -> Side {
        let Spans {
            nears,
            middles,
            fars,
            ..
        } = self.spans;
        let reach = depth_reach(footprint, terms);
        let (first, last) = (footprint.depth - reach, footprint.depth + reach);
        if first >= fars[1] || last <= nears[0] {
            return Side::Hidden;
        }
        if first >= nears[1] && last <= middles[0] {
            return Side::Front;
        }
        if first >= middles[1] {
            if !self.is_partial {
                return Side::Hidden;
            }
            if last <= fars[0] {
                return Side::Behind;
            }
        }
        Side::Cut
    }

    /// Adds a footprint to the tile in front of the surface and to what lies behind; returns how
    /// many pixels evaluated it.
    pub(super) fn add(
        &mut self,
        raster: &TileRaster<'_>,
        front: &mut Tile,
        footprint: &Footprint,
        terms: Option<&ExactTerms>,
        near: &[NearTerms],
    ) -> u32 {
        let patch = raster.patch(footprint);
        let mode = raster.mode(footprint);
        let none = ExactTerms::default();
        let terms = terms.unwrap_or(&none);
        if let Some(near) = near_terms_of(footprint, near) {
            return self.add_near(raster, front, footprint, near, patch, mode);
        }
        let exact = (footprint.path == PATH_EXACT).then_some(terms);
        let level = raster.settings.level;
        match self.side(footprint, terms) {
            Side::Hidden => 0,
            Side::Front => splat(level, mode, front, footprint, exact, patch),
            Side::Behind => splat(level, mode, self.behind, footprint, exact, patch),
            Side::Cut => {
                let cut = Cut {
                    spans: self.spans,
                    behind: self.is_partial.then_some(&mut *self.behind),
                    front,
                    footprint,
                    terms,
                    patch,
                    mode,
                };
                run_at(level, cut)
            }
        }
    }

    /// Adds a kernel that crosses the plane of the eye, pixel by pixel.
    fn add_near(
        &mut self,
        raster: &TileRaster<'_>,
        front: &mut Tile,
        footprint: &Footprint,
        terms: &NearTerms,
        patch: Patch,
        mode: Mode,
    ) -> u32 {
        let depth = footprint.depth.max(0.0);
        let mut inside = 0;
        for y in patch.rows[0]..patch.rows[1] {
            for x in patch.columns[0]..patch.columns[1] {
                let i = y * TILE_SIZE + x;
                let pixel = Vec2::from(patch.first_px) + Vec2::new(x as f32, y as f32);
                let tau = near_depth(raster.view, footprint, terms, pixel);
                if !(tau > 0.0) {
                    continue;
                }
                inside += 1;
                let up_to = |at: f32| near_cut(raster, footprint, terms, pixel, at);
                let opacity = |tau: f32| {
                    if mode.linear {
                        tau.min(1.0)
                    } else {
                        -(-tau).exp_m1()
                    }
                };
                let colour = if mode.count {
                    [1.0; 3]
                } else {
                    footprint.colour
                };
                let ends = [&self.spans.near, &self.spans.middle, &self.spans.far].map(|s| s[i]);
                let [begin, middle, end] = ends.map(up_to);
                let in_front = opacity(tau * (middle - begin));
                let at = within(depth, [ends[0], ends[1]]);
                accumulate(front, i, in_front, colour, at, mode);
                if self.is_partial && !mode.count {
                    let rest = opacity(tau * (end - middle));
                    let at = within(depth, [ends[1], ends[2]]);
                    accumulate(self.behind, i, rest, colour, at, mode);
                }
            }
        }
        inside
    }

    /// Puts the surface, and what shows through it, behind what is in front.
    pub(super) fn compose(&self, raster: &TileRaster<'_>, front: &mut Tile) {
        let Some(surface) = self.surface else {
            return;
        };
        let is_count = raster.settings.count;
        for i in 0..TILE_PIXELS {
            let behind = &*self.behind;
            let covered = surface.alpha[i];
            let before = front.alpha[i];
            let through = 1.0 - before;
            let channels = [
                (&mut front.red, &surface.red, &behind.red),
                (&mut front.green, &surface.green, &behind.green),
                (&mut front.blue, &surface.blue, &behind.blue),
            ];
            for (channel, of_surface, of_behind) in channels {
                if is_count {
                    channel[i] += of_surface[i] + of_behind[i];
                } else {
                    channel[i] += through * (of_surface[i] + (1.0 - covered) * of_behind[i]);
                }
            }
            let at_surface = before + through * covered;
            let after = at_surface + through * (1.0 - covered) * behind.alpha[i];
            front.alpha[i] = after;
            if before < 0.5 && at_surface >= 0.5 {
                front.depth[i] = surface.depth[i];
            } else if at_surface < 0.5 && after >= 0.5 {
                front.depth[i] = behind.depth[i].min(f32::MAX);
            }
        }
    }
}

/// The terms of a footprint on the near or the half-line path.
pub(super) fn near_terms_of<'a>(
    footprint: &Footprint,
    near: &'a [NearTerms],
) -> Option<&'a NearTerms> {
    match footprint.path & 3 {
        PATH_NEAR | PATH_HALF_LINE => near.get((footprint.path >> 2) as usize),
        _ => None,
    }
}

/// How far a kernel reaches along z on either side of its centre: r sqrt(V_zz), V_zz the variance at
/// the centre of the footprint and what its slope adds.
pub(super) fn depth_reach(footprint: &Footprint, terms: &ExactTerms) -> f32 {
    let slope = if footprint.path == PATH_EXACT {
        // z* = z (1 + g . d / 2) / w.
        Vec2::from(terms.gradient) * (-0.5 * footprint.depth)
    } else {
        Vec2::from(terms.gradient)
    };
    // slopeᵀ S slope = |A⁻ᵀ slope|², A the rows p and r of the form.
    let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
    let determinant = px * ry - py * rx;
    let solved = Vec2::new(ry * slope.x - rx * slope.y, px * slope.y - py * slope.x) / determinant;
    let squared = solved.length_squared() + terms.depth_sigma * terms.depth_sigma;
    let reach = (footprint.cutoff_squared * squared).sqrt();
    // NaN reaches everywhere.
    if reach.is_finite() {
        reach
    } else {
        f32::INFINITY
    }
}

/// A depth held to the part of a ray that is drawn.
#[inline(always)]
pub(super) fn within(depth: f32, [from, to]: [f32; 2]) -> f32 {
    depth.min(to).max(from)
}

/// A footprint that is cut: each pixel has its own share in front.
struct Cut<'a> {
    spans: &'a Spans,
    /// Where it is seen through the surface.
    behind: Option<&'a mut Tile>,
    front: &'a mut Tile,
    footprint: &'a Footprint,
    terms: &'a ExactTerms,
    patch: Patch,
    mode: Mode,
}

impl Kernel for Cut<'_> {
    type Output = u32;

    #[inline(always)]
    fn run<const FMA: bool>(self) -> u32 {
        let Self {
            spans,
            mut behind,
            front,
            footprint,
            terms,
            patch,
            mode,
        } = self;
        // A splat that states its opacity is not divided: it lies where its centre does.
        let is_peak = footprint.path == PATH_PEAK;
        let depth = footprint.depth.max(0.0);
        let colour = if mode.count {
            [1.0; 3]
        } else {
            footprint.colour
        };
        let walk = RowWalk::new(footprint, terms, patch);
        let mut inside_count = 0;
        for y in patch.rows[0]..patch.rows[1] {
            let first = y * TILE_SIZE;
            let row = walk.row::<FMA>(y, &front.ray_length[first..]);
            inside_count += row.count;
            if row.count == 0 {
                continue;
            }
            let [near, middle, far] = [&spans.near, &spans.middle, &spans.far]
                .map(|plane| row.shares_up_to::<FMA>(&plane[first..], is_peak));
            let opacity = |tau: f32| {
                if mode.linear {
                    tau.min(1.0)
                } else {
                    opacity::<FMA>(tau)
                }
            };
            let in_front = row.between(&near, &middle);
            for (lane, tau) in in_front.into_iter().enumerate() {
                if mode.count && row.inside[lane] == 0 {
                    continue;
                }
                let (i, alpha) = (first + lane, opacity(tau));
                let at = within(depth, [spans.near[i], spans.middle[i]]);
                accumulate(front, i, alpha, colour, at, mode);
            }
            if let (Some(behind), false) = (&mut behind, mode.count) {
                for (lane, tau) in row.between(&middle, &far).into_iter().enumerate() {
                    let (i, alpha) = (first + lane, opacity(tau));
                    let at = within(depth, [spans.middle[i], spans.far[i]]);
                    accumulate(behind, i, alpha, colour, at, mode);
                }
            }
        }
        inside_count
    }
}

/// Of a kernel that crosses the camera plane: the share of what lies in front of the eye that lies
/// in front of a depth, too.
pub(super) fn near_cut(
    raster: &TileRaster<'_>,
    footprint: &Footprint,
    terms: &NearTerms,
    pixel: Vec2,
    at: f32,
) -> f32 {
    if at == f32::INFINITY {
        return 1.0;
    }
    if footprint.path & 3 == PATH_NEAR {
        return near_share(terms, ray(raster.view, pixel), at);
    }
    let d = pixel - Vec2::from(footprint.centre_px);
    let [gx, gy, z] = terms.half_line;
    let z = z + gx * d.x + gy * d.y;
    let sigma = terms.sigma.max(f32::MIN_POSITIVE);
    let behind_eye = normal_cdf(-z / sigma);
    let share = (normal_cdf((at - z) / sigma) - behind_eye) / (1.0 - behind_eye);
    if share.is_nan() {
        return 0.0;
    }
    share.clamp(0.0, 1.0)
}

/// Puts an opacity behind what a pixel has; counts it, where pixels count kernels.
#[inline(always)]
fn accumulate(
    tile: &mut Tile,
    i: usize,
    opacity: f32,
    [red, green, blue]: [f32; 3],
    depth: f32,
    mode: Mode,
) {
    let before = tile.alpha[i];
    let weight = opacity * (1.0 - before);
    let after = before + weight;
    tile.alpha[i] = after;
    let share = if mode.count { 1.0 } else { weight };
    tile.red[i] += share * red;
    tile.green[i] += share * green;
    tile.blue[i] += share * blue;
    if mode.depth && before < 0.5 && after >= 0.5 {
        tile.depth[i] = depth;
    }
}
